"""A third-party 2D network, MediaPipe Pose (trained on photographs; used by FreeMoCap), compared with ours.

On the balancing take:

    python -m scripts.benchmarks.takes.mediapipe take find DATA found.npz      (with mediapipe 0.10.14)
    python -m scripts.benchmarks.takes.mediapipe take score DATA found.npz RUN (with muybridge)

On people in an ordinary video:

    python -m scripts.benchmarks.takes.mediapipe video boxes VIDEO boxes.npz           (with muybridge)
    python -m scripts.benchmarks.takes.mediapipe video find VIDEO boxes.npz found.npz  (with mediapipe 0.10.14)
    python -m scripts.benchmarks.takes.mediapipe video score VIDEO found.npz           (with muybridge)

MediaPipe may have an environment of its own without muybridge: `find` needs only numpy and OpenCV beside it.

take: RUN is the results folder of `muybridge run DATA/balancing`. MediaPipe gets the bounding boxes of the take's own
2D reference and processes each frame independently (static mode, the full model); ours found the person itself. The 2D
landmarks of both go through the same left-right correction, triangulation and smoothing, with cameras as delivered and
as refined on that 2D. Printed are mean distances of 12 joints from the reference: as they are, after one similarity
transform, and without each joint's mean offset; and the leave-one-camera-out error of all 23 landmarks.

video: VIDEO is from one static camera; every 20th frame is used. Our detector gives both networks the boxes.
MediaPipe's points are not the truth, so only people count whose points lie in their own box and of whom it calls three
in four limb joints visible. Printed is the share of limb joints (those that MediaPipe calls visible) within 0.2 and 0.5
of the trunk's length (centre of the shoulders to centre of the hips) of MediaPipe's, and the share nearer to the
opposite side's, with crops read as in `run` (averaged with the mirrored crop) and once.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

# Indices of our 23 landmarks among MediaPipe's 33; it has one point for both small and big toe.
MEDIAPIPE = [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28, 31, 31, 29, 32, 32, 30]
SIDE = 512
EVERY = 20
# Ways of reading crops: as in `run`, and once.
WAYS = (("mirrored too", True), ("once", False))
LEAST_PX, LEAST_SCORE, LEAST_OVERLAP, LEAST_SEEN = 60, 0.3, 0.5, 0.75


def open_mediapipe() -> Any:
    """MediaPipe's network, in the mode that processes every image independently."""
    import mediapipe

    return mediapipe.solutions.pose.Pose(static_image_mode=True, model_complexity=1, min_detection_confidence=0.3)


