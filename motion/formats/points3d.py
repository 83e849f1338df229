"""What the readers of point files (TRC, C3D) share: labelled points that come without any uncertainty."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError
from muybridge.geometry.landmarks import BODY23, LandmarkSet, Points3D


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
