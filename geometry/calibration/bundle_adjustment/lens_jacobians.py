"""Lens models of the adjustment: pixels and their analytic derivatives, all models in one form of twelve terms.

The twelve are fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV's rational model, or of its fisheye one
(k1, k2, k3, k4 in places 4, 5, 8, 9). A model with fewer parameters is a linear map onto them.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray

TERMS = 12
# Where each parameter of a model goes; a tuple: into both places.
_PLACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "SIMPLE_PINHOLE": ((0, 1), (2,), (3,)),
    "PINHOLE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL": ((0, 1), (2,), (3,), (4,)),
    "RADIAL": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV": tuple((k,) for k in range(8)),
    "FULL_OPENCV": tuple((k,) for k in range(12)),
    "SIMPLE_RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,)),
    "RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV_FISHEYE": ((0,), (1,), (2,), (3,), (4,), (5,), (8,), (9,)),
}
ADJUSTABLE_MODELS = tuple(_PLACES)
"""Lens models that an adjustment can refine."""


def term_map(model: str) -> FloatArray:
    """(12, N) map from a model's parameters to the twelve terms; ValueError for a model that has none."""
    if model not in _PLACES:
        raise ValueError(f"lens model {model} cannot be adjusted; these can: {', '.join(ADJUSTABLE_MODELS)}")
    out = np.zeros((TERMS, len(_PLACES[model])))
    for column, rows in enumerate(_PLACES[model]):
        out[list(rows), column] = 1.0
    return out


def parameter_kinds(model: str) -> tuple[str, ...]:
    """ "focal", "principal" or "distortion" of each parameter of a model."""
    names = ("focal", "focal", "principal", "principal")
    return tuple(names[p[0]] if p[0] < 4 else "distortion" for p in _PLACES[model])


def project_terms(
    terms: FloatArray, fisheye: bool, points_cam: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels of points in camera axes with their derivatives.

    Args:
        terms: (12,).
        fisheye: which of the two models.
        points_cam: (N, 3), metres.

    Returns:
        (N, 2) px, NaN behind the camera; (N, 2, 3) derivative by the point; (N, 2, 12) by the terms.
    """
    z = np.where(points_cam[:, 2] > 1e-6, points_cam[:, 2], np.nan)
    x, y = points_cam[:, 0] / z, points_cam[:, 1] / z
    distorted, by_xy, by_k = _fisheye(terms, x, y) if fisheye else _rational(terms, x, y)
    focal = terms[:2]
    px = distorted * focal + terms[2:4]
    by_point = np.empty((len(x), 2, 3))
    scaled = by_xy * focal[:, None]
    by_point[..., :2] = scaled / z[:, None, None]
    by_point[..., 2] = -(scaled[..., 0] * x[:, None] + scaled[..., 1] * y[:, None]) / z[:, None]
    by_terms = np.zeros((len(x), 2, TERMS))
    by_terms[:, 0, 0], by_terms[:, 1, 1] = distorted[:, 0], distorted[:, 1]
    by_terms[:, 0, 2] = by_terms[:, 1, 3] = 1.0
    by_terms[..., 4:] = by_k * focal[:, None]
    return px, by_point, by_terms


def _rational(terms: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """OpenCV's rational model: (N, 2) distorted, (N, 2, 2) by x and y, (N, 2, 8) by k1 .. k6."""
    k1, k2, p1, p2, k3, k4, k5, k6 = terms[4:]
    r2 = x * x + y * y
    top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    gain = top / bottom
    slope = (k1 + r2 * (2 * k2 + 3 * r2 * k3)) / bottom - gain * (k4 + r2 * (2 * k5 + 3 * r2 * k6)) / bottom
    u = x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    by_xy = np.empty((len(x), 2, 2))
    by_xy[:, 0, 0] = gain + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_xy[:, 0, 1] = by_xy[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    by_xy[:, 1, 1] = gain + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    radial = np.stack([r2, r2**2, r2**3, -gain * r2, -gain * r2**2, -gain * r2**3], axis=-1) / bottom[:, None]
    by_k = np.empty((len(x), 2, 8))
    by_k[..., [0, 1, 4, 5, 6, 7]] = np.stack([x, y], axis=-1)[..., None] * radial[:, None]
    by_k[:, 0, 2], by_k[:, 0, 3] = 2 * x * y, r2 + 2 * x * x
    by_k[:, 1, 2], by_k[:, 1, 3] = r2 + 2 * y * y, 2 * x * y
    return np.stack([u, v], axis=-1), by_xy, by_k


def _fisheye(terms: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kannala and Brandt's model as in `_rational`."""
    k = terms[[4, 5, 8, 9]]
    r = np.maximum(np.hypot(x, y), 1e-9)
    theta = np.arctan(r)
    powers = theta[:, None] ** np.array([3, 5, 7, 9])
    bent = theta + powers @ k
    by_theta = 1 + (theta[:, None] ** np.array([2, 4, 6, 8]) * np.array([3, 5, 7, 9])) @ k
    gain = bent / r
    slope = (by_theta / (1 + r * r) - gain) / r**2  # d gain / d r, over r
    by_xy = np.empty((len(x), 2, 2))
    by_xy[:, 0, 0], by_xy[:, 1, 1] = gain + x * x * slope, gain + y * y * slope
    by_xy[:, 0, 1] = by_xy[:, 1, 0] = x * y * slope
    xy = np.stack([x, y], axis=-1)
    by_k = np.zeros((len(x), 2, 8))
    by_k[..., [0, 1, 4, 5]] = xy[..., None] * (powers / r[:, None])[:, None]
    return xy * gain[:, None], by_xy, by_k
