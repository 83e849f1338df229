"""From the outputs of third-party top-down models to points and variances: SimCC bins and plain heatmaps.

SimCC (Li et al. 2022) classifies x and y separately over bins finer than pixels; RTMPose is the best-known model that
uses it. Bin b lies at input pixel b / split_ratio, pixel 0 being the centre of the first one.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.models.keypoints.decode import DecodedHeatmaps, decode_heatmaps
from muybridge.models.uncertainty import SpreadCalibration

# The point is the centre of mass within this many bins of itself, found in this many steps.
_WINDOW_BINS = 5.5
_WINDOW_STEPS = 6

# In heatmaps of values, anything below this share of a map's peak is noise, not probability.
_NOISE = 0.05


def decode_simcc(
    x_logits: Float32Array,
    y_logits: Float32Array,
    split_ratio: float,
    spread: SpreadCalibration,
    softmax_scale: float = 1.0,
    score_radius_px: float = 10.0,
) -> DecodedHeatmaps:
    """Landmarks from classifications of x and y.

    The softmax over the bins of an axis is the probability of the coordinate. The point is its mode, refined within its
    neighbourhood; the variance is the mean over both axes of E(x - point)^2 over all bins; the score is the probability
    that both coordinates are near the point.

    Args:
        x_logits: (N, K, X) over the input's width.
        y_logits: (N, K, Y) over its height.
        split_ratio: bins per input pixel.
        spread: variance calibration.
        softmax_scale: factor on the logits before the softmax, as in the model's training (RTMPose: 10).
        score_radius_px: radius for the score, input px.

    Returns:
        Points in input pixels, (N, K, 2); NaN where an axis is not finite.

    Raises:
        ValueError: outputs without three axes, or of different N or K.
    """
    if x_logits.ndim != 3 or y_logits.ndim != 3 or x_logits.shape[:2] != y_logits.shape[:2]:
        raise ValueError(f"(N, K, X) and (N, K, Y) expected, not {x_logits.shape} and {y_logits.shape}")
    x, x_spread, x_mass = _decode_axis(x_logits, softmax_scale, score_radius_px * split_ratio)
    y, y_spread, y_mass = _decode_axis(y_logits, softmax_scale, score_radius_px * split_ratio)
    points = np.stack([x, y], axis=-1) / split_ratio
    variance = spread.variance((x_spread + y_spread) / 2 / split_ratio**2)
    missing = ~np.isfinite(points).all(axis=-1)
    points[missing], variance[missing] = np.nan, np.nan
    return DecodedHeatmaps(points, variance, np.where(missing, 0.0, x_mass * y_mass))


def _decode_axis(logits: Float32Array, scale: float, radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position (bins), spread about it (bins^2) and mass within `radius` (bins) of it, each (N, K)."""
    bins = np.arange(logits.shape[-1], dtype=np.float64)
    with np.errstate(invalid="ignore"):  # values that are not finite become NaN
        scaled = scale * logits.astype(np.float64)
        p = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
        p /= p.sum(axis=-1, keepdims=True)
        best = scaled.argmax(axis=-1)
        at = best.astype(np.float64)
        for _ in range(_WINDOW_STEPS):
            near = p * np.clip(_WINDOW_BINS + 0.5 - np.abs(bins - at[..., None]), 0.0, 1.0)
            at = (near * bins).sum(axis=-1) / near.sum(axis=-1)
            # The mode stays near its bin: on a slope without a peak it must not drift away.
            at = np.clip(at, best - 1.0, best + 1.0)
        away = bins - at[..., None]
        mass = (p * (np.abs(away) <= radius)).sum(axis=-1)
        return at, (p * away**2).sum(axis=-1), np.minimum(mass, 1.0)


def decode_value_heatmaps(
    values: Float32Array, stride: float, origin_px: float, spread: SpreadCalibration, logits: bool
) -> DecodedHeatmaps:
    """Landmarks from heatmaps of other conventions.

    Args:
        values: (N, K, h, w); logits of a softmax over the cells, or values from 0 to 1 at a certain landmark (networks
            trained with a squared error).
        stride: input px per cell.
        origin_px: input px of the first cell's centre, in x and in y.
        spread: variance calibration.
        logits: whether `values` are logits.

    Returns:
        Points in input pixels, (N, K, 2); NaN where a map is not finite. The score of values is their peak, clipped to
        0..1.

    Raises:
        ValueError: `values` does not have four axes.
    """
    if values.ndim != 4:
        raise ValueError(f"heatmaps must be (N, K, h, w), not {values.shape}")
    finite = np.asarray(np.isfinite(values).all(axis=(2, 3)))
    maps = np.where(finite[..., None, None], values, 0).astype(np.float32)
    if not logits:
        peak = maps.max(axis=(2, 3), keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            maps = np.log(np.where(maps > _NOISE * np.abs(peak), maps, np.float32(1e-30)))
    cells = decode_heatmaps(maps, 1, SpreadCalibration(1.0, 0.0))
    at = cells.points_crop_px
    if not logits:  # wide Gaussians, which the window truncates: their fourth power is half as wide
        at = decode_heatmaps(4 * maps, 1, SpreadCalibration(1.0, 0.0)).points_crop_px
    points = at * stride + origin_px
    variance = spread.variance(cells.variance_crop_px2 * stride**2)
    score = cells.score
    if not logits:
        score = np.where(np.isfinite(points[..., 0]), np.clip(peak[..., 0, 0], 0.0, 1.0), 0.0).astype(np.float64)
    points[~finite], variance[~finite] = np.nan, np.nan
    return DecodedHeatmaps(points, variance, np.where(finite, score, 0.0))
