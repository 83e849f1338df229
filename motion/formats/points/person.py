"""Whether points have the size of a person, which shows a wrong unit. Points without names of a body have any size."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.skeleton.aliases import map_body, map_surface
from muybridge.geometry.skeleton.body import SHAPE_PRIOR
from muybridge.geometry.skeleton.joint_regressions import landmarks_from_markers

# Statures of people who stand, metres; children from two years on are inside.
STATURES = (0.75, 2.60)
# Beyond these it is no infant and no figure of a film either, if another unit makes it a person.
_ANY_FIGURE = (0.40, 4.0)
# Metres between the farthest points of a person in most frames, curled up or stretched out.
_EXTENTS = (0.3, 3.5)
_FEWEST_NAMES = 6
# So many frames show the size.
_FRAMES = 100
_LIMBS = {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"), "thigh": ("hip", "knee"),
          "shin": ("knee", "ankle"), "trunk": ("hip", "shoulder")}  # fmt: skip


def stature_of(points_world: FloatArray) -> float:
    """The height, metres, that the median lengths of trunk and limbs suggest; NaN where none is known.

    Args:
        points_world: (T, 23, 3) of BODY23.
    """
    found = []
    for part, (a, b) in _LIMBS.items():
        for side in ("left", "right"):
            bone = points_world[:, BODY23.index(f"{side}_{a}")] - points_world[:, BODY23.index(f"{side}_{b}")]
            length = np.linalg.norm(bone, axis=-1)
            if np.isfinite(length).any():
                found.append(float(np.nanmedian(length)) / SHAPE_PRIOR[part][0])
    return float(np.median(found)) if found else float("nan")


def implausible_stature(
    names: Sequence[str], points: FloatArray, factors: dict[str, float]
) -> tuple[float, str | None, bool] | None:
    """How tall the person would be, where no person is so tall.

    Args:
        names: (K,) labels.
        points: (T, K, 3) metres, by the unit that was assumed.
        factors: by other units, how many times longer the points are in metres if the file is in that unit.

    Returns:
        The height in metres, the unit of `factors` that makes it a person's (None where none does), and whether the
        height is too far off for any figure. None where the size is a person's, or where the names are not those of a
        body.
    """
    body, surface = map_body(names), map_surface(names)
    columns = list((body if len(body) >= len(surface) else surface).values())
    if len(columns) < _FEWEST_NAMES:
        return None
    there = np.nonzero(np.isfinite(points[:, columns, 0]).sum(axis=1) >= _FEWEST_NAMES)[0]
    some = points[there[:: max(1, len(there) // _FRAMES)]][:, columns]
    if not len(some):
        return None
    kept = tuple(names[k] for k in columns)
    tall, extent = _size(kept, some)
    if not np.isfinite(tall) or (_within(tall, STATURES) and _within(extent, _EXTENTS)):
        return None
    for unit, factor in factors.items():
        other, size = _size(kept, some * factor)
        if _within(other, STATURES) and _within(size, _EXTENTS):
            # Distances of a joint from the skin do not shrink with the unit, so the likely size shows the other.
            tall = other / factor
            return tall, unit, not _within(tall, _ANY_FIGURE)
    return None if _within(tall, STATURES) else (tall, None, not _within(tall, _ANY_FIGURE))


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]


def _size(names: tuple[str, ...], points: FloatArray) -> tuple[float, float]:
    """Stature, and the median extent over the frames, metres."""
    shape = (len(points), len(BODY23), 3)
    body, surface = map_body(names), map_surface(names)
    if len(body) >= len(surface):
        landmarks = np.full(shape, np.nan)
        for name, column in body.items():
            landmarks[:, BODY23.index(name)] = points[:, column]
    else:
        none = np.empty((0, *points.shape[:2]))
        cloud = Points3D(LandmarkSet("markers", names, ()), points, np.full((*points.shape, 3), np.nan), none,
                         none.astype(bool), 1.0)  # fmt: skip
        landmarks = landmarks_from_markers(cloud, surface).points_world
    extent = np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=-1)
    return stature_of(landmarks), float(np.median(extent))
