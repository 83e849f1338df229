"""How well each way of fitting a calibration to a video of another size agrees with what the pixels say.

    python scripts/video_size_rule.py SESSION IMAGES [REFERENCE.npz]

SESSION is a session folder. IMAGES holds one picture a camera of the calibrated size, taken by the same fixed
camera (the camera's name in the file's name). Features of the static scene are matched between that picture
and the video's first frame; each way of fitting predicts where they should have moved. Printed is the median
distance between prediction and match, px, per camera and way. With REFERENCE.npz (`points3d_world` (T, J, 3),
`keypoints2d_px` (C, T, J, 3)) the median reprojection error is printed beside it: it also holds the errors of
the poses and of the reference, so it cannot decide between ways that differ by a few pixels.
"""

import sys
from pathlib import Path
from typing import Any, get_args

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.calibration import VideoFit, find_calibration, fit_to_video, load_calibration
from muybridge.geometry.cameras.camera import Camera

MIN_SCORE = 0.3


def first_frame(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) RGB."""
    with av.open(str(path)) as container:
        return np.asarray(next(container.decode(video=0)).to_ndarray(format="rgb24"))


def matched_points(before: NDArray[Any], after: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 2) pixels of the same static features in two pictures; people who moved are outliers of RANSAC."""
    sift = cv2.SIFT_create(nfeatures=4000)
    keys_a, words_a = sift.detectAndCompute(cv2.cvtColor(before, cv2.COLOR_RGB2GRAY), None)
    keys_b, words_b = sift.detectAndCompute(cv2.cvtColor(after, cv2.COLOR_RGB2GRAY), None)
    pairs = cv2.BFMatcher().knnMatch(words_a, words_b, k=2)
    good = [a for a, b in pairs if a.distance < 0.7 * b.distance]
    a = np.array([keys_a[m.queryIdx].pt for m in good])
    b = np.array([keys_b[m.trainIdx].pt for m in good])
    _, inlier = cv2.findHomography(a, b, cv2.RANSAC, 2.0)
    keep = inlier.ravel().astype(bool)
    return a[keep], b[keep]


def moved(points_px: NDArray[np.float64], before: Camera, after: Camera) -> NDArray[np.float64]:
    """Where pixels of the calibrated picture are in the video, according to a fitted camera."""
    return after.project(after.center_world + before.rays(points_px))


def main(session: Path, images: Path, reference: Path | None) -> None:
    cameras = load_calibration(find_calibration(session))
    data = np.load(reference) if reference else None
    print(f"{'camera':10} {'video':>10} {'way':12} {'registration':>12} {'reprojection':>12}   (median px)")
    for k, camera in enumerate(cameras):
        frame = first_frame(next((session / "videos").glob(f"{camera.name}.*")))
        height, width = frame.shape[:2]
        picture = cv2.cvtColor(cv2.imread(str(next(images.glob(f"*{camera.name}*")))), cv2.COLOR_BGR2RGB)
        before, after = matched_points(picture, frame)
        for how in get_args(VideoFit)[:-2]:
            fitted, said = fit_to_video(camera, width, height, how, frame)
            off = np.median(np.linalg.norm(moved(before, camera, fitted) - after, axis=-1))
            error = np.nan
            if data is not None:
                seen = data["keypoints2d_px"][k].astype(np.float64)
                distance = np.linalg.norm(fitted.project(data["points3d_world"]) - seen[..., :2], axis=-1)
                error = np.nanmedian(np.where(seen[..., 2] > MIN_SCORE, distance, np.nan))
            print(f"{camera.name:10} {width:5}x{height} {how:12} {off:12.2f} {error:12.2f}")
            if said:
                print(f"  {said}")
        print(f"  {len(before)} features matched")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
