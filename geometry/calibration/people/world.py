"""Size, up and floor of a scene from the people in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.cameras.group import CameraGroup

AVERAGE_HEIGHT = 1.72
# Shank, thigh and trunk between joint centres, as parts of the stature (Drillis and Contini 1966, as printed in
# Winter, "Biomechanics and motor control of human movement", 2009, figure 4.1): 0.246, 0.245, 0.288.
_STATURE_PARTS = ((("knee", "ankle"), 0.246), (("hip", "knee"), 0.245), (("shoulder", "hip"), 0.288))
# How high above the floor a foot's landmarks are when it stands, metres.
_ABOVE_FLOOR = {"heel": 0.03, "big_toe": 0.02, "small_toe": 0.02, "ankle": 0.09}
_FLOOR_SPREAD = 0.5  # metres: feet that came about less do not show a floor's slope
_FLOOR_FROM_BODY_DEG = 20.0
_LEVEL_CAMERAS_DEG = 4.0
_CONTACT_SHARE = 0.2


def world_from_people(
    cameras: CameraGroup, points: FloatArray, names: Sequence[str], height: float | None
) -> tuple[CameraGroup, FloatArray, list[str]]:
    """The same cameras and points in metres, Z up, the floor at zero.

    Args:
        cameras: C cameras in any similarity frame.
        points: (T, P J, 3) landmarks of P people, NaN where unknown.
        names: (J,).
        height: of the first person, metres; None for an average adult.

    Returns:
        Cameras, points, and sentences about what was assumed. The origin is on the floor below where the
        people mostly were; the first camera looks along +Y.

    Raises:
        CalibrationError: the people were not seen well enough to tell their size.
    """
    people = points.reshape(len(points), -1, len(names), 3)
    notes: list[str] = []
    stature = _stature(people[:, 0], names)
    if height is None:
        notes.append(f"scale: the person is taken to be {AVERAGE_HEIGHT} m tall; their own height sets it exactly")
    scale = (AVERAGE_HEIGHT if height is None else height) / stature
    up, said = _up(cameras, people * scale, names)
    notes.append(said)
    forward = cameras[0].rotation[2] - up * (cameras[0].rotation[2] @ up)
    if np.linalg.norm(forward) < 1e-3:
        forward = cameras[0].rotation[1] - up * (cameras[0].rotation[1] @ up)
    forward /= np.linalg.norm(forward)
    new_from_old = np.stack([np.cross(forward, up), forward, up])
    moved = scale * points @ new_from_old.T
    shift = np.nanmedian(moved.reshape(-1, 3), axis=0)
    shift[2] = _floor_height(moved.reshape(people.shape), names)
    posed = []
    for camera in cameras:
        rotation = camera.rotation @ new_from_old.T
        center = scale * new_from_old @ camera.center_world - shift
        posed.append(camera.posed(np.concatenate([rotation, -(rotation @ center)[:, None]], axis=1)))
    return CameraGroup(tuple(posed)), moved - shift, notes


def _stature(points: FloatArray, names: Sequence[str]) -> float:
    """A person's height from their long bones, in the unit of (T, J, 3) points."""
    total, parts = 0.0, 0.0
    for (a, b), part in _STATURE_PARTS:
        lengths = [_length(points, names, f"{side}_{a}", f"{side}_{b}") for side in ("left", "right")]
        known = [v for v in lengths if np.isfinite(v)]
        if known:
            total, parts = total + float(np.mean(known)), parts + part
    if parts == 0:
        raise CalibrationError(
            "the person's size cannot be determined: no leg and no trunk was seen by two cameras; record the whole body"
        )
    return total / parts


def _length(points: FloatArray, names: Sequence[str], a: str, b: str) -> float:
    if a not in names or b not in names:
        return np.nan
    length = np.linalg.norm(points[:, list(names).index(a)] - points[:, list(names).index(b)], axis=-1)
    return float(np.nanmedian(length)) if np.isfinite(length).sum() >= 3 else np.nan


