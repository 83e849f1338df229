"""Contacts from the force plates of a C3D file."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.motion.formats.points.c3d import C3DTake

LOADED_N = 20.0  # newtons from which a plate counts as loaded, as gait laboratories have it
_OFFSET_N = 30.0  # an unloaded plate reads no more than this
_OVER_M, _INSIDE_M = 0.03, -0.01  # by which a foot that loads a plate may be over its edge, and one that does not
_QUIET = 0.2  # share of the samples, the smallest, that an offset is taken from

# Channels whose sum is the vertical force, by type of plate (C3D manual, FORCE_PLATFORM:TYPE).
_VERTICAL = {1: slice(2, 3), 2: slice(2, 3), 3: slice(4, 8)}


@dataclass(frozen=True, eq=False)
class PlateLoad:
    """One plate over time.

    Attributes:
        corners: (4, 3) metres.
        force: (T,) newtons, upright, at the frames of the points.
    """

    corners: FloatArray
    force: FloatArray

    @property
    def loaded(self) -> BoolArray:
        """(T,) whether somebody stands on it."""
        return self.force >= LOADED_N

    def carries(self, places: FloatArray, margin: float) -> BoolArray:
        """(...) whether points (..., 3) are over it, or over its edge by no more than `margin` metres."""
        at = self.corners[:, :2]
        inside = np.ones(places.shape[:-1], np.bool_)
        turning = np.sign(_cross(at[1] - at[0], at[2] - at[1]))
        for a, b in zip(at, np.roll(at, -1, 0), strict=True):
            side = (b - a) / (np.linalg.norm(b - a) + 1e-12)
            away = places[..., :2] - a
            inside &= turning * _cross(side, away) > -margin
        return inside


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def plate_loads(take: C3DTake) -> tuple[PlateLoad, ...]:
    """The force plates of a file; plates of kinds without a plain vertical channel are passed over."""
    analog, group = take.analog, take.force_platforms
    if analog is None or not {"CORNERS", "CHANNEL", "TYPE"} <= set(group):
        return ()
    channels = np.atleast_2d(np.asarray(group["CHANNEL"]))
    corners = np.asarray(group["CORNERS"], dtype=np.float64).reshape(3, 4, -1)
    kinds = np.ravel(group["TYPE"]).astype(int).tolist()
    out = []
    for k, kind in enumerate(kinds[: min(corners.shape[2], channels.shape[1])]):
        vertical = _VERTICAL.get(kind)
        columns = [] if vertical is None else channels[vertical, k].astype(int) - 1
        if not len(columns) or min(columns) < 0 or max(columns) >= analog.values.shape[1]:
            continue
        force = _force_at_frames(
            analog.values[:, columns].sum(1), analog.rate / take.points.fps, len(take.points.points_world)
        )
        out.append(PlateLoad(corners[:, :, k].T / 1e3, force))
    return tuple(out)


def _force_at_frames(samples: FloatArray, per_frame: float, frames: int) -> FloatArray:
    """(T,) newtons without the plate's offset, upwards whatever the sign of the channel."""
    quiet = np.sort(np.abs(samples))[: max(1, int(_QUIET * len(samples)))]
    offset = float(np.median(samples[np.abs(samples) <= quiet[-1]])) if quiet[-1] < _OFFSET_N else 0.0
    smooth = uniform_filter1d(samples - offset, max(1, round(per_frame)), mode="nearest")
    at = np.minimum(np.rint(np.arange(frames) * per_frame).astype(int), len(smooth) - 1)
    return np.abs(smooth[at])


def weigh_feet(probability: FloatArray, places: FloatArray, load: PlateLoad) -> tuple[BoolArray, BoolArray]:
    """(T, 2, 2) which heels and balls a plate shows to stand, and which it shows not to.

    A foot over the plate does not stand while the plate is unloaded. While it is loaded, the foot over it stands, the
    more probable of two, on whichever of its points is the more probable.

    Args:
        probability: (T, 2, 2)
        places: (T, 2, 2, 3) metres of heels and balls.
        load: of the plate; frames beyond its last are not shown.
    """
    stands, free = np.zeros(probability.shape, np.bool_), np.zeros(probability.shape, np.bool_)
    count = min(len(probability), len(load.force))
    here, loaded = places[:count], load.loaded[:count]
    free[:count] = (load.carries(here, _INSIDE_M).all(-1) & ~loaded[:, None])[..., None]
    over = load.carries(here, _OVER_M).any(-1)
    likely = probability[:count].max(-1)
    ahead = ~over[:, ::-1] | (likely > likely[:, ::-1])  # of a foot that only swings over the plate
    frames, feet = np.nonzero(over & ahead & loaded[:, None])
    stands[frames, feet, probability[frames, feet].argmax(-1)] = True
    return stands, free
