"""Analytic inverse kinematics of a limb of two bones: a ball joint at its root, a hinge in its middle."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3


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


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., 3, 3) axes as columns: along `first`, as near to `second` as can be, and at right angles to both."""
    x = _unit(first)
    y = _unit(second - (second * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], -1)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-12))
