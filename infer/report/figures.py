"""The figures of a report: agreement of the cameras, gaps, bone lengths, and signs of errors.

All are pure functions of the cameras, the 3D points and, where given, the 2D points they were triangulated from.
Shapes: `C` cameras, `T` frames, `J` landmarks.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.runtime.wording import readable


@dataclass(frozen=True)
class Headline:
    """The take in five numbers.

    Attributes:
        from_body: whether `agreement_mm` is the distance to the fitted body, because there are no cameras.
        coverage: share of frames and landmarks with a 3D position in the results.
        measured_coverage: the same before gaps were filled.
        residual_px: median distance of a 2D point to its reprojection, over all cameras.
        leave_one_out_px: median leave-one-camera-out error; NaN if unknown.
        agreement_mm: the latter at the person, mm; the former where it is unknown.
    """

    coverage: float
    measured_coverage: float
    residual_px: float
    leave_one_out_px: float
    agreement_mm: float
    from_body: bool = False


@dataclass(frozen=True)
class CameraFigures:
    """One camera's contribution, and how well it agrees.

    Attributes:
        name: the camera's name.
        seen: share of frames and landmarks with a 2D point in this camera.
        rejected: share of those 2D points that were rejected.
        residual_px: median distance of the reprojection to the 2D point; NaN if there is none.
        residual_p95_px: its 95th percentile.
        leave_one_out_px: median leave-one-camera-out error; NaN if unknown.
        unanswered: share of the 2D points for which the other cameras gave no 3D point; NaN if unknown.
        mm_per_px: size of a pixel at the person's median distance, mm.
        bias_px: (2,) median of 2D point minus reprojection, x and y; NaN if unknown.
        lag_frames: by how much this camera's video is ahead: its frame t shows what the others show at
            t + lag_frames; NaN if it cannot be determined (too little motion).
        flipped: share of left-right pairs whose 2D points fit better when flipped.
        flipped_frame: a frame in the middle of the longest run of flipped pairs; -1 if there is none.
    """

    name: str
    seen: float
    rejected: float
    residual_px: float
    residual_p95_px: float
    leave_one_out_px: float
    unanswered: float
    mm_per_px: float
    bias_px: FloatArray
    lag_frames: float
    flipped: float
    flipped_frame: int

    @property
    def shift_px(self) -> float:
        """Length of the constant offset."""
        return float(np.linalg.norm(self.bias_px))


@dataclass(frozen=True)
class BoneFigures:
    """Length of one bone over the take.

    Attributes:
        name: the bone's two ends, readable.
        median_m: median length, metres; NaN if it is never known.
        spread_m: half of the range that holds the middle 68 % of the frames (a robust standard deviation).
        worst_frame: frame that is farthest from the median, -1 if none.
        twin: index of the bone on the other side, -1 if there is none.
    """

    name: str
    median_m: float
    spread_m: float
    worst_frame: int
    twin: int

    @property
    def spread(self) -> float:
        """`spread_m` as a share of the length; 0 where that is unknown."""
        return self.spread_m / self.median_m if self.median_m > 0 else 0.0


@dataclass(frozen=True)
class Gap:
    """A run of frames without a landmark: `first` to `last`, both included."""

    landmark: int
    first: int
    last: int

    @property
    def frames(self) -> int:
        """Length of the gap."""
        return self.last - self.first + 1


@dataclass(frozen=True)
class Timeline:
    """The take in a limited number of columns, for drawing.

    Attributes:
        first_frame: (B,) first frame of each column.
        missing: (B, J) share of the column's frames without the landmark.
        cameras: (B, J) mean number of cameras that agree on the landmark, over the frames that have it.
        residual_px: (B, C) median residual of a camera; NaN where it had no 2D point.
    """

    first_frame: IntArray
    missing: FloatArray
    cameras: FloatArray
    residual_px: FloatArray


def nanmedian(values: NDArray[np.floating], axis: int | tuple[int, ...] | None = None) -> FloatArray:
    """`np.nanmedian` without its warning: NaN where there are no values."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        median: FloatArray = np.nanmedian(values, axis=axis)
    return median


def _share(mask: BoolArray) -> float:
    return float(mask.mean()) if mask.size else float("nan")


def _finite(vectors: FloatArray) -> BoolArray:
    """Which vectors of the last axis have no NaN."""
    return np.asarray(np.isfinite(vectors).all(axis=-1))


def coverage(points: Points3D) -> float:
    """Share of frames and landmarks that have a 3D position."""
    return _share(_finite(points.points_world))


