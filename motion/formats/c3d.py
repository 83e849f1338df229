"""C3D, the binary file of biomechanics, through ezc3d: Z up, millimetres, 4-byte floats.

A missing point has the residual -1 (and zeros as coordinates: every reader goes by the residual). A known
point's residual is one standard deviation of its position where a covariance is known: the format means "the
average residual of the intersecting rays", which the same figure stands for. It has one byte: whole
millimetres from 1 to 127, and 0 for "not measured".
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge import __version__
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks import Points3D
from muybridge.motion.formats.points3d import points_of_file

METRES_OF_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# The axis parameters as the C3D manual has them: what points right and up on a screen that shows the subject
# from its left.
_X_SCREEN, _Y_SCREEN = "+Y", "+Z"
_UP_PERMUTATION = {"+Z": (0, 1, 2), "+Y": (2, 0, 1)}


def write_c3d(path: Path, points: Points3D) -> None:
    """Write points in millimetres, Z up.

    Args:
        path: the file to write; replaced only once it is complete.
        points: (T, J, 3) metres; NaN where unknown.

    Raises:
        OutputError: the file cannot be written.
    """
    import ezc3d  # type: ignore[import-untyped]  # here, since it is slow to load and few need it

    xyz_mm = np.asarray(points.points_world, dtype=np.float64) * 1e3
    frames, markers = xyz_mm.shape[:2]
    missing = ~np.all(np.isfinite(xyz_mm), axis=-1)
    c3d: Any = ezc3d.c3d()
    c3d["header"]["points"]["frame_rate"] = float(points.fps)
    parameters = c3d["parameters"]
    parameters["POINT"]["RATE"]["value"] = [float(points.fps)]
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["POINT"]["LABELS"]["value"] = tuple(points.landmarks.names)
    parameters["POINT"]["DESCRIPTIONS"]["value"] = tuple(
        f"{points.landmarks.name} landmark" for _ in points.landmarks.names
    )
    c3d.add_parameter("POINT", "X_SCREEN", [_X_SCREEN])
    c3d.add_parameter("POINT", "Y_SCREEN", [_Y_SCREEN])
    c3d.add_parameter("MANUFACTURER", "COMPANY", ["muybridge"])
    c3d.add_parameter("MANUFACTURER", "SOFTWARE", ["muybridge"])
    c3d.add_parameter("MANUFACTURER", "VERSION_LABEL", [__version__])
    data = np.ones((4, markers, frames))
    data[:3] = np.where(missing[..., None], np.nan, xyz_mm).transpose(2, 1, 0)
    c3d["data"]["points"] = data
    residual = np.where(missing, -1.0, _standard_deviation_mm(points.covariance_world))
    c3d["data"]["meta_points"]["residuals"] = residual.T[None]
    c3d["data"]["meta_points"]["camera_masks"] = np.zeros((7, markers, frames), dtype=bool)
    with replacing(path) as temporary:
        try:
            c3d.write(str(temporary))
        except RuntimeError as error:  # ezc3d has one exception for everything
            raise OSError(str(error)) from error


def read_c3d(path: Path) -> Points3D:
    """Read points into metres, Z up (a file whose Y_SCREEN says +Y is turned).

    Returns:
        points_world (T, J, 3), NaN where the residual is negative; covariance isotropic from the residual
        where that is above zero, else NaN.

    Raises:
        FormatError: the file is not a C3D, holds no points, or its unit or axes are of no known kind.
    """
    import ezc3d

    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing C3D file")
    try:
        c3d: Any = ezc3d.c3d(str(path))
        point = c3d["parameters"]["POINT"]
        fps = float(point["RATE"]["value"][0])
        data = np.asarray(c3d["data"]["points"], dtype=np.float64)
        residual_file = np.asarray(c3d["data"]["meta_points"]["residuals"], dtype=np.float64)[0].T
    except (RuntimeError, OSError, KeyError, IndexError, ValueError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"{path}: is not a readable C3D ({reason}); export it again") from error
    names = _labels(point, data.shape[1])
    if not names or not data.shape[2]:
        raise FormatError(f"{path}: holds no points (labels: {len(names)}, frames: {data.shape[2]}); export them")
    if not fps > 0:
        raise FormatError(f"{path}: POINT:RATE is {fps}; it must be above zero")
    unit = _text(point, "UNITS", "mm")
    if unit not in METRES_OF_UNIT:
        raise FormatError(f"{path}: POINT:UNITS is {unit!r}; valid are {', '.join(METRES_OF_UNIT)}")
    up = _text(point, "Y_SCREEN", "+Z")
    if up not in _UP_PERMUTATION:
        raise FormatError(f"{path}: POINT:Y_SCREEN is {up!r}; valid are {', '.join(_UP_PERMUTATION)}")
    metres = METRES_OF_UNIT[unit]
    xyz = data[:3].transpose(2, 1, 0)[..., _UP_PERMUTATION[up]] * metres
    xyz[(residual_file < 0) | ~np.all(np.isfinite(xyz), axis=-1)] = np.nan
    points = points_of_file(path, names, xyz, fps, "c3d")
    variance = np.where((residual_file > 0) & np.isfinite(xyz[..., 0]), (residual_file * metres) ** 2, np.nan)
    points.covariance_world[:] = np.where(
        np.isfinite(variance)[..., None, None], np.eye(3) * variance[..., None, None], np.nan
    )
    return points


def _standard_deviation_mm(covariance_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J): root of the mean variance a coordinate, in the range the format has; 0 where it is unknown."""
    variance = np.trace(np.asarray(covariance_world, dtype=np.float64), axis1=-2, axis2=-1) / 3.0
    known = np.isfinite(variance) & (variance > 0)
    return np.where(known, np.clip(np.rint(np.sqrt(np.where(known, variance, 0.0)) * 1e3), 1, 127), 0.0)


def _text(point: Any, key: str, default: str) -> str:
    value = point[key]["value"] if key in point else []
    return str(value[0]).strip() or default if len(value) else default


def _labels(point: Any, count: int) -> list[str]:
    """The labels of all points: more than 255 are continued in LABELS2, LABELS3, ..."""
    names = [str(name).strip() for name in point["LABELS"]["value"]]
    for key in (f"LABELS{k}" for k in range(2, 9)):
        names += [str(name).strip() for name in (point[key]["value"] if key in point else [])]
    return names[:count]
