"""Hypothetical setups of a rig, with corrected cameras, video files and time shifts, and their fit to a take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.calibration.diagnosis.hypotheses import Correction
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import student_cost, student_scale
from muybridge.geometry.sync.clocks import resample
from muybridge.geometry.triangulation.multiview import TriangulateOptions, take_noise, triangulate

_BLOCKS = 6  # number of blocks of frames, which belong to the two halves in turn
_GROUPS = 4  # number of groups of landmarks
FEWEST_FRAMES = 8
_MOST_LANDMARKS = 25
_MOST_POINTS = 1800


@dataclass(frozen=True)
class Setup:
    """A rig under a hypothesis: its cameras, the time shift of each video (frames), and each camera's video file."""

    cameras: CameraGroup
    shifts: tuple[float, ...]
    files: tuple[int, ...]


Part = tuple[BoolArray, BoolArray]  # (K,) frames and (J,) landmarks


@dataclass
class Take:
    """The landmarks of a take at selected frames.

    Attributes:
        px: (C, T, J, 2) landmarks of every frame, px.
        variance: (C, T, J) px^2.
        frames: (K,) the selected frames.
        folds: parts of the observations, each with frames and landmarks that it does not have and is judged by: those
            of the other half of the frames, and a quarter of the landmarks.
        noise_px: noise floor of the reprojection errors, px.
        relative: median variance, px^2; relative standard deviations refer to it.
    """

    px: FloatArray
    variance: FloatArray
    frames: FloatArray
    noise_px: float = 0.0
    relative: float = field(init=False)
    folds: tuple[tuple[Part, Part], ...] = field(init=False)
    _resampled: dict[tuple[int, float], tuple[FloatArray, FloatArray]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        late = (np.arange(len(self.frames)) * _BLOCKS // len(self.frames)) % 2 == 1
        group = np.arange(self.variance.shape[2]) % _GROUPS
        self.folds = tuple(
            ((late == half, group != g), (late != half, group == g)) for half in (False, True) for g in range(_GROUPS)
        )
        self.relative = float(np.nanmedian(self.variance))

    def scale_variance(self, factor: float) -> None:
        """Multiply all variances."""
        self.variance *= factor
        self.relative *= factor
        self._resampled.clear()

    def of(self, setup: Setup, c: int, shift: float | None = None) -> tuple[FloatArray, FloatArray]:
        """(K, J, 2) px and (K, J) variances of camera c under a setup, or at another time shift."""
        at = setup.files[c], float(setup.shifts[c] if shift is None else shift)
        if at not in self._resampled:
            self._resampled[at] = resample(self.px[at[0]], self.variance[at[0]], 1.0, self.frames + at[1])
        return self._resampled[at]

    def all(self, setup: Setup) -> tuple[FloatArray, FloatArray]:
        """(C, K, J, 2) px and (C, K, J) variances of all cameras under a setup."""
        each = [self.of(setup, c) for c in range(len(setup.cameras))]
        return np.stack([px for px, _ in each]), np.stack([v for _, v in each])

    def sigma(self, variance: FloatArray) -> FloatArray:
        """Standard deviations relative to the median, bounded from below."""
        return np.sqrt(np.maximum(variance / self.relative, 0.1))


def take_of(
    cameras: CameraGroup, points_px: FloatArray, variance_px2: FloatArray, max_frames: int
) -> tuple[Take | None, str]:
    """The take at selected frames; or None and the reason why no diagnosis is possible."""
    px, variance = np.array(points_px, dtype=np.float64), np.array(variance_px2, dtype=np.float64)
    if px.ndim != 4 or px.shape[0] != len(cameras) or px.shape[3] != 2 or variance.shape != px.shape[:3]:
        raise ValueError(
            f"points_px must be ({len(cameras)}, T, J, 2) and variance_px2 ({len(cameras)}, T, J), "
            f"not {px.shape} and {variance.shape}"
        )
    missing = ~(np.isfinite(px).all(-1) & np.isfinite(variance) & (variance > 0))
    px[missing], variance[missing] = np.nan, np.nan
    if len(cameras) < 3:
        return None, "With two cameras it cannot be determined which of them is wrong; a third is needed."
    shared = np.flatnonzero(((~missing).sum(axis=0) >= 3).sum(axis=1) >= 3)
    if len(shared) < FEWEST_FRAMES:
        return None, (
            f"Only {len(shared)} frames have landmarks that three cameras share; {FEWEST_FRAMES} are needed to "
            "determine which camera is wrong."
        )
    px, variance = _select_landmarks(px, variance)
    most = min(len(shared), max_frames, max(40, _MOST_POINTS // variance.shape[2]))
    chosen = np.unique(np.linspace(0, len(shared) - 1, most).round().astype(int))
    frames = shared[chosen].astype(float)
    take = Take(px, variance, frames)
    # The noise level is that of the subset of cameras that agree best, so that a wrong camera does not raise it.
    near, spread = take.all(Setup(cameras, (0.0,) * len(cameras), tuple(range(len(cameras)))))
    levels = []
    for c in range(len(cameras)):
        rest = [k for k in range(len(cameras)) if k != c]
        noise, scale = take_noise(CameraGroup(tuple(cameras[k] for k in rest)), near[rest], spread[rest])
        levels.append((noise**2 + scale * float(np.nanmedian(spread)), noise, scale))
    _, take.noise_px, scale = min(levels)
    take.scale_variance(scale)
    return take, ""


def _select_landmarks(px: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At most `_MOST_LANDMARKS` landmarks, those that three cameras share most often."""
    if variance.shape[2] <= _MOST_LANDMARKS:
        return px, variance
    shared = (np.isfinite(variance).sum(axis=0) >= 3).sum(axis=0)
    chosen = np.sort(np.argsort(-shared, kind="stable")[:_MOST_LANDMARKS])
    return px[:, :, chosen], variance[:, :, chosen]


def rig_errors(take: Take, setup: Setup, part: Part | None = None) -> FloatArray:
    """(C, K, J, 2) reprojection errors of the triangulated rig over relative standard deviations.

    With a part, only of its frames and landmarks.
    """
    px, variance = take.all(setup)
    if part is not None:
        px, variance = px[:, part[0]][:, :, part[1]], variance[:, part[0]][:, :, part[1]]
    found = triangulate(setup.cameras, px, variance, TriangulateOptions(noise_px=take.noise_px))
    error = setup.cameras.project(found.points_world) - px
    seen = np.isfinite(variance)
    # Where no two cameras agree, each gets the largest error that a camera excluded from a point may have.
    far = 0.05 * max(max(c.width, c.height) for c in setup.cameras)
    error[seen & ~np.isfinite(error).all(-1)] = far
    error[:, seen.sum(axis=0) < min(3, len(setup.cameras))] = np.nan
    return np.asarray(error / take.sigma(variance)[..., None])


def robust_cost(errors: FloatArray) -> tuple[float, float]:
    """Mean robust cost and scale of (C, K, J, 2) errors."""
    squares = (errors**2).sum(-1)
    known = squares[np.isfinite(squares)]
    scale = student_scale(known)
    return float(student_cost(known, scale).mean()), scale


def leave_one_out_points(take: Take, setup: Setup, c: int) -> FloatArray:
    """(K, J, 3) points triangulated from all cameras other than c."""
    rest = [k for k in range(len(setup.cameras)) if k != c]
    px, variance = take.all(setup)
    others = CameraGroup(tuple(setup.cameras[k] for k in rest))
    return triangulate(others, px[rest], variance[rest], TriangulateOptions(noise_px=take.noise_px)).points_world


def with_correction(setup: Setup, c: int, correction: Correction) -> Setup:
    """The setup with camera c corrected."""
    cameras = list(setup.cameras)
    cameras[c] = correction.camera
    return replace(setup, cameras=CameraGroup(tuple(cameras)))


def with_shift(setup: Setup, c: int, shift: float) -> Setup:
    """The setup with the video of camera c delayed by `shift` more frames."""
    shifts = list(setup.shifts)
    shifts[c] += shift
    return replace(setup, shifts=tuple(shifts))


def with_files(setup: Setup, order: Sequence[int]) -> Setup:
    """The setup in which each camera has the file of camera `order[c]`."""
    return replace(setup, files=tuple(setup.files[k] for k in order), shifts=tuple(setup.shifts[k] for k in order))
