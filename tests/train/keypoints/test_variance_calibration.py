"""Variances of a network that is there already, fitted anew."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
pytest.importorskip("torch")
pytest.importorskip("kornia")

import onnxruntime  # noqa: E402

from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.models.onnx_files.quantization import int8_path  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402


def test_recalibration_keeps_the_weights(
    store: Path, script: Callable[[str], ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "keypoints.onnx"
    shutil.copy(shipped_model("keypoints"), path)
    monkeypatch.setattr(sys, "argv", ["recalibrate", str(path), str(store), "--crops", "128", "--size", "64"])
    recalibrate = script("networks.recalibrate_keypoints")
    monkeypatch.setattr(recalibrate, "make_backgrounds", lambda count, *how: make_backgrounds(8, *how))
    recalibrate.main()
    before, after = (onnx.load(str(p)) for p in (shipped_model("keypoints"), path))
    assert before.graph == after.graph  # what is said of them is new, the weights are not
    for file in (path, int8_path(path)):
        session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
        card = keypoint_card(session.get_modelmeta().custom_metadata_map, file)
        old = keypoint_card({e.key: e.value for e in before.metadata_props}, path)
        assert card.input_size == 64 and card.metadata["training"] == old.metadata["training"]
        assert card.spread.knots != old.spread.knots and card.marker_spread == old.marker_spread
        shares = json.loads(card.metadata["sigma_coverage"])
        assert {"one", "two", "one_visible", "one_hidden", "one_mirrored", "two_hidden_mirrored"} <= shares.keys()
        found = np.array([card.spread.hidden, card.spread.mirrored, card.spread.part, *card.spread.landmarks])
        assert np.isfinite(found).all() and (found > 0).all() and len(found) == 26
