#!/usr/bin/env python3
"""A peer's 2D network, MediaPipe Pose (trained on photographs; what FreeMoCap uses), beside ours on `balancing`.

    python -m scripts.benchmarks.takes.mediapipe find DATA found.npz          in an environment with mediapipe 0.10.14 alone
    python -m scripts.benchmarks.takes.mediapipe score DATA found.npz RUN     in muybridge's

RUN is the results folder of `muybridge run DATA/balancing`. MediaPipe is given the boxes of the take's own reference
2D, each frame anew (static mode, the full model); ours found the person by itself. The 2D of both goes through the
same repair of sides, triangulation and smoothing, with the cameras as delivered and refined on that 2D. Scored as
the take's reference asks: mean distance of 12 joints, after one similarity transform, and without each joint's mean
offset; the left-out camera's error is of all 23 landmarks.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

# Our 23 landmarks among MediaPipe's 33; it has one point for both small toe and big toe.
MEDIAPIPE = [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28, 31, 31, 29, 32, 32, 30]
SIDE = 512
JOINTS = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
               for side in ("left", "right"))  # fmt: skip


def peer() -> Any:
    """MediaPipe's network, which looks at every picture anew."""
    import mediapipe

    return mediapipe.solutions.pose.Pose(static_image_mode=True, model_complexity=1, min_detection_confidence=0.3)


def look(network: Any, picture: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(23, 3) x, y in pixels and visibility of whom it sees in a BGR picture round a box; NaN where nobody."""
    import cv2

    middle, scale = (low + high) / 2, SIDE / (1.25 * (high - low).max())
    crop = np.array([[scale, 0, SIDE / 2 - middle[0] * scale], [0, scale, SIDE / 2 - middle[1] * scale]])
    image = cv2.warpAffine(picture, crop, (SIDE, SIDE), flags=cv2.INTER_AREA)
    landmarks = network.process(np.ascontiguousarray(image[..., ::-1])).pose_landmarks
    if landmarks is None:
        return np.full((len(MEDIAPIPE), 3), np.nan)
    found = np.array([[m.x * SIDE, m.y * SIDE, m.visibility] for m in landmarks.landmark])[MEDIAPIPE]
    found[:, :2] = (found[:, :2] - crop[:, 2]) / scale
    return found


def find(data: Path, out: Path) -> None:
    """Writes (C, T, 23, 3) x, y in pixels and visibility."""
    import cv2

    reference, network = np.load(data / "balancing/reference/openpose_body25b.npz")["keypoints2d_px"], peer()
    found = np.full((*reference.shape[:2], len(MEDIAPIPE), 3), np.nan)
    began = time.monotonic()
    for c, path in enumerate(sorted((data / "balancing/videos").glob("*.mp4"))):
        video = cv2.VideoCapture(str(path))
        for t in range(reference.shape[1]):
            _, picture = video.read()
            points = reference[c, t][reference[c, t, :, 2] > 0.3, :2]
            found[c, t] = look(network, picture, points.min(0), points.max(0))
    np.savez_compressed(out, points=found)
    print(f"{found[..., 0, 0].size} crops in {time.monotonic() - began:.1f} s")


def score(data: Path, found: Path, run: Path) -> None:
    """Prints the table."""
    from muybridge.geometry.calibration.people.calibrate import refine_people
    from muybridge.geometry.landmarks.arrays import Points3D
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
    from muybridge.geometry.triangulation.left_right import repair_flips
    from muybridge.geometry.triangulation.multiview import triangulate
    from muybridge.geometry.triangulation.validation import leave_one_out_error
    from scripts.benchmarks.geometry.diagnosis import balancing

    (cameras, reference_px, reference_variance), names = balancing(data)
    truth = reference(data)
    theirs = np.load(found)["points"]
    with np.load(run / "work" / "person, refined.npz") as ours:
        px, variance = ours["array_points_px"], ours["array_variance_px2"]
    order = [names.index(n) for n in BODY23.names]
    sources = {
        "ours": (px, variance), "MediaPipe": (theirs[..., :2], np.where(theirs[..., 2] > 0.5, 1.0, np.nan)),
        "OpenPose, the reference's own": (reference_px[:, :, order], reference_variance[:, :, order]),
    }  # fmt: skip
    print("| 2D | cameras | single frames: MPJPE, aligned, offset-free | smoothed | left out px |\n" + "|---" * 5 + "|")
    for name, (px, variance) in sources.items():
        px = np.where(np.isfinite(variance)[..., None], px, np.nan)
        mended, weights, _ = repair_flips(cameras, px, variance, BODY23)
        refined = refine_people(cameras, mended, weights, BODY23.names).cameras
        for label, group in (("as delivered", cameras), ("refined", refined)):
            mended, weights, _ = repair_flips(group, px, variance, BODY23)
            result = triangulate(group, mended, weights)
            points = Points3D(BODY23, result.points_world, result.covariance_world, result.residual_px, result.inlier,
                              60.0)  # fmt: skip
            smooth = smooth_points(points, SmoothOptions()).points_world
            left_out = np.nanmedian(leave_one_out_error(group, mended, weights))
            cells = [figures(p[:, [BODY23.index(j) for j in JOINTS]], truth) for p in (result.points_world, smooth)]
            print(f"| {name} | {label} | {cells[0]} | {cells[1]} | {left_out:.1f} |", flush=True)


def reference(data: Path) -> np.ndarray:
    """(T, 12, 3) metres of the balancing take's own reference."""
    with np.load(data / "balancing/reference/openpose_body25b.npz") as stored:
        names = stored["names"].tolist()
        points: np.ndarray = stored["points3d_world"][:, [names.index(j) for j in JOINTS]]
    return points


def figures(points: np.ndarray, truth: np.ndarray) -> str:
    """MPJPE, aligned and offset-free, mm, of (T, 12, 3) metres."""
    from skimage.transform import SimilarityTransform

    known = np.isfinite(points).all(-1) & np.isfinite(truth).all(-1)
    fit = SimilarityTransform.from_estimate(points[known], truth[known])
    aligned = points.copy()
    aligned[known] = fit(points[known])
    offset = np.array([(aligned - truth)[k, j].mean(0) if k.any() else np.zeros(3) for j, k in enumerate(known.T)])
    away = [np.linalg.norm(p - truth, axis=-1)[known].mean() for p in (points, aligned, aligned - offset)]
    return ", ".join(f"{1000 * a:.1f}" for a in away)


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] == "find":
        find(*map(Path, sys.argv[2:]))
    elif len(sys.argv) == 5 and sys.argv[1] == "score":
        score(*map(Path, sys.argv[2:]))
    else:
        raise SystemExit(__doc__)
