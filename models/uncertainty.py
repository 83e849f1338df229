"""Calibration of the networks' variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class SpreadCalibration:
    """How a heatmap's spread becomes a variance, both in network input px^2.

    Fitted on held-out data when a network is exported, and stored in its file.

    Attributes:
        scale, floor_px2: `scale * spread + floor_px2`, used if there are no knots.
        knots: pairs of spread and variance, both ascending. Between them the logarithm of the variance is linear in
            that of the spread; below the first it is constant, above the last proportional to the spread.
        hidden: ratio of the variance of a certainly hidden landmark to that of a certainly visible one, for equal
            spreads.
        mirrored: ratio of the variance with averaging over the mirrored crop to that without.
        part: ratio of the variance in crops that show part of a person (`in_part`) to that in others, for equal
            spreads.
        landmarks: each landmark's variance relative to the others', for equal spreads; empty if all are equal.
    """

    scale: float = 1.0
    floor_px2: float = 1.0
    knots: tuple[tuple[float, float], ...] = ()
    hidden: float = 1.0
    mirrored: float = 1.0
    part: float = 1.0
    landmarks: tuple[float, ...] = ()

    def variance(self, spread_px2: FloatArray) -> FloatArray:
        """The variance of each coordinate, in the shape of `spread_px2`, whose last axis is that of `landmarks` if
        these are given; NaN stays NaN."""
        each = np.array(self.landmarks) if self.landmarks else 1.0
        if not self.knots:
            return np.asarray((self.scale * spread_px2 + self.floor_px2) * each, dtype=np.float64)
        at, value = np.array(self.knots).T
        inside = np.clip(spread_px2, at[0], at[-1])
        inner = np.exp(np.interp(np.log(inside), np.log(at), np.log(value)))
        return np.asarray(inner * np.maximum(spread_px2 / at[-1], 1.0) * each, dtype=np.float64)

    def ratio(self, seen: FloatArray, mirrored: bool | BoolArray, partly: BoolArray | None = None) -> FloatArray:
        """Factor on the variances.

        Args:
            seen: probability that a landmark is visible.
            mirrored: whether outputs were averaged with those of the mirrored crops; broadcasts with `seen`.
            partly: whether a crop shows only part of a person; broadcasts with `seen`.
        """
        part = 1.0 if partly is None else np.where(partly, self.part, 1.0)
        return np.asarray(self.hidden ** (1 - seen) * np.where(mirrored, self.mirrored, 1.0) * part, dtype=np.float64)
