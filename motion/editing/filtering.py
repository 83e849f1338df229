"""Smoothing over time of all that moves in a take."""

from dataclasses import replace

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.smoothing.filters import METHODS, FilterOptions, residual_cutoff, smooth_rotations
from muybridge.geometry.smoothing.filters import smooth as smooth_values
from muybridge.motion.editing.channels import T, check_editable, per_channel


def cutoff_of(thing: T) -> float:
    """Hz: the cut-off that residual analysis finds for the points, or for the positions of a motion's joints."""
    check_editable(thing)
    return residual_cutoff(
        thing.points_world if isinstance(thing, Points3D) else thing.joint_positions_world(), thing.fps
    )


def smooth(thing: T, cutoff: float | None = None, method: str = "butterworth") -> T:
    """Filter positions and rotations over time, without delay.

    Args:
        thing: a motion or points.
        cutoff: Hz, of `butterworth` alone; None finds it by residual analysis. 6 is usual for walking, 10 for sport.
        method: a filter of `muybridge.geometry.smoothing`.

    Raises:
        MuybridgeError: an unknown filter, or a cut-off that is too high for the frame rate or that the filter lacks.
    """
    check_editable(thing)
    if method not in METHODS:
        raise MuybridgeError(f"unknown filter {method!r}: choose one of {', '.join(METHODS)}")
    if cutoff is not None and method != "butterworth":
        raise MuybridgeError(f"the filter {method} has no cut-off; only butterworth has one")
    if cutoff is not None and not 0 < cutoff < 0.5 * thing.fps:
        raise MuybridgeError(
            f"a cut-off of {cutoff:g} Hz is not between 0 and half of the frame rate of {thing.fps:g} frames/s"
        )
    if method == "butterworth" and cutoff is None:
        cutoff = cutoff_of(thing)
    options = FilterOptions(cutoff_hz=cutoff)
    if isinstance(thing, Points3D):
        return replace(thing, points_world=smooth_values(thing.points_world, thing.fps, method, options))
    fps = thing.fps
    return per_channel(
        thing,
        lambda x: np.asarray(smooth_values(x, fps, method, options)),
        lambda q: smooth_rotations(q, fps, method, options),
    )
