"""Accuracy and speed of the body fit.

Usage: python -m scripts.benchmarks.geometry.body_fit joints [--bvh FILE --metres-per-unit 0.0564] [--seeds 2]
       python -m scripts.benchmarks.geometry.body_fit landmarks [--seeds 3]

joints: the truth are a BVH file's own joints (one point for joints at the same place), with noise of 10 mm per axis and
5 % missing. `online` uses a frame and earlier ones, `take` all frames; both know the file's skeleton, with the joint
limits of `skeleton.profiles`. `take, bones calibrated` starts from a skeleton with errors of up to 15 % in every bone
and estimates the lengths from the same noisy points. `fit_body` is the complete path from points to the project's own
body: left-right correction, outliers, lengths, pose; its points are 23 landmarks on the same skeleton. Frames per
second are of processor time of all threads, the best of three: other load matters little, and threads that spin count.

landmarks: the distance of smoothed points and of the fitted body from the truth under the errors of a weak network.
There are two truths: the smoothed reference of the balancing take (a slow man, whose points are not rigid), and CMU
trial 01_01 (climbing and jumping; exactly rigid). Errors are noise of 60 mm, outliers, left-right flips of a limb for
up to a fifth of a second and missing points; the noise is white, then correlated between frames like a network's.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.geometry.fitting.body_fit import FitOptions, fit_body, landmarks_from_motion
from muybridge.geometry.fitting.scaling import calibrate_skeleton
from muybridge.geometry.fitting.skeleton_fit import SkeletonFit, fit_online, fit_take, joint_rigging, solvable
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.motion.formats.skeletal.bvh import read_bvh
from scripts.benchmarks.common import CMU_METRES_PER_UNIT, DATA, as_points, cmu_landmarks, correlated_noise

SIGMA, MISSING = 0.010, 0.05


def distinct_joints(motion: Motion) -> tuple[str, ...]:
    """Joints whose position differs from their parent's."""
    lengths = motion.skeleton.bone_lengths
    return tuple(n for j, n in enumerate(motion.skeleton.names) if j == 0 or lengths[j] > 1e-6)


def add_joint_noise(truth: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = truth + rng.normal(0, SIGMA, truth.shape)
    out[rng.random(out.shape[:2]) < MISSING] = np.nan
    return out


def rmse(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.sum((found - truth) ** 2, axis=-1))))


def timed(function: Callable[[], object], repeats: int = 3) -> float:
    """Least processor time of all threads, seconds; the first run compiles and is not counted."""
    function()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
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
    """Number of angles outside the limits, read back from the resulting rotations, beyond rounding."""
    skeleton = solvable(fit.motion.skeleton, joint_rigging(fit.motion.skeleton, names))
    outside = (fit.angles < skeleton.lower - 1e-9) | (fit.angles > skeleton.upper + 1e-9)
    return int(outside[:, 1:].sum())


def report(what: str, ratio: float, per_second: float, bones: float, outside: int | str) -> None:
    print(f"{what:24s}{ratio:10.3f}{per_second:12,.0f}{bones:14.1e}{outside!s:>12}")


def wrong_lengths(names: tuple[str, ...], seed: int) -> np.ndarray:
    """(J,) factors of up to 15 %, equal on both sides."""
    rng = np.random.default_rng(seed + 100)
    factors: dict[str, float] = {}
    for name in names:
        factors.setdefault(name.replace("Right", "Left"), float(rng.uniform(0.85, 1.15)))
    return np.array([factors[n.replace("Right", "Left")] for n in names])


def measure_joints(arguments: argparse.Namespace) -> None:
    """Fit a file's own skeleton to its joints, and the project's body to landmarks."""
    motion = read_bvh(arguments.bvh, metres_per_unit=arguments.metres_per_unit)
    skeleton, names = motion.skeleton, distinct_joints(motion)
    truth = motion.joint_positions_world()[:, [skeleton.index(n) for n in names]]
    rigging = joint_rigging(skeleton, names)
    print(f"{arguments.bvh.name}: {len(truth)} frames at {motion.fps:g}/s, {len(names)} joints")
    print(f"{'':24s}{'RMSE ratio':>10}{'frames/s':>12}{'bone change':>14}{'violations':>12}")
    for seed in range(arguments.seeds):
        points = add_joint_noise(truth, seed)
        before = rmse(points, truth)
        for what, fit in (("online", fit_online), ("take", fit_take)):
            seconds = timed(lambda fit=fit, points=points: fit(skeleton, points, motion.fps, rigging))
            found = fit(skeleton, points, motion.fps, rigging)
            ratio = rmse(found.landmarks_world, truth) / before
            report(what, ratio, len(truth) / seconds, bone_spread(found.motion), violations(found, names))
        wrong = replace(skeleton, offsets=skeleton.offsets * wrong_lengths(skeleton.names, seed)[:, None])
        start = time.process_time()
        calibrated, rigged = calibrate_skeleton(wrong, points, motion.fps, rigging)
        found = fit_take(calibrated, points, motion.fps, rigged)
        seconds = time.process_time() - start
        ratio = rmse(found.landmarks_world, truth) / before
        report(
            "take, bones calibrated", ratio, len(truth) / seconds, bone_spread(found.motion), violations(found, names)
        )
    if arguments.bvh.name == "01_01.bvh":
        truth, fps = cmu_landmarks()
        points = as_points(add_joint_noise(truth, 0), fps, SIGMA)
        seconds = timed(lambda: fit_body(points))
        body = fit_body(points)
        at = landmarks_from_motion(body.motion, body.body, BODY23)
        ratio = rmse(at, truth) / rmse(points.points_world, truth)
        report("fit_body (60 Hz)", ratio, len(truth) / seconds, bone_spread(body.motion), "see tests")


