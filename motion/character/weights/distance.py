"""The readable baseline: each vertex follows the nearest bone, and the next one across a joint.

A weight is one along a bone and falls to zero across the joint at its end, over as much of the bone as the limb is wide
there.
"""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.weights.bones import Bones


def distance_weights(bones: Bones, distance: FloatArray, along: FloatArray, parents: IntArray) -> FloatArray:
    """(P, J) weights of points.

    Args:
        bones: the segments.
        distance: (P, S) metres from points to segments.
        along: (P, S) metres from a segment's beginning to the nearest place on its line; negative behind it.
        parents: (J,) of the joints.
    """
    count = len(distance)
    rows, nearest = np.arange(count), distance.argmin(axis=1)
    joint = bones.joint[nearest]
    out = np.zeros((count, bones.count))
    out[rows, joint] = 1.0
    width = np.maximum(distance[rows, nearest], 1e-9)
    length = np.linalg.norm(bones.end - bones.begin, axis=1)[nearest]
    moving = np.zeros(bones.count, bool)
    moving[bones.joint] = True
    # Half a weight at the joint itself, none of the neighbour's as far from it as the limb is wide.
    up = np.asarray(parents)[joint]
    share = np.clip(0.5 - 0.5 * along[rows, nearest] / width, 0.0, 0.5) * ((up >= 0) & moving[up])
    out[rows, joint] -= share
    out[rows, np.maximum(up, 0)] += share
    for s in np.nonzero((bones.child >= 0) & moving[bones.child])[0]:
        own = nearest == s
        share = np.clip(0.5 - 0.5 * (length[own] - along[own, s]) / width[own], 0.0, 0.5)
        out[own, bones.joint[s]] -= share
        out[own, bones.child[s]] += share
    return np.asarray(np.maximum(out, 0.0))
