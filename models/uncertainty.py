"""Calibration of the networks' variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class SpreadCalibration:
    """How a heatmap's spread becomes a variance, both in network input px^2.

    Fitted on held-out data when a network is exported and stored in its file.

    Attributes:
        scale, floor_px2: `scale * spread + floor_px2`, where there are no knots.
        knots: pairs of spread and variance, both ascending; between them the logarithm of the variance is linear
            in that of the spread, below the first it is constant, above the last proportional to the spread.
        hidden: the variance of a landmark that is surely hidden over that of one that is surely not, spreads being one.
        mirrored: the variance where a crop was looked at mirrored too over that where it was looked at once.
        part: the variance in crops that show a part of a person (`in_part`) over that in others, spreads being one.
        landmarks: of each landmark the variance over that of the others, spreads being one; empty where all are alike.
    """

    scale: float = 1.0
    floor_px2: float = 1.0
    knots: tuple[tuple[float, float], ...] = ()
    hidden: float = 1.0
    mirrored: float = 1.0
    part: float = 1.0
    landmarks: tuple[float, ...] = ()

    def variance(self, spread_px2: FloatArray) -> FloatArray:
        """The variance of each coordinate, of the spread's shape, whose last axis the `landmarks` are, if they are not
        alike; NaN stays NaN."""
        each = np.array(self.landmarks) if self.landmarks else 1.0
        if not self.knots:
            return np.asarray((self.scale * spread_px2 + self.floor_px2) * each, dtype=np.float64)
        at, value = np.array(self.knots).T
        inside = np.clip(spread_px2, at[0], at[-1])
        inner = np.exp(np.interp(np.log(inside), np.log(at), np.log(value)))
        return np.asarray(inner * np.maximum(spread_px2 / at[-1], 1.0) * each, dtype=np.float64)

    def ratio(self, seen: FloatArray, mirrored: bool, partly: BoolArray | None = None) -> FloatArray:
        """What variances are to be multiplied by, where landmarks are visible with a probability of `seen`, the crops
        were looked at mirrored too or were not, and those that are `partly`, which broadcasts with `seen`, show a part
        of a person."""
        part = 1.0 if partly is None else np.where(partly, self.part, 1.0)
        return np.asarray(self.hidden ** (1 - seen) * (self.mirrored if mirrored else 1.0) * part, dtype=np.float64)
