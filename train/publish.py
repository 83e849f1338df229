"""From a checkpoint to the ONNX file that ships: averaged weights, calibrated variance, metadata, scores."""

import datetime
import pathlib
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import nn

import muybridge
from muybridge.errors import ModelError
from muybridge.geometry.crops import BOX_PADDING
from muybridge.geometry.landmarks import BODY23, SURFACE
from muybridge.models.decode import SpreadCalibration, decode_heatmaps
from muybridge.models.export import export_onnx
from muybridge.models.keypoint_net import CHANNELS, MEAN, PLATE, STD, STRIDE, KeypointNet, PlateApart, SeparateHeads
from muybridge.models.people_net import STRIDE as PEOPLE_STRIDE
from muybridge.models.people_net import PeopleNet
from muybridge.models.quantize import int8_path, quantize
from muybridge.train.augment import Batch

# No landmark is known better than this, network pixels squared: a tenth of a pixel.
LEAST_FLOOR_PX2 = 0.01
# Shares of a Gaussian's values within one and two sigma, and the most knots of the map that is to give them.
WITHIN_ONE, WITHIN_TWO, KNOTS = 0.6827, 0.9545, 16
# Images on which the ranges of the 8-bit network's activations are measured.
CALIBRATION_IMAGES = 128
LICENCE = "Apache-2.0; trained on synthetic people alone (anny: code Apache-2.0, body data CC0)"
NORMALISATION = (
    f"RGB and difference to the background plate in 0..1; mean {MEAN} and standard deviation {STD} are applied inside "
    "the graph"
)
PEOPLE_LONG_SIDE = 320


def load_checkpoint(path: pathlib.Path) -> dict[str, Any]:
    """A checkpoint of `train.loop`; ModelError where it is none."""
    try:
        saved: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=False)
        saved["average"], saved["config"], saved["state"]
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such checkpoint; train first with `muybridge train`") from error
    except Exception as error:
        raise ModelError(f"{path}: not a training checkpoint of muybridge ({error}); train anew") from error
    return saved


def keypoint_net(saved: dict[str, Any]) -> KeypointNet:
    """The averaged network of a checkpoint."""
    net = KeypointNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()


def people_net(saved: dict[str, Any]) -> PeopleNet:
    """The averaged network of a checkpoint."""
    net = PeopleNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()


class HeldOut(NamedTuple):
    """How landmarks of held-out crops were found: N crops, J landmarks.

    Attributes:
        error_px: (N, J, 2), NaN where the truth is unknown.
        spread_px2: (N, J) of the heatmaps.
        inside: (N, J) the landmark is known and lies inside of the crop.
        visible: (N, J) and is not hidden.
    """

    error_px: NDArray[np.float64]
    spread_px2: NDArray[np.float64]
    inside: NDArray[np.bool_]
    visible: NDArray[np.bool_]

    def select(self, crops: slice, landmarks: slice) -> "HeldOut":
        """Some of the crops and landmarks."""
        at = (crops, landmarks)
        return HeldOut(self.error_px[at], self.spread_px2[at], self.inside[at], self.visible[at])


