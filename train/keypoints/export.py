"""From a checkpoint to the ONNX file that ships: averaged weights, calibrated variance, metadata, scores."""

import datetime
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.arrays import ByteArray
from muybridge.errors import ModelError
from muybridge.geometry.cameras.crops import BOX_PADDING
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.metadata import BODY_OUTPUTS, MARKER_OUTPUTS
from muybridge.models.keypoints.network import CHANNELS, PLATE, STRIDE, KeypointNet, PlateApart, SeparateHeads
from muybridge.models.onnx_files.export import export_onnx
from muybridge.models.onnx_files.quantization import int8_path, quantize
from muybridge.models.people.network import MEAN, STD, PeopleNet
from muybridge.models.people.network import STRIDE as PEOPLE_STRIDE
from muybridge.train.images.compositor import Batch
from muybridge.train.keypoints.variance_calibration import HeldOut, calibrated, held_out, look_of

# Images on which the ranges of the 8-bit network's activations are measured.
CALIBRATION_IMAGES = 128
LICENCE = "Apache-2.0; trained on synthetic people alone (anny: code Apache-2.0, body data CC0)"
IMAGES = "RGB and difference to the background plate in 0..1"
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
    if "landmarks" in saved["config"] and "hidden" not in saved["config"]:
        raise ModelError(
            f"{path}: of an earlier version's network, which normalised its images; train on from its ONNX file, with "
            "--model FILE.onnx and another --out"
        )
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


def _common(saved: dict[str, Any], kind: str, command: str) -> dict[str, Any]:
    state = saved["state"]
    return {
        "muybridge_kind": kind,
        "version": version(),
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
    measured = calibration(*held_out(look_of(net), batches))
    size = batches[0].image.shape[-1]
    metadata = _common(saved, "keypoints", command) | {
        "precision": "fp32", "landmark_set": BODY23.name, "names": list(BODY23.names),
        "input_size": str(size), "stride": str(STRIDE),
        "normalisation": IMAGES, "box_padding": str(BOX_PADDING),
        "plate_input": PLATE,
    } | measured  # fmt: skip
    if "marker_variance" in measured:
        metadata["marker_names"] = list(SURFACE.names)
    images = np.concatenate([batch.pixels.numpy() for batch in batches])
    write_keypoints(net, path, metadata, images[:CALIBRATION_IMAGES])
    return metadata


def write_keypoints(net: KeypointNet, path: pathlib.Path, metadata: Mapping[str, Any], images: ByteArray) -> None:
    """The network's file and its 8-bit version beside it, body and markers apart where `metadata` names markers; the
    ranges of the 8 bits are measured on `images` (N, 4, S, S), of the size that the file is for."""
    marked = "marker_names" in metadata
    exported = SeparateHeads(net, len(BODY23)).eval() if marked else net
    path.parent.mkdir(parents=True, exist_ok=True)
    outputs = BODY_OUTPUTS + MARKER_OUTPUTS if marked else BODY_OUTPUTS
    export_onnx(PlateApart(exported), path, (2, 3, *images.shape[2:]), outputs, metadata, PLATE)
    quantize(path, int8_path(path), images)


def calibration(once: HeldOut, mirrored: HeldOut) -> dict[str, Any]:
    """What a keypoint network's file says of its variances, and of its markers where there are any in the crops, which
    were looked at once and mirrored too."""
    body = len(BODY23)
    variance, coverage = calibrated(once, mirrored, slice(body), BODY23.mirror)
    metadata: dict[str, Any] = {"variance": variance, "sigma_coverage": coverage}
    if once.inside[:, body:].any():
        variance, coverage = calibrated(once, mirrored, slice(body, None), SURFACE.mirror)
        metadata |= {"marker_variance": variance, "marker_sigma_coverage": coverage}
        metadata["marker_scores"] = marker_scores(once.select((slice(None), slice(body, None))))
    return metadata


def version() -> str:
    """Of weights that are published today."""
    return f"{muybridge.__version__}+{datetime.date.today().isoformat()}"


def marker_scores(found: HeldOut) -> dict[str, float]:
    """Median error of the visible markers in crop pixels and the share within ten."""
    distance = np.linalg.norm(found.error_px, axis=-1)[found.visible]
    return {"median_px": round(float(np.median(distance)), 3), "within_10px": round(float((distance < 10).mean()), 4)}


def publish_people(checkpoint: pathlib.Path, path: pathlib.Path, command: str) -> dict[str, Any]:
    """Writes the person detector of `checkpoint` to `path`; returns its metadata."""
    saved = load_checkpoint(checkpoint)
    metadata = _common(saved, "people", command) | {
        "input_long_side": str(PEOPLE_LONG_SIDE), "stride": str(PEOPLE_STRIDE),
        "normalisation": f"{IMAGES}; mean {MEAN} and standard deviation {STD} are applied inside the graph",
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    export_onnx(people_net(saved), path, (2, CHANNELS, 192, 320), ("heatmap", "box"), metadata)
    return metadata
