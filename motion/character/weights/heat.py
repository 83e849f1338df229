"""Weights by heat: every bone warms the surface nearest to it, and the warmth spreads over the surface.

Source: Baran and Popovic, Automatic rigging and animation of 3D characters, 2007, section 4: (H - L) w = H p, where p
is one for the bone that a vertex belongs to, L the Laplacian of the surface, and H = c / d^2 with d the distance.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from muybridge.arrays import FloatArray
from muybridge.motion.character.surface import Surface

_LEAST_AREA = 1e-3  # of the median: points without area would not be warmed by any bone


def heat_weights(surface: Surface, belonging: FloatArray, distance: FloatArray, strength: float) -> FloatArray:
    """(P, J) weights of a surface's points, each row's sum one.

    Args:
        surface: of the mesh.
        belonging: (P, J) the joint that a point belongs to, or shares of several.
        distance: (P,) metres to its bone, as it is seen through the mesh.
        strength: c; transitions are as wide as the limb over its root.
    """
    area = surface.areas
    area = np.maximum(area, _LEAST_AREA * max(float(np.median(area)), 1e-300))
    size = surface.size
    warmth = strength * area / np.maximum(distance, 1e-5 * max(size, 1e-9)) ** 2
    system = (surface.laplacian() + sparse.diags(warmth)).tocsc()
    # The system is symmetric and positive definite, so that no pivoting is needed.
    solver = splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    used = np.nonzero(belonging.any(axis=0))[0]
    out = np.zeros_like(belonging)
    out[:, used] = np.maximum(solver.solve(warmth[:, None] * belonging[:, used]), 0.0)
    return np.asarray(out / np.maximum(out.sum(axis=1, keepdims=True), 1e-300))