LIMBS = (
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe"),
    ("knee", "ankle", "heel", "big_toe", "small_toe"),
    ("shoulder", "elbow", "wrist"),
    ("elbow", "wrist"),
)


def balancing_landmarks() -> tuple[np.ndarray, float]:
    reference = np.load(DATA / "balancing" / "reference" / "openpose_body25b.npz")
    names = [str(n) for n in reference["names"]]
    xyz = reference["points3d_world"][:, [names.index(n) for n in BODY23.names]]
    options = SmoothOptions(max_gap=np.inf, extrapolate=True)
    return smooth_points(as_points(xyz, 60.0, 0.02), options).points_world, 60.0


def add_network_errors(truth: np.ndarray, fps: float, rng: np.random.Generator, correlation: float) -> np.ndarray:
    """Add noise of 60 mm RMS, 5 % outliers of 0.5 m, left-right flips of limbs and 10 % missing points."""
    out = truth + 0.06 / np.sqrt(3) * correlated_noise(truth.shape, correlation, rng)
    far = rng.random(out.shape[:2]) < 0.05
    out[far] += rng.normal(0, 0.5 / np.sqrt(3), (far.sum(), 3))
    for limb in LIMBS:
        sides = [BODY23.index(f"{side}_{n}") for n in limb for side in ("left", "right")]
        twins = [BODY23.mirror[i] for i in sides]
        start = 0
        while start < len(out):
            start += int(rng.exponential(2.0 * fps)) + 1
            stop = start + int(rng.integers(1, max(int(fps / 5), 2)))
            out[start:stop, sides] = out[start:stop, twins]
            start = stop
    out[rng.random(out.shape[:2]) < 0.1] = np.nan
    return out


def measure_landmarks(arguments: argparse.Namespace) -> None:
    """Smooth and fit landmarks with the errors of a weak network."""
    for name, (truth, fps) in {"balancing": balancing_landmarks(), "cmu 01_01": cmu_landmarks()}.items():
        for correlation in (0.0, 0.8):
            rows: dict[str, list[tuple[float, ...]]] = {}

            def add(what: str, xyz: np.ndarray, seconds: float, rows=rows, truth=truth) -> None:
                distance = np.linalg.norm(xyz - truth, axis=-1) * 1e3
                known = distance[np.isfinite(distance)]
                speed = len(truth) / seconds if seconds else np.nan
                figures = (known.mean(), np.median(known), np.percentile(known, 95), known.size / distance.size)
                rows.setdefault(what, []).append((*figures, speed))

            for seed in range(arguments.seeds):
                points = as_points(add_network_errors(truth, fps, np.random.default_rng(seed), correlation), fps, 0.03)
                add("as measured", points.points_world, 0)
                for acceleration in arguments.smooth_acceleration:
                    start = time.perf_counter()
                    smooth = smooth_points(points, SmoothOptions(acceleration=acceleration))
                    add(f"smooth_points {acceleration:g}", smooth.points_world, time.perf_counter() - start)
                for angular in arguments.angular:
                    for root in arguments.root:
                        start = time.perf_counter()
                        options = FitOptions(angular_acceleration=angular, root_acceleration=root)
                        fit = fit_body(points, options)
                        body = landmarks_from_motion(fit.motion, fit.body, BODY23)
                        add(f"fit_body {angular:g} {root:g}", body, time.perf_counter() - start)
            print(f"{name}, noise {'white' if correlation == 0 else 'correlated'}")
            print(f"  {'':28s}{'mean mm':>9}{'median':>9}{'95 %':>9}{'known':>8}{'frames/s':>10}")
            for what, values in rows.items():
                mean = np.mean(values, axis=0)
                print(f"  {what:28s}{mean[0]:9.1f}{mean[1]:9.1f}{mean[2]:9.1f}{mean[3]:8.3f}{mean[4]:10.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    joints = commands.add_parser("joints")
    joints.add_argument("--bvh", type=Path, default=DATA / "motion" / "01_01.bvh")
    joints.add_argument("--metres-per-unit", type=float, default=CMU_METRES_PER_UNIT)
    joints.add_argument("--seeds", type=int, default=1)
    joints.set_defaults(run=measure_joints)
    landmarks = commands.add_parser("landmarks")
    landmarks.add_argument("--seeds", type=int, default=2)
    landmarks.add_argument("--smooth-acceleration", type=float, nargs="*", default=[SmoothOptions().acceleration])
    landmarks.add_argument("--angular", type=float, nargs="*", default=[FitOptions().angular_acceleration])
    landmarks.add_argument("--root", type=float, nargs="*", default=[FitOptions().root_acceleration])
    landmarks.set_defaults(run=measure_landmarks)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
