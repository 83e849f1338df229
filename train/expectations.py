"""Where landmarks are expected, in training: their true places with the faults of a first look.

In use the expectation is the person in 3D, put together from all cameras and moments, as this camera sees them: off by
the calibration and by what the cameras have in common, wrong where most of them were wrong, and sometimes of somebody
else. So the network has to look for itself, and to heed what it is told where the picture leaves two answers.
"""

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.landmarks import BODY23

MIRROR = np.array(BODY23.mirror)
_SIDES = ("left", "right")


def _of(*parts: str) -> list[int]:
    return [BODY23.index(part) for part in parts]


_FACE = _of("nose", "left_eye", "right_eye", "left_ear", "right_ear")
_ARMS = [_of(f"{s}_shoulder", f"{s}_elbow", f"{s}_wrist") for s in _SIDES]
_FEET = [_of(f"{s}_ankle", f"{s}_heel", f"{s}_big_toe", f"{s}_small_toe") for s in _SIDES]
_LEGS = [_of(f"{s}_hip", f"{s}_knee") + feet for s, feet in zip(_SIDES, _FEET, strict=True)]
# What may be turned about its first landmark, or be missing.
_LIMBS = [*_ARMS, *_LEGS, *(arm[1:] for arm in _ARMS), *(leg[1:] for leg in _LEGS), *_FEET]

# Of a crop, in sides of it: what calibration and clocks put off, and the typical landmark.
_SHIFT, _LANDMARK = 0.01, 0.014
# Shares of expectations whose sides are exchanged: of the whole body, of the arms, of the legs.
_EXCHANGED = ((0.05, list(range(len(BODY23)))), (0.05, _ARMS[0] + _ARMS[1]), (0.07, _LEGS[0] + _LEGS[1]))
# Shares of limbs that are expected elsewhere, of limbs and of landmarks that are not expected at all.
_TURNED, _TURN_SD, _ABSENT_LIMB, _ABSENT = 0.05, 0.8, 0.05, 0.04
# Share of expectations that are of somebody else.
_SOMEBODY_ELSE = 0.04


class Expectations:
    """Draws the faults of expectations from `rng`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def __call__(self, landmarks_px: NDArray[np.float32], size: int) -> NDArray[np.float32]:
        """(B, 23, 2) where the landmarks (B, 23, 2) of crops of that side are expected, px; NaN where nowhere."""
        rng, count = self.rng, len(landmarks_px)
        out = landmarks_px.astype(np.float32)
        for i in np.flatnonzero(rng.random(count) < _SOMEBODY_ELSE):
            other = landmarks_px[rng.integers(count)]
            out[i] = (other - other.mean(0)) * rng.uniform(0.5, 1.2) + rng.uniform(0.1, 0.9, 2) * size
        for share, members in _EXCHANGED:
            chosen = np.flatnonzero(rng.random(count) < share)
            out[chosen[:, None], members] = out[chosen[:, None], MIRROR[members]]
        for limb in _LIMBS:
            for i in np.flatnonzero(rng.random(count) < _TURNED):
                angle, root = rng.normal(0, _TURN_SD), out[i, limb[0]].copy()
                turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                out[i, limb] = (out[i, limb] - root) @ turn.T * rng.uniform(0.6, 1.1) + root
        # Few landmarks are far off, most of them little: heavier tails than a Gaussian's.
        spread = _LANDMARK * size * np.exp(rng.normal(0, 0.6, (count, 1, 1)))
        out += spread * rng.standard_t(3, out.shape).clip(-8, 8)
        scale = 1 + rng.normal(0, 0.02, (count, 1, 1))
        centre = out.mean(1, keepdims=True)
        out = (out - centre) * scale + centre + rng.normal(0, _SHIFT * size, (count, 1, 2))
        for limb in (*_LIMBS, _FACE):
            out[np.flatnonzero(rng.random(count) < _ABSENT_LIMB)[:, None], limb] = np.nan
        out[rng.random(out.shape[:2]) < _ABSENT] = np.nan
        return np.asarray(out, np.float32)