def held_out(net: KeypointNet, batches: list[Batch]) -> HeldOut:
    """All that the network finds in crops, body first, then markers, in crop pixels, as decoded in use."""
    parts = []
    twins = np.arange(net.visibility.out_features)  # of markers none are told apart
    twins[: len(BODY23)] = BODY23.mirror
    for batch in batches:
        with torch.inference_mode():
            heatmaps, _ = net(batch.pixels.float().div(255))
        decoded = decode_heatmaps(heatmaps.numpy(), STRIDE, SpreadCalibration(1.0, 1e-12), twins)
        at = np.concatenate([batch.landmarks_px, batch.markers_px], 1)[:, : heatmaps.shape[1]]
        seen = np.concatenate([batch.visible, batch.markers_visible], 1)[:, : heatmaps.shape[1]]
        inside = ((at >= 0) & (at < batch.image.shape[-1])).all(-1)
        parts.append((decoded.points_crop_px - at, decoded.variance_crop_px2, inside, seen & inside))
    return HeldOut(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def fit_spread(
    error_px: NDArray[np.float64], spread_px2: NDArray[np.float64], visible: NDArray[np.bool_] | None = None
) -> SpreadCalibration:
    """The map from spread to variance under which one and two sigma hold their share of held-out errors.

    "Within n sigma" is meant a coordinate: |x error| < n sigma and |y error| < n sigma count one each, and a
    Gaussian has 68.3 and 95.4 % of them. Errors are no Gaussian given the spread, though: most landmarks are near
    and a few lie on the other hypothesis, so that a sigma from the 68.3 % quantile is too small for 95.4 % and one
    from half of the 95.4 % quantile too large for 68.3 %. In every range of spreads the variance lies between the
    two, by one weight for all, with which no share is farther off than need be, neither of all landmarks nor of
    the visible ones.

    Args:
        error_px: (K, 2).
        spread_px2: (K,).
        visible: (K,) which of them are not hidden; without, only all together are looked at.
    """
    groups: list[Any] = [slice(None)] if visible is None or not visible.any() else [slice(None), visible]
    order = np.argsort(spread_px2)
    count = max(1, min(KNOTS, len(order) // 50))
    parts = np.array_split(order, count)
    at = np.array([np.exp(np.log(np.maximum(spread_px2[part], LEAST_FLOOR_PX2)).mean()) for part in parts])
    error = np.abs(error_px)
    one = np.array([np.quantile(error[part], WITHIN_ONE) for part in parts])
    two = np.array([np.quantile(error[part], WITHIN_TWO) / 2 for part in parts])

    def calibration(weight: float) -> SpreadCalibration:
        variance = np.maximum(one ** (2 - 2 * weight) * two ** (2 * weight), LEAST_FLOOR_PX2)
        variance = np.maximum.accumulate(variance)
        scale, floor = _line(spread_px2, SpreadCalibration(knots=_pairs(at, variance)).variance(spread_px2))
        return SpreadCalibration(scale, floor, _pairs(at, variance))

    def worse(weight: float) -> float:
        fitted = calibration(weight)
        within = [sigma_coverage(error_px[group], spread_px2[group], fitted) for group in groups]
        return max(max(abs(one - WITHIN_ONE), abs(two - WITHIN_TWO)) for one, two in within)

    weights = np.linspace(0.0, 1.0, 21)
    return calibration(float(weights[np.argmin([worse(w) for w in weights])]))


def _pairs(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    """Pairs, without those whose first number does not ascend."""
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(a)) > 0])
    return tuple((float(x), float(y)) for x, y in zip(a[keep], b[keep], strict=True))


def _line(spread_px2: NDArray[np.float64], variance_px2: NDArray[np.float64]) -> tuple[float, float]:
    """Scale and floor of the line nearest to the variances by their ratio, for readers that know no knots."""

    def cost(log_parameters: NDArray[np.float64]) -> float:
        scale, floor = np.exp(log_parameters)
        return float(np.abs(np.log((scale * spread_px2 + floor) / variance_px2)).mean())

    scale, floor = np.exp(minimize(cost, np.log([0.5, 0.5]), method="Nelder-Mead").x)
    return float(scale), float(max(floor, LEAST_FLOOR_PX2))


def sigma_coverage(
    error_px: NDArray[np.float64], spread_px2: NDArray[np.float64], spread: SpreadCalibration
) -> tuple[float, float]:
    """Shares of the coordinates within one and two sigma; a calibrated Gaussian has 0.683 and 0.954."""
    sigma = np.sqrt(spread.variance(spread_px2))[:, None]
    return float((np.abs(error_px) < sigma).mean()), float((np.abs(error_px) < 2 * sigma).mean())


def _common(saved: dict[str, Any], kind: str, command: str) -> dict[str, Any]:
    state = saved["state"]
    return {
        "muybridge_kind": kind,
        "version": f"{muybridge.__version__}+{datetime.date.today().isoformat()}",
        "training_command": command,
        "training": {"images": state["images"], "minutes": round(state["seconds"] / 60, 1)},
        "seed": str(saved["options"]["seed"]),
        "scores": {k: round(v, 4) for k, v in saved["scores"].items()},
        "licence": LICENCE,
    }


def publish_keypoints(
    checkpoint: pathlib.Path, path: pathlib.Path, batches: list[Batch], command: str
) -> dict[str, Any]:
    """Writes the keypoint network of `checkpoint` to `path` and its 8-bit version beside it; returns its metadata.
    `batches` are held-out crops: the variance is fitted on one half and its coverage measured on the other, and
    the 8-bit version's ranges are measured on the first of them."""
    saved = load_checkpoint(checkpoint)
    net = keypoint_net(saved)
    found, body = held_out(net, batches), len(BODY23)
    size = batches[0].image.shape[-1]
    variance, within = _calibrated(found, slice(body))
    metadata = _common(saved, "keypoints", command) | {
        "precision": "fp32", "landmark_set": BODY23.name, "names": list(BODY23.names),
        "input_size": str(size), "stride": str(STRIDE),
        "normalisation": NORMALISATION, "box_padding": str(BOX_PADDING),
        "variance": variance, "sigma_coverage": within,
        "plate_input": PLATE,
    }  # fmt: skip
    outputs = ["heatmaps", "visibility"]
    exported: nn.Module = net
    if found.error_px.shape[1] > body and found.inside[:, body:].any():
        variance, within = _calibrated(found, slice(body, None))
        metadata |= {
            "marker_names": list(SURFACE.names), "marker_variance": variance, "marker_sigma_coverage": within,
            "marker_scores": marker_scores(found.select(slice(None), slice(body, None))),
        }  # fmt: skip
        outputs += ["marker_heatmaps", "marker_visibility"]
        exported = SeparateHeads(net, body).eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    export_onnx(PlateApart(exported), path, (2, 3, size, size), tuple(outputs), metadata, PLATE)
    images = np.concatenate([batch.pixels.numpy() for batch in batches])
    quantize(path, int8_path(path), images[:CALIBRATION_IMAGES])
    return metadata


def _calibrated(found: HeldOut, landmarks: slice) -> tuple[dict[str, Any], dict[str, float]]:
    """The variance's calibration from one half of the crops and its coverage on the other, as metadata."""
    half = len(found.inside) // 2
    fit, test = found.select(slice(half), landmarks), found.select(slice(half, None), landmarks)
    spread = fit_spread(fit.error_px[fit.inside], fit.spread_px2[fit.inside], fit.visible[fit.inside])
    within: dict[str, float] = {}
    for name, chosen in (("", test.inside), ("_visible", test.visible)):
        one, two = sigma_coverage(test.error_px[chosen], test.spread_px2[chosen], spread)
        within |= {f"one{name}": round(one, 3), f"two{name}": round(two, 3)}
    return {"scale": spread.scale, "floor_px2": spread.floor_px2, "knots": spread.knots}, within


def marker_scores(found: HeldOut) -> dict[str, float]:
    """Median error of the visible markers in crop pixels and the share within ten."""
    distance = np.linalg.norm(found.error_px, axis=-1)[found.visible]
    return {"median_px": round(float(np.median(distance)), 3), "within_10px": round(float((distance < 10).mean()), 4)}


def publish_people(checkpoint: pathlib.Path, path: pathlib.Path, command: str) -> dict[str, Any]:
    """Writes the person detector of `checkpoint` to `path`; returns its metadata."""
    saved = load_checkpoint(checkpoint)
    metadata = _common(saved, "people", command) | {
        "input_long_side": str(PEOPLE_LONG_SIDE), "stride": str(PEOPLE_STRIDE), "normalisation": NORMALISATION,
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    export_onnx(people_net(saved), path, (2, CHANNELS, 192, 320), ("heatmap", "box"), metadata)
    return metadata
