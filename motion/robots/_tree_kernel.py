"""The compiled part of a robot's forward kinematics."""

import math
from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled


class Tree(NamedTuple):
    """Nodes of a kinematic tree, each with at most one joint; node 0 is the root, parents come first.

    A node's joint value is `gain * free[dof] + bias`, zero where the node rests.
    """

    parent: IndexArray
    place: FloatArray
    turn: FloatArray
    kind: IndexArray  # 0 fixed, 1 hinge, 2 slide
    axis: FloatArray
    anchor: FloatArray
    dof: IndexArray
    gain: FloatArray
    bias: FloatArray
    node_of_link: IndexArray


@compiled
def rotate(matrix: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """`out` = matrix times vector."""
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@compiled
def pose_tree(
    tree: Tree, root: FloatArray, turn: FloatArray, free: FloatArray,
    turns: FloatArray, places: FloatArray, axes: FloatArray, anchors: FloatArray,
) -> None:  # fmt: skip
    """One frame: (M, 3, 3) and (M, 3) of the nodes, and (M, 3) of their joints' axes and anchors in the world."""
    hinge, before, step = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for n in range(len(tree.parent)):
        p = tree.parent[n]
        if p < 0:
            turns[n] = turn
            places[n] = root
            continue
        rotate(turns[p], tree.place[n], step)
        for i in range(3):
            places[n, i] = places[p, i] + step[i]
            for k in range(3):
                before[i, k] = (turns[p, i, 0] * tree.turn[n, 0, k] + turns[p, i, 1] * tree.turn[n, 1, k]
                                + turns[p, i, 2] * tree.turn[n, 2, k])  # fmt: skip
        if tree.kind[n] == 0:
            turns[n] = before
            continue
        value = tree.gain[n] * free[tree.dof[n]] + tree.bias[n]
        rotate(before, tree.axis[n], axes[n])
        rotate(before, tree.anchor[n], step)
        for i in range(3):
            anchors[n, i] = places[n, i] + step[i]
        if tree.kind[n] == 2:
            turns[n] = before
            for i in range(3):
                places[n, i] += value * axes[n, i]
            continue
        _turn_about(tree.axis[n], value, hinge)
        for i in range(3):
            for k in range(3):
                turns[n, i, k] = before[i, 0] * hinge[0, k] + before[i, 1] * hinge[1, k] + before[i, 2] * hinge[2, k]
        rotate(turns[n], tree.anchor[n], step)
        for i in range(3):
            places[n, i] = anchors[n, i] - step[i]


@compiled
def _turn_about(axis: FloatArray, angle: float, out: FloatArray) -> None:
    x, y, z = axis[0], axis[1], axis[2]
    s, c = math.sin(angle), math.cos(angle)
    v = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@compiled
def pose_all(tree: Tree, root: FloatArray, turn: FloatArray, free: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All frames: (T, M, 3, 3) world from node and (T, M, 3) metres."""
    frames, m = len(root), len(tree.parent)
    turns, places = np.empty((frames, m, 3, 3)), np.empty((frames, m, 3))
    axes, anchors = np.zeros((m, 3)), np.zeros((m, 3))
    for t in range(frames):
        pose_tree(tree, root[t], turn[t], free[t], turns[t], places[t], axes, anchors)
    return turns, places
