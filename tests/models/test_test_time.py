"""Uncertain crops are read in other orientations and tilted."""

import cv2
import numpy as np
import pytest

from muybridge.arrays import ByteArray, Float32Array
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.keypoints import test_time as turning
from muybridge.models.keypoints.decode import NO_IDEA
from muybridge.models.keypoints.test_time import Series, augment_at_test_time
from muybridge.models.shipped import shipped_model

SPOT = 6  # half of a spot's side, px


def spotted(network: KeypointNetwork, places: list[tuple[int, int]]) -> ByteArray:
    """Black crops with a bright spot at each of the places (column, row)."""
    crops = np.zeros((len(places), network.crop_size, network.crop_size, 3), np.uint8)
    for crop, (x, y) in zip(crops, places, strict=True):
        crop[y - SPOT : y + SPOT, x - SPOT : x + SPOT] = 255
    return crops


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> KeypointNetwork:
    """A network that finds a spot in the upper third of a crop, and is sure of nothing else."""
    opened = KeypointNetwork(shipped_model("keypoints"), OnnxOptions(flip=False))

    def look(self: KeypointNetwork, crops: ByteArray) -> list[Float32Array]:
        cells = crops.shape[1] // opened.card.stride
        small = crops[..., 0].reshape(len(crops), cells, opened.card.stride, cells, -1).mean(axis=(2, 4)) / 255
        sees = small[:, : cells // 3].max(axis=(1, 2)) > 0.5
        maps = np.where(sees[:, None, None], 30 * small, 0.1 * small).astype(np.float32)
        count = len(self.card.landmarks)
        visibility = np.broadcast_to(sees[:, None], (len(crops), count)).astype(np.float32)
        return [np.repeat(maps[:, None], count, axis=1), visibility.copy()]

    monkeypatch.setattr(KeypointNetwork, "__call__", look)
    return opened


@pytest.fixture
def looked(network: KeypointNetwork, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many crops the network was shown, call by call."""
    counts: list[int] = []
    look = type(network).__call__

    def counted(self: KeypointNetwork, crops: ByteArray) -> list[Float32Array]:
        counts.append(len(crops))
        return look(self, crops)

    monkeypatch.setattr(KeypointNetwork, "__call__", counted)
    return counts


def test_upside_down_people_are_located(network: KeypointNetwork) -> None:
    places = [(100, 20), (30, 160), (170, 100), (20, 90), (96, 96)]
    found = network.locate(spotted(network, places))
    middles = np.repeat(np.array(places[:4])[:, None] - 0.5, len(network.landmarks), axis=1)
    np.testing.assert_allclose(found.found.points_crop_px[:4], middles, atol=2)
    np.testing.assert_array_equal(found.visibility[:, 0], [1, 1, 1, 1, 0])
    assert np.isnan(found.found.points_crop_px[4]).all()  # nowhere near an edge, however it is turned


def test_confident_crops_are_not_rotated(network: KeypointNetwork, looked: list[int]) -> None:
    network.locate(spotted(network, [(100, 20), (30, 20), (30, 160)]))
    assert looked == [3, 1, 1, 1]
    looked.clear()
    still = KeypointNetwork(shipped_model("keypoints"), OnnxOptions(flip=False, turn=False))
    assert np.isnan(still.locate(spotted(network, [(30, 160)])).found.points_crop_px).all() and looked == [1]


def test_only_samples_of_a_series_are_rotated(network: KeypointNetwork, looked: list[int]) -> None:
    # One hangs upside down in all frames, one is nobody; their frames take turns.
    places = [(60 + 5 * (k // 2), 170) if k % 2 == 0 else (96, 96) for k in range(18)]
    series = Series(np.arange(18) % 2, every=4)
    found = network.locate(spotted(network, places), series=series).found.points_crop_px[:, 0]
    np.testing.assert_allclose(found[::2], np.array(places[::2]) - 0.5, atol=2)
    assert np.isnan(found[1::2]).all()
    # One of nine frames of each in three orientations, two more of the one whom this helps; its other six in that of
    # their neighbours.
    assert looked == [18, 2, 2, 2, 2, 2, 2, 6]


def test_people_who_turn_over_within_a_series_are_located(network: KeypointNetwork) -> None:
    places = [(96, 20), (60, 20), (20, 60), (20, 90), (20, 120), (60, 172), (96, 172), (120, 172)]
    series = Series(np.zeros(len(places), dtype=np.int64), every=4)
    found = network.locate(spotted(network, places), series=series).found.points_crop_px[:, 0]
    np.testing.assert_allclose(found, np.array(places) - 0.5, atol=2)


@pytest.mark.parametrize(("here", "turned"), [(5, True), (6, False), (19, False), (20, True)])
def test_partly_visible_people_are_not_rotated(here: int, turned: bool) -> None:
    """Crops that show `here` landmarks, none of them surely, and turned all of them: of whom some are missing is not
    turned, unless there is hardly anything to lose."""
    card = KeypointNetwork(shipped_model("keypoints"), OnnxOptions()).card
    cells = card.input_size // card.stride
    spot = np.zeros((cells, cells), np.float32)
    spot[18:21, 10:13] = 1
    shown = np.where(np.arange(23) < here, 6.0, 0.0)[None, :, None, None]

    def look(crops: ByteArray) -> list[Float32Array]:
        if crops.shape[1] == card.input_size:
            return [np.broadcast_to(9 * spot, (1, 23, cells, cells)).copy()]
        fewer = (crops.shape[1] // card.stride,) * 2  # made smaller, they are no better known
        return [np.asarray(shown * cv2.resize(spot, fewer, interpolation=cv2.INTER_AREA), np.float32)]

    crops = np.zeros((1, card.input_size, card.input_size, 3), np.uint8)
    found = augment_at_test_time(look, crops, [np.asarray(shown * spot, np.float32)], card, rows=1)
    assert ((found.score[0] > NO_IDEA) == (turned | (np.arange(23) < here))).all()
    assert (np.isclose(found.points_crop_px[0, 0], 4 * np.array([11, 19]) + 1.5, atol=1).all()) != turned


def test_tilted_maps_are_resampled_to_their_place() -> None:
    cells = 56
    spot = np.zeros((2, 3, cells, cells), np.float32)
    spot[0, :, 10:13, 40:43] = 9
    spot[1, :, 30:33, 8:11] = 9
    for rows, channels in ((1, (0, 2, 3, 1)), (2, (0, 1, 2, 3))):
        for angle in (turning._TILT, -turning._TILT):
            picture = np.ascontiguousarray(spot.transpose(channels))
            tilted = turning._tilt_crops(picture, rows, angle)
            assert tilted.shape == picture.shape
            maps = tilted if rows == 2 else tilted.transpose(0, 3, 1, 2)
            # It went where a turn about the middle takes it, counter-clockwise where the angle is positive.
            middle, (x, y) = (cells - 1) / 2, (41 - (cells - 1) / 2, 11 - (cells - 1) / 2)
            there = middle + np.array([np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x])
            v, u = np.indices((cells, cells))
            found = [(axis * maps[0, 0]).sum() / maps[0, 0].sum() for axis in (u, v)]
            np.testing.assert_allclose(found, there, atol=0.1)
            back = turning._tilt_maps_back(np.ascontiguousarray(maps, dtype=np.float32), angle)
            assert np.abs(back - spot).max() < 5 and np.corrcoef(back.ravel(), spot.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("quarters", range(4))
def test_uncertain_crops_are_the_mean_of_all_readings(quarters: int) -> None:
    """Crops that only their own orientation makes known to the network, which is never sure of anything: it sees them
    turned and tilted, and its maps come back to where the spots are."""
    card = KeypointNetwork(shipped_model("keypoints"), OnnxOptions()).card
    size = card.input_size
    upright = np.zeros((1, size, size, 3), np.uint8)
    upright[0, 20:32, 104:116] = 255  # at the top: the network's own way up
    upright[0, 150:162, 60:72] = 90
    crop = np.ascontiguousarray(np.rot90(upright, -quarters, axes=(1, 2)))
    shown: list[float] = []

    def look(crops: ByteArray) -> list[Float32Array]:
        here = crops.shape[1] // card.stride
        small = crops[..., 0].reshape(len(crops), here, card.stride, here, -1).mean(axis=(2, 4)) / 255
        shown.extend(small[:, : here // 4].sum(axis=(1, 2)))
        known = small[:, : here // 4].max(axis=(1, 2)) > 0.5
        maps = np.where(known[:, None, None], 7 * small, small).astype(np.float32)
        return [np.repeat(maps[:, None], 23, axis=1), known[:, None].repeat(23, 1).astype(np.float32)]

    first = look(crop)
    plain = [m.copy() for m in first]
    alone = augment_at_test_time(look, crop, plain, card, rows=1)
    shown.clear()
    tilted = [m.copy() for m in first]
    found = augment_at_test_time(look, crop, tilted, card, rows=1, tilt=True)
    # Three quarters and, of the best of the four: two tilts, smaller, and in a tighter box at both sizes.
    assert len(shown) == 8
    np.testing.assert_allclose(found.points_crop_px, alone.points_crop_px, atol=2.5)
    assert not np.allclose(tilted[0], plain[0]) and np.corrcoef(tilted[0].ravel(), plain[0].ravel())[0, 1] > 0.9
    np.testing.assert_allclose(tilted[1], 1.0)  # the mean of looks at somebody known


def test_crops_are_tilted_where_they_are_mirrored_too(network: KeypointNetwork, looked: list[int]) -> None:
    places = [(100, 20), (96, 96)]  # one who is found, and nobody
    network.locate(spotted(network, places))
    assert looked == [2, 1, 1, 1]
    looked.clear()
    network._flip = network._flip_all = True
    network.locate(spotted(network, places))
    assert looked == [2, 1, 1, 1, 1, 1, 1, 1, 1]


def test_maps_of_a_tighter_box_come_back_to_their_place() -> None:
    size = 224
    y, x = np.indices((size, size))
    blob = (200 * np.exp(-((x - 150) ** 2 + (y - 90) ** 2) / (2 * 8.0**2))).astype(np.float32)
    for rows, crops in ((1, blob[None, ..., None]), (2, blob[None, None])):
        tighter = turning._magnify_crops(crops, rows)
        assert tighter.shape == crops.shape
        maps = np.ascontiguousarray(tighter if rows == 2 else tighter.transpose(0, 3, 1, 2))
        middle = (size - 1) / 2
        there = middle + (np.array([150, 90]) - middle) / turning._TIGHTER
        np.testing.assert_allclose([(maps[0, 0] * axis).sum() / maps[0, 0].sum() for axis in (x, y)], there, atol=0.05)
        np.testing.assert_allclose(turning._shrink_maps_back(maps)[0, 0], blob, atol=2)


def test_hidden_landmarks_have_a_large_variance_and_only_unknown_ones_are_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Maps with a share of 0.03, 0.07 and 0.15 of the probability at one place."""
    network = KeypointNetwork(shipped_model("keypoints"), OnnxOptions(flip=False, turn=False))
    cells = network.crop_size // network.card.stride
    maps = np.zeros((1, 23, cells, cells), np.float32)
    for landmark, share in enumerate((0.03, 0.07, 0.15)):
        maps[0, landmark, 30, 20] = np.log(share * cells**2 / (1 - share))
    maps[0, 3:, 30, 20] = 20
    monkeypatch.setattr(KeypointNetwork, "__call__", lambda *_: [maps, np.zeros((1, 23), np.float32)])
    found = network.locate(np.zeros((1, network.crop_size, network.crop_size, 3), np.uint8)).found
    assert np.isfinite(found.points_crop_px[0, :, 0]).tolist() == [False, True, True] + [True] * 20
    assert found.score[0, 0] == 0 and np.isnan(found.variance_crop_px2[0, 0])
    hidden, _, sure = np.sqrt(found.variance_crop_px2[0, 1:4])
    assert hidden > network.crop_size / 8 and sure < 4
