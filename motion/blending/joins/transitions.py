"""Ways to go over from one motion into another, at frames and with an alignment that are given."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat, slerp
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.joins.inertialising import inertialise
from muybridge.motion.blending.joins.join_places import Measure
from muybridge.motion.blending.joins.quadratic import FEWEST, MOST, smooth_join
from muybridge.motion.editing.cutting import join

How = Literal["inertial", "crossfade", "quadratic", "align"]
_CROSSFADE_S = 0.4
_INERTIAL_S = (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.3, 1.6)


@dataclass(frozen=True)
class JoinOptions:
    """How motions are joined.

    Attributes:
        how: "inertial" lets the difference die away behind the join, "crossfade" fades over about it, "quadratic" fits
            a parabola about it, "align" lays the motions over each other and leaves the jump.
        seconds: of the transition; None: of "inertial", the shortest one that is no more violent than the motions
            themselves; of "crossfade" 0.4.
        frames: on either side of the join, of "quadratic": 5 to 20.
        overlap: seconds at the end of one motion and the beginning of the next in which a join may be.
        measure: see `find_joins`.
        bend: whether "inertial" keeps accelerations continuous too.
        plant: whether feet are planted.
    """

    how: How = "inertial"
    seconds: float | None = None
    frames: int = 10
    overlap: float = 1.0
    measure: Measure = "clouds"
    bend: bool = True
    plant: bool = True

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < np.inf:
            raise MuybridgeError(f"a transition must last longer than 0 s, not {self.seconds:g} s")
        if not FEWEST <= self.frames <= MOST:
            raise MuybridgeError(f"the quadratic fit takes {FEWEST} to {MOST} frames on either side, not {self.frames}")

    @property
    def durations(self) -> tuple[float, ...]:
        """Seconds of the transition that may be tried, in this order."""
        if self.seconds is not None:
            return (self.seconds,)
        return _INERTIAL_S if self.how == "inertial" else (_CROSSFADE_S,)

    def margin(self, fps: float) -> int:
        """Frames on either side of the join that the transition is made of."""
        if self.how == "crossfade":
            return round(0.5 * self.durations[0] * fps)
        return self.frames if self.how == "quadratic" else 2 * int(self.how == "inertial")


def transition(
    first: Motion, second: Motion, leave: int, enter: int, options: JoinOptions, seconds: float
) -> tuple[Motion, float]:
    """The first motion up to the join, and the second one from there on.

    Args:
        first: which is left.
        second: where it is wanted on the ground.
        leave: the last frame of the first motion.
        enter: the frame of the second one at the same time.
        options: how.
        seconds: of the transition, where `how` has such; it is shorter where the motions are.

    Returns:
        The joined motion, whose frame `leave` is at the join, and the seconds of the transition.

    Raises:
        MuybridgeError: there is nothing to fade over.
    """
    fps = first.fps
    second = replace(second, skeleton=first.skeleton)  # the same to within what `same_skeleton` allows
    if options.how == "inertial":
        ahead = max((len(second) - 1 - enter) / fps, 1 / fps)
        old = first.select(slice(max(leave - 2, 0), leave + 1))
        new = inertialise(old, second, min(seconds, ahead), options.bend, enter)
        return join([first.select(slice(0, leave)), new]), min(seconds, ahead)
    cut = join([first.select(slice(0, leave)), second.select(slice(enter, None))])
    if options.how == "align":
        return cut, 0.0
    if options.how == "quadratic":
        return smooth_join(cut, leave - 0.5, options.frames), 2 * options.frames / fps
    half = min(round(0.5 * seconds * fps), leave, len(first) - 1 - leave, enter, len(second) - 1 - enter)
    if half < 1:
        raise MuybridgeError("the motions do not overlap at the join, so there is nothing to fade over: join them "
                             "farther from their ends, or without a cross-fade")  # fmt: skip
    return _faded(cut, first, second, leave, enter, half), 2 * half / fps


def _faded(cut: Motion, whole: Motion, placed: Motion, leave: int, enter: int, half: int) -> Motion:
    """The cut motion, faded over in `half` frames on either side of the join."""
    share = np.arange(1, 2 * half + 2) / (2 * half + 2)
    share = share**2 * (3 - 2 * share)  # Kovar, Gleicher and Pighin 2002, equation 6
    window = slice(leave - half, leave + half + 1)
    a, b = whole.select(window), placed.select(slice(enter - half, enter + half + 1))

    def mixed(values: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
        out, w = values.copy(), share.reshape(-1, *[1] * (values.ndim - 1))
        out[window] = (1 - w) * first + w * second
        return out

    quat = cut.quat_wxyz.copy()
    quat[window] = slerp(a.quat_wxyz, b.quat_wxyz, share[:, None])
    slides = None
    if cut.translations is not None and a.translations is not None and b.translations is not None:
        slides = mixed(cut.translations, a.translations, b.translations)
    return replace(
        cut,
        root_positions_world=mixed(cut.root_positions_world, a.root_positions_world, b.root_positions_world),
        quat_wxyz=continuous_quat(quat),
        translations=slides,
    )
