"""Analytic inverse kinematics of a limb of two bones: a ball joint at its root, a hinge in its middle."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3

_STRAIGHT = 0.01  # of the upper bone's length: a middle joint that is nearer to the line hardly shows where it bends


def solve_two_bone(
    upper: FloatArray, lower: FloatArray, hinge: FloatArray, reach: FloatArray, pole: FloatArray,
    limits: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """The ball joint's rotation and the hinge's angle that bring the limb's end to a place.

    Of the turns about the line from root to end, the one is taken whose hinge is nearest to the pole. Out of reach, the
    limb points at the place with the hinge at the nearest angle.

    Args:
        upper: (3,) metres, the bone from the ball joint to the hinge, at rest.
        lower: (3,) metres, the bone from the hinge to the limb's end, at rest.
        hinge: (3,) unit axis of the middle joint at rest.
        reach: (T, 3) metres from the limb's root to where the end shall be, in the frame that rest is given in.
        pole: (T, 3) direction that the hinge's axis shall be nearest to.
        limits: smallest and largest angle of the hinge, degrees; 0 is at rest.

    Returns:
        Rotations (T, 3, 3) of the upper bone from rest, and angles (T,) of the hinge, degrees.
    """
    parallel = hinge * (hinge @ lower)
    cosine, sine = upper @ (lower - parallel), upper @ np.cross(hinge, lower)
    size, phase = np.hypot(cosine, sine), np.arctan2(sine, cosine)
    want = ((reach**2).sum(-1) - upper @ upper - lower @ lower) / 2 - upper @ parallel
    angle = np.degrees(phase + np.arccos(np.clip(want / size, -1, 1)))
    angle = np.clip(angle, *limits)
    bent = exp_so3(np.radians(angle)[:, None] * hinge) @ np.broadcast_to(lower, reach.shape)[..., None]
    end = upper + bent[..., 0]
    at_rest = _frame(end, np.broadcast_to(hinge, reach.shape))
    return np.asarray(_frame(reach, pole) @ np.swapaxes(at_rest, -1, -2)), np.asarray(angle)


def move_two_bone(
    before: tuple[FloatArray, FloatArray, FloatArray], root: FloatArray, end: FloatArray, ahead: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turns of both bones that bring a posed limb's root and end to other places, keeping the plane that it bends in.

    For limbs of any skeleton, whose hinge need not be known: the middle joint stays on its side of the line from root
    to end. Where nothing moves, the turns are the identity.

    Args:
        before: (T, 3) metres each, root, middle and end as they are.
        root: (T, 3) metres, where the root shall be.
        end: (T, 3) metres, where the end shall be.
        ahead: (T, 3) unit vectors to the side that a straight limb shall bend to.

    Returns:
        Turns (T, 3, 3) of the upper and of the lower bone in the world, from the left; and (T,) metres by which the end
        is out of reach: above zero too far, below zero too near.
    """
    start, middle, tip = before
    upper, lower = (np.linalg.norm(v, axis=-1) for v in (middle - start, tip - middle))
    old, new = tip - start, end - root
    far = np.linalg.norm(new, axis=-1)
    reach = np.clip(far, np.abs(upper - lower) + 1e-9, upper + lower - 1e-9)
    bent = _across(middle - start, old)
    straight = np.maximum(_STRAIGHT * upper - np.linalg.norm(bent, axis=-1), 0.0)
    side = bent + straight[:, None] * _unit(_across(ahead, old))
    hinge = np.cross(_unit(old), _unit(side))
    turned = _frame(new, _carried(hinge, old, new))
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)
    off = np.sqrt(np.maximum(upper**2 - along**2, 0.0))
    # The columns of `turned` are the limb's line, its hinge, and their cross product, which points away from the knee.
    knee = along[:, None] * turned[..., 0] - off[:, None] * turned[..., 2]
    foot = reach[:, None] * turned[..., 0]
    after = turned[..., 1]
    first = _frame(knee, after) @ np.swapaxes(_frame(middle - start, hinge), -1, -2)
    second = _frame(foot - knee, after) @ np.swapaxes(_frame(tip - middle, hinge), -1, -2)
    return np.asarray(first), np.asarray(second), np.asarray(far - reach)


def _across(vectors: FloatArray, line: FloatArray) -> FloatArray:
    """The part of vectors at right angles to a line."""
    along = _unit(line)
    return np.asarray(vectors - (vectors * along).sum(-1, keepdims=True) * along)


def _carried(vectors: FloatArray, old: FloatArray, new: FloatArray) -> FloatArray:
    """Vectors turned by the smallest rotation from one direction to another."""
    a, b = _unit(old), _unit(new)
    axis, cosine = np.cross(a, b), (a * b).sum(-1, keepdims=True)
    along = (axis * vectors).sum(-1, keepdims=True)
    return np.asarray(vectors * cosine + np.cross(axis, vectors) + axis * along / np.maximum(1 + cosine, 1e-9))


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., 3, 3) axes as columns: along `first`, as near to `second` as can be, and at right angles to both."""
    x = _unit(first)
    y = _unit(second - (second * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], -1)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-12))
