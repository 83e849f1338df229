"""Several people crossing: identity switches, and the cost of company in accuracy.

Usage: python -m scripts.benchmarks.takes.people --takes 6

Model: people of 1.55 to 1.95 m walk to and fro through the middle of a room of 6 x 6 m and past each other (at least 35
cm between their centres), at 0.7 to 1.5 m/s, with swinging limbs, and turn within 0.7 s; 4 to 6 cameras of 1920 x 1080
px stand around at heights of 1.2 to 3 m; 30 frames per second. Detections of a camera: landmarks with Gaussian noise of
4 px, 3 % of them with additional noise of 60 px, 2 % of the poses with left and right flipped, landmarks outside the
image and 5 % of the others missing; a person is missed in 5 % of the frames, and whenever nearer people cover 60 % of
the bounding box; one false person of random pose every other frame on average, lasting 1 to 12 frames. Detections
become tracks by their boxes, with the tracker of `muybridge run` and its errors at crossings.

Identity switches are those of CLEAR MOT (Bernardin and Stiefelhagen 2008): a true person keeps the match while it is
within 0.4 m, the others are matched one to one by least distance, and a switch is a match with another person than the
last (per 1,000 frames of a person in the table). The error is that of the final smoothed landmarks; "alone" is each
person with the others removed from the same take, so that nobody occludes them, at the same frames.
"""

import argparse
import time

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import linear_sum_assignment

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.association.select import find_people, take_person
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation.left_right import repair_flips
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.shape_prior import apply_pose_prior
from muybridge.infer.detection.tracker import Tracker, TrackOptions
from muybridge.models.people.decode import DetectedPeople
from tests.rigs import look_at

WIDTH, HEIGHT = 1920, 1080
NOISE_PX, NEAR_M, LEAST_APART_M = 4.0, 0.4, 0.35
_HALF = {
    "eye": (0.03, -0.10, 1.65), "ear": (0.07, 0.0, 1.63), "shoulder": (0.18, 0.0, 1.45),
    "elbow": (0.22, 0.02, 1.18), "wrist": (0.24, -0.10, 0.95), "hip": (0.10, 0.0, 0.95),
    "knee": (0.11, -0.03, 0.52), "ankle": (0.11, 0.03, 0.09), "big_toe": (0.13, -0.16, 0.03),
    "small_toe": (0.17, -0.12, 0.03), "heel": (0.11, 0.09, 0.03),
}  # fmt: skip
# Standing, 1.75 m: x to the left, y backwards, z up.
BODY = np.array([
    (0.0, -0.12, 1.60) if n == "nose" else _HALF[n.split("_", 1)[1]] * np.array([1.0 if n[0] == "l" else -1.0, 1, 1])
    for n in BODY23.names
])  # fmt: skip
SWING = np.array([0.0 if z > 1.3 or abs(x) < 0.01 else np.sign(x) * (1.4 - z) * (1 if z < 0.9 else -1)
                  for x, _, z in BODY])  # fmt: skip


def room(count: int, rng: np.random.Generator) -> CameraGroup:
    """Cameras around the room, facing its middle."""
    cameras = []
    for c in range(count):
        angle = 2 * np.pi * (c + rng.uniform(-0.2, 0.2)) / count
        center = np.array([*(rng.uniform(4.5, 6.0) * np.array([np.cos(angle), np.sin(angle)])), rng.uniform(1.2, 3.0)])
        pose = look_at(center, [*rng.normal(0, 0.3, 2), 0.9])
        focal = rng.uniform(1000, 1400)
        cameras.append(Camera(f"cam{c + 1}", "PINHOLE", WIDTH, HEIGHT, (focal, focal, 959.5, 539.5), pose))
    return CameraGroup(tuple(cameras))


