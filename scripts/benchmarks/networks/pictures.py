"""A keypoint network on single images of the balancing take, without background model and calibration, and with given
boxes.

Usage: python -m scripts.benchmarks.networks.pictures DATA [--network NETWORK.onnx ...] [--every 4] [--high 0 88]

Uses every n-th frame of each camera, at its size (`--high 0`) or scaled so that the person has the given height in
pixels. Boxes are those of the 2D reference with a margin of 6 %. Prints the same figures as
scripts.benchmarks.takes.mediapipe does for a video, relative to the reference, by default for the shipped networks.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.shipped import shipped_model
from scripts.benchmarks.common import JOINTS
from scripts.benchmarks.geometry.diagnosis import balancing
from scripts.benchmarks.takes.mediapipe import WAYS, agreement

MARGIN = 0.06


class Picture(NamedTuple):
    """An image of one person.

    Attributes:
        pixels: RGB.
        extent: (2, 2) top left and bottom right of the reference's points, px.
        joints: (12, 2) their joints, px.
    """

    pixels: ByteArray
    extent: FloatArray
    joints: FloatArray

    @property
    def high(self) -> float:
        """The person's height, px."""
        return float(self.extent[1, 1] - self.extent[0, 1])

    @property
    def box(self) -> FloatArray:
        """(4,) px."""
        low, high = self.extent
        margin = MARGIN * (high - low).max()
        return np.concatenate([low - margin, high + margin])


def pictures(data: Path, every: int) -> list[Picture]:
    """One in `every` frames of all cameras."""
    (_, reference, _), names = balancing(data)
    joints, found = [names.index(name) for name in JOINTS], []
    for c, path in enumerate(sorted((data / "balancing/videos").glob("*.mp4"))):
        video = cv2.VideoCapture(str(path))
        for t, points in enumerate(reference[c]):
            read, frame = video.read()
            if not read:
                raise SystemExit(f"{path}: ends before frame {t}, which the reference has")
            if t % every == 0:
                extent = np.stack([np.nanmin(points, 0), np.nanmax(points, 0)])
                found.append(Picture(np.ascontiguousarray(frame[..., ::-1]), extent, points[joints]))
    return found


def smaller(picture: Picture, high: int) -> Picture:
    """An image scaled so that the person is `high` pixels high."""
    scale = high / picture.high
    pixels = cv2.resize(picture.pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Picture(pixels.astype(np.uint8), picture.extent * scale, picture.joints * scale)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--network", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--high", type=int, nargs="+", default=[0, 88])
    options = parser.parse_args()
    networks = options.network or [shipped_model("keypoints", precision) for precision in ("fp32", "int8")]
    whole = pictures(options.data, options.every)
    sizes = [[smaller(picture, high) for picture in whole] if high else whole for high in options.high]
    print("| network | read | person, px high | PCK@0.2 | PCK@0.5 | other side |\n" + "|---" * 6 + "|")
    for path in networks:
        for label, flip in WAYS:
            network = KeypointNetwork(path, OnnxOptions(flip=flip))
            for seen in sizes:
                box, theirs = np.array([p.box for p in seen]), np.array([p.joints for p in seen])
                cells = agreement(network, [p.pixels for p in seen], box, theirs, np.isfinite(theirs).all(-1))
                high = np.median([p.high for p in seen])
                print(f"| {path.name} | {label} | {high:.0f} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
