"""Renders of several people and things in crops and in the detector's scenes, on a made-up store of rectangles."""

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.train.images import scenes as detector  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.compositing import layer_of_render, touched_sides  # noqa: E402
from muybridge.train.images.compositor import Compositor  # noqa: E402
from muybridge.train.images.dataset import load_stores  # noqa: E402
from muybridge.train.images.options import AugmentOptions  # noqa: E402
from muybridge.train.images.scenes import SceneCompositor  # noqa: E402
from muybridge.train.keypoints.hard_examples import mix_scenes  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE, RenderSet, load_renders  # noqa: E402

SUBJECT, OTHER, THING = (100, 40, 150, 220), (160, 60, 199, 220), (60, 150, 149, 220)
COUNT = 6
PLAIN = AugmentOptions(
    scale_sd=0, shift_sd=0, rotation_sd_deg=0, tumble=0, second_person=0, embrace=0, occluder=0, mosaic=0, truncate=0,
    framed=0, loose=0, far=0, crisp=0, close_up=0, clutter=0, plate=1, backdrop=0, dark=0, tinted=0, monochrome=0,
    toned=0, faded=0, faults=False,
)  # fmt: skip


def _fill(planes: np.ndarray, box: tuple[int, ...], colour: int, thing: int = 0) -> None:
    part = planes[:, box[1] : box[3] + 1, box[0] : box[2] + 1]
    part[:3], part[3], part[5] = colour, 255, thing


@pytest.fixture
def scenes(monkeypatch: pytest.MonkeyPatch) -> RenderSet:
    """Somebody behind a table, with somebody else beside them; the last two renders are of the table alone."""
    monkeypatch.setattr("muybridge.train.synthesis.rendering.store.SHARD", COUNT)
    pixels = np.zeros((COUNT, 6, SIZE, SIZE), np.uint8)
    for i in range(COUNT):
        if i < COUNT - 2:
            _fill(pixels[i], SUBJECT, 250)
            _fill(pixels[i], OTHER, 240)
        _fill(pixels[i], THING, 230, 255)
    landmarks = np.full((COUNT, 23, 2), np.nan, np.float32)
    landmarks[:-2] = np.stack([np.full(23, 125), np.linspace(42, 218, 23)], -1)
    visible = landmarks[..., 1] < 150
    box = np.full((COUNT, 4), np.nan, np.float32)
    others = np.full((COUNT, 4, 4), np.nan, np.float32)
    box[:-2], others[:-2, 0] = SUBJECT, OTHER
    shares = np.zeros((COUNT, 4), np.float32)
    shares[:-2, 0] = 1
    kind = np.array(["table"] * (COUNT - 2) + ["things"] * 2)
    return RenderSet([pixels], landmarks, visible, box, others_px=others, others_visible=shares, kind=kind)


def _dark() -> np.ndarray:
    return np.full((2, 3, SIZE, SIZE), 20, np.uint8)


@pytest.mark.parametrize("static", [0.0, 1.0])
def test_things_are_part_of_the_background_model_or_move(scenes, static, monkeypatch) -> None:
    for name in ("STILL", "PARTLY", "GHOST"):
        monkeypatch.setattr(f"muybridge.train.images.background_difference.{name}", 0)
    options = AugmentOptions(**(vars(PLAIN) | {"static_things": static}))
    batch = Compositor(scenes, _dark(), 128, 0, options).batch(16)
    bright = batch.image[:, 0].numpy() > 225
    difference = batch.difference[:, 0].numpy()
    at = batch.landmarks_px.numpy().round().astype(int)
    columns = at[:, 0, 0]
    for i in range(16):
        column = difference[i, :, columns[i]]
        head, legs = column[at[i, 2, 1] : at[i, 8, 1]].mean(), column[at[i, 16, 1] : at[i, 21, 1]].mean()
        assert bright[i, at[i, 18, 1], columns[i]]  # the table is in front of the legs
        assert head > 60 and (legs < 0.4 * head if static else legs > 0.6 * head)
    assert batch.visible[:, :10].all() and not batch.visible[:, 16:].any()
    assert np.isfinite(batch.landmarks_px.numpy()).all()  # nobody is asked for where things are alone


