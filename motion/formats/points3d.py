"""What the readers of point files (TRC, C3D) share: labelled points that come without any uncertainty."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError
from muybridge.geometry.landmarks import BODY23, LandmarkSet, Points3D

METRES_OF_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# Which coordinates of a file are x, y, z of the world: where y is up, the file's z is our x.
UP_PERMUTATION = {"z": (0, 1, 2), "y": (2, 0, 1)}


def check_unit(path: Path, unit: str, where: str) -> str:
    """The unit, if it is one of m, cm and mm in some spelling; FormatError with what was found if not."""
    word = unit.strip().lower()
    words = {"meter": "m", "metre": "m", "meters": "m", "metres": "m", "centimeters": "cm", "centimetres": "cm",
             "millimeter": "mm", "millimeters": "mm", "millimetres": "mm"}  # fmt: skip
    word = words.get(word, word)
    if word not in METRES_OF_UNIT:
        raise FormatError(f"{path}: {where} is {unit!r}; valid are {', '.join(METRES_OF_UNIT)}")
    return word


def check_up(up: str) -> str:
    """The axis, if it is y or z; ValueError if not."""
    if up not in UP_PERMUTATION:
        raise ValueError(f"up must be one of {', '.join(UP_PERMUTATION)}, not {up!r}")
    return up


def points_of_file(
    path: Path, names: Sequence[str], points_world: NDArray[np.float64], fps: float, name: str
) -> Points3D:
    """Points3D of what a file holds: positions only, so covariance is NaN and no camera stands behind them.

    Args:
        path: for the message.
        names: (J,) labels; those of BODY23 in its order give that very set, others one called `name` without
            edges.
        points_world: (T, J, 3) metres, Z up, NaN where missing.
        fps: frames a second.
        name: the landmark set's name where it is not one of ours.

    Raises:
        FormatError: a label stands twice.
    """
    twice = sorted({n for n in names if list(names).count(n) > 1})
    if twice:
        raise FormatError(f"{path}: the label {twice[0]!r} stands more than once; rename one of them")
    landmarks = BODY23 if tuple(names) == BODY23.names else LandmarkSet(name, tuple(names), ())
    t, j = points_world.shape[:2]
    return Points3D(
        landmarks=landmarks,
        points_world=points_world,
        covariance_world=np.full((t, j, 3, 3), np.nan),
        residual_px=np.empty((0, t, j)),
        inlier=np.empty((0, t, j), dtype=np.bool_),
        fps=fps,
    )
