"""The balancing take degraded: distance of `muybridge run` from the reference with poor cameras.

Usage: python -m scripts.benchmarks.takes.degraded DATA OUT [--only NAME ...] [options of `muybridge run`]

DATA contains `balancing`; OUT gets a session per row, with its results. Distances are mean distances of 12 joints from
the take's reference: as they are, after one similarity transform, and without each joint's mean offset. Fewer cameras:
`--cameras cam01 cam02`.
"""

import argparse
import pathlib
import shutil
import time
from collections.abc import Callable

import cv2
import numpy as np

from muybridge.arrays import ByteArray
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.video import read_chunks
from muybridge.motion.formats.points.trc import read_trc
from scripts.assets.write_video import video_writer
from scripts.benchmarks.common import JOINTS, balancing_joints, print_header, reference_distances, run_muybridge


def scale(gain: Callable[[int], float | list[float]]) -> Callable[[ByteArray, int], ByteArray]:
    """Scale the brightness of all channels, or of each, per frame."""
    return lambda frame, index: (frame * gain(index)).clip(0, 255).astype(np.uint8)


def blocks(frame: ByteArray, _: int) -> ByteArray:
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 8])[1], 1), np.uint8)


def dark(frame: ByteArray, _: int) -> ByteArray:
    noise = np.empty(frame.shape, np.int16)
    cv2.randn(noise, 0, 4)
    return (frame * 0.2 + noise).clip(0, 255).astype(np.uint8)


def dark_but_for_a_window(frame: ByteArray, index: int) -> ByteArray:
    """Like a camera whose exposure is set by something bright that is in front of nobody: the lowest eighth."""
    low = dark(frame, index)
    low[-len(low) // 8 :] = 255
    return low


def grey(frame: ByteArray, _: int) -> ByteArray:
    return np.repeat(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)[..., None], 3, 2)


def blurred(frame: ByteArray, _: int) -> ByteArray:
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), 6), np.uint8)


def motion_blur(frame: ByteArray, _: int) -> ByteArray:
    return np.asarray(cv2.filter2D(frame, -1, np.full((1, 15), 1 / 15)), np.uint8)


def small(frame: ByteArray, _: int) -> ByteArray:
    less = cv2.resize(frame, None, fx=1 / 8, fy=1 / 8, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(less, frame.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.uint8)


def only(first: float, last: float) -> Callable[[ByteArray, int], ByteArray]:
    """The rows between two shares of the height."""

    def crop(frame: ByteArray, _: int) -> ByteArray:
        part = np.zeros_like(frame)
        rows = slice(round(first * len(frame)), round(last * len(frame)))
        part[rows] = frame[rows]
        return part

    return crop


class Repeating:
    """Replaces a share of the frames by the previous one, independently per camera; or shows each frame `times`
    times."""

    def __init__(self, share: float = 0.0, times: int = 1) -> None:
        self.share, self.times, self.random = share, times, np.random.default_rng(0)
        self.last: ByteArray | None = None

    def __call__(self, frame: ByteArray, index: int) -> ByteArray:
        again = index % self.times > 0 or self.random.random() < self.share
        if index == 0 or self.last is None or not again:
            self.last = frame.copy()
        return self.last


VARIANTS: dict[str, tuple[str, Callable[[ByteArray, int], ByteArray]]] = {
    "as-it-is": ("unchanged, encoded again", lambda frame, _: frame),
    "grey": ("grey", grey),
    "blocks": ("JPEG at a quality of 8", blocks),
    "dark": ("a fifth of the brightness, noise of 4 in 255", dark),
    "window": ("the same, but the lowest eighth is white", dark_but_for_a_window),
    "bright": ("2.2 times the brightness", scale(lambda _: 2.2)),
    "flat": ("a fifth of the contrast", lambda frame, _: (115 + 0.2 * frame).astype(np.uint8)),
    "blue": ("blue times 1.5, red times 0.55", scale(lambda _: [0.55, 0.9, 1.5])),
    "blurred": ("blurred, 6 px", blurred),
    "drawn": ("motion blur of 15 px", motion_blur),
    "small": ("an eighth of the resolution", small),
    "flicker": ("flickering by a third", scale(lambda i: 1 + 0.35 * np.sin(1.3 * i))),
    "repeating": ("a third of the frames repeat the previous one", Repeating(1 / 3)),
    "thrice": ("each frame three times", Repeating(times=3)),
    "no-legs": ("the upper 55 % of the image", only(0, 0.55)),
    "legs": ("the lower half of the image", only(0.5, 1)),
}  # fmt: skip


def make(source: pathlib.Path, session: pathlib.Path, degrade: Callable[[ByteArray, int], ByteArray]) -> None:
    """Write a session with degraded videos; its calibration is written last and marks it complete."""
    (session / "videos").mkdir(parents=True, exist_ok=True)
    for video in sorted((source / "videos").iterdir()):
        info = probe_video(video)
        frames = (frame for chunk in read_chunks(info) for frame in chunk)
        with video_writer(session / "videos" / f"{video.stem}.mp4", (info.width, info.height), info.fps) as write:
            for index, frame in enumerate(frames):
                write(degrade(frame, index))
    shutil.copytree(source / "calibration", session / "calibration")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--only", nargs="*", default=[], choices=VARIANTS)
    options, rest = parser.parse_known_args()
    source, truth = options.data / "balancing", balancing_joints(options.data)
    print_header(["the take", "MPJPE, aligned, offset-free mm", "found", "s"])
    for name, (words, degrade) in VARIANTS.items():
        if options.only and name not in options.only:
            continue
        session = options.out / name
        if not (session / "calibration").exists():
            make(source, session, degrade)
        start = time.monotonic()
        if failure := run_muybridge("run", str(session), "--overwrite", "--quiet", *rest):
            print(f"| {words} | failed: {failure} | | |", flush=True)
            continue
        points = read_trc(session / "muybridge" / "points.trc")
        mine = points.points_world[: len(truth), [points.landmarks.names.index(joint) for joint in JOINTS]]
        found = np.isfinite(mine).all(-1).mean()
        print(
            f"| {words} | {reference_distances(mine, truth)} | {found:.3f} | {time.monotonic() - start:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
