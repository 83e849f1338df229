"""How far a keypoint network's landmarks are off, and the variance that says so: fitted on held-out crops."""

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
from muybridge.models.keypoints.mirroring import mean_of_mirrored
from muybridge.models.keypoints.network import STRIDE, KeypointNet
from muybridge.models.uncertainty import SpreadCalibration
from muybridge.train.images.compositor import Batch

# No landmark is known better than this, network pixels squared: a tenth of a pixel.
LEAST_FLOOR_PX2 = 0.01
# Shares of a Gaussian's values within one and two sigma, and the most knots of the map that is to give them.
WITHIN_ONE, WITHIN_TWO, KNOTS = 0.6827, 0.9545, 16
# Landmarks of a pair of twins that say how much their variance differs from the others'; fewer say nothing.
LEAST_OF_A_LANDMARK = 200
# What is tried for the ratio of the variance of what looks hidden, times what the errors' slope says.
_HIDDEN = np.geomspace(0.65, 2.0, 12)
# What is tried for the ratio of the variance of crops looked at mirrored too to that of crops looked at once.
_MIRRORED = np.geomspace(0.5, 1.25, 38)

Look = Callable[[Float32Array], tuple[Float32Array, Float32Array]]
"""A network: crops (N, 4, S, S) in 0..1 to heatmaps (N, J, h, w) and visibility (N, J), logits."""


class HeldOut(NamedTuple):
    """How landmarks of held-out crops were found: N crops, J landmarks; or any selection of them, (K,) for (N, J).

    Attributes:
        error_px: (N, J, 2), NaN where the truth is unknown.
        spread_px2: (N, J) of the heatmaps.
        seen: (N, J) probability that the landmark is not hidden, as the network says.
        inside: (N, J) the landmark is known and lies inside of the crop.
        visible: (N, J) and is not hidden.
    """

    error_px: FloatArray
    spread_px2: FloatArray
    seen: FloatArray
    inside: BoolArray
    visible: BoolArray

    def select(self, at: Any) -> "HeldOut":
        """Those at an index of the first axes."""
        return HeldOut(*(values[at] for values in self))


def look_of(net: KeypointNet) -> Look:
    """A network under training as a function."""

    def look(crops: Float32Array) -> tuple[Float32Array, Float32Array]:
        with torch.inference_mode():
            heatmaps, visibility = net(torch.from_numpy(crops))
        return heatmaps.numpy(), visibility.numpy()

    return look


def held_out(look: Look, batches: list[Batch]) -> tuple[HeldOut, HeldOut]:
    """All that a network finds in crops, body first, then markers, in crop pixels, decoded as in use: looked at once,
    and by the mean of what it says of the crop and of its mirror image."""
    parts: tuple[list[HeldOut], list[HeldOut]] = [], []
    twins = np.concatenate([BODY23.mirror, len(BODY23) + np.array(SURFACE.mirror)])
    for batch in batches:
        crops = batch.pixels.numpy().astype(np.float32) / np.float32(255)
        once, other = look(crops), look(np.ascontiguousarray(crops[..., ::-1]))
        each = twins[: once[0].shape[1]]
        parts[0].append(_found(batch, *once))
        parts[1].append(_found(batch, *(mean_of_mirrored(a, b, each) for a, b in zip(once, other, strict=True))))
    first, both = (HeldOut(*(np.concatenate(v) for v in zip(*part, strict=True))) for part in parts)
    return first, both


