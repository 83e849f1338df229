"""Files of calibrations, motion and points as objects, and back."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from muybridge.errors import FormatError
from muybridge.geometry.calibration import load_calibration as _load_calibration
from muybridge.geometry.calibration import save_calibration as _save_calibration
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.registry import ReadOptions, read_file, write_file
from muybridge.motion.take import Take


def load_calibration(path: str | os.PathLike[str]) -> CameraGroup:
    """Read the cameras of a calibration file of any known format, recognised by its content.

    Args:
        path: a file; or, of a COLMAP model or of OpenCV files one a camera, their folder.

    Returns:
        C cameras: world to camera poses in metres, OpenCV axes, pixel (0, 0) the centre of the top-left pixel.

    Raises:
        CalibrationError: the file cannot be read, is of no known format, or is damaged.

    Example:
        >>> import muybridge
        >>> cameras = muybridge.load_calibration("session/calibration.toml")
        >>> cameras.project([0.0, 0.0, 1.0]).shape  # a point one metre above the origin, in every camera
        (4, 2)
    """
    return _load_calibration(Path(path))


def save_calibration(path: str | os.PathLike[str], cameras: CameraGroup) -> None:
    """Write cameras as muybridge's own TOML, from which they are read back exactly.

    Args:
        path: the file; an existing one is replaced.
        cameras: C cameras.

    Raises:
        OutputError: the file cannot be written.

    Example:
        >>> import muybridge
        >>> cameras = muybridge.load_calibration("session/calibration.toml")
        >>> muybridge.save_calibration("copy.toml", cameras)
    """
    _save_calibration(cameras, Path(path))


def read_motion(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    fps: float | None = None,
    asf: str | os.PathLike[str] | None = None,
    clip: str | int | None = None,
) -> Motion:
    """Read a motion from .bvh, .amc, .glb, .gltf, .vrm, .vrma or .fbx; the suffix decides the format.

    Args:
        path: the file.
        units: of a BVH, which does not say: `m`, `cm`, `mm`, `in` or `cmu` (0.0254 / 0.45 m). By default they are
            inferred from the figure's height.
        fps: frames a second, where the file says nothing or says it wrongly.
        asf: the skeleton of an .amc; by default the .asf file beside it.
        clip: name or number (from 0) of the animation, of a glTF or FBX file that holds several; by default the first.

    Returns:
        T frames of J joints: metres, Z up, quaternions (w, x, y, z) relative to the parent.

    Raises:
        FormatError: the file is malformed, of no known format, or holds points alone.

    Example:
        >>> import muybridge
        >>> muybridge.write_motion("walk.bvh", muybridge.capture("session").motion)
        >>> len(muybridge.read_motion("walk.bvh"))
        48
    """
    take = _read(path, units=units, fps=fps, asf=asf, clip=clip)
    if take.motion is None:
        raise FormatError(f"{path}: holds points and no motion", remedy="fit_points")
    return take.motion


def write_motion(path: str | os.PathLike[str], motion: Motion, *, bvh_units: Literal["m", "cm"] = "m") -> None:
    """Write a motion to .bvh, .glb, .fbx, .usda, .amc or .mot; the suffix decides the format.

    With a suffix of points (.trc, .c3d, .csv, .parquet, .npz) the joints' positions are written. An existing file is
    replaced.

    Args:
        path: the file.
        motion: T frames of J joints, metres, Z up.
        bvh_units: what one unit is, in a BVH.

    Raises:
        FormatError: the suffix is of no format that can be written, or the format cannot hold this skeleton.
        OutputError: the file cannot be written.

    Example:
        >>> import muybridge
        >>> motion = muybridge.capture("session").motion
        >>> muybridge.write_motion("walk.glb", motion)
    """
    write_file(Path(path), Take(motion=motion), bvh_units)


def read_points(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    up: Literal["y", "z"] | None = None,
    fps: float | None = None,
) -> Points3D:
    """Read labelled 3D points from .trc, .c3d, .csv, .tsv, .parquet or .npz; the suffix decides the format.

    Of a file of motion these are the joints' positions.

    Args:
        path: the file.
        units: of lengths, where the file does not say: `m`, `cm`, `mm` or `in`.
        up: the file's vertical axis, where it does not say.
        fps: frames a second, where the file says nothing or says it wrongly.

    Returns:
        T frames of J points: metres, Z up, NaN where missing; covariances are NaN where the file has none.

    Raises:
        FormatError: the file is malformed, of no known format, or leaves open what is not given here.

    Example:
        >>> import muybridge
        >>> muybridge.write_points("walk.trc", muybridge.capture("session").points["body23"])
        >>> muybridge.read_points("walk.trc").points_world.shape
        (48, 23, 3)
    """
    return _read(path, units=units, up=up, fps=fps).positions


def write_points(path: str | os.PathLike[str], points: Points3D) -> None:
    """Write labelled 3D points to .trc, .c3d, .csv, .parquet or .npz; the suffix decides the format.

    Args:
        path: the file; an existing one is replaced.
        points: T frames of J points, metres, Z up, NaN where missing.

    Raises:
        FormatError: the suffix is of no format that holds points.
        OutputError: the file cannot be written.

    Example:
        >>> import muybridge
        >>> points = muybridge.capture("session").points["body23"]
        >>> muybridge.write_points("walk.csv", points)
    """
    write_file(Path(path), Take(points=points))


def _read(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    up: str | None = None,
    fps: float | None = None,
    asf: str | os.PathLike[str] | None = None,
    clip: str | int | None = None,
) -> Take:
    return read_file(Path(path), ReadOptions(units, up, fps, None if asf is None else Path(asf), clip))
