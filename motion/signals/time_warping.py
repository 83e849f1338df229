"""Warps of time: moments of a clip put at other times, the way between them smooth and never backwards.

After A. Witkin, Z. Popovic, "Motion warping", 1995: t = g(t') through constraints. The curve is a cubic of continuous
slope whose slopes at the constraints are the weighted harmonic means of F. N. Fritsch, J. Butland, "A method for
constructing local monotone piecewise cubic interpolants", 1984, which keep it strictly monotone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.editing.resampling import motion_at

_MOST_FRAMES = 1_000_000
_SAME_TIME = 1e-6  # frames


@dataclass(frozen=True, eq=False)
class TimeMap:
    """Times of a clip by times of its warped copy, strictly ascending, with a continuous slope.

    Attributes:
        new: (K,) seconds of the warped clip, ascending from 0.
        old: (K,) seconds of the clip at these.
        rates: (K,) seconds of the clip for each of the warped one, there.
    """

    new: FloatArray
    old: FloatArray
    rates: FloatArray

    def __call__(self, times: FloatArray) -> FloatArray:
        """(N,) seconds of the clip at seconds (N,) of the warped one, up to the last."""
        k = np.clip(np.searchsorted(self.new, times, side="right") - 1, 0, len(self.new) - 2)
        width = self.new[k + 1] - self.new[k]
        s = (times - self.new[k]) / width
        rise = self.old[k + 1] - self.old[k]
        return np.asarray(
            self.old[k] + s * s * (3 - 2 * s) * rise
            + width * (s * (1 - s) ** 2 * self.rates[k] + s * s * (s - 1) * self.rates[k + 1])
        )  # fmt: skip


def time_map(moments: Sequence[tuple[float, float]], seconds: float) -> TimeMap:
    """The map through moments of a clip and the times at which they shall be.

    The clip begins where it began; behind the last moment it goes on at its own speed.

    Args:
        moments: pairs of a time of the clip and its new time, seconds.
        seconds: time of the clip's last frame.

    Raises:
        MuybridgeError: a moment outside of the clip, two at one time, or a warp that would run back; the message names
            the pair.
    """
    if not moments:
        raise MuybridgeError("a warp of time needs at least one pair of times, OLD=NEW")
    pairs = sorted((float(a), float(b)) for a, b in moments)
    for old, new in pairs:
        if not np.isfinite([old, new]).all() or not -_SAME_TIME <= old <= seconds + 1e-3:
            raise MuybridgeError(f"{old:g}={new:g}: the clip has no moment {old:g} s; it ends at {seconds:.3f} s")
    if pairs[0][0] > _SAME_TIME:
        pairs.insert(0, (0.0, 0.0))
    elif abs(pairs[0][1]) > _SAME_TIME:
        raise MuybridgeError(f"{pairs[0][0]:g}={pairs[0][1]:g}: the clip begins at 0 s, and stays there")
    for (old, new), (later, newer) in zip(pairs, pairs[1:], strict=False):
        if later - old < _SAME_TIME:
            raise MuybridgeError(f"{later:g}={newer:g}: the moment {later:g} s is given twice")
        if newer - new < _SAME_TIME:
            raise MuybridgeError(f"{later:g}={newer:g}: the warp would run back, since the moment {old:g} s before it "
                                 f"is put at {new:g} s; give it a later time")  # fmt: skip
    if seconds - pairs[-1][0] > 1e-3:
        pairs.append((seconds, pairs[-1][1] + seconds - pairs[-1][0]))
    if len(pairs) < 2:
        raise MuybridgeError("the clip is too short for a warp of time: it has one moment")
    old_times, new_times = np.array(pairs).T
    return TimeMap(new_times, old_times, _slopes(new_times, old_times))


def _slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """(K,) slopes, each less than three times that of the intervals beside, so that the cubic ascends strictly."""
    h = np.diff(x)
    rise = np.diff(y) / h
    if len(rise) == 1:
        return np.repeat(rise, 2)
    first, second = h[:-1] + 2 * h[1:], 2 * h[:-1] + h[1:]
    inner = (first + second) / (second / rise[:-1] + first / rise[1:])
    return np.concatenate([rise[:1], inner, rise[-1:]])


def warp_time(motion: Motion, moments: Sequence[tuple[float, float]]) -> Motion:
    """The clip with moments at other times, faster and slower in between without a jump in speed.

    Args:
        motion: of any skeleton.
        moments: pairs of a time of the clip and its new time, seconds; behind the last one the speed is the clip's own.

    Raises:
        MuybridgeError: as `time_map`, or more than a million frames.
    """
    check_editable(motion)
    warp = time_map(moments, (len(motion) - 1) / motion.fps)
    count = int(np.floor(warp.new[-1] * motion.fps + _SAME_TIME)) + 1
    if count > _MOST_FRAMES:
        raise MuybridgeError(f"the warped clip would have {count:,} frames; {_MOST_FRAMES:,} are the most")
    at = warp(np.arange(count) / motion.fps) * motion.fps
    at = np.where(np.abs(at - np.round(at)) < _SAME_TIME, np.round(at), at)
    return motion_at(motion, at)
