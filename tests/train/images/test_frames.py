"""Borders of the picture near and within people, boxes as detectors give them, people who are small in the picture."""

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

import torch  # noqa: E402

from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.camera_faults import CameraFaults  # noqa: E402
from muybridge.train.images.compositor import Compositor  # noqa: E402
from muybridge.train.images.occlusion import frame_people, loosen, map_borders  # noqa: E402
from muybridge.train.images.options import WHOLE, AugmentOptions  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE  # noqa: E402

BOX = np.tile(np.array([90.0, 30.0, 160.0, 220.0], np.float32), (4000, 1))


def test_pictures_cut_off_crowns_feet_and_sides_and_end_beside_people() -> None:
    able = np.arange(4000) < 3900
    boxes, borders = frame_people(np.random.default_rng(0), BOX, 0.5, able)
    there = np.isfinite(borders)
    assert not there[3900:].any() and 0.46 < there[:3900].any(1).mean() < 0.54
    assert set(there[there.any(1)].sum(1)) == {1, 2, 3, 4}
    inwards = (borders - BOX) * [1, 1, -1, -1]
    for side in range(4):
        cut = inwards[there[:, side], side] > 0
        assert 0.2 < cut.mean() < 0.7
    assert (boxes[:, 2:] - boxes[:, :2] > 20).all()
    shown = np.abs(np.where(there, boxes, BOX) - BOX).max(1) > 1e-3  # boxes of what the picture shows
    visible = np.concatenate([np.fmax(BOX[:, :2], borders[:, :2]), np.fmin(BOX[:, 2:], borders[:, 2:])], 1)
    np.testing.assert_allclose(boxes[shown], visible[shown], atol=1e-3)
    both = there[:, 0] & there[:, 2]
    assert (borders[both, 2] - borders[both, 0] > 0.44 * 190).all()


def test_borders_move_with_crops() -> None:
    borders = np.array([[10.0, np.nan, np.nan, 40.0]], np.float32)
    turn = np.radians(20)
    linear = 1.5 * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    matrix = np.concatenate([linear, [[20.0], [5.0]]], 1)[None].astype(np.float32)
    frames = map_borders(borders, matrix)
    render = np.array([[9.0, 20], [11, 20], [11, 39], [11, 41], [200, -90]])
    crop = (render @ linear.T + [20, 5])[None].astype(np.float32)
    assert frames.hidden(crop).tolist() == [[True, False, False, True, False]]
    assert frames.near.tolist() == [0]
    at = np.round(crop[0, :4]).astype(int)
    assert frames.mask(0, 96)[at[:, 1], at[:, 0]].tolist() == [True, False, False, True]


def test_crops_are_black_outside_of_the_picture_and_landmarks_there_hidden(renders) -> None:
    framed = AugmentOptions(
        framed=1, truncate=0, close_up=0, occluder=0, second_person=0, embrace=0, monochrome=0, toned=0, faded=0,
        faults=False,
    )  # fmt: skip
    compositor = Compositor(renders, make_backgrounds(6, SIZE, 0), 96, 0, framed)
    batch = compositor.batch(32)
    empty = batch.pixels.numpy().max(1) == 0
    assert 0.1 < empty.mean() < 0.6
    at = batch.landmarks_px.numpy().round().astype(int)
    inside = ((at >= 0) & (at < 96)).all(-1)
    x, y = at.clip(0, 95)[..., 0], at.clip(0, 95)[..., 1]
    within = np.stack([cv2.erode(one.astype(np.uint8), np.ones((3, 3))) for one in empty]) > 0  # not half a pixel off
    black = within[np.arange(32)[:, None], y, x] & inside
    assert black.sum() > 20 and not batch.visible.numpy()[black].any()


def test_boxes_are_loose_as_detectors_give_them() -> None:
    boxes = loosen(np.random.default_rng(0), BOX, 0.5)
    size = (boxes[:, 2:] - boxes[:, :2]) / (BOX[:, 2:] - BOX[:, :2])
    moved = (boxes != BOX).any(1)
    assert 0.47 < moved.mean() < 0.53
    assert 0.1 < np.abs(np.log(size[moved])).mean() < 0.25 and abs(np.log(size[moved]).mean()) < 0.02
    assert loosen(np.random.default_rng(0), BOX, 0.0) is BOX


def test_people_who_are_small_in_the_picture_lose_detail() -> None:
    faults = CameraFaults(np.random.default_rng(0))
    rng = np.random.default_rng(1)
    sharp = torch.from_numpy(np.repeat(rng.integers(60, 190, (8, 1, 128, 128)).astype(np.uint8), 3, 1))

    def detail(pixels: torch.Tensor) -> np.ndarray:
        return np.abs(np.diff(pixels.numpy().astype(float), axis=-1)).mean((1, 2, 3))

    far, crisp, same = sharp.clone(), sharp.clone(), sharp.clone()
    faults.resample(far, 1.0, 0.0)
    faults.resample(crisp, 0.0, 1.0)
    faults.resample(same, 0.0, 0.0)
    assert (detail(far)[detail(far) < 0.5 * detail(sharp)]).size >= 4
    assert (detail(crisp) > 1.2 * detail(sharp)).all() and torch.equal(same, sharp)


def test_scores_use_none_of_this(renders) -> None:
    assert not any((WHOLE.framed, WHOLE.loose, WHOLE.far, WHOLE.crisp, WHOLE.monochrome, WHOLE.toned, WHOLE.faded))
