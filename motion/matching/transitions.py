"""What is left of the differences at transitions, while the figure goes on: an inertialised transition, frame by frame.

See `muybridge.motion.blending.joins.inertialising`, which does this to whole motions.
"""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, multiply_quat, quat_from_rotvec
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.joins.inertialising import inertial_decay, rotation_offsets


@dataclass(frozen=True, eq=False)
class _Difference:
    """A difference with its derivatives at a transition: `offset`, `rate` and `bend`, (...) each."""

    offset: FloatArray
    rate: FloatArray
    bend: FloatArray

    @classmethod
    def at_end(cls, differences: FloatArray, fps: float) -> "_Difference":
        """Of differences (up to 3, ...) in the last frames before a transition."""
        last = differences[-1]
        rate = (last - differences[-2]) * fps if len(differences) > 1 else np.zeros_like(last)
        bend = np.zeros_like(last)
        if len(differences) > 2:
            bend = (last - 2 * differences[-2] + differences[-3]) * fps**2
            rate = rate + 0.5 * bend / fps  # a one-sided difference is the rate half a frame ago
        return cls(last, rate, bend)

    def after(self, times: FloatArray, seconds: float) -> FloatArray:
        """(T, ...) what is left of it at times since the transition."""
        return inertial_decay(self.offset, self.rate, self.bend, seconds, times)


@dataclass(frozen=True, eq=False)
class Transition:
    """What was played minus what plays now, at the moment of a transition.

    Attributes:
        places: of the root's position, metres.
        turns: of the joints, rotation vectors in the axes of their parents.
        slides: of the translations of sliding joints, metres; None where none slides.
    """

    places: _Difference
    turns: _Difference
    slides: _Difference | None

    @classmethod
    def between(cls, old: Motion, new: Motion) -> "Transition":
        """From the last frames of what was played to the same frames of what plays from now on, as many of them."""
        slides = None
        if old.translations is not None and new.translations is not None:
            slides = _Difference.at_end(old.translations - new.translations, new.fps)
        return cls(
            _Difference.at_end(old.root_positions_world - new.root_positions_world, new.fps),
            _Difference.at_end(rotation_offsets(old.quat_wxyz, new.quat_wxyz), new.fps), slides,
        )  # fmt: skip

    def apply(self, motion: Motion, times: FloatArray, seconds: float) -> Motion:
        """The frames that play, with what is left of the difference.

        Args:
            motion: (T frames).
            times: (T,) seconds since the transition.
            seconds: after which nothing is left.
        """
        if not len(times) or times[0] >= seconds:
            return motion
        slides = motion.translations
        if slides is not None and self.slides is not None:
            slides = slides + self.slides.after(times, seconds)
        turns = quat_from_rotvec(self.turns.after(times, seconds))
        return replace(
            motion,
            root_positions_world=motion.root_positions_world + self.places.after(times, seconds),
            quat_wxyz=continuous_quat(multiply_quat(turns, motion.quat_wxyz)),
            translations=slides,
        )