def headline(
    cameras: CameraGroup | None,
    measured: Points3D,
    delivered: Points3D,
    leave_one_out_px: FloatArray | None,
    body_residual_m: FloatArray | None = None,
) -> Headline:
    """The figures at the top of a report.

    Args:
        cameras: C cameras; None where points come from a file.
        measured: the triangulated points.
        delivered: the points as written to files.
        leave_one_out_px: (C, T, J), NaN where unknown.
        body_residual_m: (T, J) metres from the fitted body, used without cameras.
    """
    if cameras is None:
        from_body = np.full(1, np.nan) if body_residual_m is None else body_residual_m
        agreement = 1000.0 * float(nanmedian(from_body))
        return Headline(coverage(delivered), coverage(measured), float("nan"), float("nan"), agreement, True)
    residual = measured.residual_px
    loo = np.full(residual.shape, np.nan) if leave_one_out_px is None else leave_one_out_px
    best = loo if np.isfinite(loo).any() else residual
    return Headline(
        coverage=coverage(delivered),
        measured_coverage=coverage(measured),
        residual_px=float(nanmedian(residual)),
        leave_one_out_px=float(nanmedian(loo)),
        agreement_mm=float(nanmedian(best * mm_per_px(cameras, measured)[:, None, None])),
    )


def mm_per_px(cameras: CameraGroup, points: Points3D) -> FloatArray:
    """(C,) size of a pixel at the person's median distance, mm; NaN if nobody was found."""
    values = []
    for camera in cameras:
        depth = (points.points_world - camera.center_world) @ camera.rotation[2]
        focal = float(np.mean(np.diag(camera.camera_matrix)[:2]))
        values.append(1000.0 * float(nanmedian(depth)) / focal)
    return np.array(values)


def camera_figures(
    cameras: CameraGroup, points: Points3D, keypoints_px: FloatArray | None, leave_one_out_px: FloatArray | None
) -> tuple[CameraFigures, ...]:
    """Figures of every camera.

    Args:
        cameras: C cameras.
        points: 3D points of T frames.
        keypoints_px: (C, T, J, 2) the 2D points they came from; without them bias, lag and flips are unknown.
        leave_one_out_px: (C, T, J) leave-one-camera-out error; NaN where there is no 2D point, or no 3D point from the
            other cameras.
    """
    offset = projected = None
    if keypoints_px is not None:
        projected = cameras.project(points.points_world)
        offset = keypoints_px - projected
    lags = np.full(len(cameras), np.nan) if offset is None else lag_frames(offset, projected)
    scale = mm_per_px(cameras, points)
    figures = []
    for c, camera in enumerate(cameras):
        residual = points.residual_px[c]
        seen: BoolArray = np.isfinite(residual)
        has_2d = seen if keypoints_px is None else _finite(keypoints_px[c])
        loo = np.full(residual.shape, np.nan) if leave_one_out_px is None else leave_one_out_px[c]
        flipped: BoolArray = np.zeros((0, 0), bool)
        if keypoints_px is not None and projected is not None:
            flipped = flipped_pairs(keypoints_px[c], projected[c], points.landmarks)
        figures.append(
            CameraFigures(
                name=camera.name,
                seen=_share(has_2d),
                rejected=_share(~points.inlier[c][seen]) if seen.any() else float("nan"),
                residual_px=float(nanmedian(residual)),
                residual_p95_px=float(np.nanquantile(residual, 0.95)) if seen.any() else float("nan"),
                leave_one_out_px=float(nanmedian(loo)),
                unanswered=(_share(~np.isfinite(loo[has_2d])) if leave_one_out_px is not None else float("nan")),
                mm_per_px=float(scale[c]),
                bias_px=np.full(2, np.nan) if offset is None else nanmedian(offset[c], axis=(0, 1)),
                lag_frames=float(lags[c]),
                flipped=_share(flipped),
                flipped_frame=_middle_of_longest_run(np.asarray(flipped.any(axis=1))) if flipped.size else -1,
            )
        )
    return tuple(figures)


def lag_frames(offset_px: FloatArray, projected_px: FloatArray | None) -> FloatArray:
    """Time offset of every camera from the others, from its 2D points during motion.

    A 2D point that is `d` frames ahead is displaced from its reprojection by `d` times the image velocity. The 3D point
    is a mean over the cameras and so contains a part of the lag; the difference to the other cameras' median corrects
    for it.

    Args:
        offset_px: (C, T, J, 2) 2D point minus reprojection.
        projected_px: (C, T, J, 2) reprojections.

    Returns:
        (C,) frames, positive where the camera is ahead of the others; NaN where motion explains less than a
        tenth of the camera's residuals or there is too little of it.
    """
    count = len(offset_px)
    slopes, explained = np.full(count, np.nan), np.zeros(count)
    if projected_px is None or projected_px.shape[1] < 5:
        return slopes
    velocity = np.gradient(projected_px, axis=1)
    for c in range(count):
        r = offset_px[c] - nanmedian(offset_px[c], axis=(0, 1))
        size = np.linalg.norm(r, axis=-1)
        speed = np.linalg.norm(velocity[c], axis=-1)
        # Wrong 2D points and still landmarks carry no information about time.
        use = (size < 4.0 * np.nan_to_num(nanmedian(size))) & (speed > 0.5)
        if use.sum() < 50:
            continue
        r, v = r[use], velocity[c][use]
        slopes[c] = float((r * v).sum() / (v * v).sum())
        explained[c] = 1.0 - float(((r - slopes[c] * v) ** 2).sum() / max((r * r).sum(), 1e-9))
    lags = np.full(count, np.nan)
    for c in np.flatnonzero(np.isfinite(slopes) & (explained > 0.1)).tolist():
        others = np.delete(slopes, c)
        lags[c] = slopes[c] - (float(nanmedian(others)) if np.isfinite(others).any() else 0.0)
    return lags


