"""Accuracy of the marker solver: markers on synthetic bodies that follow a recorded motion, with faults.

Usage: python -m scripts.benchmarks.markers.solver [--motion FILE.bvh] [--bodies 3] [--every 4] [--frames 400]

The truth are anny's joints under CMU's trial 01_01 (never used for training or tuning), on newly drawn bodies; with
`--placed 1` the markers' placement varies as between examiners. Every take is calibrated from its own corrupted
markers. Errors are means over all 21 joints and frames: of positions, of rotations relative to the parent, and of
rotations in the world.

frame-wise, generic body: the mean body, scaled to the markers, on each frame independently. frame-wise, least squares:
the calibrated body on each frame independently (T. W. Lu, J. J. O'Connor, "Bone position estimation from skin marker
co-ordinates using global optimisation with joint constraints", Journal of Biomechanics 32, 1999). frame-wise, robust:
the same with Student's t. joint centres, then body: `muybridge solve --method landmarks`, whose joints are partly
defined differently (spine, collar bones, neck). whole take: `muybridge solve --no-correct`; whole take and network:
`muybridge solve`.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from muybridge.geometry.fitting.body_fit import fit_body
from muybridge.geometry.fitting.marker_fit import fit_markers
from muybridge.geometry.fitting.subject import (
    MarkerFitOptions,
    calibrate_person,
    follow_take,
    scaled_person,
    settle_frames,
)
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.joint_regressions import landmarks_from_markers
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.statistical_body import without_rolls
from muybridge.infer.networks.correction import SolverNetwork, correct_joints
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.skeletal.bvh import read_bvh
from muybridge.train.correction.takes import MarkerFaults, SolverTake, add_faults, marker_columns, recorded_take
from muybridge.train.synthesis.markers.trajectories import MarkerBodies
from scripts.benchmarks.common import CMU_METRES_PER_UNIT, DATA

RECORDING = DATA / "motion" / "01_01.bvh"
CASES = {
    "10 % hidden, 10 % shifted": MarkerFaults(),
    "20 % hidden, 10 % shifted": MarkerFaults(hidden=0.2),
    "20 % hidden": MarkerFaults(hidden=0.2, shifted=0.0),
    "10 + 10 %, in runs of 0.25 s": MarkerFaults(run_s=0.25),
    "20 + 10 %, in runs of 0.25 s": MarkerFaults(hidden=0.2, run_s=0.25),
}


def read_motion(path: Path, every: int, frames: int) -> Motion:
    """CMU's motion without its first frame, a T-pose; at most `frames` of it."""
    motion = read_bvh(path, metres_per_unit=CMU_METRES_PER_UNIT)
    chosen = np.arange(1, len(motion), every)[:frames]
    return Motion(motion.skeleton, motion.fps / every, motion.root_positions_world[chosen], motion.quat_wxyz[chosen])


def errors(turns: np.ndarray, places: np.ndarray, take: SolverTake) -> np.ndarray:
    """Position error in mm; rotation error relative to the parent and in the world, in degrees."""
    from muybridge.geometry.skeleton.body import BODY

    position = 1e3 * np.linalg.norm(places - take.places, axis=-1).mean()
    parents = np.array(BODY.parents[1:])

    def angle(a: np.ndarray, b: np.ndarray) -> float:
        trace = np.einsum("tjik,tjik->tj", a, b)
        return float(np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))).mean())

    def local(world: np.ndarray) -> np.ndarray:
        return np.concatenate([world[:, :1], np.swapaxes(world[:, parents], -1, -2) @ world[:, 1:]], 1)

    return np.array([position, angle(local(turns), local(take.turns)), angle(turns, take.turns)])


def by_joint(turns: np.ndarray, places: np.ndarray, take: SolverTake) -> None:
    """Print each joint's errors."""
    from muybridge.geometry.skeleton.body import BODY

    for j, name in enumerate(BODY.joint_names):
        off = (places[:, j] - take.places[:, j]) * 1e3
        trace = np.einsum("tik,tik->t", turns[:, j], take.turns[:, j])
        angle = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))).mean()
        print(f"    {name:16s} {np.linalg.norm(off, axis=-1).mean():5.1f} mm {angle:5.1f} deg")


def solve_all(
    points: np.ndarray, columns: np.ndarray, fps: float, network: Path
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """World rotations and positions from every method."""
    options = MarkerFitOptions()
    person = calibrate_person(points, columns, fps, options)
    start = follow_take(person, points, fps, options)
    out = {}
    generic = scaled_person(points, columns, options)
    for name, who, robust in (("frame-wise, generic body", generic, False),
                              ("frame-wise, least squares", person, False),
                              ("frame-wise, robust", person, True)):  # fmt: skip
        pose = settle_frames(who, points, start, options, robust)
        rotations = who.skeleton.rotations_from_angles(pose.angles)
        rotations[:, 0] = pose.turn
        skeleton, rotations = without_rolls(who.skeleton, rotations)
        out[name] = skeleton.forward(pose.root, rotations)
    names = [SURFACE.names[k] for k in columns]
    unknown, none = np.full((*points.shape, 3), np.nan), np.empty((0, *points.shape[:2]))
    cloud = Points3D(LandmarkSet("skin", tuple(names), ()), points, unknown, none, none.astype(bool), fps)
    centres = landmarks_from_markers(cloud, {n: k for k, n in enumerate(names)})
    out["joint centres, then body"] = _world(fit_body(centres).motion)
    fit = fit_markers(points, columns, fps, options, person=person)
    out["whole take"] = _world(fit.motion)
    out["whole take and network"] = _world(correct_joints(fit, points, SolverNetwork(network)).motion)
    return out


def _world(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    return motion.skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--motion", type=Path, default=RECORDING)
    parser.add_argument("--bodies", type=int, default=3)
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--placed", type=float, default=0.0, help="markers' places, in spreads of examiners")
    parser.add_argument("--cases", type=int, default=len(CASES))
    parser.add_argument(
        "--network", type=Path, default=None, help="solver.onnx of `muybridge train solver`; the shipped"
    )
    parser.add_argument("--seed", type=int, default=1001, help="of the bodies")
    parser.add_argument("--joints", action="store_true", help="errors of every joint of the last take")
    options = parser.parse_args()
    motion = read_motion(options.motion, options.every, options.frames)
    bodies = MarkerBodies(options.seed)
    takes = [recorded_take(bodies, p, motion, options.placed) for p in bodies.model.sample_phenotypes(options.bodies)]
    for case, how in list(CASES.items())[: options.cases]:
        found: dict[str, list[np.ndarray]] = {}
        rng = np.random.default_rng(77)
        begun = time.process_time()
        for k, take in enumerate(takes):
            columns = marker_columns((PLUG_IN_GAIT, CMU)[k % 2])
            points, _ = add_faults(take.points[:, columns], take.fps, how, rng)
            solved = solve_all(points, columns, take.fps, options.network or shipped_model("solver"))
            for name, (turns, places) in solved.items():
                found.setdefault(name, []).append(errors(turns, places, take))
        print(f"{case}  ({time.process_time() - begun:.0f} s)")
        for name, rows in found.items():
            mm, local, world = np.mean(rows, 0)
            print(f"  {name:28s} {mm:6.1f} mm {local:6.2f} deg {world:6.2f} deg")
        if options.joints:
            by_joint(*solved["whole take"], takes[-1])


if __name__ == "__main__":
    main()
