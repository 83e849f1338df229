"""From the networks' outputs to points, variances and boxes: numpy, written once.

Training evaluates with these functions and inference uses them, so that what was measured is what runs. Cells
and pixels: cell (row v, column u) of a map with stride s is centred at input pixel (s*u + (s-1)/2,
s*v + (s-1)/2), pixel (0, 0) being the centre of the top-left one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.models.keypoints.patches import patches
from muybridge.models.keypoints.left_right import told_apart

# The refined point is the centre of a window of this half-width (cells) on its own probability mass, reached
# in this many steps. A fixed window about the best cell would pull points towards the cell's centre.
_WINDOW_CELLS = 2.5
_WINDOW_STEPS = 3

# A point's score is the probability within this distance of it, in cells.
_SCORE_RADIUS_CELLS = 2.5

# A network with no more of its belief than this round the likeliest place knows nothing of a landmark: it is outside of
# the picture, and what comes out is a quarter of a crop off (the median of held-out people seen in part).
NO_IDEA = 0.1

# A crop in which some landmarks, but less than this share of them, are found shows a part of a person. Of whom fewer
# than so many are found, nothing is known yet.
_WHOLE, _LEAST_THERE = 0.85, 6

# Half-width of the patch of cells gathered round the best one: it holds the window and the score's circle
# wherever the point goes, which is at most one cell away.
_PATCH = 3


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

    def variance(self, spread_px2: NDArray[np.float64]) -> NDArray[np.float64]:
        """The variance of each coordinate, of the spread's shape, whose last axis the `landmarks` are, if they are not
        alike; NaN stays NaN."""
        each = np.array(self.landmarks) if self.landmarks else 1.0
        if not self.knots:
            return np.asarray((self.scale * spread_px2 + self.floor_px2) * each, dtype=np.float64)
        at, value = np.array(self.knots).T
        inside = np.clip(spread_px2, at[0], at[-1])
        inner = np.exp(np.interp(np.log(inside), np.log(at), np.log(value)))
        return np.asarray(inner * np.maximum(spread_px2 / at[-1], 1.0) * each, dtype=np.float64)

    def ratio(
        self, seen: NDArray[np.float64], mirrored: bool, partly: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float64]:
        """What variances are to be multiplied by, where landmarks are visible with a probability of `seen`, the crops
        were looked at mirrored too or were not, and those that are `partly`, which broadcasts with `seen`, show a part
        of a person."""
        part = 1.0 if partly is None else np.where(partly, self.part, 1.0)
        return np.asarray(self.hidden ** (1 - seen) * (self.mirrored if mirrored else 1.0) * part, dtype=np.float64)


class DecodedHeatmaps(NamedTuple):
    """Landmarks of `N` crops.

    Attributes:
        points_crop_px: (N, J, 2) float64; NaN where the map is not finite.
        variance_crop_px2: (N, J) variance of each coordinate.
        score: (N, J) in 0..1, zero where missing.
    """

    points_crop_px: NDArray[np.float64]
    variance_crop_px2: NDArray[np.float64]
    score: NDArray[np.float64]


def decode_heatmaps(
    logits: NDArray[np.float32], stride: int, spread: SpreadCalibration, twins: NDArray[np.intp] | None = None
) -> DecodedHeatmaps:
    """Landmarks from classification maps.

    The softmax over a landmark's cells is the probability of where it is. The point is the distribution's
    mode, refined within its neighbourhood: never an average of two hypotheses (left or right leg). The
    variance is taken over the *whole* distribution round that point, E|x - point|^2 / 2 a coordinate, so a
    second hypothesis shows as a large variance, not as a shifted point.

    Args:
        logits: (N, J, h, w).
        stride: input pixels a cell.
        spread: the network's calibration of variances.
        twins: (J,) each landmark's counterpart on the other side (its own index where it has none), if those that are
            found in one place shall be told apart where the crop shows a whole person, see `models.twins`.

    Raises:
        ValueError: `logits` has not four axes.
    """
    if logits.ndim != 4:
        raise ValueError(f"logits must be (N, J, h, w), not {logits.shape}")
    count, landmarks, height, width = logits.shape
    flat = np.ascontiguousarray(logits, dtype=np.float32).reshape(count * landmarks, height * width)
    best = flat.argmax(axis=1)
    rows = np.arange(len(flat))
    with np.errstate(invalid="ignore"):  # maps that are not finite come out as missing
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
            moved, cells = told_apart(maps, moments[:, 0], best, whole, twins)
            point_uv[moved], mass[moved] = _refine(maps[moved], cells)
            score[moved] = np.minimum(mass[moved] / moments[moved, 0], 1.0)
        # Moments are about the map's middle, for float32's sake.
        offset = point_uv - np.array([(width - 1) / 2, (height - 1) / 2])
        spread_cells2 = moments[:, 3] - 2 * (offset * moments[:, 1:3]).sum(axis=1) + (offset**2).sum(axis=1)
    missing = ~np.isfinite(moments[:, 0])
    point_uv[missing], spread_cells2[missing], score[missing] = np.nan, np.nan, 0.0
    shape = (count, landmarks)
    variance = spread.variance((np.maximum(spread_cells2, 0.0) / 2 * stride**2).reshape(shape))
    points = point_uv * stride + (stride - 1) / 2
    return DecodedHeatmaps(points.reshape(*shape, 2), variance, score.reshape(shape))


def sigmoid(logits: NDArray[np.floating]) -> NDArray[np.float64]:
    """Probabilities from logits of any shape."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits.astype(np.float64), -50, 50))))


