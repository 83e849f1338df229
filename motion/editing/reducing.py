"""Fewer keys: the frames of every joint between which it moves evenly, within a tolerance.

The keys of a joint are found as Ramer (1972), Douglas and Peucker (1973) simplify lines, for all joints at once: the
frame that is farthest from the way between two keys becomes a key, until none is farther than the tolerance. An angle
counts by how far it moves what hangs on the joint. The tolerances of the joints are then made smaller until every joint
is within the tolerance in the world.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import conjugate_quat, multiply_quat, rotvec_from_quat, slerp
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.take import Keys

_SHARES = tuple(0.7**k for k in range(14))  # of the tolerance that one joint may use
_HALVINGS = 3  # of the step between two shares
_FINEST = 0.5 * _SHARES[-1]
_Between = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
_Error = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Reduced:
    """A motion that moves evenly between its keys.

    Attributes:
        motion: at all frames; between two keys rotations are on the shortest way, positions on a straight line.
        keys: which frames are keys of what.
        error: metres, the largest distance of a joint from where it was.
    """

    motion: Motion
    keys: Keys
    error: float


def reduce_keys(motion: Motion, tolerance: float = 1e-3, angle: float = np.radians(0.5)) -> Reduced:
    """Leave out keys that interpolation between the others replaces.

    Args:
        motion: any.
        tolerance: metres that a joint may be away from where it was.
        angle: radians that a joint may be turned against its parent.

    Raises:
        MuybridgeError: a tolerance is not above zero, or the clip is empty.
    """
    check_editable(motion)
    for what, value, unit in (("tolerance", tolerance * 1e3, "mm"), ("angle", np.degrees(angle), "degrees")):
        if not 0 < value < np.inf:
            raise MuybridgeError(f"the {what} must be above zero, not {value:g} {unit}")
    slides = np.zeros((len(motion), 0, 3)) if motion.translations is None else motion.translations
    places = np.concatenate([motion.root_positions_world[:, None], slides], axis=1)
    lever = np.maximum(_reach(motion.skeleton) / tolerance, 1 / angle)
    weight_p = _weights(places, _straight, lambda a, b: np.linalg.norm(a - b, axis=-1) / tolerance)
    weight_q = _weights(motion.quat_wxyz, _even, lambda a, b: _angles(a, b) * lever)
    before = motion.joint_positions_world()

    def reduced(share: float) -> Reduced:
        keys_p, keys_q = (w > share if share else np.ones_like(w, dtype=np.bool_) for w in (weight_p, weight_q))
        moved, turned = _between_keys(places, keys_p, _straight), _between_keys(motion.quat_wxyz, keys_q, _even)
        out = replace(motion, root_positions_world=moved[:, 0], quat_wxyz=turned,
                      translations=None if motion.translations is None else moved[:, 1:])  # fmt: skip
        error = float(np.linalg.norm(out.joint_positions_world() - before, axis=-1).max())
        return Reduced(out, Keys(keys_q, keys_p), error)

    low, best = 0.0, None
    for share in _SHARES:
        if (found := reduced(share)).error <= tolerance:
            low, best = share, found
            break
    if best is None:
        return reduced(0.0)
    high = min(low / _SHARES[1], 1.0)
    for _ in range(_HALVINGS if high > low else 0):
        middle = 0.5 * (low + high)
        if (found := reduced(middle)).error <= tolerance:
            low, best = middle, found
        else:
            high = middle
    return best


def _reach(skeleton: Skeleton) -> FloatArray:
    """(J,) metres from a joint to the farthest end of what hangs on it, along the bones."""
    tips = np.linalg.norm(skeleton.tips, axis=1)
    reach = np.where(np.isfinite(tips), tips, 0.0)
    for j in range(len(skeleton) - 1, 0, -1):
        if (parent := skeleton.parents[j]) >= 0:
            reach[parent] = max(reach[parent], reach[j] + float(skeleton.bone_lengths[j]))
    return np.asarray(reach)


def _straight(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(a + (b - a) * share[..., None])


def _even(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    return slerp(a, b, share)


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(rotvec_from_quat(multiply_quat(conjugate_quat(a), b)), axis=-1))


def _neighbours(keys: BoolArray) -> tuple[IndexArray, IndexArray, FloatArray]:
    """(T, K) the key at or before each frame, the key at or after, and the share of the way between them."""
    count = len(keys)
    frames = np.arange(count)[:, None]
    low = np.maximum.accumulate(np.where(keys, frames, 0), axis=0)
    high = np.minimum.accumulate(np.where(keys, frames, count - 1)[::-1], axis=0)[::-1]
    return low, high, (frames - low) / np.maximum(high - low, 1)


def _between_keys(values: FloatArray, keys: BoolArray, between: _Between) -> FloatArray:
    low, high, share = _neighbours(keys)
    out = between(*(np.take_along_axis(values, at[..., None], axis=0) for at in (low, high)), share)
    return np.where(keys[..., None], values, out)


def _weights(values: FloatArray, between: _Between, error: _Error) -> FloatArray:
    """(T, K) tolerances under which a frame is a key of a column; infinite at both ends, 0 for those that are none
    even at the finest tolerance. No frame weighs more than the key that divided the way that it is on."""
    count, columns = values.shape[:2]
    weights = np.zeros((count, columns))
    weights[[0, -1]] = np.inf
    limit = np.full((count, columns), np.inf)  # of the way that a frame is on
    while True:
        keys = weights > 0
        away = np.where(keys, 0.0, error(_between_keys(values, keys, between), values))
        # The ways of all columns one behind the other: each begins with a key.
        starts = np.flatnonzero(keys.T)
        most = np.maximum.reduceat(away.T.ravel(), starts)
        number = np.cumsum(keys.T.ravel()) - 1
        farthest = (away.T.ravel() == most[number]) & (most[number] > _FINEST)
        _, first = np.unique(np.where(farthest, number, -1), return_index=True)
        chosen = first[farthest[first]]
        if not len(chosen):
            return weights
        t, k = chosen % count, chosen // count
        weights[t, k] = np.minimum(away[t, k], limit[t, k])
        own = np.full(len(starts), np.inf)
        own[number[chosen]] = weights[t, k]
        limit = np.minimum(limit, own[number].reshape(columns, count).T)
