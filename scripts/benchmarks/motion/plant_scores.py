"""How well planted feet stand, against the truth of generated motion."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.footskate import contact_spans

INTERIOR_S = 0.08  # off each end of a contact
SLIDES = 0.01  # metres per second


@dataclass(frozen=True)
class PlantScore:
    """Figures of one take.

    Attributes:
        drift_mm: the farthest that a ball or heel of a flat foot moves within the interior of a contact.
        sliding: frames of the contacts' interiors in which the standing point is faster than 1 cm/s, and all of them.
        deep_mm: the farthest that a heel or ball is below where the true feet rest.
        acceleration: peak of any joint, metres per second squared.
        distance_mm: mean distance of the legs' joints to the truth.
    """

    drift_mm: float
    sliding: tuple[int, int]
    deep_mm: float
    acceleration: float
    distance_mm: float


def score(motion: Motion, truth: Motion, roles: dict[str, int], contact: BoolArray) -> PlantScore:
    """The figures of a motion, of which the true contacts (T, 2, 2) of heels and balls are known."""
    places, fps = feet_of_motion(motion, roles).places, motion.fps
    margin = round(INTERIOR_S * fps)
    drift, slides, frames = 0.0, 0, 0
    for k in range(2):
        for a, b in contact_spans(_interior(contact[:, k].all(1), margin)):
            away = places[a:b, k] - places[a:b, k].mean(0)
            drift = max(drift, float(2 * np.linalg.norm(away, axis=-1).max()))
        for p in range(2):
            speed = np.linalg.norm(np.gradient(places[:, k, p], axis=0), axis=-1) * fps
            inside = _interior(contact[:, k, p], margin)
            slides, frames = slides + int((speed[inside] > SLIDES).sum()), frames + int(inside.sum())
    rest = feet_of_motion(truth, roles).places
    standing = rest[contact][:, 2]
    deep = float(np.median(standing) - places[..., 2].min()) if len(standing) else 0.0
    at, true_at = motion.joint_positions_world(), truth.joint_positions_world()
    legs = [roles[f"{s}_{p}"] for s in ("left", "right") for p in ("thigh", "shin", "foot", "toe")]
    distance = float(np.linalg.norm(at[:, legs] - true_at[:, legs], axis=-1).mean())
    return PlantScore(drift * 1e3, (slides, frames), max(deep, 0.0) * 1e3, _acceleration(at, fps), distance * 1e3)


def _interior(standing: BoolArray, margin: int) -> BoolArray:
    return np.asarray(binary_erosion(standing, iterations=margin, border_value=1)) if margin else standing


def _acceleration(at: FloatArray, fps: float) -> float:
    return float(np.linalg.norm(np.diff(at, 2, axis=0), axis=-1).max() * fps**2)