def there(score: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) how many landmarks crops show, of whose places there is an idea, by their scores (N, J)."""
    return np.asarray((score >= NO_IDEA).sum(axis=1))


def in_part(score: NDArray[np.float64], whole: float = _WHOLE) -> NDArray[np.bool_]:
    """(N,) which crops show a part of a person, less than the share `whole`, by the scores (N, J) of the landmarks."""
    count = there(score)
    return np.asarray((count >= _LEAST_THERE) & (count < whole * score.shape[1]))


def with_expectation(
    logits: NDArray[np.float32], stride: int, expected_px: NDArray[np.float64], sd_px: float, most: float
) -> NDArray[np.float32]:
    """Maps that know where their landmarks are expected: the posterior of a robust Gaussian prior.

    Of two hypotheses the one that is expected wins; a sharp peak moves by less than its own width, and one that is
    `most` surer than what was expected stays where it is.

    Args:
        logits: (N, J, h, w).
        stride: input pixels a cell.
        expected_px: (N, J, 2) px of the input; NaN where nothing is expected.
        sd_px: standard deviation of the expectation, px of the input.
        most: that it can say against a place, nats.
    """
    height, width = logits.shape[2:]
    across, down = (np.arange(n) * stride + (stride - 1) / 2 for n in (width, height))
    away2 = ((down - expected_px[..., 1:]) ** 2)[..., :, None] + ((across - expected_px[..., :1]) ** 2)[..., None, :]
    against = np.minimum(away2 / (2 * sd_px**2), most)
    return np.asarray(logits - np.where(np.isfinite(against), against, 0.0), dtype=np.float32)


def _moment_basis(height: int, width: int) -> NDArray[np.float32]:
    """(h*w, 4) columns 1, u, v, u^2 + v^2 about the map's middle."""
    u = np.tile(np.arange(width) - (width - 1) / 2, height)
    v = np.repeat(np.arange(height) - (height - 1) / 2, width)
    return np.stack([np.ones_like(u), u, v, u**2 + v**2], axis=1).astype(np.float32)


