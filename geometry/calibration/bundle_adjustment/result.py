"""What every way of calibrating hands on: cameras, each observation's residual, what is known how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, AdjustResult
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

_CELLS = 12  # along the longer side of an image
# A view does not fit if its median error is above this many px and times that of the usual view; a camera of which so
# large a share does not is wrong.
_MISFIT_PX, _MISFIT_TIMES, _GRAVE = 3.0, 5.0, 0.1
_LISTED = 8


@dataclass(frozen=True)
class CalibrationResult:
    """Calibrated cameras with what a report needs of the adjustment that they come from.

    Attributes:
        cameras: C cameras, metres.
        camera: (N,) camera of each observation.
        time: (N,) which moment it is from (a frame's number, or 0 where time plays no part).
        point: (N,) number of the point: a corner of the board, a row of the CSV.
        pixels: (N, 2) px, as observed.
        points_world: (N, 3) metres, where the adjustment puts the observed point; NaN where it has none.
        residuals_px: (N, 2) projected minus observed.
        weights: (N,) robust weight, from 1 (an inlier) down to 0.
        covariances: for each camera (D + 6, D + 6) of its lens parameters, rotation about its own axes (radians)
            and centre (metres, world axes); zero where held. Includes how well the observations really fit.
        noise_px: standard deviation of a coordinate, as the residuals show it.
    """

    cameras: CameraGroup
    camera: IntArray
    time: IntArray
    point: IntArray
    pixels: FloatArray
    points_world: FloatArray
    residuals_px: FloatArray
    weights: FloatArray
    covariances: tuple[FloatArray, ...]
    noise_px: float

    @property
    def errors_px(self) -> FloatArray:
        """(N,) length of each residual, px."""
        errors: FloatArray = np.linalg.norm(self.residuals_px, axis=1)
        return errors

    @property
    def rms_px(self) -> FloatArray:
        """(C,) root of the mean square error of each camera, px, outliers included; NaN without observations."""
        return np.array([float(np.sqrt(np.mean(e**2))) if len(e) else np.nan for e in self._by_camera()])

    @property
    def median_px(self) -> FloatArray:
        """(C,) median error of each camera, px."""
        return np.array([float(np.median(e)) if len(e) else np.nan for e in self._by_camera()])

    @property
    def focal_std_px(self) -> FloatArray:
        """(C,) standard deviation of the (first) focal length, px; 0 where it was held."""
        return np.array([np.sqrt(max(v[0, 0], 0.0)) for v in self.covariances])

    @property
    def position_std(self) -> FloatArray:
        """(C,) metres, length of the standard deviations of the centre along the axes; 0 where it was held."""
        return np.array([np.sqrt(max(np.trace(v[-3:, -3:]), 0.0)) for v in self.covariances])

    @property
    def coverage(self) -> FloatArray:
        """(C,) share of each image, in `image_cells`, in which something was observed."""
        out = np.zeros(len(self.cameras))
        for c, camera in enumerate(self.cameras):
            wide, high = image_cells(camera)
            px = self.pixels[self.camera == c]
            field = np.clip((px + 0.5) / [camera.width, camera.height] * [wide, high], 0, [wide - 1, high - 1])
            out[c] = len(np.unique(field.astype(np.int64), axis=0)) / (wide * high) if len(px) else 0.0
        return out

    def _by_camera(self) -> list[FloatArray]:
        errors = np.where(np.isfinite(self.errors_px), self.errors_px, np.nan)
        return [e[np.isfinite(e)] for e in (errors[self.camera == c] for c in range(len(self.cameras)))]


def solved(problem: AdjustProblem, result: AdjustResult, time: IntArray, points_world: FloatArray) -> CalibrationResult:
    """`CalibrationResult` of an adjustment.

    Args:
        problem: what was adjusted.
        result: what came out.
        time: (N,) moment of each observation.
        points_world: (N, 3) where the observed points are.
    """
    return CalibrationResult(
        cameras=result.cameras, camera=np.asarray(problem.camera), time=np.asarray(time),
        point=np.asarray(problem.point), pixels=np.asarray(problem.pixels), points_world=points_world,
        residuals_px=result.residuals_px, weights=result.weights, covariances=result.covariances,
        noise_px=result.noise * float(np.median(problem.sigma_px)),
    )  # fmt: skip


@dataclass(frozen=True)
class Misfit:
    """Views of one camera that do not fit what the others saw.

    Attributes:
        sentence: which they are.
        grave: whether they are so many that the camera is wrong.
    """

    sentence: str
    grave: bool


def misfits(result: CalibrationResult) -> tuple[Misfit, ...]:
    """Cameras with views that do not fit, as where one was moved half-way through; nothing where all is one moment."""
    times = np.unique(result.time)
    if len(times) < 2:
        return ()
    medians = np.full((len(result.cameras), len(times)), np.nan)
    errors = np.nan_to_num(result.errors_px, nan=np.inf)
    view = result.camera * len(times) + np.searchsorted(times, result.time)
    order = np.argsort(view, kind="stable")
    which, first = np.unique(view[order], return_index=True)
    medians.flat[which] = [np.median(e) for e in np.split(errors[order], first[1:])]
    off = medians > max(_MISFIT_PX, _MISFIT_TIMES * float(np.nanmedian(medians)))
    out = []
    for camera, mine, wrong in zip(result.cameras, medians, off, strict=True):
        if wrong.any():
            views = int(np.isfinite(mine).sum() + np.isinf(mine).sum())
            sentence = (
                f"Views of camera {camera.name} that do not fit what the others saw: {wrong.sum()} of {views} (errors "
                f"of {np.median(mine[wrong]):.0f} px; moments {_stretches(times, wrong)}). If it was moved, calibrate "
                "from the moments before that or after it alone."
            )
            out.append(Misfit(sentence, bool(wrong.sum() >= _GRAVE * views)))
    return tuple(out)


def _stretches(times: IntArray, wrong: BoolArray) -> str:
    """Times in words, those that follow each other among all as "first to last"."""
    runs = np.split(np.flatnonzero(wrong), np.flatnonzero(np.diff(np.flatnonzero(wrong)) > 1) + 1)
    words = [f"{times[r[0]]}" if len(r) == 1 else f"{times[r[0]]} to {times[r[-1]]}" for r in runs]
    return ", ".join(words[:_LISTED]) + (", ..." if len(words) > _LISTED else "")


def image_cells(camera: Camera) -> tuple[int, int]:
    """Columns and rows of the square fields by which the coverage of an image is counted."""
    side = max(camera.width, camera.height) / _CELLS
    return max(1, round(camera.width / side)), max(1, round(camera.height / side))


def table(result: CalibrationResult) -> list[str]:
    """A line a camera: how well the observations fit, and how well focal length and position are known."""
    names = result.cameras.names
    width = max(6, *(len(n) for n in names))
    lines = [f"{'camera':<{width}}  views  points  RMS px  median px  focal px         position     image covered"]
    for c, camera in enumerate(result.cameras):
        mine = result.camera == c
        held = result.focal_std_px[c] == 0
        focal = f"{camera.params[0]:.1f} " + ("(held)" if held else f"+- {result.focal_std_px[c]:.1f}")
        place = f"+- {result.position_std[c] * 1e3:.1f} mm" if result.position_std[c] > 0 else "(reference)"
        lines.append(
            f"{names[c]:<{width}}  {len(np.unique(result.time[mine])):5d}  {mine.sum():6d}  {result.rms_px[c]:6.2f}  "
            f"{result.median_px[c]:9.2f}  {focal:<15}  {place:<11}  {result.coverage[c]:5.0%}"
        )
    return lines
