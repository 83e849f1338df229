"""Triangulation measured: frames a second and error, beside a plain weighted DLT in the same run.

    python -m scripts.benchmarks.geometry.triangulation [CASE.npz]

CASE.npz (default: ../shared/data/triangulation_case.npz beside the repository) holds 2D points of a real rig
with outliers and their truth. Without it only the synthetic rigs of 4 and 16 cameras are measured. aniposelib
is measured too where it is installed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate
from muybridge.geometry.triangulation.validation import leave_one_out_error
from scripts.benchmarks.common import Timed, best_time
from scripts.benchmarks.geometry.whole_take import TakeOptions, triangulate_take
from tests.rigs import ring_of_cameras

DEFAULT_CASE = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "triangulation_case.npz"


def load_case(path: Path) -> tuple[CameraGroup, FloatArray, FloatArray]:
    """Cameras, (C, T, J, 2) px and (T, J, 3) truth."""
    data = np.load(path)
    cameras = []
    for c in range(data["camera_matrix"].shape[0]):
        matrix = data["camera_matrix"][c]
        rotation, _ = cv2.Rodrigues(data["rotvec_cam_from_world"][c])
        pose = np.hstack([rotation, data["translation_cam_from_world"][c][:, None]])
        lens = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *data["distortion_k1k2p1p2"][c])
        width, height = data["size_px"][c]
        cameras.append(Camera(f"cam{c}", "OPENCV", int(width), int(height), lens, pose))
    return CameraGroup(tuple(cameras)), data["points_px"].astype(float), data["truth_world"].astype(float)


def synthetic(count: int, frames: int = 1000, landmarks: int = 25) -> tuple[CameraGroup, FloatArray, FloatArray]:
    """A ring of cameras, 3 px noise, 5 % outliers of 80 px a coordinate."""
    group = ring_of_cameras(
        [f"cam{c:02d}" for c in range(count)],
        height=[1.5 + 0.4 * (c % 3) for c in range(count)],
        first=0.2,
        size=(1920, 1080),
        model="OPENCV",
        params=(1400.0, 1400.0, 959.5, 539.5, -0.05, 0.02, 0.0, 0.0),
    )
    rng = np.random.default_rng(count)
    truth = rng.uniform([-0.7, -0.7, 0.0], [0.7, 0.7, 1.9], (frames, landmarks, 3))
    px = group.project(truth) + rng.normal(0, 3, (count, frames, landmarks, 2))
    wrong = rng.random(px.shape[:-1]) < 0.05
    px[wrong] += rng.normal(0, 80, (int(wrong.sum()), 2))
    return group, px, truth


def weighted_dlt(cameras: CameraGroup, px: FloatArray, variance: FloatArray) -> FloatArray:
    """The plain linear method: the eigenvector of the smallest eigenvalue, all cameras, no rejection."""
    slopes = cameras.unproject(px)
    poses = cameras.cam_from_world
    shape = (len(cameras), *(1,) * (px.ndim - 2), 4)
    first, second, third = (poses[:, k].reshape(shape) for k in range(3))
    rows = np.stack([slopes[..., :1] * third - first, slopes[..., 1:] * third - second])
    rows = np.where(np.isfinite(rows), rows / np.sqrt(variance)[..., None], 0.0)
    normal = np.einsum("rc...i,rc...j->...ij", rows, rows)
    _, vectors = np.linalg.eigh(normal)
    points: FloatArray = vectors[..., :3, 0] / vectors[..., 3:, 0]
    return points


def aniposelib_points(cameras: CameraGroup, px: FloatArray) -> Callable[[], FloatArray] | None:
    """aniposelib's `triangulate` on the same arrays; None where it is not installed."""
    try:
        from aniposelib.cameras import Camera as PeerCamera
        from aniposelib.cameras import CameraGroup as PeerGroup
    except ImportError:
        return None
    peers: list[Any] = []
    for camera in cameras:
        rotation, _ = cv2.Rodrigues(camera.rotation)
        distortion = np.array([*camera.params[4:8], 0.0])
        peers.append(
            PeerCamera(matrix=camera.camera_matrix, dist=distortion, rvec=rotation.ravel(), tvec=camera.translation)
        )
    group = PeerGroup(peers)
    flat = px.reshape(len(cameras), -1, 2)
    return lambda: np.asarray(group.triangulate(flat, undistort=True)).reshape(*px.shape[1:3], 3)


def report(name: str, timed: Timed, points: FloatArray, truth: FloatArray) -> None:
    error_mm = 1000 * np.linalg.norm(points - truth, axis=-1)
    known = error_mm[np.isfinite(error_mm)]
    print(
        f"| {name} | {len(truth) / timed.wall:,.0f} | {len(truth) / timed.processor:,.0f} "
        f"| {np.median(known):.2f} | {np.sqrt(np.mean(known**2)):.2f} | {np.quantile(known, 0.99):.1f} "
        f"| {known.max():.0f} | {known.size / error_mm.size:.4f} |"
    )


def measure(title: str, cameras: CameraGroup, px: FloatArray, truth: FloatArray) -> float:
    """Prints a table; returns the processor seconds of the robust triangulation."""
    variance = np.full(px.shape[:-1], 9.0)
    print(f"\n{title}: {len(cameras)} cameras, {px.shape[1]} frames, {px.shape[2]} points\n")
    print("| method | frames/s | a processor second | median mm | RMSE mm | 99 % mm | max mm | coverage |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    triangulate(cameras, px[:, :20], variance[:, :20])  # compiles
    seconds, result = best_time(lambda: triangulate(cameras, px, variance))
    report("robust, noise from the take", seconds, result.points_world, truth)
    known, result = best_time(lambda: triangulate(cameras, px, variance, TriangulateOptions(noise_px=0.0)))
    report("robust, variances as given", known, result.points_world, truth)
    wrong = variance / 25.0
    other, result = best_time(lambda: triangulate(cameras, px, wrong))
    report("robust, variances 25 times too small", other, result.points_world, truth)
    for name, how in {
        "whole take": TakeOptions(),
        "whole take, without recurrences": TakeOptions(recurrences=0),
    }.items():
        triangulate_take(cameras, px[:, :40], variance[:, :40], options=how)
        whole, result = best_time(lambda how=how: triangulate_take(cameras, px, variance, options=how), repeats=3)
        report(name, whole, result.points_world, truth)
    linear, points = best_time(lambda: weighted_dlt(cameras, px, variance))
    report("weighted DLT", linear, points, truth)
    peer = aniposelib_points(cameras, px)
    if peer is not None:
        peer()
        taken, points = best_time(peer)
        report("aniposelib triangulate", taken, points, truth)
    left_out, _ = best_time(lambda: leave_one_out_error(cameras, px, variance), repeats=1)
    print(f"\nleave-one-camera-out error of the same: {px.shape[1] / left_out.wall:,.0f} frames/s")
    return seconds.processor


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT_CASE
    if path.exists():
        measure(f"Real rig ({path.name})", *load_case(path))
    else:
        print(f"{path} is not here: synthetic rigs only")
    few = measure("Synthetic ring", *synthetic(4))
    many = measure("Synthetic ring", *synthetic(16))
    print(f"\n16 cameras take {many / few:.1f} times the processor time of 4")


if __name__ == "__main__":
    main()
