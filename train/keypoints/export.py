"""From a checkpoint to the shipped ONNX file: averaged weights, calibrated variance, metadata and scores."""

import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from muybridge.arrays import ByteArray
from muybridge.errors import ModelError
from muybridge.geometry.cameras.crops import BOX_PADDING
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.metadata import BODY_OUTPUTS, MARKER_OUTPUTS
from muybridge.models.keypoints.network import PLATE, STRIDE, KeypointNet, PlateApart, SeparateHeads
from muybridge.models.onnx_files.export import export_onnx
from muybridge.models.onnx_files.quantization import int8_path, quantize
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import IMAGES, training_metadata
from muybridge.train.images.compositor import Batch
from muybridge.train.keypoints.variance_calibration import HeldOut, calibrate, read_held_out, reader_of

# Number of images on which the 8-bit network's activation ranges are measured.
CALIBRATION_IMAGES = 128


def load_keypoint_checkpoint(path: pathlib.Path) -> dict[str, Any]:
    """A checkpoint of this version's keypoint network.

    Raises:
        ModelError: it is missing, damaged, or of an earlier version's network.
    """
    saved = load_checkpoint(path)
    if "landmarks" in saved["config"] and "hidden" not in saved["config"]:
        raise ModelError(
            f"{path}: of an earlier version's network, which normalised its images; continue training from its ONNX "
            "file, with --model FILE.onnx and another --out"
        )
    return saved


def keypoint_net(saved: dict[str, Any]) -> KeypointNet:
    """The averaged network of a checkpoint."""
    net = KeypointNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()


def publish_keypoints(
    checkpoint: pathlib.Path, path: pathlib.Path, batches: list[Batch], command: str
) -> dict[str, Any]:
    """Write the keypoint network of a checkpoint, and its 8-bit version beside it.

    Args:
        checkpoint: of the training.
        path: of the fp32 ONNX file.
        batches: held-out crops. The variance is fitted on one half of them and its coverage measured on the other; the
            8-bit version's activation ranges are measured on the first ones.
        command: the command line that trained the network.

    Returns:
        The file's metadata.
    """
    saved = load_keypoint_checkpoint(checkpoint)
    net = keypoint_net(saved)
    measured = calibration(*read_held_out(reader_of(net), batches))
    size = batches[0].image.shape[-1]
    metadata = training_metadata(saved, "keypoints", command) | {
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
    """Write a network's file, and its 8-bit version beside it, with separate outputs for body and markers if it has
    both.

    Args:
        net: the network.
        path: of the fp32 ONNX file.
        metadata: of the file; it has `marker_names` if the network detects markers.
        images: (N, 4, S, S) of the size that the file is for, to measure the 8-bit version's activation ranges.
    """
    marked = "marker_names" in metadata
    exported = SeparateHeads(net, len(BODY23)).eval() if marked else net
    path.parent.mkdir(parents=True, exist_ok=True)
    outputs = BODY_OUTPUTS + MARKER_OUTPUTS if marked else BODY_OUTPUTS
    export_onnx(PlateApart(exported), path, (2, 3, *images.shape[2:]), outputs, metadata, PLATE)
    quantize(path, int8_path(path), images)


def calibration(once: HeldOut, mirrored: HeldOut) -> dict[str, Any]:
    """Metadata about a keypoint network's variances, and about its markers if the crops have any.

    Args:
        once: landmarks detected in held-out crops, each read once.
        mirrored: the same, each averaged with its mirrored crop.
    """
    body = len(BODY23)
    variance, coverage = calibrate(once, mirrored, slice(body), BODY23.mirror)
    metadata: dict[str, Any] = {"variance": variance, "sigma_coverage": coverage}
    if once.inside[:, body:].any():
        variance, coverage = calibrate(once, mirrored, slice(body, None), SURFACE.mirror)
        metadata |= {"marker_variance": variance, "marker_sigma_coverage": coverage}
        metadata["marker_scores"] = marker_scores(once.select((slice(None), slice(body, None))))
    return metadata


def marker_scores(found: HeldOut) -> dict[str, float]:
    """Median error of the visible markers in crop pixels, and the share within ten pixels."""
    distance = np.linalg.norm(found.error_px, axis=-1)[found.visible]
    return {"median_px": round(float(np.median(distance)), 3), "within_10px": round(float((distance < 10).mean()), 4)}
