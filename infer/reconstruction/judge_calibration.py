"""The quality of a calibration as a stage: computed once and kept in the results folder."""

import logging
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import MuybridgeError
from muybridge.geometry.calibration.diagnosis.findings import CalibrationDiagnosis, DiagnosisOptions, Fault
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, ImagePicture, Plan
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.infer.reconstruction.judge import check_keypoints
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore

_log = logging.getLogger(__name__)

STAGE = "calibration"
# Frames in which a run looks for faults of cameras; `muybridge calibrate check` takes more.
_FRAMES = 48
_FIGURES = ("count", "residual_px", "p95_px", "leave_one_out_px", "focal_sd", "position_sd")


def judge(
    cameras: CameraGroup, keypoints: Keypoints2D, fps: float, inputs: str, store: StageStore, progress: Progress,
    diagnose: bool = True,
) -> tuple[CalibrationQuality | None, StageResult | None]:  # fmt: skip
    """The quality of the calibration by a take's landmarks; None where there is nobody to judge it by.

    Args:
        cameras: C cameras, at the size of the videos.
        keypoints: everyone who was found.
        fps: frames per second.
        inputs: digest of what the keypoints were made from.
        store: where finished stages are.
        progress: receives progress messages.
        diagnose: look for faults of single cameras too.
    """
    key = digest(STAGE, inputs, fps, diagnose, code_digest("muybridge.geometry", "muybridge.infer.reconstruction"))
    stored = store.load(STAGE, key)
    if stored is not None:
        return unpack_quality(cameras, stored.arrays, stored.facts), stored
    start = time.perf_counter()
    try:
        quality = check_keypoints(cameras, keypoints, DiagnosisOptions(max_frames=_FRAMES) if diagnose else None, fps)
    except MuybridgeError as error:
        _log.info("the calibration was not judged: %s", error)
        return None, None
    if quality.diagnosis is not None and quality.diagnosis.doubt:
        _log.info("%s", quality.diagnosis.doubt)
    arrays, facts = pack_quality(quality)
    result = store.save(STAGE, key, arrays, facts, time.perf_counter() - start)
    progress.say(f"{STAGE}: {result.seconds:.1f} s")
    return quality, result


def pack_quality(quality: CalibrationQuality) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """A calibration's quality as arrays and facts; of the cameras, only the corrected ones are kept."""
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(getattr(quality, name)) for name in _FIGURES}
    for c, picture in enumerate(quality.pictures):
        arrays |= {f"picture{c}_{n}": getattr(picture, n) for n in ("count", "median_px", "mean_px")}
    arrays |= {f"plan_{n}": getattr(quality.plan, n) for n in ("low", "cameras", "points")}
    facts: dict[str, Any] = {
        "source": quality.source,
        "fitted": quality.fitted,
        "covered": [p.covered for p in quality.pictures],
        "plan": {n: float(getattr(quality.plan, n)) for n in ("cell", "height", "seen_by_three")},
        "diagnosis": None,
    }
    report = quality.diagnosis
    if report is not None:
        arrays |= {f"diagnosis_{n}": np.asarray(getattr(report, n)) for n in ("probability", "evidence", "shifts")}
        facts["diagnosis"] = {
            "faults": [asdict(f) for f in report.faults],
            "order": list(report.order),
            "files": list(report.files),
            "note": report.note,
            "too_many": report.too_many,
            "doubt": report.doubt,
            "noise_px": report.noise_px,
            "corrected_px": report.corrected_px,
            "cameras": [[c.model, list(c.params), c.cam_from_world.tolist()] for c in report.cameras],
        }
    return arrays, facts


def unpack_quality(cameras: CameraGroup, arrays: Mapping[str, Any], facts: Mapping[str, Any]) -> CalibrationQuality:
    """The quality of `cameras` that `pack_quality` made arrays and facts of."""
    pictures = tuple(
        ImagePicture(arrays[f"{k}_count"], arrays[f"{k}_median_px"], arrays[f"{k}_mean_px"], covered)
        for k, covered in ((f"picture{c}", share) for c, share in enumerate(facts["covered"]))
    )
    plan = facts["plan"]
    report = None
    if facts["diagnosis"] is not None:
        report = _diagnosis(cameras, arrays, facts["diagnosis"])
    return CalibrationQuality(
        cameras=cameras,
        source=facts["source"],
        **{name: arrays[name] for name in _FIGURES},
        pictures=pictures,
        plan=Plan(
            arrays["plan_low"], plan["cell"], arrays["plan_cameras"], plan["height"], arrays["plan_points"],
            plan["seen_by_three"],
        ),
        fitted=facts["fitted"],
        diagnosis=report,
    )  # fmt: skip


def _diagnosis(cameras: CameraGroup, arrays: Mapping[str, Any], facts: Mapping[str, Any]) -> CalibrationDiagnosis:
    corrected = tuple(
        Camera(c.name, model, c.width, c.height, tuple(params), np.array(pose))
        for c, (model, params, pose) in zip(cameras, facts["cameras"], strict=True)
    )
    return CalibrationDiagnosis(
        names=cameras.names,
        faults=tuple(_fault(f) for f in facts["faults"]),
        probability=arrays["diagnosis_probability"],
        evidence=arrays["diagnosis_evidence"],
        order=tuple(facts["order"]),
        noise_px=facts["noise_px"],
        corrected_px=facts["corrected_px"],
        cameras=CameraGroup(corrected),
        shifts=arrays["diagnosis_shifts"],
        files=tuple(facts["files"]),
        note=facts["note"],
        too_many=facts["too_many"],
        doubt=facts["doubt"],
    )


def _fault(facts: Mapping[str, Any]) -> Fault:
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in facts.items()}
    return Fault(**values)
