"""Clips as signals of their driving joints, broken into fragments where the movement turns.

After K. Pullen, C. Bregler, "Motion capture assisted animation: texturing and synthesis", 2002, section 3: the
signals are divided into frequency bands, and broken where the driving joint's changes direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import conjugate_quat, multiply_quat, rotvec_from_quat
from muybridge.motion.signals.filter_bank import band_range, filter_bank, level_count

FASTEST_HZ = 6.0  # movements that drive; what is faster is texture
_SLOWEST_HZ = 0.4  # what is slower is posture
_SHORTEST = 0.12  # seconds of a fragment
_TURN = 0.15  # of the signal's standard deviation by which it must turn back for a fragment to end


@dataclass(frozen=True, eq=False)
class Driving:
    """What the driving joints of several clips have in common.

    Attributes:
        joints: of the skeleton.
        mean_wxyz: (D, 4) rotations that all clips are written about.
        axis: (3 D,) the main direction of their movement, a unit vector.
        scale: radians, the standard deviation along it.
    """

    joints: tuple[int, ...]
    mean_wxyz: FloatArray
    axis: FloatArray
    scale: float


@dataclass(frozen=True, eq=False)
class Signals:
    """A clip's driving joints over time.

    Attributes:
        fps: frames per second.
        moving: (T, 3 D) radians, the bands in which movement is.
        rates: (T, 3 D) radians per second of these.
        posture: (T, 3 D) radians, what is slower.
        main: (T,) radians, the main movement, without what is faster than its strongest octave.
    """

    fps: float
    moving: FloatArray
    rates: FloatArray
    posture: FloatArray
    main: FloatArray


@dataclass(frozen=True)
class Fragment:
    """A piece of a clip, from one turn of the movement to the next.

    Attributes:
        clip: number of the clip; -1 is the key-framed one.
        number: within the clip; the next fragment of the same clip begins where this one ends.
        start, end: frames, both inside.
        rises: whether the main movement ascends.
    """

    clip: int
    number: int
    start: int
    end: int
    rises: bool


def find_driving(quat_wxyz: FloatArray, joints: Sequence[int], fps: float) -> Driving:
    """What drives a key-framed clip.

    Args:
        quat_wxyz: (T, J, 4) of the clip.
        joints: that drive.
        fps: frames per second.

    Raises:
        MuybridgeError: they do not move.
    """
    chosen = quat_wxyz[:, list(joints)]
    mean = chosen.mean(axis=0)
    mean = mean / np.linalg.norm(mean, axis=-1, keepdims=True)
    _, moving = _divided(vectors_about(mean, chosen), fps)
    flat = moving - moving.mean(axis=0)
    values, axes = np.linalg.eigh(flat.T @ flat / len(flat))
    scale = float(np.sqrt(max(values[-1], 0.0)))
    if scale < np.radians(0.5):
        raise MuybridgeError("the joints that should drive do not move; key-frame them, or name others that do")
    return Driving(tuple(joints), mean, axes[:, -1], scale)


def vectors_about(mean_wxyz: FloatArray, quat_wxyz: FloatArray) -> FloatArray:
    """(T, 3 D) radians: logarithms of rotations (T, D, 4) relative to (D, 4), continuous over time."""
    vectors = rotvec_from_quat(multiply_quat(conjugate_quat(mean_wxyz), quat_wxyz))
    for t in range(1, len(vectors)):
        angle = np.linalg.norm(vectors[t], axis=-1, keepdims=True)
        other = vectors[t] * (1 - 2 * np.pi / np.maximum(angle, 1e-9))
        nearer = np.linalg.norm(other - vectors[t - 1], axis=-1) < np.linalg.norm(vectors[t] - vectors[t - 1], axis=-1)
        vectors[t] = np.where(nearer[:, None] & (angle > np.pi / 2), other, vectors[t])
    return np.asarray(vectors.reshape(len(vectors), -1))


def signals_of(quat_wxyz: FloatArray, driving: Driving, fps: float) -> Signals:
    """The driving joints of a clip (T, J, 4) over time."""
    vectors = vectors_about(driving.mean_wxyz, quat_wxyz[:, list(driving.joints)])
    posture, moving = _divided(vectors, fps)
    return Signals(fps, moving, np.gradient(moving, axis=0) * fps, posture, _beat(moving @ driving.axis, fps))


def _beat(values: FloatArray, fps: float) -> FloatArray:
    """(T,) the octave of a movement (T,) that has most of it, and what is slower: its turns are those of the movement
    as a whole, not of the detail on its peaks, so that fragments of different takes begin in the same phase."""
    bands, slow = filter_bank(values)
    if not len(bands):
        return values
    most = int(np.argmax(np.var(bands, axis=1)))
    return np.asarray(bands[most:].sum(axis=0) + slow)


def _divided(values: FloatArray, fps: float) -> tuple[FloatArray, FloatArray]:
    """Posture and movement (T, N) of signals (T, N); what is faster than both is left out."""
    bands, slow = filter_bank(values)
    moving = np.zeros_like(values)
    posture = slow.copy()
    for k, band in enumerate(bands):
        low, high = band_range(k + 1, fps)
        middle = float(np.sqrt(low * high))
        if middle < _SLOWEST_HZ:
            posture += band
        elif middle <= FASTEST_HZ:
            moving += band
    return posture, moving


def texture_bands(frames: int, fps: float) -> int:
    """How many of a clip's bands are texture: faster than what drives."""
    count = 0
    for k in range(level_count(frames)):
        low, high = band_range(k + 1, fps)
        count += bool(np.sqrt(low * high) > FASTEST_HZ)
    return count


def break_clip(signals: Signals, driving: Driving, clip: int) -> list[Fragment]:
    """The fragments of a clip, one behind the other; from its first to its last frame.

    A turn counts if the movement goes back by a share of its usual size, and if the fragment is not too short.
    """
    turns = _turns(signals.main, _TURN * driving.scale, max(round(_SHORTEST * signals.fps), 2))
    out = []
    for number, (a, b) in enumerate(zip(turns, turns[1:], strict=False)):
        out.append(Fragment(clip, number, a, b, bool(signals.main[b] > signals.main[a])))
    return out


def _turns(values: FloatArray, least: float, shortest: int) -> list[int]:
    """Frames of the local extremes that differ by at least `least` from one to the next, and both ends."""
    turns, best, rising = [0], 0, 0
    for t in range(1, len(values)):
        if rising == 0 and abs(values[t] - values[0]) > least:
            rising = 1 if values[t] > values[0] else -1
            best = t
        elif rising:
            if (values[t] - values[best]) * rising > 0:
                best = t
            elif (values[best] - values[t]) * rising > least:
                turns.append(best)
                rising, best = -rising, t
    last = len(values) - 1
    if rising and last - best >= shortest:
        turns.append(best)  # it goes back to the end, by however little: filters flatten the ends of a clip
    kept = [0]
    for t in turns[1:]:
        if t - kept[-1] >= shortest:
            kept.append(t)
    while len(kept) > 1 and last - kept[-1] < shortest:
        kept.pop()
    return [*kept, last]
