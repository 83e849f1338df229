"""Crops of real people labelled by multi-view consensus: what inference hands to training."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, Float32Array
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.npz import LIMIT, load_npz

_FORMAT = 2


class PseudoLabels(NamedTuple):
    """`N` crops of the people of one take.

    Attributes:
        crops: (N, S, S, 4) uint8 RGB and the difference to the background model, zero where there is none.
        landmarks_px: (N, J, 2) crop px of the body's landmarks, then of the virtual markers; NaN without a label.
        agreed: (N, J) whether this camera's own detection agrees with the label.
        held_out: (N,) crops that are not trained on.
        padding: side of a crop relative to the longer side of the person's bounding box.
        facts: provenance.
    """

    crops: ByteArray
    landmarks_px: Float32Array
    agreed: BoolArray
    held_out: BoolArray
    padding: float
    facts: Mapping[str, Any]


def save_pseudo_labels(path: Path, labels: PseudoLabels) -> None:
    """Write a `.npz`; it appears only when it is complete."""
    facts = {"format": _FORMAT, "padding": labels.padding, "facts": dict(labels.facts)}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file, crops=labels.crops, landmarks_px=labels.landmarks_px, agreed=labels.agreed,
            held_out=labels.held_out, about=json.dumps(facts),
        )  # fmt: skip


def load_pseudo_labels(path: Path) -> PseudoLabels:
    """Read what `save_pseudo_labels` wrote.

    Raises:
        FormatError: the file is missing, damaged, or something else.
    """
    try:
        if not path.is_file():
            raise FormatError(f"{path}: no such file", remedy="pseudo_labels")
        stored = load_npz(path, what="a file of pseudo-labels", limit=LIMIT)
        arrays = {name: stored[name] for name in ("crops", "landmarks_px", "agreed", "held_out")}
        about = json.loads(str(stored["about"]))
        crops, landmarks, agreed, held_out = arrays.values()
        count, joints = len(crops), landmarks.shape[1]
        shapes = (landmarks.shape, agreed.shape, held_out.shape) == ((count, joints, 2), (count, joints), (count,))
        if about["format"] != _FORMAT or crops.dtype != np.uint8 or crops.shape[1:] != (*crops.shape[1:2] * 2, 4):
            raise ValueError("of another version")
        if not shapes or not count:
            raise ValueError("its arrays do not fit together")
        return PseudoLabels(crops, landmarks, agreed, held_out, float(about["padding"]), about["facts"])
    except FormatError:
        raise
    except Exception as error:  # whatever may be in it instead
        reason = " ".join(str(error).split())[:200]
        raise FormatError(
            f"{path}: not a file of pseudo-labels, or a damaged one ({reason})", remedy="pseudo_labels"
        ) from error
