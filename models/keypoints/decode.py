"""From network outputs to points, variances and scores, in NumPy.

Training evaluates with these functions and inference uses them, so that the measured numbers hold in use. Cell (row v,
column u) of a map with stride s is centred at input pixel (s*u + (s-1)/2, s*v + (s-1)/2); pixel (0, 0) is the centre of
the top-left one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.models.keypoints.left_right import disambiguate_left_right
from muybridge.models.keypoints.patches import patches
from muybridge.models.uncertainty import SpreadCalibration

# The refined point is the centre of mass of the probability within a window of this half-width (cells) about itself,
# found in this many steps. A fixed window about the best cell would bias points towards the cell's centre.
_WINDOW_CELLS = 2.5
_WINDOW_STEPS = 3

# A point's score is the probability within this distance of it, in cells.
_SCORE_RADIUS_CELLS = 2.5

# If no more than this probability is near the likeliest place, the network has not located the landmark: it is outside
# the image, and the point is a quarter of a crop off (median of held-out, partly visible people).
NO_IDEA = 0.1

# With even less of it, the landmark is missing from the results: two in three are outside of the crop then (held-out
# crops). From here to NO_IDEA 83 % are inside, mostly hidden, and their variance holds (67 and 83 % within one and two
# standard deviations), so that the other cameras and the body can use them.
WITHHELD = 0.05

# A crop that locates some landmarks, but less than this share of them, shows part of a person. With fewer landmarks
# than the second number nothing can be said.
_WHOLE, _LEAST_THERE = 0.85, 6

# Half-width of the patch of cells around the best one: it contains the window and the score's circle wherever the point
# moves, which is at most one cell away.
_PATCH = 3


class DecodedHeatmaps(NamedTuple):
    """Landmarks of `N` crops.

    Attributes:
        points_crop_px: (N, J, 2) float64; NaN where the map is not finite.
        variance_crop_px2: (N, J) variance of each coordinate.
        score: (N, J) in 0..1, zero where missing.
    """

    points_crop_px: FloatArray
    variance_crop_px2: FloatArray
    score: FloatArray


def decode_heatmaps(
    logits: Float32Array, stride: int, spread: SpreadCalibration, twins: IndexArray | None = None
) -> DecodedHeatmaps:
    """Landmarks from classification maps.

    The softmax over a landmark's cells is the probability of its position. The point is the distribution's mode,
    refined within its neighbourhood: never an average of two hypotheses (left or right leg). The variance is taken over
    the *whole* distribution about that point, E|x - point|^2 / 2 per coordinate, so a second hypothesis shows as a
    large variance, not as a shifted point.

    Args:
        logits: (N, J, h, w).
        stride: input pixels per cell.
        spread: the network's variance calibration.
        twins: (J,) index of each landmark's counterpart on the other side (its own index if it has none), to resolve
            left-right ambiguity in crops that show a whole person, see `left_right`.

    Raises:
        ValueError: `logits` does not have four axes.
    """
    if logits.ndim != 4:
        raise ValueError(f"logits must be (N, J, h, w), not {logits.shape}")
    count, landmarks, height, width = logits.shape
    flat = np.ascontiguousarray(logits, dtype=np.float32).reshape(count * landmarks, height * width)
    best = flat.argmax(axis=1)
    rows = np.arange(len(flat))
    with np.errstate(invalid="ignore"):  # maps that are not finite become missing points
        probability = flat - flat[rows, best][:, None]
        np.exp(probability, out=probability)
        moments = probability @ _moment_basis(height, width)
        moments = moments.astype(np.float64)
        moments[:, 1:] /= moments[:, :1]
        maps = probability.reshape(-1, height, width)
        point_uv, mass = _refine(maps, best)
        score = np.minimum(mass / moments[:, 0], 1.0)
        if twins is not None:
            whole = np.flatnonzero(~in_part(score.reshape(count, landmarks)))
            moved, cells = disambiguate_left_right(maps, moments[:, 0], best, whole, twins)
            point_uv[moved], mass[moved] = _refine(maps[moved], cells)
            score[moved] = np.minimum(mass[moved] / moments[moved, 0], 1.0)
        # Moments are about the map's centre to keep precision in float32.
        offset = point_uv - np.array([(width - 1) / 2, (height - 1) / 2])
        spread_cells2 = moments[:, 3] - 2 * (offset * moments[:, 1:3]).sum(axis=1) + (offset**2).sum(axis=1)
    missing = ~np.isfinite(moments[:, 0])
    point_uv[missing], spread_cells2[missing], score[missing] = np.nan, np.nan, 0.0
    shape = (count, landmarks)
    variance = spread.variance((np.maximum(spread_cells2, 0.0) / 2 * stride**2).reshape(shape))
    points = point_uv * stride + (stride - 1) / 2
    return DecodedHeatmaps(points.reshape(*shape, 2), variance, score.reshape(shape))


def sigmoid(logits: NDArray[np.floating]) -> FloatArray:
    """Probabilities from logits of any shape."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits.astype(np.float64), -50, 50))))