def flipped_pairs(keypoints_px: FloatArray, projected_px: FloatArray, landmarks: LandmarkSet) -> BoolArray:
    """(T, pairs) where the 2D points of a left-right pair fit much better when flipped.

    Args:
        keypoints_px: (T, J, 2) 2D points of one camera.
        projected_px: (T, J, 2) reprojections into it.
        landmarks: names of the `J` axis.
    """
    left = [i for i, name in enumerate(landmarks.names) if name.startswith("left_")]
    right = [landmarks.mirror[i] for i in left]

    def distance(a: list[int], b: list[int]) -> FloatArray:
        return np.asarray(np.linalg.norm(keypoints_px[:, a] - projected_px[:, b], axis=-1))

    straight = distance(left, left) + distance(right, right)
    crossed = distance(left, right) + distance(right, left)
    apart = np.linalg.norm(projected_px[:, left] - projected_px[:, right], axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray((crossed < 0.4 * straight) & (straight > apart))


def _middle_of_longest_run(mask: BoolArray) -> int:
    runs = _runs(mask)
    if not runs:
        return -1
    first, last = max(runs, key=lambda run: run[1] - run[0])
    return (first + last) // 2


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """(first, last) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def gaps(points: Points3D) -> tuple[Gap, ...]:
    """Every run of frames without a landmark, the longest first."""
    missing = ~_finite(points.points_world)
    found = [Gap(j, a, b) for j in range(missing.shape[1]) for a, b in _runs(missing[:, j])]
    return tuple(sorted(found, key=lambda gap: (-gap.frames, gap.first, gap.landmark)))


def bone_figures(points: Points3D) -> tuple[BoneFigures, ...]:
    """Length of every bone of the landmark set over the take, without the face, which has no long bones."""
    landmarks = points.landmarks
    face = {"nose", "left_eye", "right_eye", "left_ear", "right_ear"}
    edges = [e for e in landmarks.edges if not face & set(e)]
    mirror = landmarks.mirror
    keys = [frozenset((landmarks.index(a), landmarks.index(b))) for a, b in edges]
    figures: list[BoneFigures] = []
    for (a, b), key in zip(edges, keys, strict=True):
        i, j = landmarks.index(a), landmarks.index(b)
        length = np.linalg.norm(points.points_world[:, i] - points.points_world[:, j], axis=-1)
        other = frozenset(mirror[k] for k in key)
        twin = keys.index(other) if other != key and other in keys else -1
        median, spread, worst = float("nan"), float("nan"), -1
        if np.isfinite(length).any():
            low, median, high = (float(q) for q in np.nanquantile(length, [0.16, 0.5, 0.84]))
            spread, worst = 0.5 * (high - low), int(np.nanargmax(np.abs(length - median)))
        figures.append(BoneFigures(_bone_name(a, b), median, spread, worst, twin))
    return tuple(figures)


def _bone_name(a: str, b: str) -> str:
    """``left knee to ankle`` for ``left_knee``, ``left_ankle``."""
    side = a.split("_")[0]
    if side in ("left", "right") and b.startswith(side + "_"):
        return f"{side} {readable(a[len(side) + 1 :])} to {readable(b[len(side) + 1 :])}"
    return f"{readable(a)} to {readable(b)}"


def jumps(points: Points3D, limit: float = 15.0) -> list[tuple[float, int, int]]:
    """Impossible steps from one frame to the next: (metres, landmark, frame), the largest first.

    Args:
        points: the take.
        limit: metres per second; a thrown ball leaves the hand at 15 to 40.
    """
    step = np.linalg.norm(np.diff(points.points_world, axis=0), axis=-1)
    # At low frame rates a quick hand moves far in a frame: steps below 0.15 m are no jumps.
    at = np.argwhere(np.nan_to_num(step) > max(limit / points.fps, 0.15))
    return sorted(((float(step[t, j]), int(j), int(t) + 1) for t, j in at), reverse=True)


def timeline(points: Points3D, columns: int = 1000) -> Timeline:
    """The take in at most `columns` columns."""
    frames = len(points.points_world)
    edges = np.unique(np.linspace(0, frames, min(frames, columns) + 1).astype(np.int64))
    found = _finite(points.points_world)
    agreeing = np.where(found, points.inlier.sum(axis=0), np.nan).astype(np.float64)
    missing, cameras, residual = [], [], []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        missing.append(1.0 - found[a:b].mean(axis=0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            cameras.append(np.nanmean(agreeing[a:b], axis=0))
        residual.append(nanmedian(points.residual_px[:, a:b], axis=(1, 2)))
    return Timeline(edges[:-1], np.array(missing), np.array(cameras), np.array(residual))