def read_box(network: Any, picture: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(23, 3) x, y in pixels and visibility of the person in a bounding box of a BGR image; NaN if none is found."""
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


def find_take(data: Path, out: Path) -> None:
    """Write (C, T, 23, 3) x, y in pixels and visibility."""
    import cv2

    reference, network = np.load(data / "balancing/reference/openpose_body25b.npz")["keypoints2d_px"], open_mediapipe()
    found = np.full((*reference.shape[:2], len(MEDIAPIPE), 3), np.nan)
    start = time.monotonic()
    for c, path in enumerate(sorted((data / "balancing/videos").glob("*.mp4"))):
        video = cv2.VideoCapture(str(path))
        for t in range(reference.shape[1]):
            _, picture = video.read()
            points = reference[c, t][reference[c, t, :, 2] > 0.3, :2]
            found[c, t] = read_box(network, picture, points.min(0), points.max(0))
    np.savez_compressed(out, points=found)
    print(f"{found[..., 0, 0].size} crops in {time.monotonic() - start:.1f} s")


def score_take(data: Path, found: Path, run: Path) -> None:
    """Print the table of the balancing take."""
    from muybridge.geometry.calibration.people.calibrate import refine_people
    from muybridge.geometry.landmarks.arrays import Points3D
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
    from muybridge.geometry.triangulation.left_right import repair_flips
    from muybridge.geometry.triangulation.multiview import triangulate
    from muybridge.geometry.triangulation.validation import leave_one_out_error
    from scripts.benchmarks.common import JOINTS, balancing_joints, reference_distances
    from scripts.benchmarks.geometry.diagnosis import balancing

    (cameras, reference_px, reference_variance), names = balancing(data)
    truth = balancing_joints(data)
    theirs = np.load(found)["points"]
    with np.load(run / "work" / "person, refined.npz") as ours:
        px, variance = ours["array_points_px"], ours["array_variance_px2"]
    order = [names.index(n) for n in BODY23.names]
    sources = {
        "ours": (px, variance), "MediaPipe": (theirs[..., :2], np.where(theirs[..., 2] > 0.5, 1.0, np.nan)),
        "OpenPose (the reference)": (reference_px[:, :, order], reference_variance[:, :, order]),
    }  # fmt: skip
    print("| 2D | cameras | single frames: MPJPE, aligned, offset-free | smoothed | left out px |\n" + "|---" * 5 + "|")
    for name, (px, variance) in sources.items():
        px = np.where(np.isfinite(variance)[..., None], px, np.nan)
        repaired, weights, _ = repair_flips(cameras, px, variance, BODY23)
        refined = refine_people(cameras, repaired, weights, BODY23.names).cameras
        for label, group in (("as delivered", cameras), ("refined", refined)):
            repaired, weights, _ = repair_flips(group, px, variance, BODY23)
            result = triangulate(group, repaired, weights)
            points = Points3D(BODY23, result.points_world, result.covariance_world, result.residual_px, result.inlier,
                              60.0)  # fmt: skip
            smooth = smooth_points(points, SmoothOptions()).points_world
            left_out = np.nanmedian(leave_one_out_error(group, repaired, weights))
            cells = [
                reference_distances(p[:, [BODY23.index(j) for j in JOINTS]], truth)
                for p in (result.points_world, smooth)
            ]
            print(f"| {name} | {label} | {cells[0]} | {cells[1]} | {left_out:.1f} |", flush=True)


def frames(video: Path) -> np.ndarray:
    """(T, H, W, 3) BGR of every `EVERY`th frame."""
    import cv2

    reader, kept, number = cv2.VideoCapture(str(video)), [], 0
    while (read := reader.read())[0]:
        if number % EVERY == EVERY // 2:
            kept.append(read[1])
        number += 1
    if not kept:
        raise SystemExit(f"{video}: its {number} readable frames are too few")
    return np.stack(kept)


def find_boxes(video: Path, out: Path) -> None:
    """Write (N,) frame numbers and (N, 4) boxes, px."""
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


def find_people(video: Path, given: Path, out: Path) -> None:
    """Add (N, 23, 3) x, y in pixels and visibility."""
    pictures, stored, network = frames(video), dict(np.load(given)), open_mediapipe()
    seen = zip(stored["frame"], stored["box"], strict=True)
    np.savez(out, points=[read_box(network, pictures[frame], box[:2], box[2:]) for frame, box in seen], **stored)


def score_people(video: Path, given: Path) -> None:
    """Print the table of a video."""
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
    from muybridge.models.shipped import shipped_model
    from scripts.benchmarks.common import JOINTS

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
    """The last three cells of the table.

    Args:
        network: a keypoint network.
        pictures: RGB images of one person each.
        box: (N, 4) bounding boxes, px.
        theirs: (N, 12, 2) px, the other network's points of `JOINTS`.
        seen: (N, 12) which of these count.
    """
    from muybridge.geometry.cameras.crops import crops_for_boxes
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.infer.detection.crop_pixels import extract_crops
    from scripts.benchmarks.common import JOINTS

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
    """(N,) whether MediaPipe found the person inside the box and mostly visible."""
    low, high = points[..., :2].min(1), points[..., :2].max(1)
    both = np.clip(np.minimum(box[:, 2:], high) - np.maximum(box[:, :2], low), 0, None).prod(1)
    overlap = both / ((box[:, 2:] - box[:, :2]).prod(1) + (high - low).prod(1) - both)
    visible = (points[:, joints, 2] > 0.5).mean(1) >= LEAST_SEEN
    return (overlap > LEAST_OVERLAP) & visible & ((high - low)[:, 1] > LEAST_PX)


STEPS: dict[tuple[str, str], tuple[Any, int]] = {
    ("take", "find"): (find_take, 2), ("take", "score"): (score_take, 3), ("video", "boxes"): (find_boxes, 2),
    ("video", "find"): (find_people, 3), ("video", "score"): (score_people, 2),
}  # fmt: skip


def main() -> None:
    step, count = STEPS.get((*sys.argv[1:3],), (None, 0))  # type: ignore[arg-type]
    if step is None or len(sys.argv) != 3 + count:
        raise SystemExit(__doc__)
    step(*map(Path, sys.argv[3:]))


if __name__ == "__main__":
    main()
