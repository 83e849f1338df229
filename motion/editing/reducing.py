"""Fewer keys: the frames of every joint between which it moves evenly, within a tolerance.

The keys of a joint are found as Ramer (1972), Douglas and Peucker (1973) simplify lines: the
frame that is farthest from the way between two keys becomes a key, until none is farther than the tolerance. An angle
counts by how far it moves what hangs on the joint. The tolerances of the joints are then made smaller until every joint
is within the tolerance in the world.
"""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing._keys_kernel import between_keys, divide
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.take import Keys

_SHARES = tuple(0.7**k for k in range(14))  # of the tolerance that one joint may use
_HALVINGS = 3  # of the step between two shares
_FINEST = 0.5 * _SHARES[-1]


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
    places, quat = np.ascontiguousarray(places), np.ascontiguousarray(motion.quat_wxyz)
    weight_p = divide(places, np.full(places.shape[1], 1 / tolerance), _FINEST, False)
    weight_q = divide(quat, lever, _FINEST, True)
    before = motion.joint_positions_world()

    def reduced(share: float) -> Reduced:
        keys_p, keys_q = (w > share if share else np.ones_like(w, dtype=np.bool_) for w in (weight_p, weight_q))
        moved, turned = between_keys(places, keys_p, False), between_keys(quat, keys_q, True)
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