def test_pictures_end_where_a_render_cuts_something_off(scenes) -> None:
    _fill(scenes.pixels[0][0], (60, 200, 149, SIZE - 1), 230, 255)
    assert touched_sides(scenes.pixels_of(0)).tolist() == [False, False, False, True]
    options = AugmentOptions(**(vars(PLAIN) | {"padding": 2.2}))
    compositor = Compositor(scenes, _dark(), 128, 0, options)
    ends, goes_on = compositor.batch(1, np.array([0])).image[0], compositor.batch(1, np.array([1])).image[0]
    assert (ends[:, -4:] == 0).all() and (goes_on[:, -4:] > 0).all()


def test_detector_gets_everybody_of_a_render_and_no_boxes_of_things(scenes, monkeypatch) -> None:
    for name in ("STILL", "PARTLY", "GHOST", "NEAR_SHARE", "CAST_SHARE", "MOVED_SHARE", "HELD_SHARE", "LIT_SHARE",
                 "CLOSE_SHARE", "BEFORE_SHARE"):  # fmt: skip
        monkeypatch.setattr(detector, name, 0)
    monkeypatch.setattr(detector, "THINGS_SHARE", 1)
    compositor = SceneCompositor(scenes, make_backgrounds(4, SIZE, 0), 0, 1.0)
    layer = layer_of_render(scenes, 0, 90.0, (192, 320), 900.0)
    assert layer is not None
    np.testing.assert_allclose(layer.boxes[0], (np.array(SUBJECT) - [60, 40] * 2 + 0.5) / 2 - 0.5, atol=1e-3)
    np.testing.assert_allclose(layer.mirrored().boxes[1, [0, 2]], layer.pixels.shape[1] - 1 - layer.boxes[1, [2, 0]])
    monkeypatch.setattr(SceneCompositor, "_occluder", lambda *_: None)
    monkeypatch.setattr(compositor, "whole", compositor.scenes)  # of which there are none alone
    people, none, crowded = 0, 0, 0
    for _ in range(30):
        frame, plate, boxes, _ = compositor._scene(192, 320)
        assert frame.shape == plate.shape == (192, 320, 3)
        people += len(boxes)
        none += not len(boxes) and bool((frame > 225).all(-1).sum() > 50)
        crowded += len(boxes) >= 2
        for left, top, right, bottom in np.round(boxes).astype(int):
            part = frame[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
            assert (part > 215).all(-1).mean() > 0.5
    assert people > 50 and crowded > 15 and none >= 1
    assert compositor.batch(4, (192, 320)).image.shape == (4, 4, 192, 320)


def test_layers_that_a_render_cuts_off_reach_the_borders(scenes) -> None:
    _fill(scenes.pixels[0][0], (0, 200, SIZE - 1, 220), 230, 255)
    layer = layer_of_render(scenes, 0, 40.0, (192, 320), 900.0)
    assert layer is not None and layer.cut.tolist() == [True, False, True, False]
    for wish in (-500, 0, 500):
        x, y = layer.at_borders(np.array([wish, 17]), 192, 320)
        assert x <= 0 and x + layer.pixels.shape[1] >= 320 and y == 17
    assert layer_of_render(scenes, 0, 40.0, (192, 320), 100.0) is None


def test_shares_of_scenes_in_what_is_drawn() -> None:
    mixed = mix_scenes(np.array([0.1, 0.3, 0.2, 0.2, 0.2]), np.arange(4), np.array([2, 3]), 0.75)
    np.testing.assert_allclose(mixed, [0.0625, 0.1875, 0.375, 0.375, 0])
    np.testing.assert_allclose(mix_scenes(np.full(3, 1 / 3), np.arange(3), np.arange(0), 0.5), 1 / 3)


def test_several_stores_follow_one_another(store) -> None:
    one = load_renders(store, range(1))
    both = load_stores([store, store], range(1))
    assert len(both) == 2 * len(one) and len(both.pixels) == 2
    np.testing.assert_array_equal(both.pixels_of(len(one) + 3), one.pixels_of(3))
    np.testing.assert_array_equal(both.box_px[len(one) :], one.box_px)
