"""How near smoothed points and the fitted body come to the truth under the errors of a weak network.

Usage: python -m scripts.benchmarks.geometry.skeleton [--seeds 3]

Two truths: the balancing take's reference, smoothed (a slow man; its points are no rigid body), and CMU trial
01_01 (climbs and jumps; exactly rigid). Each is spoiled with noise of 60 mm, outliers, left-right swaps of a
limb for up to a fifth of a second and missing points, once white and once correlated in time, as a network's
errors are from frame to frame.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from muybridge.geometry.fitting.body_fit import FitOptions, fit_body, landmarks_from_motion
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.motion.formats.skeletal.bvh import read_bvh

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data"
LIMBS = (
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe"),
    ("knee", "ankle", "heel", "big_toe", "small_toe"),
    ("shoulder", "elbow", "wrist"),
    ("elbow", "wrist"),
)


def as_points(xyz: np.ndarray, fps: float, sigma: float) -> Points3D:
    t, j = xyz.shape[:2]
    covariance = np.tile(np.eye(3) * sigma**2, (t, j, 1, 1))
    return Points3D(BODY23, xyz, covariance, np.empty((0, t, j)), np.empty((0, t, j), bool), fps)


def balancing_truth() -> tuple[np.ndarray, float]:
    reference = np.load(DATA / "balancing" / "reference" / "openpose_body25b.npz")
    names = [str(n) for n in reference["names"]]
    xyz = reference["points3d_world"][:, [names.index(n) for n in BODY23.names]]
    options = SmoothOptions(max_gap=np.inf, extrapolate=True)
    return smooth_points(as_points(xyz, 60.0, 0.02), options).points_world, 60.0


def cmu_truth() -> tuple[np.ndarray, float]:
    motion = read_bvh(DATA / "motion" / "01_01.bvh", metres_per_unit=0.0254 / 0.45)
    world = motion.forward()[1::2]
    joint = motion.skeleton.index

    def at(name: str, offset: tuple[float, float, float]) -> np.ndarray:
        matrix = world[:, joint(name)]
        return matrix[:, :3, 3] + matrix[:, :3, :3] @ np.array(offset)

    places = {"nose": at("Head", (0, -0.11, 0.04))}
    for side, sign in (("Left", 1), ("Right", -1)):
        low = side.lower() + "_"
        places[low + "eye"] = at("Head", (sign * 0.03, -0.08, 0.07))
        places[low + "ear"] = at("Head", (sign * 0.07, 0, 0.05))
        joints = {"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg", "knee": "Leg"}
        for landmark, name in {**joints, "ankle": "Foot"}.items():
            places[low + landmark] = at(side + name, (0, 0, 0))
        places[low + "heel"] = at(side + "Foot", (0, 0.05, -0.05))
        places[low + "big_toe"] = at(side + "ToeBase", (-sign * 0.02, -0.06, -0.01))
        places[low + "small_toe"] = at(side + "ToeBase", (sign * 0.04, -0.03, -0.01))
    return np.stack([places[n] for n in BODY23.names], axis=1), motion.fps / 2


def spoiled(truth: np.ndarray, fps: float, rng: np.random.Generator, memory: float) -> np.ndarray:
    """Noise of 60 mm RMS, 5 % outliers of 0.5 m, swaps, 10 % missing; `memory` is the share of noise kept."""
    noise = rng.normal(0, 0.06 / np.sqrt(3), truth.shape)
    for t in range(1, len(noise)):
        noise[t] = memory * noise[t - 1] + np.sqrt(1 - memory**2) * noise[t]
    out = truth + noise
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--smooth-acceleration", type=float, nargs="*", default=[SmoothOptions().acceleration])
    parser.add_argument("--angular", type=float, nargs="*", default=[FitOptions().angular_acceleration])
    parser.add_argument("--root", type=float, nargs="*", default=[FitOptions().root_acceleration])
    arguments = parser.parse_args()
    for name, (truth, fps) in {"balancing": balancing_truth(), "cmu 01_01": cmu_truth()}.items():
        for memory in (0.0, 0.8):
            rows: dict[str, list[tuple[float, ...]]] = {}

            def add(what: str, xyz: np.ndarray, seconds: float, rows=rows, truth=truth) -> None:
                distance = np.linalg.norm(xyz - truth, axis=-1) * 1e3
                known = distance[np.isfinite(distance)]
                speed = len(truth) / seconds if seconds else np.nan
                figures = (known.mean(), np.median(known), np.percentile(known, 95), known.size / distance.size)
                rows.setdefault(what, []).append((*figures, speed))

            for seed in range(arguments.seeds):
                points = as_points(spoiled(truth, fps, np.random.default_rng(seed), memory), fps, 0.03)
                add("as measured", points.points_world, 0)
                for acceleration in arguments.smooth_acceleration:
                    begun = time.perf_counter()
                    smooth = smooth_points(points, SmoothOptions(acceleration=acceleration))
                    add(f"smooth_points {acceleration:g}", smooth.points_world, time.perf_counter() - begun)
                for angular in arguments.angular:
                    for root in arguments.root:
                        begun = time.perf_counter()
                        options = FitOptions(angular_acceleration=angular, root_acceleration=root)
                        fit = fit_body(points, options)
                        body = landmarks_from_motion(fit.motion, fit.body, BODY23)
                        add(f"fit_body {angular:g} {root:g}", body, time.perf_counter() - begun)
            print(f"{name}, noise {'white' if memory == 0 else 'correlated'}")
            print(f"  {'':28s}{'mean mm':>9}{'median':>9}{'95 %':>9}{'known':>8}{'frames/s':>10}")
            for what, values in rows.items():
                mean = np.mean(values, axis=0)
                print(f"  {what:28s}{mean[0]:9.1f}{mean[1]:9.1f}{mean[2]:9.1f}{mean[3]:8.3f}{mean[4]:10.0f}")


if __name__ == "__main__":
    main()
