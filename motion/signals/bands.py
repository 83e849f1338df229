"""Gains of frequency bands: the character of a movement, from a tremor to a swagger, as an equalizer has it for sound.

After A. Bruderlin, L. Williams, "Motion signal processing", 1995, section 2.2, on logarithms of rotations rather than
Euler angles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.signals.charts import Chart, chart_of
from muybridge.motion.signals.filter_bank import band_range, filter_bank, level_count
from muybridge.wording import counted


@dataclass(frozen=True, eq=False)
class MotionBands:
    """A motion divided into frequency bands, of `K` octaves.

    Attributes:
        motion: that was divided.
        chart: its rotations as vectors about a running mean.
        rotations: (K, T, J, 3) radians; bands of the chart's vectors from fine to coarse.
        slow_rotations: (T, J, 3) radians, what the bands leave.
        positions: (K, T, 1 + S, 3) metres; bands of the first root's position and of sliding joints' translations.
        slow_positions: (T, 1 + S, 3) metres, what the bands leave.
    """

    motion: Motion
    chart: Chart
    rotations: FloatArray
    slow_rotations: FloatArray
    positions: FloatArray
    slow_positions: FloatArray

    def __len__(self) -> int:
        return len(self.rotations)

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Hz between which each band lies, from fine to coarse."""
        return tuple(band_range(k + 1, self.motion.fps) for k in range(len(self)))

    def with_gains(self, gains: Sequence[float]) -> Motion:
        """The motion with bands scaled; what the bands leave, which is the slowest, is kept.

        Args:
            gains: of the bands from fine to coarse; those of further bands are 1.

        Raises:
            MuybridgeError: more gains than bands, or one that is no number.
        """
        if len(gains) > len(self):
            raise MuybridgeError(
                f"{len(gains)} gains are given, and a clip of {counted(len(self.motion), 'frame')} has "
                f"{counted(len(self), 'band')}; give at most as many"
            )
        if not np.isfinite(gains).all():
            raise MuybridgeError(f"gains must be numbers, not {', '.join(f'{g:g}' for g in gains)}")
        change = np.asarray(gains, dtype=np.float64) - 1
        turns, places = (np.tensordot(change, x[: len(gains)], 1) for x in (self.rotations, self.positions))
        motion = self.motion
        quat = self.chart.rotations(self.chart.vectors + turns)
        slides = None if motion.translations is None else motion.translations + places[:, 1:]
        return replace(
            motion, quat_wxyz=quat, translations=slides,
            root_positions_world=motion.root_positions_world + places[:, 0],
        )  # fmt: skip


def split_bands(motion: Motion) -> MotionBands:
    """Divide a motion into frequency bands; with the slow rest they add up to it.

    Each band is an octave: the finest holds what is faster than 0.18 times the frame rate, each further one reaches
    down to half of that. The ends of a path over the ground, and a steady travel, are in no band.

    Args:
        motion: of any skeleton.

    Raises:
        MuybridgeError: the clip has fewer than three frames.
    """
    check_editable(motion)
    if level_count(len(motion)) == 0:
        raise MuybridgeError(f"the clip has {counted(len(motion), 'frame')}; bands need at least 3")
    chart = chart_of(motion.quat_wxyz)
    rotations, slow = filter_bank(chart.vectors)
    places = motion.root_positions_world[:, None]
    if motion.translations is not None:
        places = np.concatenate([places, motion.translations], axis=1)
    positions, slow_positions = filter_bank(places, odd=True)
    return MotionBands(motion, chart, rotations, slow, positions, slow_positions)


def scale_bands(motion: Motion, gains: Sequence[float]) -> Motion:
    """The motion with frequency bands scaled.

    Args:
        motion: of any skeleton.
        gains: of the bands from fine to coarse, see `split_bands`; those of further bands are 1.

    Raises:
        MuybridgeError: the clip has fewer than three frames, or fewer bands than there are gains.
    """
    return split_bands(motion).with_gains(gains)
