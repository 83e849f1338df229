"""A skeleton with the landmarks on it, as the compiled kernels of the fits take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray, IndexArray, IntArray
from muybridge.geometry.skeleton.skeleton import Skeleton, require_one_rigid_tree


class Chain(NamedTuple):
    """A skeleton and the landmarks on it, as the kernels want them.

    A state has `N = 6 + K` unknowns: root position, root turn about the world's axes, and the `K` open angles.
    """

    parents: IntArray  # (J,)
    offsets: FloatArray  # (J, 3)
    twist: IntArray  # (J,)
    open_joint: IntArray  # (K,) joint of each open angle
    open_axis: IntArray  # (K,) its axis
    first: IntArray  # (J + 1,) first open angle of each joint, counted from 6
    above: IntArray  # (N,) the unknown that is next on the way to the root, -1 for the first
    lower: FloatArray  # (K,)
    upper: FloatArray  # (K,)
    rest: FloatArray  # (K,) mean of the weak prior
    prior: FloatArray  # (K,) its inverse variance
    carrier: IntArray  # (L,) joint that carries each landmark
    places: FloatArray  # (L, 3) in that joint's axes


def open_angles(skeleton: Skeleton) -> IndexArray:
    """(K,) indices into the flattened (J, 3) of the angles that may move, without the root's."""
    moves = skeleton.upper - skeleton.lower > 1e-9
    moves[0] = False
    return np.flatnonzero(moves.ravel())


def make_chain(
    skeleton: Skeleton, landmark_joints: IndexArray, landmark_offsets: FloatArray, rest: FloatArray, prior: FloatArray
) -> Chain:
    """A Chain; `rest` and `prior` are (J, 3).

    Raises:
        ValueError: the skeleton has several roots, or joints that slide.
    """
    require_one_rigid_tree(skeleton, "a body fit")
    chosen = open_angles(skeleton)
    joint, axis = np.divmod(chosen, 3)
    first = 6 + np.searchsorted(joint, np.arange(len(skeleton) + 1))
    above = np.full(6 + len(chosen), -1)
    above[1:6] = np.arange(5)
    last = np.full(len(skeleton), 5)  # the last unknown on the way from the root to each joint
    for j in range(1, len(skeleton)):
        before = last[skeleton.parents[j]]
        for k in range(first[j], first[j + 1]):
            above[k], before = before, k
        last[j] = before
    return Chain(
        np.array(skeleton.parents, dtype=np.int64),
        np.ascontiguousarray(skeleton.offsets, dtype=np.float64),
        np.array(skeleton.twist_axis, dtype=np.int64),
        joint.astype(np.int64),
        axis.astype(np.int64),
        first.astype(np.int64),
        above.astype(np.int64),
        skeleton.lower.ravel()[chosen].copy(),
        skeleton.upper.ravel()[chosen].copy(),
        np.asarray(rest, dtype=np.float64).ravel()[chosen].copy(),
        np.asarray(prior, dtype=np.float64).ravel()[chosen].copy(),
        np.asarray(landmark_joints).astype(np.int64),
        np.ascontiguousarray(landmark_offsets, dtype=np.float64),
    )
