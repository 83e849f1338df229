"""Scenes for the person detector agree with their boxes."""

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.train.images import scenes  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.distractors import cast_shadow  # noqa: E402
from muybridge.train.images.scenes import SceneBatch, SceneCompositor  # noqa: E402
from muybridge.train.people.train import as_tensors, generalised_iou, make_targets  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE, RenderSet  # noqa: E402


def test_static_people_are_in_the_background_model_of_a_scene(renders, monkeypatch):
    def strongest(still=0.0, partly=0.0, ghost=0.0):
        """Of pixels that differ much from the plate, how many lie in boxes of people, as a share of these, and how many
        elsewhere, as a share of the former: no two shares have the same scenes."""
        for name, share in (("STILL", still), ("PARTLY", partly), ("GHOST", ghost)):
            monkeypatch.setattr(f"muybridge.train.images.scenes.{name}", share)
        for name in ("NEAR_SHARE", "CAST_SHARE", "MOVED_SHARE", "HELD_SHARE", "LIT_SHARE"):
            monkeypatch.setattr(f"muybridge.train.images.scenes.{name}", 0)
        batch = SceneCompositor(renders, make_backgrounds(6, SIZE, 0), 3).batch(48, (192, 320))
        within, beside, room = 0, 0, 0
        for image, boxes, ignored in zip(batch.image[:, 3].numpy(), batch.boxes, batch.ignore, strict=True):
            if not image.any():  # no plate
                continue
            inside = np.zeros(image.shape, bool)
            for x0, y0, x1, y1 in np.round(np.concatenate([boxes, ignored])).astype(int):
                inside[max(y0 - 2, 0) : y1 + 3, max(x0 - 2, 0) : x1 + 3] = True
            within, beside = within + (image > 40)[inside].sum(), beside + (image > 40)[~inside].sum()
            room += inside.sum()
        return within / room, beside / within

    (moving, shadows), (still, _), (partly, _) = strongest(), strongest(still=1.0), strongest(partly=1.0)
    assert still < 0.3 * moving  # shadows are not in the plate
    assert 0.4 * moving < partly < 0.9 * moving
    assert strongest(ghost=1.0)[1] > 4 * shadows


def test_people_cast_shadows_from_their_feet_and_keep_their_boxes(renders, monkeypatch):
    pole, frame = np.zeros((20, 9), np.uint8), np.full((60, 60, 3), 200, np.uint8)
    pole[5:16, 4] = 255
    cast_shadow(frame, pole, 15.0, np.array([20, 30]), (1.0, 0.5, 0.5, 0.3))
    dark = np.argwhere(frame[..., 0] < 180)
    assert abs(dark[-1] - [45, 24]).max() <= 1 and abs(dark[0] - [40, 34]).max() <= 1  # foot and top of a pole of 10 px
    assert abs((dark[:, 1] - 24) - 2 * (45 - dark[:, 0])).max() <= 2
    boxes = []
    for name in ("GHOST", "STILL", "PARTLY", "NEAR_SHARE", "MOVED_SHARE", "HELD_SHARE", "LIT_SHARE"):
        monkeypatch.setattr(f"muybridge.train.images.scenes.{name}", 0)
    for share in (0, 1):
        monkeypatch.setattr("muybridge.train.images.scenes.CAST_SHARE", share)
        monkeypatch.setattr(SceneCompositor, "_light", lambda self: (0.8, -0.4, 0.4, 1.0))
        boxes.append(SceneCompositor(renders, make_backgrounds(6, SIZE, 0), 0)._scene(192, 320))
    assert np.array_equal(boxes[0][2], boxes[1][2]) and np.array_equal(boxes[0][1], boxes[1][1])  # boxes and the plate
    assert (boxes[1][0] <= boxes[0][0]).all() and (boxes[1][0] < boxes[0][0]).any()