def _refine(
    probability: NDArray[np.float32], best: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (K, 2) in cells (u, v), and the mass (K,) near them, of (K, h, w) maps with best cells `best`.

    A window with fractional edges moves to the centre of its mass: exact for a symmetric peak wherever it
    lies between cells.
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
        # The mode stays in its cell or the next: a slope without a peak must not walk away.
        np.clip(offset, -1.0, 1.0, out=offset)
    away_u, away_v = (grid - offset[:, :1]) ** 2, (grid - offset[:, 1:]) ** 2
    distance2 = away_v[:, :, None] + away_u[:, None, :]
    mass = (patch * (distance2 <= _SCORE_RADIUS_CELLS**2)).sum(axis=(1, 2))
    return np.stack([best_u, best_v], axis=1) + offset.astype(np.float64), mass.astype(np.float64)


class DetectedPeople(NamedTuple):
    """People of one image, best first.

    Attributes:
        boxes_px: (K, 4) left, top, right, bottom, px of the network's input.
        scores: (K,) in 0..1.
    """

    boxes_px: NDArray[np.float64]
    scores: NDArray[np.float64]


def decode_people(
    heatmap: NDArray[np.float32],
    box: NDArray[np.float32],
    stride: int,
    threshold: float = 0.3,
    max_people: int = 16,
    max_overlap: float = 0.5,
) -> list[DetectedPeople]:
    """People's boxes from the detector's maps.

    Args:
        heatmap: (N, 1, h, w) logits of a box's centre.
        box: (N, 4, h, w) distances from the cell's centre to the left, top, right and bottom edge, input px.
        stride: input pixels a cell.
        threshold: least probability of a detection.
        max_people: most detections an image.
        max_overlap: of two boxes that overlap more (intersection over union) the better one stays.

    Returns:
        one entry an image.
    """
    if heatmap.ndim != 4 or box.shape != (len(heatmap), 4, *heatmap.shape[2:]):
        raise ValueError(f"heatmap (N, 1, h, w) and box (N, 4, h, w) expected: {heatmap.shape}, {box.shape}")
    scores = sigmoid(heatmap[:, 0])
    padded = np.pad(scores, ((0, 0), (1, 1), (1, 1)), constant_values=-1.0)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    peaks = (scores >= threshold) & (scores >= around.max(axis=(-1, -2)))
    found = []
    for image in range(len(scores)):
        rows, columns = np.nonzero(peaks[image])
        center = np.stack([columns, rows], axis=1) * stride + (stride - 1) / 2
        left, top, right, bottom = box[image][:, rows, columns].astype(np.float64)
        boxes = np.stack([center[:, 0] - left, center[:, 1] - top, center[:, 0] + right, center[:, 1] + bottom], axis=1)
        usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] - boxes[:, :2] > 1.0).all(axis=1)
        boxes, score = boxes[usable], scores[image, rows, columns][usable]
        keep = suppress_overlaps(boxes, score, max_overlap)[:max_people]
        found.append(DetectedPeople(boxes[keep], score[keep]))
    return found


def suppress_overlaps(
    boxes_px: NDArray[np.float64], scores: NDArray[np.float64], max_overlap: float
) -> NDArray[np.intp]:
    """Indices, best first, of the boxes that no better box overlaps by more than `max_overlap` (IoU)."""
    order = np.argsort(-scores, kind="stable")
    overlap = box_overlap(boxes_px, boxes_px)
    keep: list[int] = []
    for index in order:
        if not keep or overlap[index, keep].max() <= max_overlap:
            keep.append(int(index))
    return np.array(keep, dtype=np.intp)


def box_overlap(a_px: NDArray[np.float64], b_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """(A, B) intersection over union of (A, 4) and (B, 4) boxes: left, top, right, bottom."""
    low = np.maximum(a_px[:, None, :2], b_px[None, :, :2])
    high = np.minimum(a_px[:, None, 2:], b_px[None, :, 2:])
    common = np.clip(high - low, 0, None).prod(axis=-1)
    area_a = (a_px[:, 2:] - a_px[:, :2]).prod(axis=-1)
    area_b = (b_px[:, 2:] - b_px[:, :2]).prod(axis=-1)
    overlap: NDArray[np.float64] = common / np.maximum(area_a[:, None] + area_b[None, :] - common, 1e-12)
    return overlap
