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
from muybridge.geometry.calibration.formats.json_files.gaussian_splatting import read_gaussian_splatting
from muybridge.geometry.calibration.formats.json_files.human36m import read_human36m
from muybridge.geometry.calibration.formats.json_files.panoptic import read_panoptic
from muybridge.geometry.calibration.formats.json_files.voxelpose import read_voxelpose
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
        "OpenCV XML",
        ("OpenCV XML (OpenPose's too)",),
        re.compile(_XML + r"<opencv_storage\b", re.S),
        lambda text, path: read_opencv_yaml(text, path.stem),
    ),
    CalibrationFormat(
        "Human3.6M JSON",
        ("Human3.6M JSON",),
        re.compile(r"\A\s*\{(?=[\s\S]*\"extrinsics\"\s*:)(?=[\s\S]*\"calibration_matrix\"\s*:)"),
        read_human36m,
    ),
    CalibrationFormat(
        "Panoptic JSON",
        ("CMU Panoptic JSON",),
        re.compile(r"\A\s*\{(?=[\s\S]*\"cameras\"\s*:\s*\[)(?=[\s\S]*\"distCoef\"\s*:)"),
        lambda text, _: read_panoptic(text),
    ),
    CalibrationFormat(
        "VoxelPose JSON",
        ("VoxelPose JSON (Shelf, Campus)",),
        re.compile(r"\A\s*\{(?=[\s\S]*\"fx\"\s*:)(?=[\s\S]*\"R\"\s*:)(?=[\s\S]*\"T\"\s*:)"),
        lambda text, _: read_voxelpose(text),
    ),
    CalibrationFormat(
        "Gaussian splatting JSON",
        ("3D Gaussian splatting cameras.json",),
        re.compile(r"\A\s*\[(?=[\s\S]*\"img_name\"\s*:)(?=[\s\S]*\"rotation\"\s*:)"),
        lambda text, _: read_gaussian_splatting(text),
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
        re.compile(rf"\A%YAML|\A(?!\s*[<{{\[])[\s\S]*?(?:!!opencv-matrix|^{_OPENCV_KEY})", re.M),
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

# What files that are no calibration of a known format begin with or contain, and what a user can do about them.
_LOOKS_LIKE: tuple[tuple[re.Pattern[bytes], str], ...] = (
    (
        re.compile(rb"\A\x80[\x02-\x05][\x95}\](cq]"),
        "a Python pickle (OpenCap's cameraIntrinsicsExtrinsics.pickle is one), which is not read since it can run any "
        "program: write its intrinsicMat, distortion, rotation, translation and imageSize as OpenCV YAML",
    ),
    (
        re.compile(rb'\A\s*\{(?=[\s\S]*"frames"\s*:)(?=[\s\S]*"transform_matrix"\s*:)'),
        "a NeRF's transforms.json; use the COLMAP model that it was made from",
    ),
    (
        re.compile(rb"^\s*T_cn_cnm1\s*:|^\s*T_cam_imu\s*:", re.M),
        "Kalibr's camchain, whose poses are relative to the camera before; write each camera's pose as OpenCV YAML",
    ),
    (
        re.compile(rb"^\s*projection_matrix\s*:", re.M),
        "ROS camera_info, which has no pose; add a rotation and a translation to it",
    ),
    (re.compile(rb"\AMATLAB 5\.0|\A\x89HDF"), "MATLAB or HDF5 data; export the cameras as OpenCV YAML or TOML"),
    (re.compile(rb"\A\x93NUMPY|\APK\x03\x04"), "NumPy data or a ZIP archive; unpack it, or export it as OpenCV YAML"),
    (re.compile(rb"^\s*muybridge_sync\s*=", re.M), "the clocks of synchronised cameras, not a calibration"),
    (
        re.compile(rb"^\s*(?:square_size_override_cm|aruco_scale)\s*=", re.M),
        "the description of a calibration board, not a calibration",
    ),
    (re.compile(rb"\A(?:\xff\xd8\xff|\x89PNG|BM|II\*|MM\0\*)"), "an image; calibrate from images of a board"),
    (re.compile(rb"\A....ftyp|\A\x1aE\xdf\xa3|\ARIFF", re.S), "a video; calibrate from videos of a board"),
    (re.compile(rb"\A(?i:\s*<!doctype html|\s*<html)"), "a web page, such as a report"),
)


def looks_like(data: bytes) -> str | None:
    """What the content of a file that is of no known format looks like, or None."""
    return next((words for pattern, words in _LOOKS_LIKE if pattern.search(data)), None)


# Our own TOML files that are no calibration, such as `sync.toml`, whose tables look like those of other programs.
_OTHERS_OF_OURS = re.compile(r"^\s*muybridge_(?!calibration\b)\w+\s*=", re.M)


def recognise(text: str | None) -> CalibrationFormat | None:
    """The format of a text, or None; the first row whose mark matches counts."""
    if text is None or _OTHERS_OF_OURS.search(text):
        return None
    return next((row for row in FORMATS if row.mark and row.read and row.mark.search(text)), None)


WRITERS: dict[str, Writer] = {name: writer for row in FORMATS for name, writer in row.write.items()}
"""Writers by the name of the export format."""

KNOWN_FORMATS: tuple[str, ...] = tuple(title for row in FORMATS for title in row.titles)
"""The formats that `load_calibration` reads."""
