"""A camera's lens in OpenCV's terms, as the writers of calibration formats need it."""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import ADJUSTABLE_MODELS, term_map
from muybridge.geometry.cameras.camera import Camera


def lens_terms(camera: Camera) -> FloatArray:
    """(12,) fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.

    Raises:
        ValueError: the lens model cannot be written in these terms.
    """
    if camera.model not in ADJUSTABLE_MODELS:
        raise ValueError(f"camera {camera.name}: the format has no {camera.model} lens")
    return np.asarray(term_map(camera.model) @ np.array(camera.params))


def lens_matrix(camera: Camera) -> FloatArray:
    """(3, 3) camera matrix; ValueError as `lens_terms`."""
    fx, fy, cx, cy = lens_terms(camera)[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def lens_distortion(camera: Camera, most: int = 8, fisheye: bool = True) -> list[float]:
    """OpenCV's distortion coefficients, as few as suffice.

    Args:
        camera: the camera.
        most: number of coefficients that the format has.
        fisheye: whether the format has fisheye lenses.

    Raises:
        ValueError: the format cannot store the lens.
    """
    terms = lens_terms(camera)
    if "FISHEYE" in camera.model:
        if not fisheye:
            raise ValueError(f"camera {camera.name}: the format has no fisheye lens")
        return [float(terms[k]) for k in (4, 5, 8, 9)]
    values = [float(v) for v in terms[4:]]
    while len(values) > 5 and values[-1] == 0.0:
        values.pop()
    values = values if len(values) <= 5 else [float(v) for v in terms[4:]]
    if len(values) > most:
        raise ValueError(f"camera {camera.name}: the format has {most} distortion terms, a {camera.model} lens more")
    return values


def five_terms(camera: Camera) -> tuple[float, float, float, float, float]:
    """k1, k2, p1, p2, k3 of a lens without fisheye distortion; ValueError as `lens_distortion`."""
    k1, k2, p1, p2, k3 = (*lens_distortion(camera, most=5, fisheye=False), 0.0)[:5]
    return k1, k2, p1, p2, k3
