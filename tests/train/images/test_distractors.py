"""Moving objects stay within their masks and do not change people's boxes."""

import numpy as np
import pytest

pytest.importorskip("torch")

from muybridge.train.images import scenes  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.distractors import hold, light_up, move_things  # noqa: E402
from muybridge.train.images.scenes import SceneCompositor  # noqa: E402
from muybridge.train.synthesis.rendering.store import RenderSet  # noqa: E402

GREY = 90


def room() -> np.ndarray:
    return np.full((120, 160, 3), GREY, np.uint8)


def white() -> np.ndarray:
    return np.full((120, 160, 3), 250, np.uint8)


def test_objects_appear_or_disappear() -> None:
    came = went = 0
    for seed in range(40):
        frame, plate = room(), room()
        move_things(frame, plate, white, np.random.default_rng(seed))
        assert set(np.unique(frame)) | set(np.unique(plate)) <= {GREY, 250}
        came, went = came + (frame > plate).any(), went + (plate > frame).any()
    assert came > 15 and went > 8


def test_light_changes_part_of_the_image_in_one_direction() -> None:
    ways = []
    for seed in range(20):
        frame = room()
        light_up(frame, np.random.default_rng(seed))
        change = frame.astype(int) - GREY
        assert (change >= 0).all() or (change <= 0).all()
        ways.append(np.sign(change.sum()))
    assert {-1, 1} <= set(ways)


def test_held_objects_cover_their_mask_and_leave_fingers_in_front() -> None:
    mine = np.zeros((120, 160), bool)
    mine[20:110, 60:100] = True
    sizes, kept = [], 0
    for seed in range(60):
        frame = room()
        frame[mine] = 30
        before = frame.copy()
        there = hold(frame, mine, white, np.random.default_rng(seed))
        assert np.array_equal(frame[~there], before[~there])
        sizes.append(int(there.sum()))
        if there.any():
            y, x = np.nonzero(there)
            hull = np.zeros_like(there)
            hull[y.min() : y.max() + 1, x.min() : x.max() + 1] = True
            kept += bool((hull & mine & ~there).any())
        again = before.copy()
        assert np.array_equal(hold(again, mine, white, np.random.default_rng(seed)), there)
        assert np.array_equal(again, frame)
    assert np.median(sizes) > 60 and max(sizes) < mine.size / 2 and kept > 10


@pytest.fixture
def renders() -> RenderSet:
    """Two people: upright rectangles in one colour."""
    pixels = np.zeros((2, 5, 256, 256), np.uint8)
    pixels[:, :3, 30:220, 100:150], pixels[:, 3, 30:220, 100:150] = 120, 255
    landmarks = np.tile(np.array([125.0, 120.0], np.float32), (2, 23, 1))
    return RenderSet(
        [pixels], landmarks_px=landmarks, visible=np.ones((2, 23), bool),
        box_px=np.tile(np.array([100, 30, 149, 219], np.float32), (2, 1)),
    )  # fmt: skip


def test_held_objects_are_only_in_the_frame_and_keep_boxes(renders: RenderSet, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {}
    for name in ("MOVED_SHARE", "LIT_SHARE", "STILL", "PARTLY", "GHOST", "CAST_SHARE"):
        monkeypatch.setattr(scenes, name, 0)
    monkeypatch.setattr(scenes, "outside_of_video", lambda rng, h, w: (np.zeros((h, w), bool), None))
    for share in (0, 1):
        monkeypatch.setattr(scenes, "HELD_SHARE", share)
        backgrounds = make_backgrounds(4, 256, 0)
        made[share] = [SceneCompositor(renders, backgrounds, seed)._scene(192, 320) for seed in range(12)]
    changed = 0
    for (frame, plate, boxes, ignored), (held, same, those, hidden) in zip(made[0], made[1], strict=True):
        assert np.array_equal(plate, same)
        assert len(boxes) + len(ignored) == len(those) + len(hidden)
        order = [np.array(sorted(np.concatenate(pair).tolist())) for pair in ((boxes, ignored), (those, hidden))]
        assert np.array_equal(*order)
        changed += bool((frame != held).any())
    assert changed >= 8
