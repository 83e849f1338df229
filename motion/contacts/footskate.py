"""How far points slide that should stand still on the ground."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray


def contact_spans(contact: BoolArray) -> list[tuple[int, int]]:
    """Runs of true in (T,): first frame, and the frame after the last."""
    edges = np.diff(np.concatenate([[0], np.asarray(contact).astype(int), [0]]))
    return list(zip(np.nonzero(edges == 1)[0].tolist(), np.nonzero(edges == -1)[0].tolist(), strict=True))


def sliding_frames(places: FloatArray, contact: BoolArray, allowed: float = 0.005) -> BoolArray:
    """(T,) frames of a contact in which a point is away from where it stands.

    Args:
        places: (T, 3) metres, Z up.
        contact: (T,) whether the point stands on the ground.
        allowed: metres from the median place of the contact, over the ground (the point may rise: a foot rolls over its
            toes).
    """
    out = np.zeros(len(places), bool)
    for a, b in contact_spans(contact):
        out[a:b] = np.linalg.norm(places[a:b, :2] - np.median(places[a:b, :2], 0), axis=1) > allowed
    return out


@dataclass(frozen=True)
class Footskate:
    """How much a point slides during its contacts.

    Attributes:
        frames: of contact.
        mean_speed: metres per second over the ground, of these frames.
        extent: metres, the largest distance between two places of one contact.
        sliding: share of these frames in which the point is farther than `allowed` from where it stands.
    """

    frames: int
    mean_speed: float
    extent: float
    sliding: float


def measure_footskate(places: FloatArray, contact: BoolArray, fps: float, allowed: float = 0.005) -> Footskate:
    """How much one point slides; without any contact everything is zero.

    Args:
        places: (T, 3) metres, Z up.
        contact: (T,) whether the point stands on the ground.
        fps: frames per second.
        allowed: metres, see `sliding_frames`.

    Raises:
        ValueError: the shapes do not fit together.
    """
    if places.shape != (len(contact), 3):
        raise ValueError(f"places must be ({len(contact)}, 3) as there are {len(contact)} frames, not {places.shape}")
    way, steps, extent, frames = 0.0, 0, 0.0, 0
    for a, b in contact_spans(contact):
        flat = places[a:b, :2]
        way += float(np.linalg.norm(np.diff(flat, axis=0), axis=1).sum())
        extent = max(extent, _extent(flat))
        steps, frames = steps + b - a - 1, frames + b - a
    share = float(sliding_frames(places, contact, allowed).sum()) / max(frames, 1)
    return Footskate(frames, way * fps / max(steps, 1), extent, share)


def _extent(places: FloatArray) -> float:
    """The largest distance between two of (N, 2) places, to a percent: over 32 directions."""
    angles = np.arange(32) * np.pi / 32
    return float(np.ptp(places @ np.stack([np.cos(angles), np.sin(angles)]), axis=0).max())
