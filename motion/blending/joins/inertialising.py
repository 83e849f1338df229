"""Inertialised transitions: the new motion plays at once, and the difference to the old one dies away.

Bollo 2018, "Inertialization: High-Performance Animation Transitions in Gears of War". The difference in place and its
first and second derivative at the transition are carried to zero by a polynomial of the fifth degree, so that the
result is continuous in all three.
"""

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
)
from muybridge.geometry.skeleton.motion import Motion


def inertial_decay(
    offset: FloatArray, rate: FloatArray, bend: FloatArray, seconds: float, times: FloatArray
) -> FloatArray:
    """(T, ...) a difference that goes to zero, with given derivatives at its start and none at its end.

    Args:
        offset: (...) at time zero.
        rate: (...) its derivative there, per second.
        bend: (...) its second derivative there, per second squared.
        seconds: after which it is zero for good.
        times: (T,) seconds, not negative.
    """
    s = np.minimum(np.asarray(times, dtype=np.float64) / seconds, 1.0).reshape(-1, *[1] * np.ndim(offset))
    x, v, a = np.asarray(offset), np.asarray(rate) * seconds, np.asarray(bend) * seconds**2
    rest = 1 - s
    # The Hermite basis of the fifth degree: each term is one for its own derivative at zero, none for all others.
    of_x = rest**3 * (1 + 3 * s + 6 * s**2)
    of_v = rest**3 * (s + 3 * s**2)
    of_a = rest**3 * s**2 / 2
    return np.asarray(of_x * x + of_v * v + of_a * a)


def rotation_offsets(old: FloatArray, new: FloatArray) -> FloatArray:
    """(F, J, 3) rotation vectors that turn the new rotations (F, J, 4) into the old ones, without jumps in time; those
    of the last frame are of at most half a turn."""
    out = rotvec_from_quat(multiply_quat(old, conjugate_quat(new)))
    for f in range(len(out) - 2, -1, -1):  # beyond half a turn a vector has another one that means the same
        size = np.maximum(np.linalg.norm(out[f], axis=-1, keepdims=True), 1e-12)
        other = out[f] * (1 - 2 * np.pi / size)
        nearer = np.linalg.norm(other - out[f + 1], axis=-1) < np.linalg.norm(out[f] - out[f + 1], axis=-1)
        out[f] = np.where(nearer[:, None], other, out[f])
    return out


def inertialise(old: Motion, new: Motion, seconds: float = 0.3, match_bend: bool = True, lead: int = 0) -> Motion:
    """Play `new`, begun so that it continues `old` without a jump in place, velocity or acceleration.

    Args:
        old: what has been played; of its last three frames the last one is where the transition happens.
        new: what plays from there on, already where it is wanted on the ground. The same skeleton and frames per
            second.
        seconds: over which the difference dies away.
        match_bend: whether the acceleration is continuous too; where the old motion is noisy it is better not.
        lead: frames of `new` before the one that is at the time of the old motion's last one: they are not played, and
            tell how it moves there. Where there are none, it is taken to have moved as it goes on.

    Returns:
        (T - lead frames) the new motion; its first frame is the old one's last.
    """
    before = new.select(slice(max(lead - 2, 0), lead + 1))
    new = new.select(slice(lead, None))
    frames = min(3, len(old), len(new) if lead < 2 else 3)
    times = np.arange(len(new)) / new.fps

    def settle(difference: FloatArray) -> FloatArray:
        """(T, ...) of differences (F, ...) in the last frames of the old motion, carried back from the new one."""
        rate = (difference[-1] - difference[-2]) * new.fps if frames > 1 else np.zeros_like(difference[-1])
        bend = np.zeros_like(rate)
        if frames > 2 and match_bend:
            bend = (difference[-1] - 2 * difference[-2] + difference[-3]) * new.fps**2
            rate = rate + 0.5 * bend / new.fps  # a one-sided difference is the rate half a frame ago
        return inertial_decay(difference[-1], rate, bend, seconds, times)

    def leading(values: FloatArray, known: FloatArray) -> FloatArray:
        return known[-frames:] if len(known) >= frames else _before(values, frames)

    ago = before.quat_wxyz[-frames:] if len(before) >= frames else _before_rotations(new.quat_wxyz, frames)
    places = settle(old.root_positions_world[-frames:]
                    - leading(new.root_positions_world, before.root_positions_world))  # fmt: skip
    turns = settle(rotation_offsets(old.quat_wxyz[-frames:], ago))
    slides = None
    if new.translations is not None and old.translations is not None and before.translations is not None:
        gone = leading(new.translations, before.translations)
        slides = new.translations + settle(old.translations[-frames:] - gone)
    return replace(
        new,
        root_positions_world=new.root_positions_world + places,
        quat_wxyz=continuous_quat(multiply_quat(quat_from_rotvec(turns), new.quat_wxyz)),
        translations=slides,
    )


def _before(values: FloatArray, frames: int) -> FloatArray:
    """(frames, ...) ending with the first of values (T, ...), continued backwards with their own derivatives."""
    if frames == 1:
        return values[:1]
    if frames == 2:
        return np.stack([2 * values[0] - values[1], values[0]])
    step, bend = values[1] - values[0], values[2] - 2 * values[1] + values[0]
    first = values[0] - step + bend
    return np.stack([values[0] - 2 * step + 3 * bend, first, values[0]])


def _before_rotations(quat: FloatArray, frames: int) -> FloatArray:
    """(frames, J, 4) ending with the first of rotations (T, J, 4), continued backwards."""
    away = rotvec_from_quat(multiply_quat(quat[:frames], conjugate_quat(quat[:1])))
    return multiply_quat(quat_from_rotvec(_before(away, frames)), quat[:1])
