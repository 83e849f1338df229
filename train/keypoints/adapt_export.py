"""From footage to the ONNX files of a network that is used to it."""

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
from muybridge.train.keypoints.adapt import Agreement, View, adapted, agreement
from muybridge.train.keypoints.evaluate import load_model
from muybridge.train.keypoints.export import CALIBRATION_IMAGES, write_keypoints
from muybridge.train.options import Adaptation

_BEYOND_BELIEF = 0.04  # of the crop
# What it has to come nearer for it to have learned anything: unfolding its normalisation alone changes it by rounding.
_LEAST_GAIN = 0.002
# What was measured of the network before says nothing of it now.
_OUTDATED = ("scores", "sigma_coverage", "marker_scores", "marker_sigma_coverage", "training_command")


def adapt(options: Adaptation, command: str) -> str:
    """Trains and writes `keypoints.onnx`, `keypoints-int8.onnx` and `adapt.json` into `options.out`; says what came
    of it.

    Raises:
        FormatError: the footage is none.
        ModelError: the network is not one that training can go on from, or knows other landmarks than the footage.
        SessionError: the network agrees with all cameras no better than before, or so little that they cannot teach
            it; nothing is written.
    """
    footage = load_pseudo_labels(options.footage)
    path = options.model or shipped_model("keypoints")
    _, card = load_model(path)
    net = keypoint_net_from_onnx(path)
    _check(footage, card, net, options)
    torch.set_num_threads(options.threads or os.cpu_count() or 1)
    keep_memory()
    view = View(footage, card.input_size, card.box_padding)
    before = agreement(net, view)
    if before.median_px > _BEYOND_BELIEF * view.size:
        raise SessionError(
            f"{options.footage}: what all cameras agree on lies {before.median_px:.0f} px of the network's crop from "
            "what each of them sees (median): that is no label to learn from; see what `muybridge run` says of the rig"
        )
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=True, console=Console(stderr=True)) as progress:
        bar = progress.add_task(f"adapting to {len(footage.crops)} crops", total=1.0)
        student, images = adapted(net, view, options, lambda share: progress.update(bar, completed=share))
    after = agreement(student, view)
    if after.mean_px > (1 - _LEAST_GAIN) * before.mean_px:
        raise SessionError(
            f"{options.footage}: the network comes no nearer to what all cameras agree on than before "
            f"({_change(before, after)}): use it as it was, or give it more --minutes"
        )
    _write(student, view, card, options, {
        "command": command, "images": images, "minutes": options.minutes, "crops": int((~footage.held_out).sum()),
        "held_out_crops": int(footage.held_out.sum()), "before": asdict(before), "after": asdict(after),
        **footage.facts,
    })  # fmt: skip
    return f"adapted in {images:,} images: {_change(before, after)}; wrote {options.out / 'keypoints.onnx'}"


def _check(footage: PseudoLabels, card: KeypointModelCard, net: KeypointNet, options: Adaptation) -> None:
    landmarks, there = int(net.config["landmarks"]), footage.landmarks_px.shape[1]
    if card.landmarks != BODY23 or there not in (landmarks, len(BODY23)):
        raise ModelError(f"{options.model}: knows {landmarks} landmarks, {options.footage} has {there}: make it again")
    if footage.crops.shape[1] < card.input_size:
        raise ModelError(f"{options.footage}: its crops are smaller than the network's; make it again")


def _change(before: Agreement, after: Agreement) -> str:
    return (
        f"in frames kept apart, landmarks lie {before.mean_px:.1f} px of the network's crop (median "
        f"{before.median_px:.1f}) from what all cameras agree on before, {after.mean_px:.1f} (median "
        f"{after.median_px:.1f}) after"
    )


def _write(
    net: KeypointNet, view: View, card: KeypointModelCard, options: Adaptation, facts: dict[str, object]
) -> None:
    metadata = {k: v for k, v in card.metadata.items() if k not in _OUTDATED} | {
        "version": f"{card.version}, adapted", "adapted": json.dumps(facts),
        "plate_input": PLATE,
        "licence": f"{card.metadata.get('licence', '')}; then adapted to footage of the user's, without labels",
    }  # fmt: skip
    crops = len(view.footage.crops)
    some = np.linspace(0, crops - 1, min(CALIBRATION_IMAGES, crops)).astype(int)
    write_keypoints(net, options.out / "keypoints.onnx", metadata, view.plain(some)[0])
    with replacing(options.out / "adapt.json") as temporary:
        temporary.write_text(json.dumps(facts, indent=1), encoding="utf-8")
