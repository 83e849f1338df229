#!/usr/bin/env python3
"""Fits the variances of a published keypoint network anew and writes them into its files' metadata.

usage: python scripts/calibrate_sigma.py NETWORK.onnx RENDERS [CROPS]

The calibration is fitted on one half of CROPS (default 3,072) held-out crops of RENDERS, half of them with the
background plate, and its coverage measured on the other, as `muybridge train keypoints` does; weights stay as they
are. The 8-bit version beside NETWORK.onnx, if there is one, takes the same.
"""

import json
import pathlib
import sys
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from muybridge.files import replacing
from muybridge.geometry.landmarks import BODY23
from muybridge.models.quantize import int8_path
from muybridge.train.augment import AugmentOptions, Compositor
from muybridge.train.backgrounds import make_backgrounds
from muybridge.train.evaluation import load_model
from muybridge.train.loop import HELD_OUT
from muybridge.train.renders import SIZE, load_renders
from muybridge.train.sigma import Look, calibrated, held_out

# Of the crops and of their backgrounds: no training's and no evaluation's.
SEED = 20_000


def look_of(path: pathlib.Path) -> Look:
    """A network's file as a function: body first, then markers."""
    session, card = load_model(path)
    heatmaps, visibility = ["heatmaps"], ["visibility"]
    if card.markers is not None:
        heatmaps, visibility = [*heatmaps, "marker_heatmaps"], [*visibility, "marker_visibility"]

    def look(crops: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        found = session.run([*heatmaps, *visibility], card.inputs(crops))
        half = len(heatmaps)
        return np.concatenate(found[:half], 1), np.concatenate(found[half:], 1)

    return look


def main() -> None:
    if len(sys.argv) not in (3, 4):
        raise SystemExit(__doc__)
    path, renders = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    count = -(-int(sys.argv[3] if len(sys.argv) == 4 else 3072) // 64)
    card = load_model(path)[1]
    people, backgrounds = load_renders(renders, HELD_OUT), make_backgrounds(256, SIZE, SEED)
    compositor = Compositor(people, backgrounds, card.input_size, SEED, AugmentOptions(close_up=0))
    batches = [compositor.batch(64) for _ in range(count)]
    once, mirrored = (held_out(look_of(path), batches, flip) for flip in (False, True))
    new: dict[str, Any] = {}
    for prefix, landmarks in (("", slice(len(BODY23))), ("marker_", slice(len(BODY23), None))):
        if once.inside[:, landmarks].any():
            new[f"{prefix}variance"], new[f"{prefix}sigma_coverage"] = calibrated(once, mirrored, landmarks)
            print(prefix, new[f"{prefix}variance"], new[f"{prefix}sigma_coverage"])
    for file in (path, int8_path(path)):
        if file.is_file():
            model = onnx.load(str(file))
            metadata = {entry.key: entry.value for entry in model.metadata_props}
            onnx.helper.set_model_props(model, metadata | {key: json.dumps(value) for key, value in new.items()})
            with replacing(file) as temporary:
                onnx.save(model, str(temporary))


if __name__ == "__main__":
    main()
