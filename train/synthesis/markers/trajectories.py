"""Synthetic marker trajectories: all surface landmarks on bodies of all shapes under generated motion.

A store is a folder of shards; shard `k` depends on the seed and `k` alone. What happens to markers in a laboratory
(jitter, gaps, ghosts, exchanges) is added while training (`train.marker_augment`).
"""

import pathlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.bodies.surface_markers import marker_table
from muybridge.train.synthesis.motions.rig import SkinnedBody, forward, skin, turn
from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionSampler

FPS = 30.0
FRAMES = 192
CLIPS = 32
# Share of the clips that wander between poses of the static sampler, whose poses are wider than generated motion.
WANDER = 0.25
# A marker's centre over the skin, metres: its radius and base.
STANDOFF = (0.006, 0.018)


@dataclass(frozen=True)
class MarkerClips:
    """Marker trajectories.

    Attributes:
        points: (N, T, M, 3) metres, z up, in the order of `SURFACE`; T frames at `FPS`.
        normals: (N, T, M, 3) unit, out of the skin.
        kinds: (N,) index into `MOTIONS`, or its length for wandering between poses.
    """

    points: Float32Array
    normals: NDArray[np.int8]
    kinds: IndexArray


class MarkerBodies:
    """Bodies that carry markers: skin under the landmarks alone, which is fast."""

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
        """Everything drawn from now on depends on `seed` alone."""
        self.rng = self.model.rng = self.model.poses.rng = np.random.default_rng(seed)

    def _outward(self) -> FloatArray:
        """(M,) +1 where the landmark's triangle runs anticlockwise seen from outside, else -1."""
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
        """The skeleton with the landmarks' vertices as its skin."""
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
        """Markers (T, M, 3) with their stand-off, and unit normals (T, M, 3), of a motion of `skeleton`."""
        rotations, origins = forward(skeleton, turn(rotvec), root)
        corners = skin(skeleton, rotations, origins)[:, self.place]
        points = np.einsum("tmkc,mk->tmc", corners, marker_table().weights.astype(np.float64))
        a, b, c = np.moveaxis(corners, 2, 0)
        normals = np.cross(b - a, c - a) * self.outward[:, None]
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
        return points + normals * self.rng.uniform(*STANDOFF), normals

    def wander(self) -> tuple[FloatArray, FloatArray]:
        """Rotation vectors (T, bones, 3) and roots (T, 3) of a walk from pose to pose of the static sampler."""
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
        """`count` clips, two bodies a motion."""
        points: list[FloatArray] = []
        normals, kinds = [], []
        while len(points) < count:
            bodies = [self.skeleton(p) for p in self.model.sample_phenotypes(2)]
            if self.rng.random() < WANDER:
                rotvec, root = self.wander()
                kind = len(MOTIONS)
            else:
                # The first body's motion; on the second the feet may slide, which labelling does not mind.
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
    """Makes those of `shards` that are not in the folder `out` yet."""
    out.mkdir(parents=True, exist_ok=True)
    bodies = None
    for k in shards:
        path = out / f"{k:05}.npz"
        if path.exists():
            continue
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, k]).generate_state(1)[0]))
        made = bodies.clips(CLIPS)
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, points=made.points, normals=made.normals, kinds=made.kinds, names=np.array(SURFACE.names))


def load_marker_clips(folder: pathlib.Path, shards: range) -> MarkerClips:
    """All clips of those of `shards` that are in `folder`; none is an empty array."""
    empty = np.zeros((0, FRAMES, len(SURFACE), 3))
    points, normals, kinds = [empty.astype(np.float32)], [empty.astype(np.int8)], [np.zeros(0, np.intp)]
    for path in sorted(folder.glob("*.npz")):
        if path.stem.isdecimal() and int(path.stem) in shards:
            with np.load(path) as shard:
                if tuple(shard["names"].tolist()) == SURFACE.names:
                    points.append(shard["points"])
                    normals.append(shard["normals"])
                    kinds.append(shard["kinds"])
    return MarkerClips(np.concatenate(points), np.concatenate(normals), np.concatenate(kinds))
