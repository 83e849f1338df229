"""Self-attention of the keypoint network: what it adds, and that files keep it."""

import pathlib

import pytest

torch = pytest.importorskip("torch")

from muybridge.models.keypoints.attention import AttentionBlock  # noqa: E402
from muybridge.models.keypoints.network import KeypointNet, PlateApart, SeparateHeads, with_attention  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx  # noqa: E402
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, measure_normalisation  # noqa: E402

SMALL = {"landmarks": 95, "widths": (16, 16, 24, 64), "depths": (0, 1, 1, 1)}
OUTPUTS = ("heatmaps", "visibility", "marker_heatmaps", "marker_visibility")


def _trained_alike(net: KeypointNet) -> None:
    """Give the layers that start at zero some weights."""
    for block in net.attention:
        for last in (block.out, block.narrow):
            torch.nn.init.normal_(last.weight, std=0.1)


def test_added_attention_changes_nothing_at_first() -> None:
    torch.manual_seed(0)
    net, image = KeypointNet(**SMALL).eval(), torch.rand(2, 4, 96, 128)
    larger = with_attention(net, 2)
    with torch.no_grad():
        for before, after in zip(net(image), larger(image), strict=True):
            assert torch.equal(before, after)
    assert with_attention(larger, 2).config == larger.config
    with pytest.raises(ValueError, match="2 blocks"):
        with_attention(larger, 1)


def test_every_cell_attends_to_every_other() -> None:
    torch.manual_seed(0)
    block = AttentionBlock(64).eval()
    for last in (block.out, block.narrow):
        torch.nn.init.normal_(last.weight, std=0.1)
    cells = torch.rand(1, 64, 5, 7)
    cells.requires_grad_()
    block(cells)[0, :, 0, 0].sum().backward()
    assert cells.grad is not None and (cells.grad.abs().sum(1) > 0).all()


def test_number_of_channels_must_be_divisible() -> None:
    with pytest.raises(ValueError, match="100 channels"):
        AttentionBlock(100)
    AttentionBlock(20)


def test_training_continues_from_a_file_with_attention(tmp_path: pathlib.Path) -> None:
    torch.manual_seed(0)
    net, image, path = KeypointNet(**SMALL, attention=2).eval(), torch.rand(2, 4, 64, 96), tmp_path / "net.onnx"
    _trained_alike(net)
    measure_normalisation(net, [torch.rand(4, 4, 64, 64)])
    export_onnx(PlateApart(SeparateHeads(net, 23)), path, (2, 3, 64, 64), OUTPUTS, {}, "difference")
    again = keypoint_net_from_onnx(path)
    assert again.config["attention"] == 2
    with torch.no_grad():
        torch.testing.assert_close(again(image)[0], net(image)[0], rtol=1e-3, atol=1e-3)
