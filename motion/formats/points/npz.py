"""Points as NumPy's `.npz`: `points_world` (T, J, 3) in metres with Z up, `names` (J,), `fps`, `covariance_world`.

Read are also the usual other names of these arrays.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.common import METRES_OF_UNIT, UP_PERMUTATION, check_unit, check_up
from muybridge.motion.formats.points.world import PointsOfFile, Trajectories, points_of_file
from muybridge.npz import load_npz

# Frames that are turned at once, so that a long file needs no second copy.
_CHUNK = 4096
_POINTS = ("points_world", "points3d_world", "points3d", "points", "keypoints3d", "joints3d", "xyz", "markers")
_NAMES = ("names", "labels", "landmarks", "keypoint_names", "joint_names", "marker_names")
_RATES = ("fps", "rate", "frame_rate", "framerate", "mocap_framerate", "mocap_frame_rate")


def write_npz(path: Path, points: Points3D) -> None:
    """Write points with their covariances.

    Raises:
        OutputError: the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            points_world=points.points_world,
            covariance_world=points.covariance_world,
            names=np.array(points.landmarks.names),
            fps=np.array(points.fps),
            unit=np.array("m"),
        )


def read_npz(
    path: Path, fps: float | None = None, unit: str | None = None, up: str = "z", limit: int | None = None
) -> Points3D:
    """Read points into metres, Z up; nothing in the file is run.

    Args:
        path: the file.
        fps: frames per second; None for what the file states.
        unit: m, cm or mm; None for the file's `unit`, metres where it has none.
        up: y or z.
        limit: bytes that the file's arrays may take; None for the limits of `muybridge.npz.load_npz`.

    Raises:
        FormatError: malformed, larger than allowed, or an array is missing; the message lists what is there.
    """
    return read_npz_from(path, fps, unit, up, limit).points


def read_npz_from(
    path: Path, fps: float | None = None, unit: str | None = None, up: str = "z", limit: int | None = None
) -> PointsOfFile:
    """The points as `read_npz` has them, and what was left out."""
    path, up = Path(path), check_up(up)
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing .npz file")
    arrays = load_npz(path, limit=limit)
    with parsing(path, FormatError, "an .npz"):
        found = _trajectories(path, arrays, fps)
        covariance, shape = arrays.pop("covariance_world", None), found.xyz.shape
        read = points_of_file(path, found, "npz", unit, up, fps)
        if covariance is not None and covariance.shape == (*shape, 3) and covariance.dtype.kind == "f":
            metres, turn = METRES_OF_UNIT[check_unit(path, unit or found.unit, "the unit")], UP_PERMUTATION[up]
            turned = _turned(covariance.astype(np.float64, copy=False), metres, list(turn))
            read = replace(read, points=replace(read.points, covariance_world=turned))
        return read


def _trajectories(path: Path, arrays: dict[str, NDArray[Any]], fps: float | None) -> Trajectories:
    there = ", ".join(f"{k} {v.shape}" for k, v in arrays.items()) or "nothing"
    xyz = _pick(arrays, _POINTS)
    if xyz is None or xyz.ndim != 3 or xyz.shape[-1] not in (3, 4) or xyz.dtype.kind not in "fiu":
        raise FormatError(f"{path}: needs `points_world` of shape (frames, landmarks, 3); there is {there}")
    names = _pick(arrays, _NAMES)
    if names is None or names.shape != xyz.shape[1:2] or names.dtype.kind not in "US":
        raise FormatError(f"{path}: needs `names`, one text for each of {xyz.shape[1]} landmarks; there is {there}")
    if fps is None:
        rate = _pick(arrays, _RATES)
        if rate is None or rate.size != 1 or rate.dtype.kind not in "fiu" or not 0 < float(rate.flat[0]) < 1e9:
            raise FormatError(f"{path}: has no `fps`, frames per second", remedy="fps_unstated")
        fps = float(rate.flat[0])
    stated = arrays.get("unit")
    word = str(stated.flat[0]) if stated is not None and stated.size == 1 else "m"
    if not len(xyz):
        raise FormatError(f"{path}: has no frame")
    labels = tuple(n.decode("utf-8", "replace") if isinstance(n, bytes) else str(n) for n in names.tolist())
    place = xyz[..., :3].astype(np.float64, copy=False)
    return Trajectories(labels, place, fps, check_unit(path, word, "the unit"))


def _turned(covariance: FloatArray, metres: float, turn: list[int]) -> FloatArray:
    """Covariances (T, J, 3, 3) in the world; `covariance` is overwritten."""
    for at in range(0, len(covariance), _CHUNK):
        part = covariance[at : at + _CHUNK]
        part[:] = part[..., turn, :][..., turn] * metres**2
    return covariance


def _pick(arrays: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any] | None:
    return next((arrays[n] for n in names if n in arrays), None)
