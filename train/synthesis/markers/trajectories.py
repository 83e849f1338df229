"""Synthetic marker trajectories: all surface landmarks on bodies of all shapes under generated motion.

A store is a folder of shards; shard `k` depends only on the seed and `k`. The faults of marker recordings (jitter,
gaps, ghosts, swaps) are added during training (`augment`).
"""

import pathlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.engine.shards import Arrays, concatenate, missing_shards, read_shards, save_shard
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.bodies.surface_markers import marker_table
from muybridge.train.synthesis.motions.rig import SkinnedBody, forward, skin, turn
from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionSampler

FPS = 30.0
FRAMES = 192
CLIPS = 32
# Share of clips that move between poses of the static sampler, whose range is wider than that of generated motion.
WANDER = 0.25
# Range of the distance of a marker's centre from the skin, metres: its radius and base.
STANDOFF = (0.006, 0.018)


@dataclass(frozen=True)
class MarkerClips:
    """Marker trajectories.

    Attributes:
        points: (N, T, M, 3) metres, z up, in the order of `SURFACE`; T frames at `FPS`.
        normals: (N, T, M, 3) out of the skin, of length 127.
        kinds: (N,) index into `MOTIONS`, or its length for transitions between static poses.
    """

    points: Float32Array
    normals: NDArray[np.int8]
    kinds: IndexArray


