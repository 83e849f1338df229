"""Where the camera of a render stands, and how it frames a person."""

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES
from muybridge.train.synthesis.rendering.view import View, direction_from_angles, look_at, target_of_pixel

SIZE = 256  # pixels
# The crop spans the person's bounding box times the network's padding (1.25), plus a margin for the shadow.
SPAN = 1.25 * 1.1
# Unusual views: from steeply above (a security camera), from the floor upwards, and near with a wide lens.
STEEP, LOW, NEAR = range(3)
_NEAREST = 0.2  # metres between the camera and the sphere around the person


def sample_view(
    vertices: Float32Array, rng: np.random.Generator, size: int = SIZE, span: float = SPAN, unusual: float = 0.0
) -> View:
    """A gravity-aligned view of the centre of a bounding box, like the virtual cameras of `geometry.cameras.crops`:
    cameras stand 1 to 8 m away, from knee height to the ceiling.

    Args:
        vertices: (V, 3) of a person, or of something else, world metres.
        rng: source of random numbers.
        size: of the image, px.
        span: `size` relative to the longer side of the box.
        unusual: share of views from 45 to 80 degrees above, from the floor upwards, and from very near.
    """
    body = vertices[:BODY_VERTICES].astype(float)
    center = (body.min(0) + body.max(0)) / 2
    reach = float(np.linalg.norm(body - center, axis=1).max())
    azimuth = rng.uniform(0, 2 * np.pi)
    kind = int(rng.integers(3)) if unusual and rng.random() < unusual else None
    distance, elevation = _usual_place(rng, reach) if kind is None else _unusual_place(rng, kind, center, reach)
    elevation = max(elevation, -np.arcsin(min(0.95, max(center[2] - 0.05, 0.02) / distance)))
    eye = center + distance * direction_from_angles(azimuth, elevation)
    roll = np.radians(rng.normal(0, 3))
    return _frame(body, eye, distance, roll, size, span)


def _usual_place(rng: np.random.Generator, reach: float) -> tuple[float, float]:
    """Distance in metres, elevation in radians."""
    distance = reach * float(np.exp(rng.uniform(np.log(2.0), np.log(9.0))))
    steep = rng.random() < 0.1
    return distance, float(np.radians(rng.uniform(30, 65) if steep else rng.normal(13, 14)))


def _unusual_place(rng: np.random.Generator, kind: int, center: FloatArray, reach: float) -> tuple[float, float]:
    """The same for views of that kind."""
    if kind == STEEP:
        return max(reach * rng.uniform(1.5, 5.0), reach + _NEAREST), float(np.radians(rng.uniform(45, 80)))
    if kind == NEAR:
        return max(reach * rng.uniform(1.15, 1.8), reach + _NEAREST), float(np.radians(rng.normal(8, 18)))
    drop = max(center[2] - rng.uniform(0.05, 0.3), 0.02)
    distance = max(drop / np.sin(np.radians(rng.uniform(10, 28))), reach * 1.2, reach + _NEAREST)
    return distance, -float(np.arcsin(drop / distance))


def _frame(points: FloatArray, eye: FloatArray, distance: float, roll: float, size: int, span: float) -> View:
    """A view from `eye` (3,), `distance` away from the centre of `points` (V, 3), whose image their bounding box fills
    but for the padding of `span`; `roll` in radians."""
    middle = (size - 1) / 2
    target = (points.min(0) + points.max(0)) / 2
    focal = float(size)
    few = points[::4]
    for some in (few, few, points):  # the centre of the box moves slightly as the camera turns to it
        view = View(look_at(eye, target), focal, (middle, middle), size, size)
        px = np.ascontiguousarray(view.project(some)[0].T)
        low, high = px.min(1), px.max(1)
        focal = focal * size / (span * float((high - low).max()))
        target = target_of_pixel(view, (low + high) / 2, eye, distance)
    return View(look_at(eye, target, roll), float(focal), (middle, middle), size, size)
