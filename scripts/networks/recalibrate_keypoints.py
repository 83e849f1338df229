"""Recalibrate an exported keypoint network, optionally for crops of another size; its weights do not change.

Usage: python -m scripts.networks.recalibrate_keypoints NETWORK.onnx RENDERS [--crops 2048] [--size PX]

As at the end of `muybridge train keypoints`, variances are fitted on one half of the held-out crops of RENDERS, some of
them with a background model, their coverage is measured on the other half, the 8-bit version beside NETWORK.onnx is
made again, and scores are computed. In addition, the ratio for crops averaged with their mirror image is fitted with
the complete test-time augmentation of `muybridge run` (smaller, rotated and tilted crops), which needs an exported
file; and then, on as many crops of parts of people, the ratio for those: each on both halves, measured on the other.
"""

import argparse
import json
import pathlib
from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import onnxruntime
from rich.progress import track

from muybridge.arrays import Float32Array
from muybridge.files import replacing
from muybridge.models.keypoints.decode import in_part
from muybridge.models.keypoints.metadata import BODY_OUTPUTS, MARKER_OUTPUTS, KeypointModelCard, keypoint_card
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx
from muybridge.models.onnx_files.quantization import int8_path, quantize
from muybridge.train.engine.export import dated_version
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.images.dataset import HELD_OUT
from muybridge.train.images.options import WHOLE
from muybridge.train.keypoints.evaluate import load_model, read_batch
from muybridge.train.keypoints.export import CALIBRATION_IMAGES, calibration
from muybridge.train.keypoints.train import evaluate
from muybridge.train.keypoints.variance_calibration import (
    LEAST_LANDMARKS,
    Reader,
    coverage,
    fit_ratio,
    read_held_out,
)
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.store import load_renders

# Seed of the crops and their backgrounds, different from any training's and evaluation's.
SEED = 20_000


def reader_of(session: onnxruntime.InferenceSession, card: KeypointModelCard) -> Reader:
    """A network's session as a function: body first, then markers."""
    outputs = BODY_OUTPUTS if card.markers is None else BODY_OUTPUTS + MARKER_OUTPUTS

    def look(crops: Float32Array) -> tuple[Float32Array, Float32Array]:
        found = session.run(outputs, card.inputs(crops))
        return np.concatenate(found[::2], 1), np.concatenate(found[1::2], 1)

    return look


def as_read(
    session: onnxruntime.InferenceSession, card: KeypointModelCard, batches: list[Batch], partly: bool, look: str
) -> tuple[float, dict[str, float]]:
    """Factor on a network's variances for crops read as in `muybridge run`, and the resulting coverage, as in
    `sigma_coverage`.

    It is fitted on either half of the crops and measured on the other, and the mean of both is used, since a few
    tumbling people have much weight in one half. One, and no coverage, if there are too few crops.

    Args:
        session, card: the network.
        batches: of crops.
        partly: use only crops that the network takes for parts of people.
        look: suffix of the names of the shares.
    """
    parts = []
    for batch in track(batches, "reading as `run` does", transient=True):
        found, error, inside = read_batch(session, card, batch, flip=True, turn=True)
        counts = in_part(found.score) if partly else np.ones(len(error), dtype=bool)
        values = (error, found.variance_crop_px2, inside, batch.visible.numpy())
        parts.append([each[counts] for each in values])
    whole = [np.concatenate(values) for values in zip(*parts, strict=True)]
    half = len(whole[0]) // 2
    halves = [[values[part] for values in whole] for part in (slice(half), slice(half, None))]
    if min(inside.sum() for _, _, inside, _ in halves) < LEAST_LANDMARKS:
        return 1.0, {}
    ratios = [fit_ratio(error[at], variance[at], visible[at]) for error, variance, at, visible in halves]
    measured = [
        coverage(error, ratio * variance, inside, visible, look)
        for ratio, (error, variance, inside, visible) in zip(ratios[::-1], halves, strict=True)
    ]
    shares = {name: round(float(np.mean([each[name] for each in measured])), 3) for name in measured[0]}
    return float(np.sqrt(np.prod(ratios))), shares


def text(new: dict[str, Any]) -> dict[str, str]:
    """The form of metadata in a file."""
    return {key: value if isinstance(value, str) else json.dumps(value) for key, value in new.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=pathlib.Path)
    parser.add_argument("renders", type=pathlib.Path)
    parser.add_argument("--crops", type=int, default=2048)
    parser.add_argument("--size", type=int)
    options = parser.parse_args()
    path: pathlib.Path = options.network
    session, card = load_model(path)
    size = options.size or card.input_size
    people, backgrounds = load_renders(options.renders, HELD_OUT), make_backgrounds(256, SIZE, SEED)
    compositor, near = (Compositor(people, backgrounds, size, SEED, replace(WHOLE, close_up=c)) for c in (0.0, 1.0))
    batches = [compositor.batch(64) for _ in range(-(-options.crops // 64))]
    close_ups = [near.batch(64) for _ in batches]
    scores = evaluate(keypoint_net_from_onnx(path), batches[:8])
    measured = calibration(*read_held_out(reader_of(session, card), batches))
    new = {"input_size": str(size), "version": dated_version(), **measured}
    new["scores"] = {key: round(value, 4) for key, value in scores.items()}
    model = onnx.load(str(path))
    metadata = {entry.key: entry.value for entry in model.metadata_props} | text(new)
    for key, crops in (("mirrored", batches), ("part", close_ups)):
        card = keypoint_card(metadata | text(new), path)
        ratio, shares = as_read(session, card, crops, key == "part", f"_{key}")
        new["variance"][key] = ratio * new["variance"].get(key, 1.0)
        new["sigma_coverage"] |= shares
    onnx.helper.set_model_props(model, metadata | text(new))
    with replacing(path) as temporary:
        onnx.save(model, str(temporary))
    images = np.concatenate([batch.pixels.numpy() for batch in batches[:2]])
    quantize(path, int8_path(path), images[:CALIBRATION_IMAGES])
    print(json.dumps({key: value for key, value in new.items() if key[-8:] != "variance"}, indent=1))


if __name__ == "__main__":
    main()