def test_scene_boxes_hold_their_people(renders, monkeypatch):
    for name in ("GHOST", "CAST_SHARE", "MOVED_SHARE", "LIT_SHARE"):
        monkeypatch.setattr(f"muybridge.train.images.scenes.{name}", 0)
    compositor = SceneCompositor(renders, make_backgrounds(6, SIZE, 0), 0)
    batch = compositor.batch(12, (192, 320))
    assert tuple(batch.image.shape) == (12, 4, 192, 320)
    assert sum(len(b) for b in batch.boxes) > 8
    moving = [i for i in range(12) if batch.image[i, 3].max() > 60 and len(batch.boxes[i])]
    assert moving, "no scene with a plate difference"
    for i in moving:  # where the plate differs strongly, somebody is
        y, x = np.nonzero(batch.image[i, 3].numpy() > 60)
        boxes = np.concatenate([batch.boxes[i], batch.ignore[i]])
        inside = [((x >= b[0] - 2) & (x <= b[2] + 2) & (y >= b[1] - 2) & (y <= b[3] + 2)) for b in boxes]
        # Shadows differ too, outside of the boxes.
        assert np.any(inside, axis=0).mean() > 0.5


def test_people_beside_each_other_touch(renders, monkeypatch):
    monkeypatch.setattr(scenes, "BESIDE_SHARE", 1.0)
    compositor = SceneCompositor(renders, make_backgrounds(6, SIZE, 0), 2)
    sizes = np.array([40.0, 90.0, 250.0])
    beside = compositor._beside(sizes)
    assert beside == [[1], [0, 2], [1]] and sizes.max() < 1.5 * sizes.min()
    mate = np.array([100.0, 50.0, 140.0, 150.0])
    overlaps = []
    for _ in range(50):
        _, box = compositor._person(90.0, 0.0)
        moved = box + np.tile(compositor._next_to(mate, box), 2)
        assert abs(moved[3] - mate[3]) < 20  # one floor
        overlaps.append((min(moved[2], mate[2]) - max(moved[0], mate[0])) / min(moved[2] - moved[0], 40))
    assert 0.6 < np.mean(np.array(overlaps) > 0) and np.median(overlaps) < 0.8


def test_close_ups_end_at_the_image_border(renders, close_ups, monkeypatch):
    monkeypatch.setattr(scenes, "NEAR_SHARE", 1.0)
    both = RenderSet(
        [*renders.pixels, *close_ups.pixels],
        *(np.concatenate([getattr(r, k) for r in (renders, close_ups)])
          for k in ("landmarks_px", "visible", "box_px", "markers_px", "markers_visible", "cut_px")),
    )  # fmt: skip
    monkeypatch.setattr("muybridge.train.synthesis.rendering.store.SHARD", 24)
    compositor = SceneCompositor(both, make_backgrounds(6, SIZE, 0), 1)
    at_border = 0
    for _ in range(20):
        frame, owners = np.full((192, 320, 3), 90, np.uint8), np.full((192, 320), -1, np.int16)
        near = compositor._near(frame, owners, 7)
        box, mine = near.box, owners == 7
        assert mine.sum() <= near.area and (frame[mine] != 90).any()
        edges = mine[-1], mine[:, 0], mine[:, -1], mine[0]
        at_border += any(e.sum() > 3 for e in edges)
        rows, columns = np.nonzero(mine)
        assert columns.min() >= box[0] - 1 and columns.max() <= box[2] + 1
        assert rows.min() >= box[1] - 1 and rows.max() <= box[3] + 1
    assert at_border >= 14  # of some the picture has another side
    assert sum(len(b) for b in compositor.batch(6, (192, 320)).boxes) >= 6


def test_detector_targets_encode_boxes():
    import torch

    box = np.array([[40.0, 30.0, 99.0, 150.0]], np.float32)
    batch = SceneBatch(torch.zeros(1, 4, 192, 320, dtype=torch.uint8), [box], [np.zeros((0, 4), np.float32)])
    targets = make_targets(batch)
    row, column = np.unravel_index(targets.heat[0].argmax(), targets.heat[0].shape)
    center = np.array([column, row]) * 8 + 3.5
    left, top, right, bottom = targets.box[0][:, row, column]
    found = [center[0] - left, center[1] - top, center[0] + right, center[1] + bottom]
    np.testing.assert_allclose(found, box[0], atol=1e-4)
    assert targets.has_box[0].sum() > 1 and targets.weight.min() == 1
    assert as_tensors(batch)[1].shape == (1, 24, 40)


def test_generalised_iou():
    import torch

    a = torch.tensor([1.0, 1.0, 1.0, 1.0])
    assert float(generalised_iou(a, a)) == pytest.approx(1, abs=1e-5)
    half = torch.tensor([1.0, 1.0, 0.0, 1.0])
    assert float(generalised_iou(a, half)) == pytest.approx(0.5, abs=1e-5)
