"""Crops of real people with where their landmarks are according to all cameras: what inference hands to training."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, Float32Array
from muybridge.errors import FormatError
from muybridge.files import replacing

_FORMAT = 2


class PseudoLabels(NamedTuple):
    """`N` crops of the people of one take.

    Attributes:
        crops: (N, S, S, 4) uint8 RGB and the difference to the background plate, zero where there is none.
        landmarks_px: (N, J, 2) crop px of the body's landmarks, then of the virtual markers; NaN without a label.
        agreed: (N, J) whether what this camera's own network said agrees with the label.
        held_out: (N,) crops that are kept from training.
        padding: side of a crop over the longer side of the person's box.
        facts: where it comes from.
    """

    crops: ByteArray
    landmarks_px: Float32Array
    agreed: BoolArray
    held_out: BoolArray
    padding: float
    facts: Mapping[str, Any]


def save_pseudo_labels(path: Path, footage: PseudoLabels) -> None:
    """Write a `.npz`, whole or not at all."""
    facts = {"format": _FORMAT, "padding": footage.padding, "facts": dict(footage.facts)}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file, crops=footage.crops, landmarks_px=footage.landmarks_px, agreed=footage.agreed,
            held_out=footage.held_out, about=json.dumps(facts),
        )  # fmt: skip


def load_pseudo_labels(path: Path) -> PseudoLabels:
    """Read what `save_pseudo_labels` wrote.

    Raises:
        FormatError: the file is missing, damaged, or something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in ("crops", "landmarks_px", "agreed", "held_out")}
            about = json.loads(str(file["about"]))
        crops, landmarks, agreed, held_out = arrays.values()
        count, joints = len(crops), landmarks.shape[1]
        shapes = (landmarks.shape, agreed.shape, held_out.shape) == ((count, joints, 2), (count, joints), (count,))
        if about["format"] != _FORMAT or crops.dtype != np.uint8 or crops.shape[1:] != (*crops.shape[1:2] * 2, 4):
            raise ValueError("it is of another version")
        if not shapes or not count:
            raise ValueError("its arrays do not belong together")
        return PseudoLabels(crops, landmarks, agreed, held_out, float(about["padding"]), about["facts"])
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file; `muybridge adapt SESSION` makes one") from error
    except Exception as error:  # numpy's and zipfile's errors share no base but Exception
        raise FormatError(f"{path}: not footage that `muybridge adapt` wrote ({error}); make it again") from error
