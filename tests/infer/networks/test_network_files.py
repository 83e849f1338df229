"""Files of keypoint networks: what is refused, and what the shipped ones contain."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from muybridge.errors import ModelError
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.networks.keypoints import KeypointNetwork, PeopleNetwork
from muybridge.models.shipped import shipped_model
from tests.infer.detection.test_inference import _tiny_keypoints


def test_a_plate_that_cannot_be_left_out_is_refused(tmp_path: Path) -> None:
    path = _tiny_keypoints(tmp_path / "other.onnx", plate_input="difference")
    with pytest.raises(ModelError, match="'difference' cannot be left out"):
        KeypointNetwork(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"muybridge_kind": ""}, "not a muybridge model"),
        ({"muybridge_kind": "people"}, "of kind 'people' where 'keypoints' is needed"),
        ({"landmark_set": "body23"}, "landmark names are not those of body23"),
        ({"names": '["nose", "left_wrist", "navel"]'}, "twin"),
        ({"names": '["a", "b"]'}, "heatmaps"),
        ({"names": "nose"}, "names is not JSON"),
        ({"names": '["a", "a", "b"]'}, "twice"),
        ({"input_size": "100"}, "divisible by 32"),
        ({"stride": "four"}, "stride is 'four'"),
        ({"variance": "[1]"}, "not a JSON object"),
        ({"variance": '{"scale": 0, "floor_px2": 1}'}, "variance.scale"),
        ({"box_padding": ""}, "no box_padding"),
        ({"box_padding": "1e300"}, "box_padding is 1e+300"),
        ({"input_size": "32000"}, "of at most 4096"),
        ({"input_size": "9" * 5000}, "of at most 4096"),
        ({"names": "[" * 5000}, "names is not JSON"),
        ({"variance": '{"scale": NaN, "floor_px2": 1}'}, "variance.scale"),
    ],
)
def test_other_keypoint_files_are_refused(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    path = _tiny_keypoints(tmp_path / "other.onnx", **changes)
    with pytest.raises(ModelError, match=re.escape(message)) as caught:
        KeypointNetwork(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["keypoints", "people"])
def test_shipped_models_open(kind: Any) -> None:
    path = shipped_model(kind)
    network = KeypointNetwork(path) if kind == "keypoints" else PeopleNetwork(path)
    assert network.card.metadata["training_command"] and network.card.metadata["licence"]
    if isinstance(network, KeypointNetwork):
        assert network.card.landmarks == BODY23


def test_metadata_that_are_no_utf8_are_refused_in_one_line(tmp_path: Path) -> None:
    path = _tiny_keypoints(tmp_path / "other.onnx", version="marker-text")
    data = path.read_bytes()
    assert data.count(b"marker-text") == 1
    path.write_bytes(data.replace(b"marker-text", b"\xff\xfe\xe9ker-text"))
    with pytest.raises(ModelError, match="UTF-8") as caught:
        KeypointNetwork(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_maps_of_another_size_than_the_metadata_say_are_refused(tmp_path: Path) -> None:
    path = _tiny_keypoints(tmp_path / "other.onnx", stride="8")  # its maps are of 4 px cells
    network = KeypointNetwork(path)
    with pytest.raises(ModelError, match="an output has the shape") as caught:
        network(np.zeros((1, network.crop_size, network.crop_size, 3), np.uint8))
    assert str(path) in str(caught.value)
