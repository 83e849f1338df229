"""A person of fifteen landmarks who walks on, to be written in any layout."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet

PLACES_MM = {
    "nose": (0, -80, 1580), "left_shoulder": (190, 0, 1400), "right_shoulder": (-190, 0, 1400),
    "left_elbow": (240, 0, 1120), "right_elbow": (-240, 0, 1120), "left_wrist": (250, -50, 880),
    "right_wrist": (-250, -50, 880), "left_hip": (90, 0, 920), "right_hip": (-90, 0, 920), "left_knee": (100, 0, 500),
    "right_knee": (-100, 0, 500), "left_ankle": (100, 0, 90), "right_ankle": (-100, 0, 90),
    "left_heel": (100, 50, 30), "right_heel": (-100, 50, 30),
}  # fmt: skip
NAMES = tuple(PLACES_MM)
FRAMES, FPS, HIDDEN, GAP = 8, 50.0, 3, slice(4, 7)


def walk_mm(gap: bool = True) -> FloatArray:
    """(8, 15, 3) millimetres, Z up, 24 mm a frame; the left elbow is missing in three frames."""
    out = np.tile(np.array(list(PLACES_MM.values()), dtype=np.float64), (FRAMES, 1, 1))
    out[..., 1] -= 24.0 * np.arange(FRAMES)[:, None]
    if gap:
        out[GAP, HIDDEN] = np.nan
    return out


def walk(names: tuple[str, ...] = NAMES, factor: float = 1e-3) -> Points3D:
    """The walk in metres, or in other units."""
    xyz = walk_mm() * factor
    none = np.empty((0, *xyz.shape[:2]))
    unknown = np.full((*xyz.shape, 3), np.nan)
    return Points3D(LandmarkSet("walk", names, ()), xyz, unknown, none, none.astype(bool), FPS)
