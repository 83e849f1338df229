"""What the report's template fills in: figures, findings and the rows of tables."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.infer.report.calibration_figures import CalibrationView
from muybridge.infer.report.calibration_findings import calibration_findings
from muybridge.infer.report.data import ReportData
from muybridge.infer.report.diagnosis_wording import diagnosis_text
from muybridge.infer.report.figures import (
    BoneFigures,
    CameraFigures,
    Headline,
    bone_figures,
    camera_figures,
    headline,
    nanmedian,
)
from muybridge.infer.report.findings import Finding, findings, sort_findings, verdict
from muybridge.infer.runtime.wording import readable
from muybridge.wording import counted

_FILES: Mapping[str, str] = {
    ".trc": "3D points (OpenSim, Pose2Sim)",
    ".c3d": "3D points (biomechanics software)",
    ".bvh": "moving skeleton (Blender, Maya, Unreal)",
    ".glb": "moving skeleton with a mesh (viewers, game engines)",
    ".mot": "joint angles (OpenSim)",
    ".mp4": "video with landmarks and skeleton overlaid",
    ".json": "figures, options and versions",
}
_RATINGS = {"good": "Good take", "fair": "Usable, with care", "poor": "Needs attention"}


@dataclass(frozen=True)
class LandmarkRow:
    """One row of the landmarks table: (median residual px, the same at the person mm) per camera, then over all."""

    name: str
    cells: tuple[tuple[float, float], ...]
    coverage: float


@dataclass(frozen=True)
class BoneRow:
    """One row of the bones table: a bone, or left and right."""

    name: str
    bones: tuple[BoneFigures, ...]


class ReportView:
    """A report's figures, computed where the template asks for them."""

    def __init__(self, data: ReportData):
        self._data = data

    @cached_property
    def cameras(self) -> tuple[CameraFigures, ...]:
        """Figures of every camera."""
        data = self._data
        if data.cameras is None:
            return ()
        return camera_figures(data.cameras, data.points, data.keypoints_px, data.leave_one_out_px)

    @cached_property
    def bones(self) -> tuple[BoneFigures, ...]:
        """Figures of every bone."""
        return bone_figures(self._data.points)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What went wrong, the worst first."""
        data = self._data
        report = None if data.calibration is None else data.calibration.diagnosis
        judged = report is not None and bool(np.isfinite(report.noise_px))
        own = findings(data.points, self.cameras, self.bones, data.warnings, judged)
        return sort_findings((*calibration_findings(data.calibration), *own))

    @cached_property
    def headline(self) -> Headline:
        """The take in five numbers."""
        data = self._data
        return headline(data.cameras, data.points, data.delivered or data.points, data.leave_one_out_px,
                        data.body_residual_m)  # fmt: skip

    @cached_property
    def _verdict(self) -> tuple[str, str]:
        return verdict(self.headline, self.bones)

    @property
    def rating(self) -> str:
        """good, fair or poor."""
        return self._verdict[0]

    @property
    def verdict(self) -> str:
        """The same in words."""
        return _RATINGS[self.rating]

    @property
    def sentence(self) -> str:
        """Why."""
        return self._verdict[1]

    @property
    def facts(self) -> list[str]:
        """The take's size, in phrases that are not broken over lines."""
        points = self._data.points
        frames = len(points.points_world)
        facts = (
            *([counted(len(self.cameras), "camera")] if self.cameras else []),
            counted(frames, "frame"),
            f"{points.fps:g} frames/s",
            f"{frames / points.fps:.2f} s",
        )
        return [fact.replace(" ", "\u00a0") for fact in facts]

    @property
    def covered(self) -> str:
        """What the coverage means."""
        filled = self.headline.coverage - self.headline.measured_coverage
        covered = "of all landmarks and frames have a 3D position"
        return f"{covered}, {100 * filled:.1f} % of them by filling gaps" if filled >= 0.0005 else covered

    @property
    def seconds(self) -> float:
        """Computing time of all stages."""
        return sum(self._data.timings_s.values())

    @property
    def ms_per_image(self) -> float:
        """Computing time per frame and camera, milliseconds."""
        return 1000 * self.seconds / (len(self._data.points.points_world) * max(1, len(self.cameras)))

    @property
    def files(self) -> list[tuple[str, str]]:
        """The other results: names and what they are."""
        return [(name, _FILES.get(name[name.rfind(".") :], "")) for name in self._data.files]

    @property
    def landmark_rows(self) -> list[LandmarkRow]:
        """Median residual of every landmark in every camera, or from the fitted body, and its coverage."""
        points, body = self._data.points, self._data.body_residual_m
        found = np.isfinite(points.points_world).all(axis=-1).mean(axis=0)
        if not self.cameras:
            mm = np.full(len(found), np.nan) if body is None else 1000.0 * nanmedian(body, axis=0)
            names = points.landmarks.names
            return [LandmarkRow(readable(n), ((mm[j], mm[j]),), float(found[j])) for j, n in enumerate(names)]
        median = nanmedian(points.residual_px, axis=1)
        overall = nanmedian(points.residual_px, axis=(0, 1))
        scale = np.array([c.mm_per_px for c in self.cameras])
        overall_mm = nanmedian(points.residual_px * scale[:, None, None], axis=(0, 1))
        return [
            LandmarkRow(
                readable(name),
                (*((median[c, j], median[c, j] * scale[c]) for c in range(len(scale))), (overall[j], overall_mm[j])),
                float(found[j]),
            )
            for j, name in enumerate(points.landmarks.names)
        ]

    @property
    def bone_rows(self) -> list[BoneRow]:
        """Bones, left and right in one row."""
        rows = []
        for i, bone in enumerate(self.bones):
            if 0 <= bone.twin < i:
                continue
            if bone.twin >= 0:
                rows.append(BoneRow(bone.name.replace("left ", ""), (bone, self.bones[bone.twin])))
            else:
                rows.append(BoneRow(bone.name, (bone,)))
        return rows

    @property
    def thumbnails(self) -> list[tuple[int, list[tuple[str, str]]]]:
        """By frame: (camera, base64 JPEG)."""
        images = self._data.thumbnails
        return [
            (frame, [(t.camera, base64.b64encode(t.jpeg).decode("ascii")) for t in images if t.frame == frame])
            for frame in sorted({t.frame for t in images})
        ]


class _JudgedCalibration(CalibrationView):
    """A calibration within a take's report."""

    @property
    def verdict(self) -> str:
        """Whether it is good, in a sentence."""
        diagnosis = self.quality.diagnosis
        assert diagnosis is not None  # see `calibration_verdict`
        if diagnosis.faults:
            return "No: the sentences at the top say which camera is wrong, and how."
        return diagnosis_text(diagnosis)

    @property
    def source(self) -> str:
        """What it was judged by."""
        return self.quality.source


def calibration_verdict(quality: CalibrationQuality | None) -> CalibrationView | None:
    """The calibration's section of a take's report; None where the calibration was not judged."""
    if quality is None or quality.diagnosis is None:
        return None
    return _JudgedCalibration(quality)