def _columns(names: Sequence[str], *parts: str) -> list[int]:
    return [k for k, n in enumerate(names) if any(n == f"{s}_{p}" for s in ("left", "right") for p in parts)]


def _mean(points: FloatArray, columns: list[int]) -> FloatArray:
    """(T, P, 3) mean of some landmarks; NaN where one is."""
    return np.asarray(points[:, :, columns].mean(axis=2))


def _up(cameras: CameraGroup, people: FloatArray, names: Sequence[str]) -> tuple[FloatArray, str]:
    """Unit vector up, and how it was found."""
    axis = _mean(people, _columns(names, "shoulder")) - _mean(people, _columns(names, "ankle"))
    axis = axis[np.isfinite(axis).all(axis=-1)]
    if not len(axis):
        raise CalibrationError(
            "up cannot be determined: shoulders and ankles were never seen together; record the whole body"
        )
    body = np.median(axis / np.linalg.norm(axis, axis=-1, keepdims=True), axis=0)
    body /= np.linalg.norm(body)
    floor = _floor_normal(people, names, body)
    if floor is not None:
        return floor, "up: square to the floor on which the feet stood"
    rows = cameras.cam_from_world[:, 0, :3]
    values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
    level = vectors[:, 0] * np.sign(vectors[:, 0] @ body)
    tilt = np.degrees(np.arcsin(np.sqrt(max(values[0], 0))))
    apart = np.degrees(np.arccos(np.clip(level @ body, -1, 1)))
    spread = np.degrees(np.arcsin(np.sqrt(np.clip(values[1], 0, 1))))
    if tilt < _LEVEL_CAMERAS_DEG < spread and apart < _FLOOR_FROM_BODY_DEG:
        return level, f"up: the cameras are taken to be level sideways (they are to {tilt:.1f} degrees)"
    return body, "up: along the people's bodies, since their feet showed too little of the floor"


def _floor_normal(people: FloatArray, names: Sequence[str], body: FloatArray) -> FloatArray | None:
    """Normal of the floor through the feet's lowest places; None where they came about too little."""
    feet = people[:, :, _columns(names, "heel", "big_toe") or _columns(names, "ankle")].reshape(-1, 3)
    feet = feet[np.isfinite(feet).all(axis=-1)]
    if len(feet) < 30:
        return None
    normal = body
    for _ in range(10):
        height = feet @ normal
        across = feet - height[:, None] * normal
        # The lowest places in every part of the floor, not only where it happens to be deepest.
        cell = np.round((across - across.mean(axis=0)) / _FLOOR_SPREAD).astype(np.int64)
        _, group = np.unique(cell, axis=0, return_inverse=True)
        low = np.zeros(len(feet), dtype=np.bool_)
        for g in range(group.max() + 1):
            here = np.flatnonzero(group.ravel() == g)
            if len(here) >= 5:
                low[here[height[here] <= np.quantile(height[here], _CONTACT_SHARE)]] = True
        if low.sum() < 10:
            return None
        centered = feet[low] - feet[low].mean(axis=0)
        _, sizes, axes = np.linalg.svd(centered, full_matrices=False)
        if sizes[1] / np.sqrt(low.sum()) < _FLOOR_SPREAD:
            return None
        new = axes[2] * np.sign(axes[2] @ body)
        if new @ normal > 1 - 1e-10:
            break
        normal = new
    return normal if np.degrees(np.arccos(np.clip(normal @ body, -1, 1))) < _FLOOR_FROM_BODY_DEG else None


def _floor_height(people: FloatArray, names: Sequence[str]) -> float:
    """Height of the floor along Z: the lowest fifth of the feet's landmarks, less what is below them."""
    lowest = []
    for part, above in _ABOVE_FLOOR.items():
        columns = _columns(names, part)
        if columns:
            height = people[:, :, columns, 2].ravel()
            height = height[np.isfinite(height)]
            if len(height):
                lowest.append(float(np.quantile(height, _CONTACT_SHARE / 2)) - above)
    return float(np.median(lowest)) if lowest else float(np.nanmin(people[..., 2]))
