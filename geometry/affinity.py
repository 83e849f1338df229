"""Pieces of tracks, how well those of different cameras agree, and the groups they form.

The part of `muybridge.geometry.association` that compares; that module chooses and follows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.cameras import CameraGroup
from muybridge.geometry.landmarks import Keypoints2D

_MIN_LANDMARKS = 4
_SAMPLED_FRAMES = 40
_PRIOR_FRAMES = 5.0


@dataclass(frozen=True)
class AssociateOptions:
    """How tracks of several cameras become people. Sizes are the longer side of a person's landmarks, px.

    Attributes:
        max_epipolar: epipolar distance, in body sizes, from which two tracks speak against each other.
        max_gap: frames without the person after which a track is cut (to be joined again by other cameras).
        max_jump: movement between two frames, in body sizes, at which a track is cut.
        min_frames: shorter pieces of a track only take part in the following frame by frame.
        max_tracks: at most so many pieces are compared, the longest and largest.
        follow: distance of a detection to the triangulated person, in body sizes, up to which it is this
            person; beyond twice of it, it is not.
    """

    max_epipolar: float = 0.10
    max_gap: int = 10
    max_jump: float = 0.6
    min_frames: int = 5
    max_tracks: int = 160
    follow: float = 0.2


@dataclass(frozen=True)
class Piece:
    """An unbroken piece of one camera's track."""

    camera: int
    slot: int
    frames: NDArray[np.int64]


@dataclass(frozen=True)
class Scene:
    """What is measured once: everything (C, T, P, ...)."""

    slopes: NDArray[np.float64]  # (C, T, P, J, 2) normalised coordinates
    centers: NDArray[np.float64]  # (C, T, P, 2) normalised
    size: NDArray[np.float64]  # (C, T, P) normalised; NaN where nobody is
    mirror: NDArray[np.int64]  # (J,)


def scene_of(cameras: CameraGroup, keypoints: Keypoints2D) -> Scene:
    slopes = cameras.unproject(keypoints.points_px)
    size = extent(slopes)
    size[~(size > 0)] = np.nan
    slopes[np.isnan(size)] = np.nan
    low, high = _box(slopes)
    return Scene(slopes, 0.5 * (low + high), size, np.array(keypoints.landmarks.mirror))


