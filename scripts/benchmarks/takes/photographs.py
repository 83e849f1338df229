#!/usr/bin/env python3
"""A peer's 2D network, MediaPipe Pose (trained on photographs), beside ours on people in an ordinary video.

    python -m scripts.benchmarks.takes.photographs boxes VIDEO boxes.npz          in muybridge's environment
    python -m scripts.benchmarks.takes.photographs find VIDEO boxes.npz found.npz in an environment with mediapipe 0.10.14 alone
    python -m scripts.benchmarks.takes.photographs score VIDEO found.npz          in muybridge's

VIDEO is one still camera's, of people who go about; every 20th frame is looked at. Our detector gives both networks
the boxes. MediaPipe's points are no truth, so only people count whom it puts into their own box with three limb joints
in four visible. Printed is the share of shoulders, elbows, wrists, hips, knees and ankles (those that MediaPipe calls
visible) within 0.2 and 0.5 of the trunk's length (middle of the shoulders to middle of the hips) of MediaPipe's, and
of those that lie nearer to the other side's, each crop read as `run` reads it (mirrored too) and read once.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scripts.benchmarks.takes.mediapipe import JOINTS, look, peer

EVERY = 20
# How `run` reads a crop, and once.
WAYS = (("mirrored too", True), ("once", False))
LEAST_PX, LEAST_SCORE, LEAST_OVERLAP, LEAST_SEEN = 60, 0.3, 0.5, 0.75


def frames(video: Path) -> np.ndarray:
    """(T, H, W, 3) BGR of every `EVERY`th frame."""
    import cv2

    reader, kept, number = cv2.VideoCapture(str(video)), [], 0
    while (read := reader.read())[0]:
        if number % EVERY == EVERY // 2:
            kept.append(read[1])
        number += 1
    if not kept:
        raise SystemExit(f"{video}: of its {number} frames that can be read none is a {EVERY}th")
    return np.stack(kept)


def boxes(video: Path, out: Path) -> None:
    """Writes (N,) numbers of frames and (N, 4) boxes, px."""
    from muybridge.infer.detection.background import BackgroundModel
    from muybridge.infer.detection.orientation import Letterbox, orientation_for
    from muybridge.infer.detection.person_detector import PeopleDetector, PeopleOptions
    from muybridge.infer.networks.keypoints import PeopleNetwork
    from muybridge.models.shipped import shipped_model

    pictures = frames(video)[..., ::-1]
    network = PeopleNetwork(shipped_model("people"))
    letterbox = Letterbox(orientation_for(None, pictures.shape[2], pictures.shape[1]), network.card.input_long_side)
    detector = PeopleDetector(network, letterbox, PeopleOptions(min_score=LEAST_SCORE))
    found = [people.boxes_px if people is not None else np.empty((0, 4)) for people in
             detector(BackgroundModel(letterbox)(pictures))]  # fmt: skip
    np.savez(out, frame=np.repeat(np.arange(len(found)), [len(f) for f in found]), box=np.concatenate(found))


def find(video: Path, given: Path, out: Path) -> None:
    """Adds (N, 23, 3) x, y in pixels and visibility."""
    pictures, stored, network = frames(video), dict(np.load(given)), peer()
    seen = zip(stored["frame"], stored["box"], strict=True)
    np.savez(out, points=[look(network, pictures[frame], box[:2], box[2:]) for frame, box in seen], **stored)


def score(video: Path, given: Path) -> None:
    """Prints the table."""
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
    from muybridge.models.shipped import shipped_model

    joints = [BODY23.index(name) for name in JOINTS]
    stored = np.load(given)
    usable = _usable(stored["points"], stored["box"], joints)
    pictures, frame, box = frames(video)[..., ::-1], stored["frame"][usable], stored["box"][usable]
    theirs, seen = stored["points"][usable][:, joints, :2], stored["points"][usable][:, joints, 2] > 0.5
    print(f"{len(box)} people, {np.median(box[:, 3] - box[:, 1]):.0f} px high (median), of {len(usable)} boxes")
    print("| crops of | read | PCK@0.2 | PCK@0.5 | other side |\n" + "|---" * 5 + "|")
    for precision in ("fp32", "int8"):
        for label, flip in WAYS:
            network = KeypointNetwork(shipped_model("keypoints", precision), OnnxOptions(flip=flip))
            cells = agreement(network, [pictures[f] for f in frame], box, theirs, seen)
            print(f"| {precision} | {label} | {cells} |", flush=True)


def agreement(
    network: Any, pictures: Sequence[np.ndarray], box: np.ndarray, theirs: np.ndarray, seen: np.ndarray
) -> str:
    """The table's last three cells, of a keypoint network on RGB `pictures` of one person each, in boxes (N, 4), px,
    against points of `JOINTS` (N, 12, 2), px, of which those `seen` (N, 12) count."""
    from muybridge.geometry.cameras.crops import crops_for_boxes
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.infer.detection.crop_pixels import extract_crops

    joints = [BODY23.index(name) for name in JOINTS]
    other = [joints.index(BODY23.mirror[joint]) for joint in joints]
    middle = [theirs[:, [JOINTS.index(f"{side}_{part}") for side in ("left", "right")]].mean(1)
              for part in ("shoulder", "hip")]  # fmt: skip
    trunk = np.linalg.norm(middle[0] - middle[1], axis=-1)[:, None]
    crops = crops_for_boxes(box, network.crop_size, padding=network.box_padding)
    pixels = np.concatenate([extract_crops(picture, crops.select([i])) for i, picture in enumerate(pictures)])
    ours = crops.to_image(network.locate(pixels).found.points_crop_px)[:, joints]
    away = np.nan_to_num(np.linalg.norm(ours - theirs, axis=-1), nan=np.inf) / trunk
    flipped = (away > 0.2) & (np.linalg.norm(ours[:, other] - theirs, axis=-1) / trunk < away / 2)
    return " | ".join(f"{those[seen].mean():.3f}" for those in (away < 0.2, away < 0.5, flipped))


def _usable(points: np.ndarray, box: np.ndarray, joints: list[int]) -> Any:
    """(N,) bool: whom MediaPipe found where the box is, and mostly visible."""
    low, high = points[..., :2].min(1), points[..., :2].max(1)
    both = np.clip(np.minimum(box[:, 2:], high) - np.maximum(box[:, :2], low), 0, None).prod(1)
    overlap = both / ((box[:, 2:] - box[:, :2]).prod(1) + (high - low).prod(1) - both)
    visible = (points[:, joints, 2] > 0.5).mean(1) >= LEAST_SEEN
    return (overlap > LEAST_OVERLAP) & visible & ((high - low)[:, 1] > LEAST_PX)


if __name__ == "__main__":
    steps: dict[str, Any] = {"boxes": boxes, "find": find, "score": score}
    if len(sys.argv) < 4 or len(sys.argv) != {"boxes": 4, "find": 5, "score": 4}.get(sys.argv[1]):
        raise SystemExit(__doc__)
    steps[sys.argv[1]](*map(Path, sys.argv[2:]))
