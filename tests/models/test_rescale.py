"""Partly visible people are read at a smaller size."""

import numpy as np
import pytest

from muybridge.arrays import ByteArray, Float32Array, FloatArray
from muybridge.infer.detection.detect import DetectOptions, first_pass
from muybridge.infer.detection.pose_estimator import KeypointOptions
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.keypoints.test_time import at_side, augment_at_test_time, reading_sides
from muybridge.models.shipped import shipped_model


def scores(here: int) -> FloatArray:
    return np.where(np.arange(23) < here, 0.9, 0.05)[None]


@pytest.mark.parametrize(
    ("here", "side"), [(23, 256), (22, 224), (20, 224), (19, 192), (12, 192), (11, 160), (6, 160), (5, 256), (0, 256)]
)
def test_less_visible_people_are_read_at_smaller_sizes(here: int, side: int) -> None:
    assert reading_sides(scores(here), 256, 256) == side
    assert reading_sides(scores(here), 192, 256) == min(side, 192)  # never larger than they are


@pytest.mark.parametrize("rows", [1, 2])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_maps_of_smaller_crops_match_those_of_the_crops(rows: int, channels: int) -> None:
    """The network finds what is bright; a shift by half a pixel of either resolution would show."""
    size, stride = 256, 4
    v, u = np.indices((size, size))
    bright = np.exp(-((u - 90.5) ** 2 + (v - 171.5) ** 2) / (2 * 14.0**2))
    crop = np.repeat((255 * bright)[None, ..., None], channels, axis=-1).astype(np.float32)
    crops = crop if rows == 1 else crop.transpose(0, 3, 1, 2)
    shown: list[tuple[int, ...]] = []

    def look(crops: Float32Array) -> list[Float32Array]:
        shown.append(crops.shape)
        picture = crops[..., 0] if rows == 1 else crops[:, 0]
        cells = picture.shape[-1] // stride
        maps = picture.reshape(1, cells, stride, cells, stride).mean(axis=(2, 4))
        return [maps[:, None].copy(), np.array([[3.0]], np.float32)]

    whole, (maps, visibility) = look(crops)[0], at_side(look, 192, rows)(crops)
    assert shown[1][rows : rows + 2] == (192, 192) and maps.shape == whole.shape and visibility == [[3.0]]
    cells = np.indices(maps.shape[2:])
    for found in (maps, whole):
        v_mid, u_mid = ((axis * found[0, 0]).sum() / found.sum() for axis in cells)
        np.testing.assert_allclose([u_mid, v_mid], [(90.5 - 1.5) / 4, (171.5 - 1.5) / 4], atol=0.02)
    assert at_side(look, size, rows) is not look and (at_side(look, size, rows)(crops)[0] == whole).all()


@pytest.mark.parametrize(("here", "looks"), [(23, []), (21, [224]), (15, [192]), (8, [160])])
def test_parts_of_people_are_read_at_their_size(here: int, looks: list[int]) -> None:
    card = KeypointNetwork(shipped_model("keypoints")).card
    shown: list[int] = []

    def maps(size: int, spot: tuple[int, int]) -> list[Float32Array]:
        out = np.zeros((1, 23, size // 4, size // 4), np.float32)
        out[0, :here, spot[0] - 1 : spot[0] + 2, spot[1] - 1 : spot[1] + 2] = 14
        return [out, np.zeros((1, 23), np.float32)]

    def look(crops: ByteArray) -> list[Float32Array]:
        shown.append(crops.shape[1])
        return maps(crops.shape[1], (10, 30))

    first = maps(256, (40, 20))
    found = augment_at_test_time(look, np.zeros((1, 256, 256, 3), np.uint8), first, card, rows=1)
    assert shown == looks
    cell = (20, 40) if not looks else ((np.array([30, 10]) + 0.5) * 256 / looks[0] - 0.5)
    np.testing.assert_allclose(found.points_crop_px[0, 0], 4 * np.array(cell) + 1.5, atol=1.5)


def test_first_pass_uses_smaller_crops() -> None:
    options = first_pass(DetectOptions()).keypoints.onnx
    network, whole = KeypointNetwork(shipped_model("keypoints"), options), KeypointNetwork(shipped_model("keypoints"))
    assert (network.crop_size, whole.crop_size) == (192, 256)
    for stated in (0.625, 0.75, 1.0, 1.5):  # a stated size is what the network sees in both passes
        options = DetectOptions(keypoints=KeypointOptions(onnx=OnnxOptions(size=stated)))
        assert first_pass(options).keypoints.onnx.size == stated
    crops = np.random.default_rng(0).integers(0, 256, (2, 192, 192, 3), dtype=np.uint8)
    found = network.locate(crops).found
    there = np.isfinite(found.points_crop_px)
    assert found.points_crop_px.shape == (2, 23, 2) and (found.points_crop_px[there] < 192).all()


def test_invalid_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="size must be between"):
        OnnxOptions(size=0.5)  # half of it is read nowhere
    with pytest.raises(ValueError, match="multiple of 32"):
        KeypointNetwork(shipped_model("keypoints"))(np.zeros((1, 200, 200, 3), np.uint8))
