"""Rotations over time as vectors: logarithms relative to a running mean that is near enough for them not to wrap."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
)
from muybridge.motion.signals.filter_bank import level_count, low_pass

_FARTHEST = np.radians(120)  # from the mean, up to which logarithms are vectors that can be filtered and scaled
_SHORTEST = 0.3  # length of a mean of unit quaternions from which its direction is well defined


@dataclass(frozen=True, eq=False)
class Chart:
    """Rotations as vectors: `quat = mean exp(vectors)`.

    Attributes:
        mean_wxyz: (T, J, 4) running mean of each joint; constant where the joint stays near one rotation.
        vectors: (T, J, 3) radians, of less than 120 degrees; continuous over time as the rotations are.
    """

    mean_wxyz: FloatArray
    vectors: FloatArray

    def rotations(self, vectors: FloatArray) -> FloatArray:
        """(T, J, 4) wxyz, continuous, of other vectors (T, J, 3) about the same mean."""
        return continuous_quat(multiply_quat(self.mean_wxyz, quat_from_rotvec(vectors)))


def chart_of(quat_wxyz: FloatArray) -> Chart:
    """Rotations relative to a running mean.

    A joint's mean is the constant one if the joint never turns farther than 120 degrees from it, as nearly all do.
    A body that turns around needs one that follows it: that of the longest window, among those of a filter bank, from
    which it is never farther. Logarithms are therefore continuous where the rotations are, whatever they wrap around.

    Args:
        quat_wxyz: (T, J, 4), continuous in sign over time.
    """
    quat = continuous_quat(quat_wxyz)
    mean, vectors = np.empty_like(quat), np.empty((*quat.shape[:-1], 3))
    for j in range(quat.shape[1]):
        mean[:, j], vectors[:, j] = _of_joint(quat[:, j])
    return Chart(mean, vectors)


def _of_joint(quat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (T, 4) and vectors (T, 3) of one joint's rotations (T, 4)."""
    for level in (None, *range(level_count(len(quat)), 0, -1)):
        if level is None:
            mean = np.broadcast_to(quat.mean(axis=0), quat.shape)
        else:
            mean = low_pass(quat, level)
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        if length.min() < _SHORTEST:
            continue
        mean = mean / length
        vectors = rotvec_from_quat(multiply_quat(conjugate_quat(mean), quat))
        if np.linalg.norm(vectors, axis=1).max() < _FARTHEST:
            return mean, vectors
    return quat, np.zeros((len(quat), 3))  # it turns by more than that from frame to frame
