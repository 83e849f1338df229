"""Euler angles, continuous in time, for formats without quaternions."""

import warnings

import numpy as np
import scipy

from muybridge.arrays import FloatArray


def smooth_euler(quat_xyzw: FloatArray, order: str) -> FloatArray:
    """Euler angles over time without needless jumps.

    Every rotation has two sets of angles, each up to full turns; the one nearest to the frame before is
    taken, so that what an animation program puts between two frames is between them.

    Args:
        quat_xyzw: (T, J, 4).
        order: three different axes as scipy has them: capitals are multiplied in that order (each about the axes
            that the ones before have turned), small letters in the opposite one.

    Returns:
        (T, J, 3) radians.
    """
    t_count, j_count = quat_xyzw.shape[:2]
    if not quat_xyzw.size:
        return np.zeros((t_count, j_count, 3))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock")  # the angles are right all the same
        turns = scipy.spatial.transform.Rotation.from_quat(quat_xyzw.reshape(-1, 4))
        euler = turns.as_euler(order).reshape(t_count, j_count, 3)
    for t in range(1, t_count):
        one = euler[t]
        other = np.stack([one[:, 0] + np.pi, np.pi - one[:, 1], one[:, 2] + np.pi], axis=1)
        ways = np.stack([one, other])
        ways -= 2 * np.pi * np.round((ways - euler[t - 1]) / (2 * np.pi))
        nearer = np.argmin(np.sum((ways - euler[t - 1]) ** 2, axis=-1), axis=0)
        euler[t] = ways[nearer, np.arange(j_count)]
    return np.asarray(euler)
