"""A calibration for its page: residuals over each image, the room from above, and which camera is at fault."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.diagnosis.findings import KINDS, CalibrationDiagnosis
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, ImagePicture
from muybridge.geometry.cameras.camera import Camera

_KIND_NAMES = {
    "turned": "turned", "moved": "moved", "focal": "focal length", "shifted": "out of step",
    "swapped": "file exchanged", "unrelated": "shows something else",
}  # fmt: skip
_LONGEST = 1.6  # cells that the longest arrow spans
_IMAGE_CELL, _PLAN_CELL = 24, 10  # side of a cell in the drawings
_FOCAL_MEANING = (
    "how well these observations alone would tell the focal length; the calibration may know it better",
    "standard deviation from the adjustment; where it is large, a low residual is no proof",
)


def blamed(diagnosis: CalibrationDiagnosis | None, name: str) -> str:
    """What is wrong with a camera in a word or two; empty for nothing."""
    if diagnosis is None:
        return ""
    return ", ".join(_KIND_NAMES[f.kind] for f in diagnosis.faults if name in f.cameras)


@dataclass(frozen=True)
class CameraRow:
    """One row of the cameras table; tints are 0 to 100."""

    name: str
    fault: str
    probability: float
    residual_px: float
    residual_tint: float
    p95_px: float
    leave_one_out_px: float
    leave_one_out_tint: float
    covered: float
    focal_px: float
    focal_sd_percent: float
    focal_tint: float
    position_sd_mm: float
    position_tint: float


class Evidence(NamedTuple):
    """How much better the rig would fit with each change to each camera: (value, tint) per cell."""

    columns: list[tuple[str, str]]
    rows: list[tuple[str, list[tuple[float, float]]]]


class ResidualCell(NamedTuple):
    """A part of an image, in the drawing's units."""

    x: int
    y: int
    tint: float
    points: int
    median_px: float


class Arrow(NamedTuple):
    """A mean residual, in the drawing's units; without a head where it is too short to draw."""

    x: float
    y: float
    tip_x: float
    tip_y: float
    points: str


@dataclass(frozen=True)
class ResidualImage:
    """One camera's residuals over its image."""

    name: str
    fault: str
    columns: int
    rows: int
    cells: list[ResidualCell]
    arrows: list[Arrow]
    cell: int = _IMAGE_CELL

    @property
    def width(self) -> int:
        """Of the drawing."""
        return self.columns * self.cell

    @property
    def height(self) -> int:
        """Of the drawing."""
        return self.rows * self.cell


@dataclass(frozen=True)
class Residuals:
    """Every camera's residuals on one scale: the tint is full at `full_px`, the longest arrows are `longest_px`."""

    full_px: str
    longest_px: float
    images: list[ResidualImage]


class PlanCell(NamedTuple):
    """A place on the floor, in the drawing's units."""

    x: int
    y: int
    tint: float
    images: int


class CameraMark(NamedTuple):
    """A wedge that looks where the camera looks, with its name."""

    name: str
    faulty: bool
    x: float
    y: float
    wedge: str
    label_x: float
    label_y: float
    anchor: str


@dataclass(frozen=True)
class PlanView:
    """The room from above: how many images every place is in, the cameras, and where points were."""

    width: int
    tall: int
    height_m: float
    seen_by_three: float
    cells: list[PlanCell]
    dots: str
    cameras: list[CameraMark]
    rule_m: str
    rule_px: float
    cell: float = _PLAN_CELL + 0.3  # cells overlap a little, so that no gaps show

    @property
    def rule_y(self) -> int:
        """Where the scale bar is."""
        return self.tall + 16


