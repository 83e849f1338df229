"""Facts for `run.json`: inputs, versions, machine, stages."""

import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from muybridge import __version__
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.infer.runtime.stages import StageResult
from muybridge.infer.session.session import Session

_PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "opencv-contrib-python-headless",
    "onnxruntime",
    "pycolmap",
    "av",
    "ezc3d",
)


def session_facts(session: Session) -> dict[str, Any]:
    """The session, for `run.json`."""
    return {
        "name": session.name,
        "path": session.path.resolve(),
        "calibration": session.calibration,
        "frames": session.frames,
        "fps": session.fps,
        "cameras": {
            name: {
                "video": video.path.name,
                "width": video.width,
                "height": video.height,
                "fps": video.fps,
                "frames": video.frames,
                "codec": video.codec,
                "container": video.container,
                "rotation_deg": video.rotation_deg,
                "size_bytes": video.size_bytes,
            }
            for name, video in zip(session.cameras.names, session.videos, strict=True)
        },
    }


def calibration_facts(calibration: CalibrationQuality | None) -> dict[str, Any] | None:
    """The diagnosis of the calibration, for `run.json`; None where it was not judged."""
    if calibration is None or calibration.diagnosis is None:
        return None
    report = calibration.diagnosis
    return {
        "sentence": report.sentence,
        "faults": [asdict(f) for f in report.faults],
        "probability": dict(zip(report.names, report.probability.tolist(), strict=True)),
    }


def stage_facts(stages: Mapping[str, StageResult]) -> dict[str, dict[str, Any]]:
    """Seconds by stage, and whether an earlier run had finished it."""
    return {name: {"seconds": s.seconds, "resumed": s.resumed} for name, s in stages.items()}


def versions() -> dict[str, str]:
    """Versions of muybridge, Python and the libraries that compute."""
    found = {"muybridge": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """The machine: system, processors, and the peak memory of the process so far."""
    facts: dict[str, Any] = {"system": platform.platform(), "processors": os.cpu_count()}
    peak = _peak_memory_mb()
    return facts if peak is None else facts | {"peak_memory_mb": peak}


def _peak_memory_mb() -> int | None:
    """Peak memory of this process; None where the system does not report it."""
    # On Linux `getrusage` includes the parent's memory at the time it started this process.
    status = Path("/proc/self/status")
    if status.exists():
        found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text())
        if found:
            return int(found[1]) // 2**10
    if sys.platform == "win32":
        return None
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit // 2**20
