"""Clips for the solver's training: generated motion on several bodies, markers and the truth of every joint.

A store is a folder of shards; shard `k` depends on the seed and `k` alone. In its folder `followed` are the same
motions, followed by other people as a recorded skeleton is, whose collar bones and toes do not move. Placement and
spoiling are drawn when fits are made.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.numerics.rotations import quat_from_matrix
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.rigid_bones import body_through
from muybridge.geometry.skeleton.statistical_body import marker_body, without_rolls
from muybridge.train.synthesis.markers.rig import BODY_JOINTS, follow, joints_of, rig_of
from muybridge.train.synthesis.markers.trajectories import FPS, MarkerBodies
from muybridge.train.synthesis.motions.rig import SkinnedBody
from muybridge.train.synthesis.motions.sampler import MotionSampler

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

    points: Float32Array
    normals: NDArray[np.int8]
    turns: Float32Array
    places: Float32Array


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
        _save(path, _shard(bodies))


def _save(path: pathlib.Path, made: SolverClips) -> None:
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, points=made.points, normals=made.normals, turns=made.turns, places=made.places,
                 names=np.array(SURFACE.names), joints=np.array(BODY.joint_names))  # fmt: skip


def _shard(bodies: MarkerBodies) -> SolverClips:
    made = []
    for _ in range(MOTIONS_A_SHARD):
        if bodies.rng.random() < WANDER:
            rotvec, root = bodies.wander()
        else:
            base = bodies.model.skeleton(bodies.model.sample_phenotypes(1)[0])
            clip = MotionSampler(base, bodies.rng).sample(FRAMES / FPS, FPS)
            rotvec, root = clip.rotvec, clip.root
        rotvec, root = rotvec[:FRAMES], root[:FRAMES]
        for phenotype in bodies.model.sample_phenotypes(BODIES_A_MOTION):
            made.append(_clip(bodies, bodies.skeleton(phenotype), rotvec, root))
    return _together(made)


def _clip(
    bodies: MarkerBodies, body: SkinnedBody, rotvec: FloatArray, root: FloatArray
) -> tuple[NDArray[np.generic], ...]:
    points, normals = bodies.markers(body, rotvec, root)
    turns, places = joints_of(rig_of(body.bones, body.rest), body, rotvec, root)
    return (points.astype(np.float32), np.rint(normals * 127).astype(np.int8),
            turns[:, BODY_JOINTS].astype(np.float32), places[:, BODY_JOINTS].astype(np.float32))  # fmt: skip


def _together(made: list[tuple[NDArray[np.generic], ...]]) -> SolverClips:
    return SolverClips(*(np.stack(parts) for parts in zip(*made, strict=True)))


def make_followed(clips: pathlib.Path, shards: range, seed: int = 0) -> None:
    """Those of `shards` that `clips/followed` does not have yet: further people who follow their motions."""
    out = clips / "followed"
    out.mkdir(parents=True, exist_ok=True)
    bodies = None
    for k in shards:
        path = out / f"{k:05}.npz"
        if path.exists():
            continue
        make_solver_clips(clips, range(k, k + 1), seed)
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, 8, k]).generate_state(1)[0]))
        _save(path, _follow_all(bodies, load_solver_clips(clips, range(k, k + 1))))


def _follow_all(bodies: MarkerBodies, led: SolverClips) -> SolverClips:
    """As many people again, who follow the first body of each motion."""
    table = marker_body()
    skeleton, _ = without_rolls(table.skeleton(table.parts(table.mean)[0]), np.zeros((1, len(table.names), 3, 3)))
    made = []
    for k in range(0, len(led.points), BODIES_A_MOTION):
        bones, root, local = body_through(skeleton, led.turns[k].astype(float), led.places[k].astype(float))
        motion = Motion(bones, FPS, root, quat_from_matrix(local))
        for phenotype in bodies.model.sample_phenotypes(BODIES_A_MOTION):
            body = bodies.skeleton(phenotype)
            made.append(_clip(bodies, body, *follow(body, motion)))
    return _together(made)


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