def cut_tracks(scene: Scene, options: AssociateOptions) -> list[Piece]:
    """The tracks, cut at pauses and jumps; the longest and largest."""
    pieces: list[Piece] = []
    cameras, total, people = scene.size.shape
    least = min(options.min_frames, max(1, total // 4))
    for c in range(cameras):
        for p in range(people):
            frames = np.flatnonzero(np.isfinite(scene.size[c, :, p]))
            if frames.size == 0:
                continue
            gap = np.diff(frames)
            moved = np.linalg.norm(np.diff(scene.centers[c, frames, p], axis=0), axis=-1)
            size = np.minimum(scene.size[c, frames[1:], p], scene.size[c, frames[:-1], p])
            cut = (gap > options.max_gap) | (moved > options.max_jump * size * np.sqrt(gap))
            for piece in np.split(frames, np.flatnonzero(cut) + 1):
                if piece.size >= least:
                    pieces.append(Piece(c, p, piece))

    def importance(piece: Piece) -> float:
        return float(np.sum(scene.size[piece.camera, piece.frames, piece.slot]))

    return sorted(pieces, key=importance, reverse=True)[: options.max_tracks]


def affinities(
    cameras: CameraGroup, scene: Scene, pieces: list[Piece], options: AssociateOptions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, N) how well pieces agree, in -1..1, and (N, N) the frames on which that rests (zero: unknown)."""
    count = len(pieces)
    affinity, weight = np.zeros((count, count)), np.zeros((count, count))
    for i, a in enumerate(pieces):
        for k in range(i):
            b = pieces[k]
            if a.camera == b.camera:
                continue
            common = np.intersect1d(a.frames, b.frames, assume_unique=True)
            if common.size == 0:
                continue
            sample = common[:: max(1, -(-common.size // _SAMPLED_FRAMES))]
            value, sure = _agreement(cameras, scene, a, b, sample, options)
            affinity[i, k] = affinity[k, i] = value
            weight[i, k] = weight[k, i] = sure * common.size
    return affinity, weight


def _agreement(
    cameras: CameraGroup,
    scene: Scene,
    a: Piece,
    b: Piece,
    frames: NDArray[np.int64],
    options: AssociateOptions,
) -> tuple[float, float]:
    """How well two pieces agree over the frames, in -1..1, and how much that can be trusted, 0..1."""
    points_a, points_b = scene.slopes[a.camera, frames, a.slot], scene.slopes[b.camera, frames, b.slot]
    size_a, size_b = scene.size[a.camera, frames, a.slot], scene.size[b.camera, frames, b.slot]
    b_from_a = _relative(cameras, a.camera, b.camera)
    # Labels of left and right may be exchanged in one of the views: the better reading counts, as does the
    # middle of every pair, which does not care.
    twins = scene.mirror
    readings = (
        (points_a, points_b),
        (points_a, points_b[:, twins]),
        (0.5 * (points_a + points_a[:, twins]), 0.5 * (points_b + points_b[:, twins])),
    )
    distances = np.stack([_epipolar(b_from_a, p, q, size_a, size_b) for p, q in readings])
    per_frame = np.min(np.where(np.isnan(distances), np.inf, distances), axis=0)
    per_frame = per_frame[np.isfinite(per_frame)]
    if per_frame.size == 0:
        return 0.0, 0.0
    center_a, center_b = scene.centers[a.camera, frames, a.slot], scene.centers[b.camera, frames, b.slot]
    depth_a, depth_b = _depths(b_from_a, center_a, center_b)
    in_front = (depth_a > 0) & (depth_b > 0)
    if in_front.mean() < 0.5:
        return -1.0, 1.0
    # The same person has about one size, whoever looks.
    ratio = np.median(np.abs(np.log((size_a * depth_a)[in_front] / (size_b * depth_b)[in_front])))
    error = float(np.median(per_frame)) + options.max_epipolar * max(0.0, ratio - np.log(1.5))
    # Who stands between two cameras that face each other agrees with everybody.
    sure = float(np.median(_epipole_distance(b_from_a, center_a, center_b, size_a, size_b)))
    return float(np.clip(1.0 - error / options.max_epipolar, -1.0, 1.0)), min(1.0, sure)


def _relative(cameras: CameraGroup, a: int, b: int) -> NDArray[np.float64]:
    """(3, 4) b_from_a of two cameras."""
    a_pose, b_pose = cameras[a].cam_from_world, cameras[b].cam_from_world
    rotation = b_pose[:, :3] @ a_pose[:, :3].T
    return np.hstack([rotation, (b_pose[:, 3] - rotation @ a_pose[:, 3])[:, None]])


def _homogeneous(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def _epipolar(
    b_from_a: NDArray[np.float64],
    points_a: NDArray[np.float64],
    points_b: NDArray[np.float64],
    size_a: NDArray[np.float64],
    size_b: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(F,) median over landmarks of the Sampson distance in body sizes; points (F, J, 2), sizes (F,)."""
    x, y, z = b_from_a[:, 3] / max(float(np.linalg.norm(b_from_a[:, 3])), 1e-12)
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ b_from_a[:, :3]
    ray_a, ray_b = _homogeneous(points_a), _homogeneous(points_b)
    line_b = ray_a @ essential.T
    line_a = ray_b @ essential
    error = np.abs(np.sum(ray_b * line_b, axis=-1))
    slope2 = np.sum(line_a[..., :2] ** 2, axis=-1) * size_a[:, None] ** 2
    slope2 += np.sum(line_b[..., :2] ** 2, axis=-1) * size_b[:, None] ** 2
    # The scale of the Sampson distance of two equal errors is that of one of them.
    distance = error / np.sqrt(np.maximum(slope2, 1e-24)) * np.sqrt(2.0)
    return row_median(distance)


def row_median(values: NDArray[np.float64], least: int = _MIN_LANDMARKS) -> NDArray[np.float64]:
    """Medians over the last axis without its NaNs; NaN with fewer than `least` numbers (or all, if fewer)."""
    count = np.isfinite(values).sum(axis=-1)
    # Sorted, NaN come last. Many times faster than nanmedian.
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=-1)
    last = np.maximum(count - 1, 0)
    low = np.take_along_axis(ordered, (last // 2)[..., None], axis=-1)[..., 0]
    high = np.take_along_axis(ordered, ((last + 1) // 2)[..., None], axis=-1)[..., 0]
    enough = count >= max(1, min(least, values.shape[-1]))
    return np.where(enough, 0.5 * (low + high), np.nan)


def _depths(
    b_from_a: NDArray[np.float64], points_a: NDArray[np.float64], points_b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(F,) depths in a and in b of the points nearest to two rays each, (F, 2)."""
    ray_a = _homogeneous(points_a) @ b_from_a[:, :3].T
    ray_b = _homogeneous(points_b)
    between = -b_from_a[:, 3]
    aa, bb, ab = (np.sum(p * q, axis=-1) for p, q in ((ray_a, ray_a), (ray_b, ray_b), (ray_a, ray_b)))
    ra, rb = ray_a @ between, ray_b @ between
    det = np.maximum(aa * bb - ab * ab, 1e-9 * aa * bb)
    return (bb * ra - ab * rb) / det, (ab * ra - aa * rb) / det


def _epipole_distance(
    b_from_a: NDArray[np.float64],
    center_a: NDArray[np.float64],
    center_b: NDArray[np.float64],
    size_a: NDArray[np.float64],
    size_b: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(F,) how far the person is from where the cameras see each other, in body sizes, the nearer of both."""
    a_in_b = b_from_a[:, 3]
    b_in_a = -b_from_a[:, :3].T @ b_from_a[:, 3]
    nearest = np.full(size_a.shape, np.inf)
    for other, center, size in ((b_in_a, center_a, size_a), (a_in_b, center_b, size_b)):
        if abs(other[2]) > 1e-9:
            away = np.linalg.norm(center - other[:2] / other[2], axis=-1) / size
            nearest = np.minimum(nearest, away)
    return nearest


def group_pieces(
    pieces: list[Piece], evidence: NDArray[np.float64], weight: NDArray[np.float64]
) -> list[list[int]]:
    """Groups of pieces with positive evidence inside, no two of one camera at the same time."""
    count = len(pieces)
    clash = np.zeros((count, count), dtype=np.bool_)
    for i, a in enumerate(pieces):
        for k, b in enumerate(pieces[:i]):
            if a.camera == b.camera:
                both = np.intersect1d(a.frames, b.frames, assume_unique=True).size
                clash[i, k] = clash[k, i] = both > 0.2 * min(a.frames.size, b.frames.size)
    groups = [[i] for i in range(count)]
    while len(groups) > 1:
        # Average linkage, drawn to zero where it rests on few frames.
        member = np.zeros((len(groups), count))
        for g, group in enumerate(groups):
            member[g, group] = 1.0
        gain = member @ evidence @ member.T / (member @ weight @ member.T + _PRIOR_FRAMES)
        gain[(member @ clash @ member.T) > 0] = -np.inf
        np.fill_diagonal(gain, -np.inf)
        g, h = divmod(int(np.argmax(gain)), len(groups))
        if gain[g, h] <= 0:
            break
        groups[min(g, h)] += groups.pop(max(g, h))
    return _settled(groups, evidence, clash)


def _settled(
    groups: list[list[int]], evidence: NDArray[np.float64], clash: NDArray[np.bool_]
) -> list[list[int]]:
    """Moves single pieces to the group with most evidence for them, as greedy grouping errs early."""
    label = np.empty(evidence.shape[0], dtype=np.int64)
    for g, group in enumerate(groups):
        label[group] = g
    for _ in range(5):
        moved = False
        for i in range(label.size):
            options = [(0.0, -1)]
            for g in np.unique(label):
                others = (label == g) & (np.arange(label.size) != i)
                if others.any() and not clash[i, others].any():
                    options.append((float(evidence[i, others].sum()), int(g)))
            current = label[i]
            stay = next((value for value, g in options if g == current), 0.0)
            value, target = max(options)
            if value > stay + 1e-9:
                label[i] = target if target >= 0 else label.max() + 1
                moved = True
        if not moved:
            break
    return [np.flatnonzero(label == g).tolist() for g in np.unique(label)]


def _box(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates (..., 2) of points (..., J, 2); NaN with fewer than `_MIN_LANDMARKS`."""
    known = np.isfinite(points).all(axis=-1, keepdims=True)
    enough = known.sum(axis=-2) >= min(_MIN_LANDMARKS, points.shape[-2])
    low = np.where(known, points, np.inf).min(axis=-2)
    high = np.where(known, points, -np.inf).max(axis=-2)
    return np.where(enough, low, np.nan), np.where(enough, high, np.nan)


def extent(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) longer side of the box round points (..., J, 2); NaN with fewer than `_MIN_LANDMARKS`."""
    low, high = _box(points)
    longer: NDArray[np.float64] = (high - low).max(axis=-1)
    return longer