class MarkerBodies:
    """Bodies with markers; only the skin under the landmarks is posed, which is fast."""

    def __init__(self, seed: int) -> None:
        self.model = BodyModel(seed)
        self.reseed(seed)
        table = marker_table()
        self.vertices, self.place = np.unique(table.vertices, return_inverse=True)
        self.place = self.place.reshape(table.vertices.shape)
        net = self.model.model
        weights = net.vertex_bone_weights.numpy()[self.vertices].astype(np.float64)
        bones = net.vertex_bone_indices.numpy()[self.vertices]
        order = np.argsort(-weights, 1)[:, :4]
        self.weights = np.take_along_axis(weights, order, 1)
        self.weights /= self.weights.sum(1, keepdims=True)
        self.bones = np.take_along_axis(bones, order, 1)
        self.outward = self._outward()

    def reseed(self, seed: int) -> None:
        """Make everything drawn from now on depend only on `seed`."""
        self.rng = self.model.rng = self.model.poses.rng = np.random.default_rng(seed)

    def _outward(self) -> FloatArray:
        """(M,) +1 where the landmark's triangle is counter-clockwise seen from outside, else -1."""
        rest = self.model.rest.astype(np.float64)
        faces = self.model.parts[0]
        faces = faces[(faces < BODY_VERTICES).all(1)]
        each = np.cross(rest[faces[:, 1]] - rest[faces[:, 0]], rest[faces[:, 2]] - rest[faces[:, 0]])
        normals = np.zeros_like(rest)
        for k in range(3):
            np.add.at(normals, faces[:, k], each)
        a, b, c = np.moveaxis(rest[marker_table().vertices], 1, 0)
        mean = normals[marker_table().vertices].sum(1)
        return np.where((np.cross(b - a, c - a) * mean).sum(-1) >= 0, 1.0, -1.0)

    def skeleton(self, phenotypes: Float32Array) -> SkinnedBody:
        """The skeleton of a body, with the landmarks' vertices as its skin."""
        import torch

        base = self.model.skeleton(phenotypes)
        rest = np.tile(np.eye(4, dtype=np.float32), (1, len(self.model.bones), 1, 1))
        with torch.inference_mode():
            shape = torch.from_numpy(phenotypes[None])
            out = self.model.model(pose_parameters=torch.from_numpy(rest), phenotype_kwargs=shape)
        joint = out["bone_poses"][0, 0, :3, 3].numpy().astype(np.float64)
        surface = out["vertices"][0].numpy().astype(np.float64)[self.vertices]
        surface += base.rest[0] - joint
        return replace(base, surface=surface, skin=self.bones, weights=self.weights)

    def markers(self, skeleton: SkinnedBody, rotvec: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Markers (T, M, 3) including their stand-off, and unit normals (T, M, 3), for a motion of `skeleton`."""
        rotations, origins = forward(skeleton, turn(rotvec), root)
        corners = skin(skeleton, rotations, origins)[:, self.place]
        points = np.einsum("tmkc,mk->tmc", corners, marker_table().weights.astype(np.float64))
        a, b, c = np.moveaxis(corners, 2, 0)
        normals = np.cross(b - a, c - a) * self.outward[:, None]
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
        return points + normals * self.rng.uniform(*STANDOFF), normals

    def wander(self) -> tuple[FloatArray, FloatArray]:
        """Rotation vectors (T, bones, 3) and root positions (T, 3) of transitions between poses of the static
        sampler."""
        rng, count = self.rng, 7
        poses = self.model.poses.sample(count).rotvec
        at = np.linspace(0, count - 1, FRAMES) + 0.25 * np.sin(np.linspace(0, 2 * np.pi * count, FRAMES))
        first = np.clip(at.astype(int), 0, count - 2)
        share = np.clip(at - first, 0, 1)
        share = share * share * (3 - 2 * share)
        start = Rotation.from_rotvec(poses[first].reshape(-1, 3))
        step = (start.inv() * Rotation.from_rotvec(poses[first + 1].reshape(-1, 3))).as_rotvec()
        step = step.reshape(FRAMES, -1, 3) * share[:, None, None]
        rotvec = (start * Rotation.from_rotvec(step.reshape(-1, 3))).as_rotvec().reshape(step.shape)
        places = np.cumsum(rng.normal(0, 0.2, (count, 3)), 0) * [1, 1, 0.3] + [0, 0, 0.95]
        root = places[first] * (1 - share[:, None]) + places[first + 1] * share[:, None]
        return rotvec, root

    def clips(self, count: int) -> MarkerClips:
        """`count` clips, two bodies per motion."""
        points: list[FloatArray] = []
        normals, kinds = [], []
        while len(points) < count:
            bodies = [self.skeleton(p) for p in self.model.sample_phenotypes(2)]
            if self.rng.random() < WANDER:
                rotvec, root = self.wander()
                kind = len(MOTIONS)
            else:
                # Motion generated on one body; the feet of another one may slide, which does not matter for labelling.
                clip = MotionSampler(self.model.skeleton(self.model.sample_phenotypes(1)[0]), self.rng).sample(
                    FRAMES / FPS, FPS
                )
                rotvec, root, kind = clip.rotvec, clip.root, list(MOTIONS).index(clip.kind)
            for body in bodies:
                at, out = self.markers(body, rotvec, root)
                points.append(at.astype(np.float32))
                normals.append(np.rint(out * 127).astype(np.int8))
                kinds.append(kind)
        return MarkerClips(np.stack(points[:count]), np.stack(normals[:count]), np.array(kinds[:count]))


def make_marker_clips(out: pathlib.Path, shards: range, seed: int = 0) -> None:
    """Generate those of `shards` that are not in the folder `out` yet."""
    bodies = None
    for number in missing_shards(out, shards):
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, number]).generate_state(1)[0]))
        save_shard(out, number, vars(bodies.clips(CLIPS)) | {"names": np.array(SURFACE.names)})


def load_marker_clips(folder: pathlib.Path, shards: range) -> MarkerClips:
    """All clips of those of `shards` that are in `folder`; arrays are empty if there are none."""
    points = np.zeros((0, FRAMES, len(SURFACE), 3), np.float32)
    empty: Arrays = {"points": points, "normals": points.astype(np.int8), "kinds": np.zeros(0, np.intp)}
    return MarkerClips(**concatenate(read_shards(folder, shards, empty, SURFACE.names), empty))
