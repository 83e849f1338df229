"""From footage to the ONNX files of an adapted network."""

import json
import os
from dataclasses import asdict

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from muybridge.errors import ModelError, SessionError
from muybridge.files import replacing
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.metadata import KeypointModelCard
from muybridge.models.keypoints.network import PLATE, KeypointNet
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx
from muybridge.models.pseudo_labels import PseudoLabels, load_pseudo_labels
from muybridge.models.shipped import shipped_model
from muybridge.train.engine.malloc import keep_memory
from muybridge.train.keypoints.adapt import Agreement, View, measure_agreement, train_on_footage
from muybridge.train.keypoints.evaluate import load_model
from muybridge.train.keypoints.export import CALIBRATION_IMAGES, write_keypoints
from muybridge.train.keypoints.options import Adaptation

_MAX_DISAGREEMENT = 0.04  # share of the crop
# Least relative gain that counts: unfolding the normalisation changes the result by rounding.
_LEAST_GAIN = 0.002
# Metadata that no longer hold for the adapted network.
_OUTDATED = ("scores", "sigma_coverage", "marker_scores", "marker_sigma_coverage", "training_command")


def adapt(options: Adaptation, command: str) -> str:
    """Adapt a network and write `keypoints.onnx`, `keypoints-int8.onnx` and `adapt.json` into `options.out`.

    Args:
        options: of the adaptation.
        command: the command line, for the metadata.

    Returns:
        A summary.

    Raises:
        FormatError: the footage cannot be read.
        ModelError: training cannot continue from the network, or its landmarks differ from those of the footage.
        SessionError: the network agrees with the multi-view consensus no better than before, or so little that it
            cannot learn from it; nothing is written.
    """
    labels = load_pseudo_labels(options.footage)
    path = options.model or shipped_model("keypoints")
    _, card = load_model(path)
    net = keypoint_net_from_onnx(path)
    _check(labels, card, net, options)
    torch.set_num_threads(options.threads or os.cpu_count() or 1)
    keep_memory()
    view = View(labels, card.input_size, card.box_padding)
    before = measure_agreement(net, view)
    if before.median_px > _MAX_DISAGREEMENT * view.size:
        raise SessionError(
            f"{options.footage}: the multi-view consensus is {before.median_px:.0f} px of the network's crop away from "
            "what each camera sees (median), too far to be used as labels; see the report of `muybridge run` on the "
            "calibration"
        )
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=True, console=Console(stderr=True)) as progress:
        bar = progress.add_task(f"adapting to {len(labels.crops)} crops", total=1.0)
        student, images = train_on_footage(net, view, options, lambda share: progress.update(bar, completed=share))
    after = measure_agreement(student, view)
    if after.mean_px > (1 - _LEAST_GAIN) * before.mean_px:
        raise SessionError(
            f"{options.footage}: the network agrees with the multi-view consensus no better than before "
            f"({_change(before, after)}): use it unadapted, or allow more --minutes"
        )
    _write(student, view, card, options, {
        "command": command, "images": images, "minutes": options.minutes, "steps": options.steps,
        "crops": int((~labels.held_out).sum()),
        "held_out_crops": int(labels.held_out.sum()), "before": asdict(before), "after": asdict(after),
        **labels.facts,
    })  # fmt: skip
    return f"adapted in {images:,} images: {_change(before, after)}; wrote {options.out / 'keypoints.onnx'}"


def _check(labels: PseudoLabels, card: KeypointModelCard, net: KeypointNet, options: Adaptation) -> None:
    landmarks, there = int(net.config["landmarks"]), labels.landmarks_px.shape[1]
    if card.landmarks != BODY23 or there not in (landmarks, len(BODY23)):
        raise ModelError(f"{options.model}: has {landmarks} landmarks, {options.footage} has {there}: make that again")
    if labels.crops.shape[1] < card.input_size:
        raise ModelError(f"{options.footage}: its crops are smaller than the network's; make it again")


def _change(before: Agreement, after: Agreement) -> str:
    return (
        f"in held-out frames, the mean distance of landmarks to the multi-view consensus was {before.mean_px:.1f} px "
        f"(median {before.median_px:.1f}) before and {after.mean_px:.1f} px (median {after.median_px:.1f}) after"
    )


def _write(
    net: KeypointNet, view: View, card: KeypointModelCard, options: Adaptation, facts: dict[str, object]
) -> None:
    metadata = {k: v for k, v in card.metadata.items() if k not in _OUTDATED} | {
        "version": f"{card.version}, adapted", "adapted": json.dumps(facts),
        "plate_input": PLATE,
        "licence": f"{card.metadata.get('licence', '')}; then adapted to a user's unlabelled footage",
    }  # fmt: skip
    crops = len(view.labels.crops)
    some = np.linspace(0, crops - 1, min(CALIBRATION_IMAGES, crops)).astype(int)
    write_keypoints(net, options.out / "keypoints.onnx", metadata, view.plain(some)[0])
    with replacing(options.out / "adapt.json") as temporary:
        temporary.write_text(json.dumps(facts, indent=1), encoding="utf-8")
