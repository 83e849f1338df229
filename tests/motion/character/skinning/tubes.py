"""Meshes with known skins for tests: tubes along x."""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.motion.character.skinning import Skin


def tube(rings: int = 41, around: int = 16, length: float = 2.0, radius: float = 0.2) -> tuple[FloatArray, IntArray]:
    """(V, 3) and (F, 3) of a closed tube along x, from 0 to its length, outside outwards."""
    x = np.repeat(np.linspace(0, length, rings), around)
    turn = np.tile(np.linspace(0, 2 * np.pi, around, endpoint=False), rings)
    points = np.stack([x, radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    here = np.arange(rings - 1)[:, None] * around + np.arange(around)
    right = np.arange(rings - 1)[:, None] * around + (np.arange(around) + 1) % around
    sides = [np.stack([here, right, here + around], -1), np.stack([right, right + around, here + around], -1)]
    first, last = len(points), len(points) + 1
    ring, back = np.arange(around), (np.arange(around) + 1) % around
    ends = [np.stack([back, ring, np.full(around, first)], -1),
            np.stack([ring + first - around, back + first - around, np.full(around, last)], -1)]  # fmt: skip
    triangles = np.concatenate([s.reshape(-1, 3) for s in sides] + ends)
    return np.concatenate([points, [[0, 0, 0], [length, 0, 0]]]), triangles


def hinged_tube(width: float = 0.4) -> Skin:
    """A tube of two bones whose weights change over `width` around the joint in its middle."""
    points, triangles = tube()
    share = np.clip(0.5 + (points[:, 0] - 1.0) / width, 0, 1)
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, 0, 3] = -1.0
    return Skin(points, triangles, np.tile([0, 1], (len(points), 1)), np.stack([1 - share, share], axis=1), bind)


def chained_tube(bones: int) -> Skin:
    """A tube of so many bones of the same length, whose weights change over half of a bone around each joint."""
    points, triangles = tube()
    place = points[:, 0] / 2.0 * bones
    beyond = np.clip(0.5 + (place[:, None] - np.arange(1, bones)) / 0.5, 0, 1)
    share = np.c_[np.ones(len(points)), beyond] - np.c_[beyond, np.zeros(len(points))]
    bind = np.tile(np.eye(4), (bones, 1, 1))
    bind[:, 0, 3] = -2.0 / bones * np.arange(bones)
    return Skin(points, triangles, np.tile(np.arange(bones), (len(points), 1)), share, bind)


def chain_frames(skin: Skin, rotvec: FloatArray) -> FloatArray:
    """(1, J, 4, 4) world_from_joints of a chained tube, each joint turned by (J, 3) against the one before."""
    rest = -skin.bind[:, :3, 3]
    out = np.tile(np.eye(4), (1, len(rotvec), 1, 1))
    turns = exp_so3(rotvec)
    out[0, 0, :3, :3] = turns[0]
    for j in range(1, len(rotvec)):
        out[0, j, :3, :3] = out[0, j - 1, :3, :3] @ turns[j]
        out[0, j, :3, 3] = out[0, j - 1, :3, 3] + out[0, j - 1, :3, :3] @ (rest[j] - rest[j - 1])
    return out


def hinge_frames(rotvec: FloatArray) -> FloatArray:
    """(T, 2, 4, 4) world_from_joints of that tube with its second bone turned by (T, 3) rotation vectors."""
    out = np.tile(np.eye(4), (len(rotvec), 2, 1, 1))
    out[:, 1, :3, :3], out[:, 1, 0, 3] = exp_so3(rotvec), 1.0
    return out


def middle_radius(vertices: FloatArray) -> float:
    """Mean distance of the middle ring from its own centre."""
    ring = vertices[20 * 16 : 21 * 16]
    return float(np.linalg.norm(ring - ring.mean(axis=0), axis=1).mean())
