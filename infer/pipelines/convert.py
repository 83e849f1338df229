"""Points or motion from one file format to another, with gaps filled and filtered over time."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.smoothing.filters import FilterOptions, residual_cutoff, smooth, smooth_rotations
from muybridge.geometry.smoothing.gaps import GapOptions, fill_gaps
from muybridge.motion.formats.skeletal.asf import find_asf
from muybridge.motion.take import Take

Filter = Literal["kalman", "butterworth", "savgol", "gcv_spline", "one_euro", "gaussian", "median", "loess"]


@dataclass(frozen=True)
class FilterChoice:
    """What is done to a take over time.

    Attributes:
        fill_gaps: seconds; gaps of points that are at most as long are filled.
        method: filter of points, or of a motion's rotations; None for none.
        cutoff_hz: of the Butterworth filter; None to find it by residual analysis.
    """

    fill_gaps: float = 0.0
    method: Filter | None = None
    cutoff_hz: float | None = None

    def check(self, take: Take) -> None:
        """Check that the options fit each other and the take.

        Raises:
            MuybridgeError: they do not.
        """
        if self.cutoff_hz is not None and self.method != "butterworth":
            raise MuybridgeError("only the Butterworth filter has a cut-off frequency", remedy="butterworth")
        if self.fill_gaps > 0 and take.points is None:
            raise MuybridgeError("gaps of points can be filled; a motion has no gaps")
        if self.cutoff_hz is not None and not 0 < self.cutoff_hz < 0.5 * take.fps:
            raise MuybridgeError(
                f"cut-off of {self.cutoff_hz:g} Hz: with {take.fps:g} frames/s it must be between 0 and "
                f"{0.5 * take.fps:g} Hz"
            )


def written_files(target: Path) -> list[Path]:
    """All files that writing `target` writes: an AMC file goes with the ASF file of its skeleton."""
    return [target, target.with_suffix(".asf")] if target.suffix.lower() == ".amc" else [target]


def read_files(source: Path, asf: Path | None) -> list[Path]:
    """All files that reading `source` reads."""
    if source.suffix.lower() == ".amc" and source.is_file():
        return [source, asf or find_asf(source)]
    return [source]


def filter_take(take: Take, options: FilterChoice) -> tuple[Take, list[str]]:
    """Fill gaps of a take and filter it over time.

    Args:
        take: points or a motion.
        options: what is done.

    Returns:
        The take, and what was done, a sentence each.

    Raises:
        MuybridgeError: the options do not fit each other or the take.
    """
    options.check(take)
    if options.fill_gaps <= 0 and options.method is None:
        return take, []
    notes = []
    cutoff = options.cutoff_hz
    motion = take.motion
    if take.points is not None:
        values = take.points.points_world
    else:
        assert motion is not None  # a take has the one or the other
        values = motion.root_positions_world
    if options.fill_gaps > 0:
        before = int(np.isnan(values).any(axis=-1).sum())
        values = fill_gaps(values, take.fps, options=GapOptions(max_gap=options.fill_gaps))
        left = int(np.isnan(values).any(axis=-1).sum())
        notes.append(f"{before - left} missing points filled in, {left} left (longer gaps, and the ends of the take)")
    if options.method == "butterworth" and cutoff is None:
        cutoff = residual_cutoff(values, take.fps)
        notes.append(f"cut-off {cutoff:.1f} Hz, by residual analysis")
    filters = FilterOptions(cutoff_hz=cutoff)
    if options.method is not None:
        values = smooth(values, take.fps, options.method, filters)
    if take.points is not None:
        return replace(take, points=replace(take.points, points_world=values)), notes
    assert motion is not None
    turned = smooth_rotations(motion.quat_wxyz, take.fps, options.method or "kalman", filters)
    return replace(take, motion=replace(motion, root_positions_world=values, quat_wxyz=turned)), notes
