"""Loose islands of a mesh, such as eyes, buttons and straps: they follow the surface next to them."""

import numpy as np
from scipy.spatial import cKDTree

from muybridge.arrays import FloatArray
from muybridge.motion.character.surface import Surface

_SMALL = 0.03  # of the mesh's area: larger islands are parts of the body
_APART = 2.0  # times its depth that a bone is off the middle of an island through which it does not run
_STIFF = 0.06  # of the mesh's size: shorter islands keep their form
_NEIGHBOURS = 4


def follow_surface(surface: Surface, weights: FloatArray, from_middle: FloatArray, depth: FloatArray) -> FloatArray:
    """(P, J) weights in which loose islands have those of the nearest other surface.

    An island is loose if it is small and no bone runs through it. A short one, such as a button, gets one set of
    weights, so that it keeps its form; a long one, such as a strap, bends with what it lies on.

    Args:
        surface: of the mesh.
        weights: (P, J) of its points.
        from_middle: (P,) metres from the middle below each point to the nearest bone.
        depth: (P,) metres that this middle is deep.
    """
    islands = surface.islands
    count = int(islands.max(initial=-1)) + 1
    if count < 2:
        return weights
    area = np.bincount(islands, surface.areas, count)
    loose = area < _SMALL * area.sum()
    for k in np.nonzero(loose)[0]:
        own = islands == k
        loose[k] = np.median(from_middle[own]) > _APART * np.median(depth[own])
    if not loose.any() or loose.all():
        return weights
    held = ~loose[islands]
    tree, source = cKDTree(surface.points[held]), weights[held]
    out = weights.copy()
    for k in np.nonzero(loose)[0]:
        own = np.nonzero(islands == k)[0]
        gap, at = tree.query(surface.points[own], k=min(_NEIGHBOURS, len(source)))
        gap, at = gap.reshape(len(own), -1), at.reshape(len(own), -1)
        share = 1.0 / (gap + 1e-3 * surface.size) ** 2
        taken = np.einsum("pn,pnj->pj", share / share.sum(axis=1, keepdims=True), source[at])
        if np.linalg.norm(np.ptp(surface.points[own], axis=0)) < _STIFF * surface.size:
            # What lies nearest counts most: the side of a button that is on the shirt.
            nearness = 1.0 / (gap[:, 0] + 1e-3 * surface.size)
            taken = np.tile(np.average(taken, axis=0, weights=nearness), (len(own), 1))
        out[own] = taken
    return out
