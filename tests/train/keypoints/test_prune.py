"""Networks of other designs: narrower ones made from trained ones, and those of earlier versions."""

import shutil
import sys

import pytest

pytest.importorskip("onnx")
torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import ModelError  # noqa: E402
from muybridge.models.keypoints.network import PLATE, KeypointNet, PlateApart  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx  # noqa: E402
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx  # noqa: E402
from muybridge.models.onnx_files.quantization import int8_path  # noqa: E402
from muybridge.models.people.network import MEAN, STD  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from scripts.networks.prune import prune  # noqa: E402

WIDTHS, DEPTHS = (16, 16, 24, 24), (0, 1, 2, 1)


@pytest.fixture
def net() -> KeypointNet:
    torch.manual_seed(0)
    net = KeypointNet(23, WIDTHS, DEPTHS).eval()
    with torch.no_grad():
        for module in net.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                torch.nn.init.normal_(module.running_mean, 0, 0.1)
                torch.nn.init.uniform_(module.running_var, 0.5, 2)
                torch.nn.init.uniform_(module.weight, 0.5, 2)
                torch.nn.init.normal_(module.bias, 0.3, 0.1)
    return net


@pytest.fixture
def images() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    return [torch.rand(64, 4, 64, 64, generator=generator) for _ in range(2)]


@torch.no_grad()
def says(net: KeypointNet, image: torch.Tensor) -> torch.Tensor:
    return net(image)[0]


def test_redundant_channels_can_be_pruned(net, images):
    with torch.no_grad():
        net.levels[2][2].second[1].weight.zero_()  # a block that adds nothing
        net.levels[2][2].second[1].bias.zero_()
        for block in (net.levels[2][1], net.laterals[0].block):  # the last eight channels are others' twins
            normalisation = block.first[1]
            for values in (block.first[0].weight, *(getattr(normalisation, n) for n in ("weight", "bias"))):
                values[16:] = values[:8]
            for values in (normalisation.running_mean, normalisation.running_var):
                values[16:] = values[:8]
    less = prune(net, (0, 1, 1, 1), (16, 16, 16, 24), images)
    assert less.config["depths"] == (0, 1, 1, 1) and less.config["hidden"] == (16, 16, 16, 24)
    torch.testing.assert_close(says(less, images[0]), says(net, images[0]), rtol=1e-3, atol=1e-3)
    assert len(net.levels[2]) == 3 and net.levels[2][1].first[0].out_channels == 24  # left as it was


def test_remaining_channels_compensate(net, images):
    less = prune(net, DEPTHS, (16, 16, 20, 24), images)
    fresh = torch.rand(8, 4, 64, 64, generator=torch.Generator().manual_seed(2))
    whole, near = says(net, fresh), says(less, fresh)
    # Leaving them out alone, of the same channels.
    bare = prune(net, DEPTHS, (16, 16, 20, 24), images)
    with torch.no_grad():
        for block, original in ((bare.levels[2][1], net.levels[2][1]), (bare.levels[2][2], net.levels[2][2]),
                                (bare.laterals[0].block, net.laterals[0].block)):  # fmt: skip
            kept = [int((original.first[1].bias == value).nonzero()[0]) for value in block.first[1].bias]
            assert len(set(kept)) == 20 and torch.equal(block.first[0].weight, original.first[0].weight[kept])
            block.second[0].weight.copy_(original.second[0].weight[:, kept])
            block.second[1].bias.copy_(original.second[1].bias)
    assert (near - whole).std() < 0.7 * (says(bare, fresh) - whole).std()


def test_invalid_sizes_are_refused(net, images):
    with pytest.raises(ModelError, match=r"depths \(0, 1, 3, 1\).*\(0, 1, 2, 1\)"):
        prune(net, (0, 1, 3, 1), WIDTHS, images)
    with pytest.raises(ModelError, match=r"hidden \(16, 16, 25, 24\)"):
        prune(net, DEPTHS, (16, 16, 25, 24), images)
    with pytest.raises(ModelError, match=r"hidden \(16, 16, 0, 24\): each may be from 1 "):
        prune(net, DEPTHS, (16, 16, 0, 24), images)


def test_design_is_read_from_a_file(net, images, tmp_path):
    less, path = prune(net, (0, 1, 1, 1), (16, 16, 16, 8), images), tmp_path / "narrow.onnx"
    export_onnx(PlateApart(less), path, (2, 3, 64, 64), ("heatmaps", "visibility"), {}, PLATE)
    again = keypoint_net_from_onnx(path)
    assert again.config == less.config
    torch.testing.assert_close(says(again, images[0]), says(less, images[0]), rtol=1e-3, atol=1e-3)


class _Normalised(KeypointNet):
    """As networks were until images went into them as they are."""

    divides = False

    def features(self, image):
        """(N, 4, S, S) -> as of the network."""
        mean, deviation = (torch.tensor(values).view(1, 4, 1, 1) for values in (MEAN, STD))
        return super().features((image - mean) / deviation if self.divides else image - mean)


# The earliest ones subtracted a mean alone.
@pytest.mark.parametrize("divides", [pytest.param(False, marks=pytest.mark.slow), True])
def test_older_files_with_input_normalisation_are_read(net, images, divides, tmp_path):
    with torch.no_grad():  # beyond the border was the mean, and is black: no filter looks there
        net.stem[0][0].weight[:, :, 0] = 0
        net.stem[0][0].weight[:, :, :, 0] = 0
    earlier, path = _Normalised(23, WIDTHS, DEPTHS).eval(), tmp_path / "earlier.onnx"
    earlier.load_state_dict(net.state_dict())
    earlier.divides = divides
    export_onnx(PlateApart(earlier), path, (2, 3, 64, 64), ("heatmaps", "visibility"), {}, PLATE)
    with torch.no_grad():
        expected = earlier(images[0])[0]
    torch.testing.assert_close(says(keypoint_net_from_onnx(path), images[0]), expected, rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_pruning_script_writes_a_trainable_network(store, script, tmp_path, monkeypatch, capsys):
    main = script("networks.narrow_keypoints").main
    path, out = tmp_path / "keypoints.onnx", tmp_path / "less.onnx"
    shutil.copy(shipped_model("keypoints"), path)
    command = ["narrow", str(path), str(out), str(store), "--depths", "0", "2", "2", "1", "--hidden", "32", "64", "64"]
    monkeypatch.setattr(sys, "argv", [*command, "160"])
    main()
    assert keypoint_net_from_onnx(out).config["hidden"] == (32, 64, 64, 160) and int8_path(out).is_file()
    assert "after: " in capsys.readouterr().out
    with pytest.raises(ModelError, match="less.onnx is there already"):
        main()
