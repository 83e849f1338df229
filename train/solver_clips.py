"""Clips for the solver's training: generated motion on several bodies, markers and the truth of every joint.

A store is a folder of shards; shard `k` depends on the seed and `k` alone. Placement and spoiling are drawn while
training.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.files import replacing
from muybridge.geometry.body import BODY
from muybridge.geometry.landmarks import SURFACE
from muybridge.train.bodies import F32
from muybridge.train.marker_clouds import FPS, MarkerBodies
from muybridge.train.marker_rig import BODY_JOINTS, joints_of, rig_of
from muybridge.train.motions import MotionSampler

FRAMES = 128
MOTIONS_A_SHARD = 8
BODIES_A_MOTION = 4
# Share of the motions that wander between poses of the static sampler.
WANDER = 0.35


@dataclass(frozen=True)
class SolverClips:
    """Markers and joints.

    Attributes:
        points: (N, T, M, 3) metres, in the order of SURFACE; T frames at `FPS`.
        normals: (N, T, M, 3) out of the skin, -127..127.
        turns: (N, T, J, 3, 3) world from joint; places: (N, T, J, 3) metres, of BODY's joints.
    """

    points: F32
    normals: NDArray[np.int8]
    turns: F32
    places: F32


def make_solver_clips(out: pathlib.Path, shards: range, seed: int = 0) -> None:
    """Makes those of `shards` that are not in the folder `out` yet."""
    out.mkdir(parents=True, exist_ok=True)
    bodies = None
    for k in shards:
        path = out / f"{k:05}.npz"
        if path.exists():
            continue
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, 7, k]).generate_state(1)[0]))
        made = _shard(bodies)
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, points=made.points, normals=made.normals, turns=made.turns, places=made.places,
                     names=np.array(SURFACE.names), joints=np.array(BODY.joint_names))  # fmt: skip


def _shard(bodies: MarkerBodies) -> SolverClips:
    points, normals, turns, places = [], [], [], []
    for _ in range(MOTIONS_A_SHARD):
        if bodies.rng.random() < WANDER:
            rotvec, root = bodies.wander()
        else:
            base = bodies.model.skeleton(bodies.model.sample_phenotypes(1)[0])
            clip = MotionSampler(base, bodies.rng).sample(FRAMES / FPS, FPS)
            rotvec, root = clip.rotvec, clip.root
        rotvec, root = rotvec[:FRAMES], root[:FRAMES]
        for phenotype in bodies.model.sample_phenotypes(BODIES_A_MOTION):
            body = bodies.skeleton(phenotype)
            at, out = bodies.markers(body, rotvec, root)
            turned, placed = joints_of(rig_of(body.bones, body.rest), body, rotvec, root)
            points.append(at.astype(np.float32))
            normals.append(np.rint(out * 127).astype(np.int8))
            turns.append(turned[:, BODY_JOINTS].astype(np.float32))
            places.append(placed[:, BODY_JOINTS].astype(np.float32))
    return SolverClips(np.stack(points), np.stack(normals), np.stack(turns), np.stack(places))


def load_solver_clips(folder: pathlib.Path, shards: range) -> SolverClips:
    """All clips of those of `shards` that are in `folder`; none is an empty array."""
    size, joints = len(SURFACE), len(BODY.joint_names)
    points, normals = [np.zeros((0, FRAMES, size, 3), np.float32)], [np.zeros((0, FRAMES, size, 3), np.int8)]
    turns, places = [np.zeros((0, FRAMES, joints, 3, 3), np.float32)], [np.zeros((0, FRAMES, joints, 3), np.float32)]
    for path in sorted(folder.glob("*.npz")):
        if path.stem.isdecimal() and int(path.stem) in shards:
            with np.load(path) as shard:
                if tuple(shard["names"].tolist()) == SURFACE.names:
                    points.append(shard["points"])
                    normals.append(shard["normals"])
                    turns.append(shard["turns"])
                    places.append(shard["places"])
    return SolverClips(np.concatenate(points), np.concatenate(normals), np.concatenate(turns), np.concatenate(places))