def walkers(count: int, frames: int, rng: np.random.Generator, fps: float = 30.0) -> FloatArray:
    """(N, T, J, 3) metres."""
    turning = 2 * round(fps / 3) + 1
    paths, bodies, turns = [], [], []
    for k in range(count):
        heading = np.pi * (k + rng.uniform(-0.3, 0.3)) / count
        along = np.array([np.cos(heading), np.sin(heading)])
        aside = rng.uniform(-0.3, 0.3) * np.array([-along[1], along[0]])
        speed, phase, reach = rng.uniform(0.7, 1.5), rng.uniform(0, 4), rng.uniform(1.5, 2.4)
        run = (np.arange(frames) / fps * speed / reach + phase) % 4
        way = np.convolve(
            np.pad(np.where(run < 2, 1.0, -1.0), turning // 2, mode="edge"), np.full(turning, 1 / turning), "valid"
        )
        paths.append(reach * np.where(run < 2, run - 1, 3 - run)[:, None] * along + aside)
        turns.append(heading + np.pi / 2 * (1 - way) + np.pi / 2)
        body = np.repeat(BODY[None], frames, axis=0)
        body[..., 1] += 0.35 * SWING * np.sin(2 * np.pi * 0.9 * np.arange(frames) / fps + phase)[:, None]
        bodies.append(body * rng.uniform(1.55, 1.95) / 1.75)
    path = _separate_paths(np.stack(paths), fps / 5)
    body, turn = np.stack(bodies), np.stack(turns)[..., None]
    x = body[..., 0] * np.cos(turn) - body[..., 1] * np.sin(turn) + path[..., :1]
    y = body[..., 0] * np.sin(turn) + body[..., 1] * np.cos(turn) + path[..., 1:]
    return np.stack([x, y, body[..., 2]], -1)


def _separate_paths(path: FloatArray, smooth: float) -> FloatArray:
    """(N, T, 2) paths that avoid each other, smoothed over `smooth` frames."""
    for _ in range(200):
        between = path[:, None] - path[None]
        away = np.linalg.norm(between, axis=-1, keepdims=True)
        away[np.arange(len(path)), np.arange(len(path))] = np.inf
        if away.min() > LEAST_APART_M:
            break
        push = np.clip(1.15 * LEAST_APART_M - away, 0, None) * between / np.maximum(away, 1e-6)
        push[~np.isfinite(push)] = 0.0
        path = path + gaussian_filter1d(push.sum(1), smooth, axis=1, mode="nearest")
    return path


def boxes_of(px: FloatArray) -> FloatArray:
    """(..., J, 2) to (..., 4), slightly wider than the landmarks."""
    low, high = np.nanmin(px, -2), np.nanmax(px, -2)
    margin = 0.06 * (high - low).max(-1, keepdims=True)
    return np.concatenate([low - margin, high + margin], -1)


def covered(boxes: FloatArray, depth: FloatArray) -> BoolArray:
    """(N,) whether 60 % of a box are behind a nearer one."""
    low = np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    share = np.clip(high - low, 0, None).prod(-1) / (boxes[:, 2:] - boxes[:, :2]).prod(-1)[:, None]
    return np.any((share > 0.6) & (depth[None] < depth[:, None]), axis=1)


def camera_tracks(
    camera: Camera, people: FloatArray, rng: np.random.Generator, slots: int, fps: float
) -> tuple[FloatArray, FloatArray]:
    """One camera's landmarks by slot: (T, P, J, 2) px and (T, P) score."""
    count, frames, landmarks = people.shape[:3]
    true_px = camera.project(people)
    depth = (people.mean(2) @ camera.rotation.T + camera.cam_from_world[:, 3])[..., 2]
    noise = rng.normal(0, NOISE_PX, true_px.shape)
    noise += (rng.random(true_px.shape[:3]) < 0.03)[..., None] * rng.normal(0, 60, true_px.shape)
    px = true_px + noise
    exchanged = rng.random((count, frames)) < 0.02
    px[exchanged] = px[exchanged][:, list(BODY23.mirror)]
    inside = ((true_px > 0) & (true_px < [WIDTH, HEIGHT])).all(-1)
    px[~inside | (rng.random(inside.shape) < 0.05)] = np.nan
    missed = rng.random((count, frames)) < 0.05
    tracker = Tracker(np.array([-0.5, -0.5, WIDTH - 0.5, HEIGHT - 0.5]), TrackOptions(max_people=slots), fps)
    out, score = np.full((frames, slots, landmarks, 2), np.nan), np.zeros((frames, slots))
    false: list[tuple[int, FloatArray]] = []
    for t in range(frames):
        false = [(left - 1, pose + rng.normal(0, 3, 2)) for left, pose in false if left > 1]
        if rng.random() < 0.5 / 6.5:
            pose = rng.normal(0, 1, (landmarks, 2)) * rng.uniform(40, 120) + rng.uniform([0, 0], [WIDTH, HEIGHT])
            false.append((int(rng.integers(1, 13)), pose))
        seen = ~missed[:, t] & (inside[:, t].sum(-1) >= 8) & ~covered(boxes_of(true_px[:, t]), depth[:, t])
        poses = [*px[seen, t], *(pose for _, pose in false)]
        sure = [0.9] * int(seen.sum()) + [0.5] * len(false)
        order = rng.permutation(len(poses))
        found = np.array([boxes_of(poses[k]) for k in order]).reshape(-1, 4)
        tracked = tracker.step(DetectedPeople(found, np.array([sure[k] for k in order])))
        for slot in np.flatnonzero(tracked.seen):
            k = int(np.argmin(np.abs(found - tracked.boxes_px[slot]).sum(-1)))
            out[t, slot], score[t, slot] = poses[order[k]], sure[order[k]]
    return out, score


def keypoints_of(cameras: CameraGroup, people: FloatArray, seed: int, slots: int, fps: float = 30.0) -> Keypoints2D:
    """Keypoints of all cameras."""
    rng = np.random.default_rng(seed)
    own = [np.random.default_rng(rng.integers(1 << 31)) for _ in cameras]
    parts = [camera_tracks(c, people, draws, slots, fps) for c, draws in zip(cameras, own, strict=True)]
    px = np.stack([p for p, _ in parts])
    known = np.isfinite(px).all(-1)
    score = np.where(known, np.stack([s for _, s in parts])[..., None], 0.0)
    return Keypoints2D(BODY23, px, np.where(known, NOISE_PX**2, np.nan), score)


def solved(cameras: CameraGroup, keypoints: Keypoints2D, fps: float = 30.0) -> list[FloatArray]:
    """(T, J, 3) of everyone seen by two cameras."""
    found = []
    for person in find_people(cameras, keypoints, fps=fps):
        if person.seen_share <= 0:
            continue
        px, variance, _ = take_person(keypoints, person)
        px, variance, _ = repair_flips(cameras, px, variance, BODY23)
        cloud = triangulate(cameras, px, variance)
        cloud = apply_pose_prior(cameras, px, variance, BODY23, fps, cloud)
        points = Points3D(BODY23, cloud.points_world, cloud.covariance_world, cloud.residual_px, cloud.inlier, fps)
        found.append(smooth_points(points, SmoothOptions()).points_world)
    return found


def match(truth: FloatArray, found: list[FloatArray]) -> tuple[int, IntArray]:
    """Identity switches, and (N, T) index of the found person of each true one in each frame, -1 if none."""
    result = np.full(truth.shape[:2], -1)
    if not found:
        return 0, result
    error = np.linalg.norm(np.stack(found)[:, None] - truth[None], axis=-1)  # (F, N, T, J)
    with np.errstate(all="ignore"):
        away = np.nanmedian(error, axis=-1)
    away = np.where(np.isfinite(away) & (away < NEAR_M), away, 100.0)
    last = np.full(len(truth), -1)
    switches = 0
    for t in range(truth.shape[1]):
        cost = away[:, :, t].copy()
        for n in np.flatnonzero(last >= 0):
            if cost[last[n], n] < NEAR_M:
                cost[last[n], n] = -100.0  # keeps its match
        for f, n in zip(*linear_sum_assignment(cost), strict=True):
            if away[f, n, t] < NEAR_M:
                switches += int(last[n] >= 0 and last[n] != f)
                last[n] = result[n, t] = f
    return switches, result


def matched_points(found: list[FloatArray], which: IntArray) -> FloatArray:
    """(N, T, J, 3) of the found people in the order of the true ones, NaN where nobody was found."""
    if not found:
        return np.full((*which.shape, 1, 3), np.nan)
    points = np.stack(found)[which, np.arange(which.shape[1])]
    return np.where((which >= 0)[..., None, None], points, np.nan)


def compare(truth: FloatArray, found: list[FloatArray]) -> tuple[int, FloatArray]:
    """Identity switches, and the error (N, T, J) of the matched landmarks in mm, NaN where unmatched."""
    switches, which = match(truth, found)
    return switches, 1000 * np.linalg.norm(matched_points(found, which) - truth, axis=-1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=4, help="of each kind")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fps", type=float, default=30.0)
    options = parser.parse_args()
    print("| people | cameras | frames | found | switches per 1,000 | MPJPE mm | alone mm | frames/s |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)
    for count in (2, 3, 4, 5):
        for cams in (4, 6):
            rows = []
            for take in range(options.takes):
                rows.append(_measure(count, cams, options, options.seed + 1000 * count + 100 * cams + take))
            found, switches, error, alone, seconds = (np.array(v, float) for v in zip(*rows, strict=True))
            total = options.takes * options.frames
            print(f"| {count} | {cams} | {total} | {found.mean():.3f} | {1000 * switches.sum() / (total * count):.2f} "
                  f"| {error.mean():.1f} | {alone.mean():.1f} | {total / seconds.sum():.0f} |", flush=True)  # fmt: skip


def _measure(count: int, cams: int, options: argparse.Namespace, seed: int) -> tuple[float, int, float, float, float]:
    """Share of the true people's frames found, switches, error, error alone, seconds."""
    slots, rng = max(count + 1, TrackOptions().max_people), np.random.default_rng(seed)
    fps = options.fps
    cameras, people = room(cams, rng), walkers(count, options.frames, rng, fps)
    keypoints = keypoints_of(cameras, people, seed, slots, fps)
    start = time.perf_counter()
    found = solved(cameras, keypoints, fps)
    seconds = time.perf_counter() - start
    switches, error = compare(people, found)
    single = np.concatenate([
        compare(one[None], solved(cameras, keypoints_of(cameras, one[None], seed + n, slots, fps), fps))[1]
        for n, one in enumerate(people)
    ])  # fmt: skip
    both = np.isfinite(error) & np.isfinite(single)
    return float(np.isfinite(error).any(-1).mean()), switches, error[both].mean(), single[both].mean(), seconds


if __name__ == "__main__":
    main()
