#!/usr/bin/env python3
"""A keypoint network on single pictures of `balancing`, with no plate, no calibration and given boxes.

    python scripts/bench_pictures.py DATA [--network NETWORK.onnx ...] [--every 4] [--high 0 88]

Every so many frames of each camera, as large as they are (`--high 0`) or made so small that the person is so many
pixels high; boxes are those of the reference's own 2D, with a margin of 6 %. Prints the share of shoulders, elbows,
wrists, hips, knees and ankles within 0.2 and 0.5 of the trunk's length of the reference's points, and of those beyond
0.2 that lie nearer to the other side's, of the shipped networks unless told which.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from bench_mediapipe import JOINTS
from numpy.typing import NDArray

from muybridge.geometry.crops import crops_for_boxes
from muybridge.geometry.landmarks import BODY23
from muybridge.infer.crops import extract_crops
from muybridge.infer.onnx import KeypointNetwork, OnnxOptions
from muybridge.models.registry import shipped_model

# Reference points that are less sure are no truth.
SURE = 0.3
MARGIN = 0.06
OURS = [BODY23.index(name) for name in JOINTS]
TWINS = [BODY23.mirror[joint] for joint in OURS]


class Picture(NamedTuple):
    """RGB pixels, the person's box (4,), and the reference's joints (12, 3): x, y in pixels and how sure."""

    pixels: NDArray[np.uint8]
    box: NDArray[np.float64]
    joints: NDArray[np.float64]


def pictures(data: Path, every: int) -> list[Picture]:
    """Of all cameras, one in `every` frames."""
    with np.load(data / "balancing/reference/openpose_body25b.npz") as stored:
        reference, order = (
            stored["keypoints2d_px"].astype(float),
            [list(stored["names"]).index(name) for name in JOINTS],
        )
    found = []
    for c, path in enumerate(sorted((data / "balancing/videos").glob("*.mp4"))):
        video = cv2.VideoCapture(str(path))
        for t, points in enumerate(reference[c]):
            read, frame = video.read()
            if not read:
                raise SystemExit(f"{path}: ends before frame {t}, which the reference has")
            if t % every == 0:
                sure = points[points[:, 2] > SURE, :2]
                low, high = sure.min(0), sure.max(0)
                margin = MARGIN * (high - low).max()
                found.append(Picture(frame[..., ::-1], np.concatenate([low - margin, high + margin]), points[order]))
    return found


def smaller(picture: Picture, high: int) -> Picture:
    """A picture in which the person is `high` pixels high."""
    scale = high / ((picture.box[3] - picture.box[1]) / (1 + 2 * MARGIN))
    pixels = cv2.resize(picture.pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Picture(pixels.astype(np.uint8), picture.box * scale, picture.joints * [scale, scale, 1])


def shares(network: KeypointNetwork, seen: list[Picture]) -> tuple[float, float, float]:
    """Of the joints: within 0.2 and 0.5 of the trunk, and on the other side."""
    crops = crops_for_boxes(np.array([p.box for p in seen]), network.crop_size, padding=network.box_padding)
    pixels = [extract_crops(np.ascontiguousarray(p.pixels), crops.select([i])) for i, p in enumerate(seen)]
    at = crops.to_image(network.locate(np.concatenate(pixels)).found.points_crop_px)
    truth = np.array([p.joints for p in seen])
    middle = [truth[:, [JOINTS.index(f"{side}_{part}") for side in ("left", "right")], :2].mean(1)
              for part in ("shoulder", "hip")]  # fmt: skip
    trunk, sure = np.linalg.norm(middle[0] - middle[1], axis=-1)[:, None], truth[..., 2] > SURE
    away, other = (np.nan_to_num(np.linalg.norm(at[:, which] - truth[..., :2], axis=-1), nan=np.inf) / trunk
                   for which in (OURS, TWINS))  # fmt: skip
    swapped = (away > 0.2) & (other < away / 2)
    return float((away < 0.2)[sure].mean()), float((away < 0.5)[sure].mean()), float(swapped[sure].mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--network", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--high", type=int, nargs="+", default=[0, 88])
    options = parser.parse_args()
    networks = options.network or [shipped_model("keypoints", precision) for precision in ("fp32", "int8")]
    whole = pictures(options.data, options.every)
    print("| network | person, px high | read | PCK@0.2 | PCK@0.5 | other side |\n" + "|---" * 6 + "|")
    for path in networks:
        for high in options.high:
            seen = [smaller(picture, high) for picture in whole] if high else whole
            for label, flip in (("mirrored too", True), ("once", False)):
                row = shares(KeypointNetwork(path, OnnxOptions(flip=flip)), seen)
                size = np.median([(p.box[3] - p.box[1]) / (1 + 2 * MARGIN) for p in seen])
                print(
                    f"| {path.name} | {size:.0f} | {label} | {' | '.join(f'{share:.3f}' for share in row)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
