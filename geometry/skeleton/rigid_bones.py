"""A body of constant bone lengths, fitted to joints that were each estimated independently."""

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.geometry.skeleton.skeleton import Skeleton, require_one_rigid_tree

# Standard deviations of an estimated position and rotation, metres and radians: their weights against each other.
PLACE, TURN = 0.004, 0.03
_ROUNDS = 3
_STRETCH = 1000


def body_through(skeleton: Skeleton, turns: FloatArray, places: FloatArray) -> tuple[Skeleton, FloatArray, FloatArray]:
    """The skeleton, root and rotations that are nearest to joints estimated in the world.

    Least squares over each frame's root and rotations, in turn with the bones, which are one for the take
    (Gauss-Newton; rotations in the world are the unknowns, so that a place depends on its ancestors' alone).

    Args:
        skeleton: whose parents count; its bones are taken anew.
        turns: (T, J, 3, 3) world from joint.
        places: (T, J, 3) metres.

    Returns:
        The skeleton with its bones, root (T, 3) and rotations (T, J, 3, 3) against the parent.
    """
    require_one_rigid_tree(skeleton, "a body of rigid bones")
    parents = np.array(skeleton.parents)
    found, root = turns.copy(), places[:, 0].copy()
    offsets = _bones(skeleton.offsets, parents, found, places)
    for _ in range(_ROUNDS):
        for start in range(0, len(turns), _STRETCH):
            part = slice(start, start + _STRETCH)
            found[part], root[part] = _nearer(offsets, parents, found[part], root[part], turns[part], places[part])
        offsets = _bones(offsets, parents, found, places)
    local = found.copy()
    local[:, 1:] = np.swapaxes(found[:, parents[1:]], -1, -2) @ found[:, 1:]
    return replace(skeleton, offsets=offsets), root, local


def _bones(offsets: FloatArray, parents: IndexArray, turns: FloatArray, places: FloatArray) -> FloatArray:
    """(J, 3) each joint in its parent's axes, the median of all frames."""
    out = offsets.copy()
    bone = places[:, 1:] - places[:, parents[1:]]
    out[1:] = np.median(np.einsum("tjik,tji->tjk", turns[:, parents[1:]], bone), axis=0)
    return out


def _nearer(
    offsets: FloatArray,
    parents: IndexArray,
    turns: FloatArray,
    root: FloatArray,
    target_turns: FloatArray,
    target_places: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step: rotations (T, J, 3, 3) and root (T, 3)."""
    t, size = turns.shape[:2]
    bone = np.einsum("tjik,jk->tji", turns[:, parents[1:]], offsets[1:])
    at = np.empty((t, size, 3))
    slope = np.zeros((t, size, 3, 3 + 3 * size))
    at[:, 0], slope[:, 0, :, :3] = root, np.eye(3)
    for j in range(1, size):
        parent, (x, y, z) = parents[j], np.moveaxis(bone[:, j - 1], -1, 0)
        at[:, j] = at[:, parent] + bone[:, j - 1]
        slope[:, j] = slope[:, parent]
        # A turn w of the parent moves the joint by the cross product of w and the bone.
        own, none = 3 + 3 * parent, np.zeros(t)
        slope[:, j, :, own : own + 3] += np.stack([none, z, -y, -z, none, x, y, -x, none], -1).reshape(t, 3, 3)
    a = slope.reshape(t, 3 * size, -1) / PLACE
    off = (target_places - at).reshape(t, -1, 1) / PLACE
    # Left perturbation: R = exp(w) R; the remainder to the estimated rotation is its own target.
    left = log_so3(target_turns @ np.swapaxes(turns, -1, -2)).reshape(t, -1)
    held = np.r_[np.zeros(3), np.full(3 * size, TURN**-2)]
    right = np.swapaxes(a, 1, 2) @ off
    right[:, 3:, 0] += left / TURN**2
    step = np.linalg.solve(np.swapaxes(a, 1, 2) @ a + np.diag(held), right)[..., 0]
    return exp_so3(step[:, 3:].reshape(t, size, 3)) @ turns, root + step[:, :3]
