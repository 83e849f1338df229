"""Averages of several networks of a training run."""

import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest

pytest.importorskip("torch")

import torch  # noqa: E402

from muybridge.errors import ModelError  # noqa: E402
from muybridge.models.keypoints.metadata import BODY_OUTPUTS, MARKER_OUTPUTS  # noqa: E402
from muybridge.models.keypoints.network import PLATE, KeypointNet, PlateApart, SeparateHeads  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx  # noqa: E402
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, people_net_from_onnx, training_record
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.train.keypoints.export import keypoint_net  # noqa: E402
from muybridge.train.people.export import people_net  # noqa: E402
from scripts.networks.weight_averaging import average_keypoints, average_people  # noqa: E402


@pytest.fixture(scope="module")
def shipped() -> Path:
    return shipped_model("keypoints", "fp32")


@pytest.fixture
def changed(change_weights):
    """The network with one convolution's weights all larger by `by`."""

    def change(path: Path, to: Path, by: float) -> Path:
        layer = "levels.2.1.first.0.weight"
        return change_weights(path, to, lambda i: i.name.endswith(layer), lambda w: w + np.float32(by))

    return change


def test_average_of_a_network_with_itself_is_itself(shipped, tmp_path):
    twin = Path(shutil.copy(shipped, tmp_path / "twin.onnx"))
    saved = average_keypoints([shipped, twin])
    image = torch.rand(2, 4, 192, 192, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        ours, theirs = keypoint_net(saved)(image)[0], keypoint_net_from_onnx(shipped)(image)[0]
    assert torch.allclose(ours, theirs, atol=1e-5)
    assert saved["state"]["images"] > 1e6 and saved["options"]["seed"] == training_record(shipped)["seed"]


def test_average_weights_are_the_mean(shipped, changed, tmp_path):
    saved = average_keypoints([shipped, changed(shipped, tmp_path / "other.onnx", 0.25)])
    before = keypoint_net_from_onnx(shipped).state_dict()
    moved = {k: (saved["average"][k] - v).float() for k, v in before.items()}
    far = [k for k, d in moved.items() if d.abs().max() > 1e-6]
    assert far == ["levels.2.1.first.0.weight"]
    assert torch.allclose(moved[far[0]], torch.full_like(moved[far[0]], 0.125), atol=1e-6)


def test_detectors_are_averaged_too(tmp_path):
    path = shipped_model("people")
    saved = average_people([path, Path(shutil.copy(path, tmp_path / "twin.onnx"))])
    image = torch.rand(1, 4, 192, 320, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        ours, theirs = people_net(saved)(image)[0], people_net_from_onnx(path)(image)[0]
    assert torch.allclose(ours, theirs, atol=1e-5)
    with pytest.raises(ModelError, match="keypoints"):
        average_people([path, shipped_model("keypoints")])


def test_networks_of_other_designs_are_not_averaged(shipped, tmp_path):
    path, other = tmp_path / "other.onnx", KeypointNet(95, (16, 16, 24, 24), (0, 1, 1, 1)).eval()
    for module in other.modules():  # as in a trained network, where the file keeps them apart from the filters
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.running_mean, 0, 0.1)
            torch.nn.init.uniform_(module.weight, 0.5, 2)
    export_onnx(PlateApart(SeparateHeads(other, 23)), path, (2, 3, 64, 64), BODY_OUTPUTS + MARKER_OUTPUTS, {}, PLATE)
    with pytest.raises(ModelError, match=r"other\.onnx: of another design than .*keypoints\.onnx"):
        average_keypoints([shipped, path])


def test_training_histories_add_up(shipped, tmp_path):
    def told(images: int, minutes: float) -> Path:
        model = onnx.load(str(shipped))
        (training,) = (p for p in model.metadata_props if p.key == "training")
        training.value = json.dumps({"images": images, "minutes": minutes})
        path = tmp_path / f"{images}.onnx"
        onnx.save(model, str(path))
        return path

    saved = average_keypoints([told(1500, 30), told(1000, 20), told(1200, 25), tmp_path / "1500.onnx"])
    assert saved["state"] == {"images": 1700, "seconds": pytest.approx(60 * 35)}


def test_unusable_networks_are_refused(shipped, tmp_path):
    with pytest.raises(ModelError, match="two networks"):
        average_keypoints([shipped])
    junk = tmp_path / "junk.onnx"
    junk.write_bytes(b"no network")
    with pytest.raises(ModelError, match="junk.onnx"):
        average_keypoints([shipped, junk])
