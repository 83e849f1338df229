"""Data, noise and figures that several benchmarks share."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray

# Real data beside the checkout.
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
CMU_METRES_PER_UNIT = 0.0254 / 0.45  # unit of CMU's motion files
# Limb joints that are scored in the balancing take.
JOINTS = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
               for side in ("left", "right"))  # fmt: skip


def print_header(columns: Sequence[str]) -> None:
    """Print the head of a Markdown table."""
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}", flush=True)


def run_muybridge(*arguments: str) -> str | None:
    """Run the command line; return the last line of its messages if it fails."""
    import subprocess

    done = subprocess.run([sys.executable, "-m", "muybridge", *arguments], capture_output=True, text=True)
    return (done.stderr or done.stdout).strip().splitlines()[-1] if done.returncode else None


@dataclass(frozen=True)
class Timed:
    """Least wall-clock and processor seconds of several runs; the latter hardly depend on what else is running."""

    wall: float
    processor: float


def best_time(call: Callable[[], Any], repeats: int = 5) -> tuple[Timed, Any]:
    """Times of several runs, and the result of the last one."""
    walls, processors, result = [], [], None
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        result = call()
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    return Timed(min(walls), min(processors)), result


def correlated_noise(shape: tuple[int, ...], correlation: float, rng: np.random.Generator) -> FloatArray:
    """Noise (T, ...) of unit standard deviation, correlated between consecutive frames."""
    out = rng.normal(size=shape)
    for t in range(1, len(out)):
        out[t] = correlation * out[t - 1] + np.sqrt(1 - correlation**2) * out[t]
    return out


def as_points(xyz: FloatArray, fps: float, sigma: float) -> Any:
    """`Points3D` of BODY23 with isotropic noise of `sigma` metres."""
    from muybridge.geometry.landmarks.arrays import Points3D
    from muybridge.geometry.landmarks.sets import BODY23

    t, j = xyz.shape[:2]
    covariance = np.tile(np.eye(3) * sigma**2, (t, j, 1, 1))
    return Points3D(BODY23, xyz, covariance, np.empty((0, t, j)), np.empty((0, t, j), bool), fps)


def cmu_landmarks() -> tuple[FloatArray, float]:
    """Landmarks (T, 23, 3) rigidly attached to the skeleton of CMU trial 01_01 (climbing, jumping), and frames/s."""
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.motion.formats.skeletal.bvh import read_bvh

    motion = read_bvh(DATA / "motion" / "01_01.bvh", metres_per_unit=CMU_METRES_PER_UNIT)
    world = motion.forward()[1::2]
    joint = motion.skeleton.index

    def at(name: str, offset: tuple[float, float, float]) -> FloatArray:
        matrix = world[:, joint(name)]
        return np.asarray(matrix[:, :3, 3] + matrix[:, :3, :3] @ np.array(offset))

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


def balancing_joints(data: Path) -> FloatArray:
    """(T, 12, 3) metres: the reference of the balancing take."""
    with np.load(data / "balancing/reference/openpose_body25b.npz") as stored:
        names = stored["names"].tolist()
        points: FloatArray = stored["points3d_world"][:, [names.index(j) for j in JOINTS]]
    return points


def reference_distances(points: FloatArray, truth: FloatArray) -> str:
    """Mean distance of (T, 12, 3) metres from the reference in mm: as it is, after one similarity transform, and then
    without each joint's mean offset."""
    from skimage.transform import SimilarityTransform

    known = np.isfinite(points).all(-1) & np.isfinite(truth).all(-1)
    fit = SimilarityTransform.from_estimate(points[known], truth[known])
    aligned = points.copy()
    aligned[known] = fit(points[known])
    offset = np.array([(aligned - truth)[k, j].mean(0) if k.any() else np.zeros(3) for j, k in enumerate(known.T)])
    away = [np.linalg.norm(p - truth, axis=-1)[known].mean() for p in (points, aligned, aligned - offset)]
    return ", ".join(f"{1000 * a:.1f}" for a in away)