def _found(batch: Batch, heatmaps: Float32Array, visibility: Float32Array) -> HeldOut:
    """What heatmaps and visibility of a batch say, beside the truth."""
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
    """The map from spread to variance under which one and two sigma hold their share of held-out errors.

    "Within n sigma" is meant a coordinate: |x error| < n sigma and |y error| < n sigma count one each, and a
    Gaussian has 68.3 and 95.4 % of them. Errors are no Gaussian given the spread, though: most landmarks are near
    and a few lie on the other hypothesis, so that a sigma from the 68.3 % quantile is too small for 95.4 % and one
    from half of the 95.4 % quantile too large for 68.3 %. In every range of spreads the variance lies between the
    two, by one weight for all, with which no share is farther off than need be, neither of all landmarks nor of
    the visible ones nor of the hidden ones.

    Args:
        error_px: (K, 2).
        spread_px2: (K,).
        visible: (K,) which of them are not hidden; without, only all together are looked at.
        seen: (K,) the probability of that, as the network says; with it, what looks hidden may have a larger variance
            of the same spread: as much larger as makes the shares right, near what the errors' slope says.
    """
    groups = [slice(None)] if visible is None else _groups(visible)
    seen = np.ones(len(error_px)) if seen is None else seen
    order = np.argsort(spread_px2)
    parts = np.array_split(order, max(1, min(KNOTS, len(order) // 50)))
    slope = _hidden(error_px, seen, parts)
    # Where the slope says nothing of it there is nothing to choose.
    tried = np.unique(np.maximum(slope * _HIDDEN, 1.0)) if slope > 1 and len(groups) > 1 else [slope]
    fits = [_fit_hidden(error_px, spread_px2, seen, float(hidden), parts, groups) for hidden in tried]
    best = min(fits, key=lambda fit: fit[0])[1]
    scale, floor = _line(spread_px2, best.variance(spread_px2))
    return replace(best, scale=scale, floor_px2=floor)


def _fit_hidden(
    error_px: FloatArray, spread_px2: FloatArray, seen: FloatArray, hidden: float,
    parts: list[IndexArray], groups: list[Any],
) -> tuple[float, SpreadCalibration]:  # fmt: skip
    """`fit_spread` with a given ratio of hidden landmarks, and by how much a share is off at most."""
    at = np.array([np.exp(np.log(np.maximum(spread_px2[part], LEAST_FLOOR_PX2)).mean()) for part in parts])
    factor = SpreadCalibration(hidden=hidden).ratio(seen, False)
    error = np.abs(error_px) / np.sqrt(factor)[:, None]
    one = np.array([np.quantile(error[part], WITHIN_ONE) for part in parts])
    two = np.array([np.quantile(error[part], WITHIN_TWO) / 2 for part in parts])

    def calibration(weight: float) -> SpreadCalibration:
        variance = np.maximum(one ** (2 - 2 * weight) * two ** (2 * weight), LEAST_FLOOR_PX2)
        return SpreadCalibration(knots=_pairs(at, np.maximum.accumulate(variance)), hidden=hidden)

    fits = [calibration(float(weight)) for weight in np.linspace(0.0, 1.0, 21)]
    off = [_farthest_off(error_px, fit.variance(spread_px2) * factor, groups) for fit in fits]
    best = int(np.argmin(off))
    return off[best], fits[best]


def fit_mirrored(spread: SpreadCalibration, found: HeldOut) -> SpreadCalibration:
    """The calibration with the ratio by which variances are smaller where crops are looked at mirrored too, which
    `found`, a selection of K landmarks, were."""
    return replace(spread, mirrored=fitted_ratio(found.error_px, variances(spread, found), found.visible))


def fitted_ratio(error_px: FloatArray, variance_px2: FloatArray, visible: BoolArray) -> float:
    """By what variances (K,) of coordinates (K, 2) have to be multiplied for no share within one or two sigma to be
    farther off than need be, neither of all nor of the `visible` (K,) nor of the hidden."""
    groups = _groups(visible)
    off = [_farthest_off(error_px, variance_px2 * ratio, groups) for ratio in _MIRRORED]
    return float(_MIRRORED[int(np.argmin(off))])


def variances(spread: SpreadCalibration, found: HeldOut, mirrored: bool = False) -> FloatArray:
    """(K,) px^2 of each coordinate."""
    return spread.variance(found.spread_px2) * spread.ratio(found.seen, mirrored)


def within(error_px: FloatArray, variance_px2: FloatArray) -> tuple[float, float]:
    """Shares of the coordinates (K, 2) within one and two sigma (K,); a calibrated Gaussian has 0.683 and 0.954."""
    sigma = np.sqrt(variance_px2)[:, None]
    return float((np.abs(error_px) < sigma).mean()), float((np.abs(error_px) < 2 * sigma).mean())


def landmark_ratios(found: HeldOut, mirror: Sequence[int]) -> FloatArray:
    """(J,) by what each landmark's variance differs from the others' of the same spread, their product being one: the
    geometric mean of what its 68.3 and its 95.4 % quantile say, equal for twins, whose errors are each other's. One for
    landmarks that are hardly ever there.

    Args:
        found: (N, J) landmarks.
        mirror: (J,) each landmark's twin, itself where it has none.
    """
    alike = found.select(found.inside)
    spread = fit_spread(alike.error_px, alike.spread_px2, alike.visible, alike.seen)
    away = np.abs(found.error_px) / np.sqrt(variances(spread, found))[..., None]
    logarithms: dict[int, float] = {}
    for landmark, twin in enumerate(mirror):
        pair = [landmark, twin]
        errors = away[:, pair][found.inside[:, pair]]
        if len(errors) >= LEAST_OF_A_LANDMARK:
            one, two = np.quantile(errors, [WITHIN_ONE, WITHIN_TWO])
            logarithms[landmark] = np.log(one * two / 2)
    ratios = np.ones(len(mirror))
    ratios[list(logarithms)] = np.exp(np.array(list(logarithms.values())) - np.mean(list(logarithms.values()) or [0.0]))
    return ratios


def calibrated(
    once: HeldOut, mirrored: HeldOut, landmarks: slice, mirror: Sequence[int]
) -> tuple[dict[str, Any], dict[str, float]]:
    """The variance's calibration from one half of the crops and its coverage on the other, as metadata.

    Args:
        once, mirrored: the same crops, looked at once and mirrored too.
        landmarks: which of them.
        mirror: of each of those its twin, itself where it has none.
    """
    once, mirrored = (found.select((slice(None), landmarks)) for found in (once, mirrored))
    half = len(once.inside) // 2
    ratios = landmark_ratios(once.select(slice(half)), mirror)
    # Errors over the root of the ratios are as large as any landmark's: what follows need not know whose they are.
    once, mirrored = (found._replace(error_px=found.error_px / np.sqrt(ratios)[:, None]) for found in (once, mirrored))
    first, both = (found.select(slice(half)).select(found.inside[:half]) for found in (once, mirrored))
    spread = fit_mirrored(fit_spread(first.error_px, first.spread_px2, first.visible, first.seen), both)
    shares: dict[str, float] = {}
    for look, found in (("", once.select(slice(half, None))), ("_mirrored", mirrored.select(slice(half, None)))):
        variance = variances(spread, found, bool(look))
        shares |= shares_of(found.error_px, variance, found.inside, found.visible, look)
    metadata = {"scale": spread.scale, "floor_px2": spread.floor_px2, "knots": spread.knots}
    metadata |= {
        "hidden": spread.hidden,
        "mirrored": spread.mirrored,
        "landmarks": [round(float(r), 4) for r in ratios],
    }
    return metadata, shares


def shares_of(
    error_px: FloatArray, variance_px2: FloatArray, inside: BoolArray,
    visible: BoolArray, look: str,
) -> dict[str, float]:  # fmt: skip
    """Shares within one and two sigma, as a file's metadata has them: of all landmarks that are `inside` (N, J), of the
    `visible` (N, J) and of the hidden.

    Args:
        error_px: (N, J, 2).
        variance_px2: (N, J) of each coordinate.
        inside, visible: as of `HeldOut`.
        look: how they were looked at, the end of the shares' names.
    """
    shares: dict[str, float] = {}
    for name, group in (("", inside), ("_visible", visible), ("_hidden", inside & ~visible)):
        one, two = within(error_px[group], variance_px2[group])
        shares |= {f"one{name}{look}": round(one, 3), f"two{name}{look}": round(two, 3)}
    return shares


def _hidden(error_px: FloatArray, seen: FloatArray, parts: list[IndexArray]) -> float:
    """By what the variance grows from surely visible to surely hidden: the slope of the errors' logarithms within
    `parts` of about one spread each, which the few errors that are far off hardly turn."""
    size = np.log(np.abs(error_px) + np.sqrt(LEAST_FLOOR_PX2)).mean(axis=1)
    x = np.concatenate([seen[part].mean() - seen[part] for part in parts])
    y = np.concatenate([size[part] - size[part].mean() for part in parts])
    return float(np.clip(np.exp(2 * (x * y).sum() / max((x * x).sum(), 1e-9)), 1.0, 4.0))


def _groups(visible: BoolArray) -> list[Any]:
    """All landmarks, the visible ones (K,) and the hidden ones."""
    return [slice(None), *(group for group in (visible, ~visible) if group.any())]


def _farthest_off(error_px: FloatArray, variance_px2: FloatArray, groups: list[Any]) -> float:
    """By how much the share within one or two sigma is off in the group where it is most so."""
    shares = [within(error_px[group], variance_px2[group]) for group in groups]
    return max(max(abs(one - WITHIN_ONE), abs(two - WITHIN_TWO)) for one, two in shares)


def _pairs(a: FloatArray, b: FloatArray) -> tuple[tuple[float, float], ...]:
    """Pairs, without those whose first number does not ascend."""
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(a)) > 0])
    return tuple((float(x), float(y)) for x, y in zip(a[keep], b[keep], strict=True))


def _line(spread_px2: FloatArray, variance_px2: FloatArray) -> tuple[float, float]:
    """Scale and floor of the line nearest to the variances by their ratio, for readers that know no knots."""

    def cost(log_parameters: FloatArray) -> float:
        scale, floor = np.exp(log_parameters)
        return float(np.abs(np.log((scale * spread_px2 + floor) / variance_px2)).mean())

    scale, floor = np.exp(minimize(cost, np.log([0.5, 0.5]), method="Nelder-Mead").x)
    return float(scale), float(max(floor, LEAST_FLOOR_PX2))
