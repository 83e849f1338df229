"""Errors of a keypoint network's landmarks, and a variance that matches them: fitted on held-out crops."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.optimize import minimize

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import decode_heatmaps, sigmoid
from muybridge.models.keypoints.network import STRIDE, KeypointNet
from muybridge.models.keypoints.test_time import mean_of_mirrored
from muybridge.models.uncertainty import SpreadCalibration
from muybridge.train.images.compositor import Batch

# Least variance, network pixels squared: a standard deviation of a tenth of a pixel.
LEAST_FLOOR_PX2 = 0.01
# Shares of a Gaussian's values within one and two sigma, and the largest number of knots of the map.
WITHIN_ONE, WITHIN_TWO, KNOTS = 0.6827, 0.9545, 16
# Least number of errors of a left-right pair from which its ratio is estimated.
LEAST_LANDMARKS = 200
# Trial ratios of the variance of hidden landmarks, relative to the estimate from the slope of the errors.
_HIDDEN_TRIALS = np.geomspace(0.65, 2.0, 12)
# Trial ratios of the variance with averaging over the mirrored crop to that without.
_MIRRORED_TRIALS = np.geomspace(0.5, 1.25, 38)

Reader = Callable[[Float32Array], tuple[Float32Array, Float32Array]]
"""A network: from crops (N, 4, S, S) in 0..1 to heatmaps (N, J, h, w) and visibility (N, J), logits."""


class HeldOut(NamedTuple):
    """Landmarks detected in held-out crops: N crops, J landmarks; or any selection of them, (K,) instead of (N, J).

    Attributes:
        error_px: (N, J, 2), NaN where the truth is unknown.
        spread_px2: (N, J) of the heatmaps.
        seen: (N, J) predicted probability that the landmark is not hidden.
        inside: (N, J) whether the landmark is known and lies inside the crop.
        visible: (N, J) whether, in addition, it is not hidden.
    """

    error_px: FloatArray
    spread_px2: FloatArray
    seen: FloatArray
    inside: BoolArray
    visible: BoolArray

    def select(self, at: Any) -> "HeldOut":
        """Those at an index of the first axes."""
        return HeldOut(*(values[at] for values in self))


def reader_of(net: KeypointNet) -> Reader:
    """A network under training as a function."""

    def read(crops: Float32Array) -> tuple[Float32Array, Float32Array]:
        with torch.inference_mode():
            heatmaps, visibility = net(torch.from_numpy(crops))
        return heatmaps.numpy(), visibility.numpy()

    return read


def read_held_out(read: Reader, batches: list[Batch]) -> tuple[HeldOut, HeldOut]:
    """All landmarks that a network detects in crops, body first, then markers, in crop pixels, decoded as in use.

    Args:
        read: the network.
        batches: of held-out crops.

    Returns:
        The landmarks of the crops, and those of outputs averaged with the mirrored crops.
    """
    parts: tuple[list[HeldOut], list[HeldOut]] = [], []
    twins = np.concatenate([BODY23.mirror, len(BODY23) + np.array(SURFACE.mirror)])
    for batch in batches:
        crops = batch.pixels.numpy().astype(np.float32) / np.float32(255)
        once, other = read(crops), read(np.ascontiguousarray(crops[..., ::-1]))
        each = twins[: once[0].shape[1]]
        parts[0].append(_decode(batch, *once))
        parts[1].append(_decode(batch, *(mean_of_mirrored(a, b, each) for a, b in zip(once, other, strict=True))))
    first, both = (HeldOut(*(np.concatenate(v) for v in zip(*part, strict=True))) for part in parts)
    return first, both


def _decode(batch: Batch, heatmaps: Float32Array, visibility: Float32Array) -> HeldOut:
    """Decode heatmaps and visibility of a batch and compare them with the truth."""
    count, body, plain = heatmaps.shape[1], len(BODY23), SpreadCalibration(1.0, 1e-12)
    decoded = [decode_heatmaps(heatmaps[:, :body], STRIDE, plain, np.array(BODY23.mirror))]
    if count > body:
        decoded.append(decode_heatmaps(heatmaps[:, body:], STRIDE, plain))
    points = np.concatenate([found.points_crop_px for found in decoded], 1)
    spread = np.concatenate([found.variance_crop_px2 for found in decoded], 1)
    at = np.concatenate([batch.landmarks_px, batch.markers_px], 1)[:, :count]
    visible = np.concatenate([batch.visible, batch.markers_visible], 1)[:, :count]
    inside = np.all((at >= 0) & (at < batch.image.shape[-1]), axis=-1)
    return HeldOut(points - at, spread, sigmoid(visibility), inside, visible & inside)


def fit_spread(
    error_px: FloatArray, spread_px2: FloatArray,
    visible: BoolArray | None = None, seen: FloatArray | None = None,
) -> SpreadCalibration:  # fmt: skip
    """The map from spread to variance under which one and two sigma contain their share of held-out errors.

    "Within n sigma" is meant per coordinate: |x error| < n sigma and |y error| < n sigma count separately, and a
    Gaussian has 68.3 and 95.4 % of them. Given the spread, errors are not Gaussian, though: most landmarks are near and
    a few lie on the other hypothesis, so that a sigma from the 68.3 % quantile is too small for 95.4 % and one from
    half of the 95.4 % quantile too large for 68.3 %. In every range of spreads the variance lies between the two, with
    one weight for all ranges, chosen to minimise the largest deviation of a share among all landmarks, the visible ones
    and the hidden ones.

    Args:
        error_px: (K, 2).
        spread_px2: (K,).
        visible: (K,) which of them are not hidden; without, only all of them together are considered.
        seen: (K,) the predicted probability of that. With it, landmarks that look hidden may have a larger variance for
            the same spread, by the ratio that best fits the shares, near what the slope of the errors suggests.
    """
    groups = [slice(None)] if visible is None else _groups(visible)
    seen = np.ones(len(error_px)) if seen is None else seen
    order = np.argsort(spread_px2)
    parts = np.array_split(order, max(1, min(KNOTS, len(order) // 50)))
    slope = _fit_hidden_slope(error_px, seen, parts)
    # If the slope shows no growth, there is nothing to choose.
    tried = np.unique(np.maximum(slope * _HIDDEN_TRIALS, 1.0)) if slope > 1 and len(groups) > 1 else [slope]
    fits = [_fit_hidden(error_px, spread_px2, seen, float(hidden), parts, groups) for hidden in tried]
    best = min(fits, key=lambda fit: fit[0])[1]
    scale, floor = _fit_line(spread_px2, best.variance(spread_px2))
    return replace(best, scale=scale, floor_px2=floor)


def _fit_hidden(
    error_px: FloatArray, spread_px2: FloatArray, seen: FloatArray, hidden: float,
    parts: list[IndexArray], groups: list[Any],
) -> tuple[float, SpreadCalibration]:  # fmt: skip
    """`fit_spread` with a given ratio for hidden landmarks, and the largest deviation of a share."""
    at = np.array([np.exp(np.log(np.maximum(spread_px2[part], LEAST_FLOOR_PX2)).mean()) for part in parts])
    factor = SpreadCalibration(hidden=hidden).ratio(seen, False)
    error = np.abs(error_px) / np.sqrt(factor)[:, None]
    one = np.array([np.quantile(error[part], WITHIN_ONE) for part in parts])
    two = np.array([np.quantile(error[part], WITHIN_TWO) / 2 for part in parts])

    def calibration(weight: float) -> SpreadCalibration:
        variance = np.maximum(one ** (2 - 2 * weight) * two ** (2 * weight), LEAST_FLOOR_PX2)
        return SpreadCalibration(knots=_pairs(at, np.maximum.accumulate(variance)), hidden=hidden)

    fits = [calibration(float(weight)) for weight in np.linspace(0.0, 1.0, 21)]
    off = [_largest_miss(error_px, fit.variance(spread_px2) * factor, groups) for fit in fits]
    best = int(np.argmin(off))
    return off[best], fits[best]


def fit_mirrored(spread: SpreadCalibration, found: HeldOut) -> SpreadCalibration:
    """The calibration with the ratio of the variances of outputs averaged with mirrored crops, from `found`, a
    selection of K such landmarks."""
    return replace(spread, mirrored=fit_ratio(found.error_px, variances(spread, found), found.visible))


def fit_ratio(error_px: FloatArray, variance_px2: FloatArray, visible: BoolArray) -> float:
    """Factor on variances that minimises the largest deviation of a share within one or two sigma, among all landmarks,
    the visible ones and the hidden ones.

    Args:
        error_px: (K, 2).
        variance_px2: (K,) of each coordinate.
        visible: (K,).
    """
    groups = _groups(visible)
    off = [_largest_miss(error_px, variance_px2 * ratio, groups) for ratio in _MIRRORED_TRIALS]
    return float(_MIRRORED_TRIALS[int(np.argmin(off))])


def variances(spread: SpreadCalibration, found: HeldOut, mirrored: bool = False) -> FloatArray:
    """(K,) px^2 of each coordinate."""
    return spread.variance(found.spread_px2) * spread.ratio(found.seen, mirrored)


def within(error_px: FloatArray, variance_px2: FloatArray) -> tuple[float, float]:
    """Shares of the coordinates (K, 2) within one and two sigma (K,); a calibrated Gaussian has 0.683 and 0.954."""
    sigma = np.sqrt(variance_px2)[:, None]
    return float((np.abs(error_px) < sigma).mean()), float((np.abs(error_px) < 2 * sigma).mean())


def landmark_ratios(found: HeldOut, mirror: Sequence[int]) -> FloatArray:
    """Ratio of each landmark's variance to the others' at the same spread.

    It is the geometric mean of the ratios from the 68.3 and the 95.4 % quantile, equal for left-right twins, whose
    errors are exchangeable; one for landmarks that are rarely in view. The ratios' product is one.

    Args:
        found: (N, J) landmarks.
        mirror: (J,) index of each landmark's counterpart, its own if it has none.

    Returns:
        (J,).
    """
    alike = found.select(found.inside)
    spread = fit_spread(alike.error_px, alike.spread_px2, alike.visible, alike.seen)
    away = np.abs(found.error_px) / np.sqrt(variances(spread, found))[..., None]
    logarithms: dict[int, float] = {}
    for landmark, twin in enumerate(mirror):
        pair = [landmark, twin]
        errors = away[:, pair][found.inside[:, pair]]
        if len(errors) >= LEAST_LANDMARKS:
            one, two = np.quantile(errors, [WITHIN_ONE, WITHIN_TWO])
            logarithms[landmark] = np.log(one * two / 2)
    ratios = np.ones(len(mirror))
    ratios[list(logarithms)] = np.exp(np.array(list(logarithms.values())) - np.mean(list(logarithms.values()) or [0.0]))
    return ratios


def calibrate(
    once: HeldOut, mirrored: HeldOut, landmarks: slice, mirror: Sequence[int]
) -> tuple[dict[str, Any], dict[str, float]]:
    """Calibrate the variance on one half of the crops and measure its coverage on the other, for the metadata.

    Args:
        once: landmarks in crops.
        mirrored: the same, from outputs averaged with the mirrored crops.
        landmarks: which of them.
        mirror: index of the counterpart of each of these, its own if it has none.

    Returns:
        The calibration, and the coverage.
    """
    once, mirrored = (found.select((slice(None), landmarks)) for found in (once, mirrored))
    half = len(once.inside) // 2
    ratios = landmark_ratios(once.select(slice(half)), mirror)
    # Divided by the root of the ratios, errors are equally large for all landmarks: what follows need not distinguish
    # them.
    once, mirrored = (found._replace(error_px=found.error_px / np.sqrt(ratios)[:, None]) for found in (once, mirrored))
    first, both = (found.select(slice(half)).select(found.inside[:half]) for found in (once, mirrored))
    spread = fit_mirrored(fit_spread(first.error_px, first.spread_px2, first.visible, first.seen), both)
    shares: dict[str, float] = {}
    for look, found in (("", once.select(slice(half, None))), ("_mirrored", mirrored.select(slice(half, None)))):
        variance = variances(spread, found, bool(look))
        shares |= coverage(found.error_px, variance, found.inside, found.visible, look)
    metadata = {"scale": spread.scale, "floor_px2": spread.floor_px2, "knots": spread.knots}
    metadata |= {
        "hidden": spread.hidden,
        "mirrored": spread.mirrored,
        "landmarks": [round(float(r), 4) for r in ratios],
    }
    return metadata, shares


def coverage(
    error_px: FloatArray, variance_px2: FloatArray, inside: BoolArray,
    visible: BoolArray, look: str,
) -> dict[str, float]:  # fmt: skip
    """Shares within one and two sigma, as in a file's metadata: of all landmarks that are `inside`, of the visible and
    of the hidden ones.

    Args:
        error_px: (N, J, 2).
        variance_px2: (N, J) of each coordinate.
        inside, visible: as in `HeldOut`.
        look: suffix of the shares' names, which tells how the crops were read.
    """
    shares: dict[str, float] = {}
    for name, group in (("", inside), ("_visible", visible), ("_hidden", inside & ~visible)):
        one, two = within(error_px[group], variance_px2[group])
        shares |= {f"one{name}{look}": round(one, 3), f"two{name}{look}": round(two, 3)}
    return shares


def _fit_hidden_slope(error_px: FloatArray, seen: FloatArray, parts: list[IndexArray]) -> float:
    """Growth of the variance from certainly visible to certainly hidden: from the slope of the errors' logarithms
    within `parts` of similar spread, on which the few large errors have little influence."""
    size = np.log(np.abs(error_px) + np.sqrt(LEAST_FLOOR_PX2)).mean(axis=1)
    x = np.concatenate([seen[part].mean() - seen[part] for part in parts])
    y = np.concatenate([size[part] - size[part].mean() for part in parts])
    return float(np.clip(np.exp(2 * (x * y).sum() / max((x * x).sum(), 1e-9)), 1.0, 4.0))


def _groups(visible: BoolArray) -> list[Any]:
    """All landmarks, the visible ones (K,) and the hidden ones."""
    return [slice(None), *(group for group in (visible, ~visible) if group.any())]


def _largest_miss(error_px: FloatArray, variance_px2: FloatArray, groups: list[Any]) -> float:
    """Largest deviation of the share within one or two sigma in any group."""
    shares = [within(error_px[group], variance_px2[group]) for group in groups]
    return max(max(abs(one - WITHIN_ONE), abs(two - WITHIN_TWO)) for one, two in shares)


def _pairs(a: FloatArray, b: FloatArray) -> tuple[tuple[float, float], ...]:
    """Pairs with ascending first numbers; others are dropped."""
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(a)) > 0])
    return tuple((float(x), float(y)) for x, y in zip(a[keep], b[keep], strict=True))


def _fit_line(spread_px2: FloatArray, variance_px2: FloatArray) -> tuple[float, float]:
    """Scale and floor of the line nearest to the variances by ratio, for readers without support for knots."""

    def cost(log_parameters: FloatArray) -> float:
        scale, floor = np.exp(log_parameters)
        return float(np.abs(np.log((scale * spread_px2 + floor) / variance_px2)).mean())

    scale, floor = np.exp(minimize(cost, np.log([0.5, 0.5]), method="Nelder-Mead").x)
    return float(scale), float(max(floor, LEAST_FLOOR_PX2))
