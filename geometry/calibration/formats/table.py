"""Calibration formats: how each is recognised, read and written. A new format is one module and one row here."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from muybridge.geometry.calibration.formats.anipose_toml import read_rig_toml, rig_toml_text
from muybridge.geometry.calibration.formats.colmap import colmap_texts
from muybridge.geometry.calibration.formats.common import Calibration
from muybridge.geometry.calibration.formats.easymocap import easymocap_texts, read_easymocap
from muybridge.geometry.calibration.formats.native import native_text, read_native
from muybridge.geometry.calibration.formats.opencv import MATRIX_KEYS, opencv_text, read_opencv_yaml
from muybridge.geometry.calibration.formats.optitrack import optitrack_text, read_optitrack
from muybridge.geometry.calibration.formats.qualisys import qualisys_text, read_qualisys
from muybridge.geometry.calibration.formats.vicon import read_vicon, vicon_text
from muybridge.geometry.cameras.group import CameraGroup

Reader = Callable[[str, Path], Calibration]
Writer = Callable[[CameraGroup], str | dict[str, str]]
"""Returns the text of the file, or the texts of several files by name."""

_XML = r"\A\s*(?:<\?xml[^>]*>\s*)?(?:<!--.*?-->\s*)*"
_OPENCV_KEY = r"\s*(?:-\s+)?(?:" + "|".join(MATRIX_KEYS) + r")\s*:"


@dataclass(frozen=True)
class CalibrationFormat:
    """One format of calibration files.

    Attributes:
        name: used in messages about a file of this format.
        titles: entries in the list of known formats.
        mark: pattern that occurs in the text of such a file; None for a format that is recognised by its file names.
        read: reads the text of a file at a path.
        write: writers by the name of the export format.
    """

    name: str
    titles: tuple[str, ...]
    mark: re.Pattern[str] | None = None
    read: Reader | None = None
    write: Mapping[str, Writer] = field(default_factory=dict)


# The first row whose mark matches counts. The marks survive truncation and damage, so that the reader can report what
# is wrong with the file: our own TOML names itself; XML and YAML have a typical first line; the rest is TOML.
FORMATS: tuple[CalibrationFormat, ...] = (
    CalibrationFormat(
        "Muybridge TOML",
        ("Muybridge TOML",),
        re.compile(r"^\s*muybridge_calibration\s*=", re.M),
        lambda text, _: read_native(text),
        {"muybridge": native_text},
    ),
    CalibrationFormat(
        "Qualisys",
        ("Qualisys (.qca.txt)",),
        re.compile(_XML + r"<(?:QTM_Parameters[^>]*>\s*<)?calibration\b", re.S),
        lambda text, _: read_qualisys(text),
        {"qualisys": qualisys_text},
    ),
    CalibrationFormat(
        "Vicon",
        ("Vicon (.xcp)",),
        re.compile(_XML + r"<Cameras\b", re.S),
        lambda text, _: read_vicon(text),
        {"vicon": vicon_text},
    ),
    CalibrationFormat(
        "OptiTrack",
        ("OptiTrack (.mcal, or a .csv of its attributes)",),
        re.compile(rf"(?s:{_XML}<calibrationProfile\b)|\A[^\n]*\bOrientMatrix0\b[^\n]*,|\A[^\n]*,\s*OrientMatrix0\b"),
        lambda text, _: read_optitrack(text),
        {"optitrack": optitrack_text},
    ),
    CalibrationFormat(
        "EasyMocap",
        ("EasyMocap (intri.yml and extri.yml)",),
        re.compile(  # not beside a camera's own key: OpenCV's dist_coeffs looks like a camera named coeffs
            rf"\A(?![\s\S]*^{_OPENCV_KEY})[\s\S]*?^(?:K|R|Rot|T|dist)_[^\s:]+\s*:\s*!!opencv-matrix", re.M
        ),
        read_easymocap,
        {"easymocap": easymocap_texts},
    ),
    CalibrationFormat(
        "OpenCV YAML",
        ("OpenCV YAML",),
        re.compile(rf"\A%YAML|!!opencv-matrix|^{_OPENCV_KEY}", re.M),
        lambda text, path: read_opencv_yaml(text, path.stem),
        {"opencv": opencv_text},
    ),
    CalibrationFormat(
        "Pose2Sim, Anipose or Caliscope TOML",
        ("Pose2Sim/Anipose TOML", "Caliscope TOML"),
        re.compile(r"^\s*\[cameras\.|^\s*matrix\s*=", re.M),
        lambda text, _: read_rig_toml(text),
        {
            "anipose": lambda cameras: rig_toml_text(cameras, "anipose"),
            "freemocap": lambda cameras: rig_toml_text(cameras, "freemocap"),
            "pose2sim": lambda cameras: rig_toml_text(cameras, "pose2sim"),
            "caliscope": lambda cameras: rig_toml_text(cameras, "caliscope"),
        },
    ),
    CalibrationFormat(
        "COLMAP model",
        ("COLMAP model (text or binary: cameras and images)",),
        write={"colmap": colmap_texts},
    ),
)

WRITERS: dict[str, Writer] = {name: writer for row in FORMATS for name, writer in row.write.items()}
"""Writers by the name of the export format."""

KNOWN_FORMATS: tuple[str, ...] = tuple(title for row in FORMATS for title in row.titles)
"""The formats that `load_calibration` reads."""