class CalibrationView:
    """What the calibration's templates fill in.

    Attributes:
        quality: the figures.
    """

    def __init__(self, quality: CalibrationQuality):
        self.quality = quality

    @property
    def diagnosed(self) -> bool:
        """Whether a faulty camera was looked for."""
        return self.quality.diagnosis is not None

    @cached_property
    def left_out(self) -> bool:
        """Whether leave-one-out errors are known."""
        return bool(np.isfinite(self.quality.leave_one_out_px).any())

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Of the cameras table: names and meanings."""
        head = [("Camera", "")]
        if self.diagnosed:
            head += [
                ("what is wrong", ""), ("culprit", "how likely this camera is what is wrong with the rig"),
            ]  # fmt: skip
        head += [
            ("residual", "median distance of a 2D point to its reprojection"),
            ("95 %", "95th percentile of the residual"),
        ]
        if self.left_out:
            head.append(("leave one out", "median distance to what the other cameras alone say"))
        return [
            *head,
            ("image covered", "share of the image where something was seen"),
            ("focal length", "as calibrated"),
            ("known to", _FOCAL_MEANING[self.quality.fitted]),
            ("position known to", "standard deviation from the adjustment, relative to all cameras"),
        ]

    @property
    def rows(self) -> list[CameraRow]:
        """Of the cameras table, the likeliest culprit first where one was looked for."""
        quality, diagnosis = self.quality, self.quality.diagnosis
        order = diagnosis.order if diagnosis is not None and diagnosis.faults else range(len(quality.cameras))
        full_focal, full_position = (8.0, 200.0) if quality.fitted else (np.inf, np.inf)
        rows = []
        for c in order:
            camera = quality.cameras[c]
            width = max(camera.width, camera.height)
            focal, position = quality.focal_sd[c] * 100, quality.position_sd[c] * 1000
            rows.append(
                CameraRow(
                    name=camera.name,
                    fault=blamed(diagnosis, camera.name),
                    probability=float("nan") if diagnosis is None else float(diagnosis.probability[c]),
                    residual_px=quality.residual_px[c],
                    residual_tint=100 * min(200 / width * quality.residual_px[c], 1.0),
                    p95_px=quality.p95_px[c],
                    leave_one_out_px=quality.leave_one_out_px[c],
                    leave_one_out_tint=100 * min(100 / width * quality.leave_one_out_px[c], 1.0),
                    covered=quality.pictures[c].covered,
                    focal_px=camera.params[0],
                    focal_sd_percent=focal,
                    focal_tint=min(100.0 * focal / full_focal, 100.0),
                    position_sd_mm=position,
                    position_tint=min(100.0 * position / full_position, 100.0),
                )
            )
        return rows

    @property
    def evidence(self) -> Evidence | None:
        """What would explain the errors; None where nothing was tried."""
        diagnosis = self.quality.diagnosis
        if diagnosis is None or not np.isfinite(diagnosis.noise_px):
            return None
        meaning = "log-likelihood gained over held-out frames if this is put right, less the penalty for its parameters"
        most = max(float(diagnosis.evidence.max()), 1.0)
        rows = [
            (diagnosis.names[c], [(float(v), 100 * max(float(v), 0.0) / most) for v in diagnosis.evidence[c]])
            for c in diagnosis.order
        ]
        return Evidence([("Camera", ""), *((_KIND_NAMES[k], meaning) for k in KINDS)], rows)

    @property
    def residuals(self) -> Residuals:
        """Residuals over every image, all on one scale."""
        quality = self.quality
        # A few cells of wrong points must not make all others pale, or their arrows vanish.
        full = float(f"{max(_usual(quality, [p.median_px for p in quality.pictures]), 0.1):.1g}")
        longest = max(_usual(quality, [np.linalg.norm(p.mean_px, axis=-1) for p in quality.pictures]), 1e-6)
        images = [
            _residual_image(camera.name, blamed(quality.diagnosis, camera.name), picture, full, longest)
            for camera, picture in zip(quality.cameras, quality.pictures, strict=True)
        ]
        return Residuals(f"{full:g}", longest, images)

    @property
    def plan(self) -> PlanView:
        """The room from above."""
        diagnosis = self.quality.diagnosis
        faulty = set() if diagnosis is None else {n for f in diagnosis.faults for n in f.cameras}
        return _plan_view(self.quality, faulty)


def _usual(quality: CalibrationQuality, values: Sequence[FloatArray]) -> float:
    """The value that cells with nineteen of twenty points do not exceed."""
    count = np.concatenate([p.count.ravel() for p in quality.pictures])
    every = np.concatenate([v.ravel() for v in values])
    use = (count > 0) & np.isfinite(every)
    if not use.any():
        return 1.0
    order = np.argsort(every[use])
    share = np.cumsum(count[use][order]) / count[use].sum()
    return float(every[use][order][int(np.searchsorted(share, 0.95))])


def _residual_image(name: str, fault: str, picture: ImagePicture, full: float, longest: float) -> ResidualImage:
    rows, columns = picture.count.shape
    cells, arrows = [], []
    for r in range(rows):
        for q in range(columns):
            count = int(picture.count[r, q])
            if count:
                tint = min(100.0 * picture.median_px[r, q] / full, 100.0)
                cells.append(ResidualCell(q * _IMAGE_CELL, r * _IMAGE_CELL, tint, count, picture.median_px[r, q]))
            if count >= 3:
                by = picture.mean_px[r, q] / longest
                by = by / max(float(np.hypot(*by)), 1.0) * _LONGEST * _IMAGE_CELL
                arrows.append(_arrow((q + 0.5) * _IMAGE_CELL, (r + 0.5) * _IMAGE_CELL, by))
    return ResidualImage(name, fault, columns, rows, cells, arrows)


def _arrow(x: float, y: float, by: FloatArray) -> Arrow:
    length = float(np.hypot(*by))
    if not length > 0.5:
        return Arrow(x, y, x, y, "")
    ahead, side = by / length, np.array([-by[1], by[0]]) / length
    tip = np.array([x, y]) + by
    size = min(5.0, 0.6 * length)
    wings = [tip - size * ahead + s * 0.5 * size * side for s in (-1, 1)]
    return Arrow(x, y, float(tip[0]), float(tip[1]), _corners((tip, *wings)))


def _corners(points: Sequence[FloatArray]) -> str:
    return " ".join(f"{p[0]:.1f},{p[1]:.1f}" for p in points)


def _plan_view(quality: CalibrationQuality, faulty: set[str]) -> PlanView:
    cameras, plan = quality.cameras, quality.plan
    rows, columns = plan.cameras.shape
    most = max(len(cameras), 1)
    width, tall = columns * _PLAN_CELL, rows * _PLAN_CELL

    def at(xy: FloatArray) -> tuple[float, float]:
        place = (np.asarray(xy) - plan.low) / plan.cell * _PLAN_CELL
        return float(place[0]), float(tall - place[1])

    cells = [
        PlanCell(q * _PLAN_CELL, (rows - 1 - r) * _PLAN_CELL, 80 * n / most, n)
        for r in range(rows) for q in range(columns) if (n := int(plan.cameras[r, q]))
    ]  # fmt: skip
    step = next(s for s in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if s / plan.cell * _PLAN_CELL > 50 or s == 50.0)
    return PlanView(
        width=width,
        tall=tall,
        height_m=plan.height,
        seen_by_three=plan.seen_by_three,
        cells=cells,
        dots=" ".join(f"M{x:.1f} {y:.1f}h0" for x, y in (at(p) for p in plan.points)),
        cameras=[_camera_mark(c, at(c.center_world[:2]), c.name in faulty, width) for c in cameras],
        rule_m=f"{step:g}",
        rule_px=step / plan.cell * _PLAN_CELL,
    )


def _camera_mark(camera: Camera, at: tuple[float, float], faulty: bool, width: float) -> CameraMark:
    axis = camera.rotation[2, :2] * [1, -1]
    axis = axis / max(float(np.hypot(*axis)), 1e-9)
    side = np.array([-axis[1], axis[0]])
    x = np.array(at)
    wedge = _corners((x, x + 16 * axis + 8 * side, x + 16 * axis - 8 * side))
    anchor = "end" if at[0] > 0.85 * width else "start" if at[0] < 0.15 * width else "middle"
    label = x + np.array([0.0, 16.0 if axis[1] < 0 else -16.0])
    return CameraMark(camera.name, faulty, *at, wedge, float(label[0]), float(label[1]) + 4, anchor)
