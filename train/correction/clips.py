"""Clips for the training of the correction network: generated motion on several bodies, with markers and true joints.

A store is a folder of shards; shard `k` depends only on the seed and `k`. Its subfolder `followed` has the same motions
retargeted to other people like recorded skeletons, whose collar bones and toes do not move. Marker placement and faults
are drawn when fits are made.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.numerics.rotations import quat_from_matrix
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.rigid_bones import body_through
from muybridge.geometry.skeleton.statistical_body import marker_body, without_rolls
from muybridge.train.engine.shards import Arrays, concatenate, missing_shards, read_shards, save_shard
from muybridge.train.synthesis.markers.rig import BODY_JOINTS, follow, joints_of, rig_of
from muybridge.train.synthesis.markers.trajectories import FPS, MarkerBodies
from muybridge.train.synthesis.motions.rig import SkinnedBody
from muybridge.train.synthesis.motions.sampler import MotionSampler

FRAMES = 128
MOTIONS_A_SHARD = 8
BODIES_A_MOTION = 4
# Share of motions that move between poses of the static sampler.
WANDER = 0.35


@dataclass(frozen=True)
class SolverClips:
    """Markers and joints.

    Attributes:
        points: (N, T, M, 3) metres, in the order of SURFACE; T frames at `FPS`.
        normals: (N, T, M, 3) out of the skin, of length 127.
        turns: (N, T, J, 3, 3) world_from_joint rotations of BODY's joints.
        places: (N, T, J, 3) their positions, metres.
    """

    points: Float32Array
    normals: NDArray[np.int8]
    turns: Float32Array
    places: Float32Array


def make_solver_clips(out: pathlib.Path, shards: range, seed: int = 0) -> None:
    """Generate those of `shards` that are not in the folder `out` yet."""
    bodies = None
    for number in missing_shards(out, shards):
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, 7, number]).generate_state(1)[0]))
        _save(out, number, _make_clips(bodies))


def _save(folder: pathlib.Path, number: int, clips: SolverClips) -> None:
    names = {"names": np.array(SURFACE.names), "joints": np.array(BODY.joint_names)}
    save_shard(folder, number, vars(clips) | names)


def _make_clips(bodies: MarkerBodies) -> SolverClips:
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
    return _stack(made)


def _clip(
    bodies: MarkerBodies, body: SkinnedBody, rotvec: FloatArray, root: FloatArray
) -> tuple[NDArray[np.generic], ...]:
    points, normals = bodies.markers(body, rotvec, root)
    turns, places = joints_of(rig_of(body.bones, body.rest), body, rotvec, root)
    return (points.astype(np.float32), np.rint(normals * 127).astype(np.int8),
            turns[:, BODY_JOINTS].astype(np.float32), places[:, BODY_JOINTS].astype(np.float32))  # fmt: skip


def _stack(made: list[tuple[NDArray[np.generic], ...]]) -> SolverClips:
    return SolverClips(*(np.stack(parts) for parts in zip(*made, strict=True)))


def make_followed(clips: pathlib.Path, shards: range, seed: int = 0) -> None:
    """Generate those of `shards` that `clips/followed` does not have yet: other people who follow their motions."""
    out, bodies = clips / "followed", None
    for number in missing_shards(out, shards):
        make_solver_clips(clips, range(number, number + 1), seed)
        bodies = bodies or MarkerBodies(seed)
        bodies.reseed(int(np.random.SeedSequence([seed, 8, number]).generate_state(1)[0]))
        _save(out, number, _follow_all(bodies, load_solver_clips(clips, range(number, number + 1))))


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
    return _stack(made)


def load_solver_clips(folder: pathlib.Path, shards: range) -> SolverClips:
    """All clips of those of `shards` that are in `folder`; arrays are empty if there are none."""
    size, joints = len(SURFACE), len(BODY.joint_names)
    empty: Arrays = {
        "points": np.zeros((0, FRAMES, size, 3), np.float32), "normals": np.zeros((0, FRAMES, size, 3), np.int8),
        "turns": np.zeros((0, FRAMES, joints, 3, 3), np.float32),
        "places": np.zeros((0, FRAMES, joints, 3), np.float32),
    }  # fmt: skip
    return SolverClips(**concatenate(read_shards(folder, shards, empty, SURFACE.names), empty))