def count_located(score: FloatArray) -> IntArray:
    """(N,) number of landmarks that crops locate at all, by their scores (N, J)."""
    return np.asarray((score >= NO_IDEA).sum(axis=1))


def in_part(score: FloatArray, whole: float = _WHOLE) -> BoolArray:
    """(N,) whether crops show only part of a person, less than the share `whole`, by the scores (N, J) of the
    landmarks."""
    count = count_located(score)
    return np.asarray((count >= _LEAST_THERE) & (count < whole * score.shape[1]))


def with_expectation(
    logits: Float32Array, stride: int, expected_px: FloatArray, sd_px: float, most: float
) -> Float32Array:
    """Maps combined with an expected position: the posterior of a robust Gaussian prior.

    Of two hypotheses the expected one wins. A sharp peak moves by less than its own width, and one that is `most` nats
    above the expected place stays.

    Args:
        logits: (N, J, h, w).
        stride: input pixels per cell.
        expected_px: (N, J, 2) px of the input; NaN where nothing is expected.
        sd_px: standard deviation of the expectation, px of the input.
        most: the largest penalty of a place, nats.
    """
    height, width = logits.shape[2:]
    across, down = (np.arange(n) * stride + (stride - 1) / 2 for n in (width, height))
    away2 = ((down - expected_px[..., 1:]) ** 2)[..., :, None] + ((across - expected_px[..., :1]) ** 2)[..., None, :]
    against = np.minimum(away2 / (2 * sd_px**2), most)
    return np.asarray(logits - np.where(np.isfinite(against), against, 0.0), dtype=np.float32)


def _moment_basis(height: int, width: int) -> Float32Array:
    """(h*w, 4) columns 1, u, v, u^2 + v^2 about the map's centre."""
    u = np.tile(np.arange(width) - (width - 1) / 2, height)
    v = np.repeat(np.arange(height) - (height - 1) / 2, width)
    return np.stack([np.ones_like(u), u, v, u**2 + v**2], axis=1).astype(np.float32)


def _refine(probability: Float32Array, best: IndexArray) -> tuple[FloatArray, FloatArray]:
    """Points refined to fractions of a cell.

    A window with fractional edges moves to the centre of its mass, which is exact for a symmetric peak anywhere between
    cells.

    Args:
        probability: (K, h, w) maps.
        best: (K,) flat index of their likeliest cells.

    Returns:
        Points (K, 2) in cells (u, v), and the mass (K,) near them.
    """
    count, width = len(probability), probability.shape[2]
    best_v, best_u = best // width, best % width
    patch = patches(probability, np.arange(count), best, _PATCH)
    grid = np.arange(-_PATCH, _PATCH + 1).astype(np.float32)
    offset = np.zeros((count, 2), dtype=np.float32)
    for _ in range(_WINDOW_STEPS):
        weight_u = np.clip(_WINDOW_CELLS + 0.5 - np.abs(grid - offset[:, :1]), 0.0, 1.0)
        weight_v = np.clip(_WINDOW_CELLS + 0.5 - np.abs(grid - offset[:, 1:]), 0.0, 1.0)
        # The window is applied along v first: (K, u) columns, then along u: (K, v) rows.
        columns = np.matmul(weight_v[:, None, :], patch)[:, 0] * weight_u
        lines = np.matmul(patch, weight_u[:, :, None])[..., 0] * weight_v
        total = columns.sum(axis=1)
        offset = np.stack([columns @ grid, lines @ grid], axis=1) / total[:, None]
        # The mode stays within a cell of the best: on a slope without a peak it must not drift away.
        np.clip(offset, -1.0, 1.0, out=offset)
    away_u, away_v = (grid - offset[:, :1]) ** 2, (grid - offset[:, 1:]) ** 2
    distance2 = away_v[:, :, None] + away_u[:, None, :]
    mass = (patch * (distance2 <= _SCORE_RADIUS_CELLS**2)).sum(axis=(1, 2))
    return np.stack([best_u, best_v], axis=1) + offset.astype(np.float64), mass.astype(np.float64)
