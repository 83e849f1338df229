"""Speed and accuracy of the body fit on one core, against the noise that goes in.

Usage: python -m scripts.benchmarks.geometry.body_fit [--bvh FILE --metres-per-unit 0.0564] [--seeds 2]

The truth is a BVH file's own joints (one point for joints at the same place), spoiled with noise of 10 mm per axis,
5 % missing. `online` sees a frame and those before it, `take` all frames; both know the file's skeleton, with the
ranges of motion of `skeleton_profiles`. `take, bones calibrated` starts from a skeleton with every bone wrong by up
to 15 % and finds the lengths from the same noisy points. `fit_body` is the whole road from points to the project's
own body: sides, outliers, lengths, pose; its points are 23 landmarks on the same skeleton. Frames per second are of
processor time of the one thread that computes, the best of three, so that other programs on the machine count little.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.geometry.fitting.body_fit import fit_body, landmarks_from_motion
from muybridge.geometry.fitting.scaling import calibrate_skeleton
from muybridge.geometry.fitting.skeleton_fit import SkeletonFit, fit_online, fit_take, joint_rigging, solvable
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.bvh import read_bvh
from scripts.benchmarks.geometry.skeleton import as_points, cmu_truth

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data"
SIGMA, MISSING = 0.010, 0.05


def distinct_joints(motion: Motion) -> tuple[str, ...]:
    """Joints that are not at the place of their parent."""
    lengths = motion.skeleton.bone_lengths
    return tuple(n for j, n in enumerate(motion.skeleton.names) if j == 0 or lengths[j] > 1e-6)


def spoiled(truth: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = truth + rng.normal(0, SIGMA, truth.shape)
    out[rng.random(out.shape[:2]) < MISSING] = np.nan
    return out


def rmse(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.sum((found - truth) ** 2, axis=-1))))


def timed(function: Callable[[], object], repeats: int = 3) -> float:
    """Least processor time of this thread, seconds; the first run compiles and is not counted."""
    function()
    times = []
    for _ in range(repeats):
        begun = time.thread_time()
        function()
        times.append(time.thread_time() - begun)
    return min(times)


def bone_spread(motion: Motion) -> float:
    """Largest relative change of any bone's length over the take."""
    at, skeleton = motion.joint_positions_world(), motion.skeleton
    out = 0.0
    for j, parent in enumerate(skeleton.parents[1:], start=1):
        length = np.linalg.norm(at[:, j] - at[:, parent], axis=1)
        if skeleton.bone_lengths[j] > 1e-6:
            out = max(out, float(np.ptp(length) / length.mean()))
    return out


def violations(fit: SkeletonFit, names: tuple[str, ...]) -> int:
    """Angles outside the limits, read back from the rotations that come out, beyond rounding."""
    skeleton = solvable(fit.motion.skeleton, joint_rigging(fit.motion.skeleton, names))
    outside = (fit.angles < skeleton.lower - 1e-9) | (fit.angles > skeleton.upper + 1e-9)
    return int(outside[:, 1:].sum())


def report(what: str, ratio: float, per_second: float, bones: float, outside: int | str) -> None:
    print(f"{what:24s}{ratio:10.3f}{per_second:12,.0f}{bones:14.1e}{outside!s:>12}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bvh", type=Path, default=DATA / "motion" / "01_01.bvh")
    parser.add_argument("--metres-per-unit", type=float, default=0.0254 / 0.45)
    parser.add_argument("--seeds", type=int, default=1)
    arguments = parser.parse_args()
    motion = read_bvh(arguments.bvh, metres_per_unit=arguments.metres_per_unit)
    skeleton, names = motion.skeleton, distinct_joints(motion)
    truth = motion.joint_positions_world()[:, [skeleton.index(n) for n in names]]
    rigging = joint_rigging(skeleton, names)
    print(f"{arguments.bvh.name}: {len(truth)} frames at {motion.fps:g}/s, {len(names)} joints")
    print(f"{'':24s}{'RMSE ratio':>10}{'frames/s':>12}{'bone change':>14}{'violations':>12}")
    for seed in range(arguments.seeds):
        points = spoiled(truth, seed)
        before = rmse(points, truth)
        for what, fit in (("online", fit_online), ("take", fit_take)):
            seconds = timed(lambda fit=fit, points=points: fit(skeleton, points, motion.fps, rigging))
            found = fit(skeleton, points, motion.fps, rigging)
            ratio = rmse(found.landmarks_world, truth) / before
            report(what, ratio, len(truth) / seconds, bone_spread(found.motion), violations(found, names))
        wrong = replace(skeleton, offsets=skeleton.offsets * wrong_lengths(skeleton.names, seed)[:, None])
        begun = time.thread_time()
        calibrated, rigged = calibrate_skeleton(wrong, points, motion.fps, rigging)
        found = fit_take(calibrated, points, motion.fps, rigged)
        seconds = time.thread_time() - begun
        ratio = rmse(found.landmarks_world, truth) / before
        report(
            "take, bones calibrated", ratio, len(truth) / seconds, bone_spread(found.motion), violations(found, names)
        )
    if arguments.bvh.name == "01_01.bvh":
        truth, fps = cmu_truth()
        points = as_points(spoiled(truth, 0), fps, SIGMA)
        seconds = timed(lambda: fit_body(points))
        body = fit_body(points)
        at = landmarks_from_motion(body.motion, body.body, BODY23)
        ratio = rmse(at, truth) / rmse(points.points_world, truth)
        report("fit_body (60 Hz)", ratio, len(truth) / seconds, bone_spread(body.motion), "see tests")


def wrong_lengths(names: tuple[str, ...], seed: int) -> np.ndarray:
    """(J,) factors of up to 15 %, the same left and right."""
    rng = np.random.default_rng(seed + 100)
    factors: dict[str, float] = {}
    for name in names:
        factors.setdefault(name.replace("Right", "Left"), float(rng.uniform(0.85, 1.15)))
    return np.array([factors[n.replace("Right", "Left")] for n in names])


if __name__ == "__main__":
    main()
