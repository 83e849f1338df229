"""Synthetic people: poses, bodies, renders and training images agree with their labels."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.compositor import Compositor  # noqa: E402
from muybridge.train.images.options import WHOLE, AugmentOptions  # noqa: E402
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES  # noqa: E402
from muybridge.train.synthesis.clothing.sample import bare_outfit  # noqa: E402
from muybridge.train.synthesis.rendering.close_ups import cut_boxes, map_cuts  # noqa: E402
from muybridge.train.synthesis.rendering.labels import surface_depth  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE  # noqa: E402
from muybridge.train.synthesis.rendering.takes import choreograph, perform  # noqa: E402
from muybridge.train.synthesis.rendering.view import View, look_at  # noqa: E402


def test_bodies_stand_on_the_floor_and_left_is_left(body):
    body.rng = body.poses.rng = np.random.default_rng(0)
    poses = body.poses.sample(32, kinds=("stand",))
    batch = body.pose(poses.rotvec, body.sample_phenotypes(32), poses.kinds)
    assert np.abs(batch.vertices[:, :BODY_VERTICES, 2].min(1)).max() < 1e-4
    at = {n: batch.landmarks[:, i] for i, n in enumerate(BODY23.names)}
    assert (at["nose"][:, 2] > at["left_hip"][:, 2] + 0.3).all()
    assert (at["left_hip"][:, 0] > at["right_hip"][:, 0]).all()  # +x is the subject's left
    toes = at["left_big_toe"] - at["left_heel"]
    assert np.mean(toes[:, 1] < 0) == 1.0  # faces -y
    assert ((batch.height > 1.0) & (batch.height < 2.3)).all()


def test_body_samples_are_seeded(body):
    def draw():
        body.rng = body.poses.rng = np.random.default_rng(11)
        return body.sample(6)

    first, second = draw(), draw()
    np.testing.assert_array_equal(first.landmarks, second.landmarks)
    assert np.ptp(first.landmarks[:, 0, 2]) > 0.05  # they differ among themselves


def test_view_projects_where_opengl_draws(body, renderer):
    """A vertex that juts out most to the right is where the silhouette ends."""
    body.rng = body.poses.rng = np.random.default_rng(2)
    batch = body.sample(4)
    outfit = bare_outfit(np.random.default_rng(0))
    for i in range(4):
        renderer.load(batch.vertices[i])
        center = batch.vertices[i, :BODY_VERTICES].mean(0).astype(float)
        view = View(look_at(center + [2.5, -3.0, 0.8], center, 0.1), 270.0, (130.0, 118.0), 256, 240)
        shot = renderer.render(view, outfit, batch.landmarks[i])
        rows, columns = np.nonzero(shot.rgba[..., 3])
        drawn = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        assert np.abs(drawn - shot.box_px).max() < 1.5
        assert shot.visible.any()


def test_surface_depth_is_the_median_around_a_point():
    metres = np.full((16, 16), 5.0)
    metres[4:9, 4:9] = 2.0  # something near, in front of a wall
    px = np.array([[6.0, 6.0], [8.2, 7.0], [9.0, 7.0], [8.0, 8.0], [0.0, 3.0]])
    inside, front = surface_depth(px, metres)
    # Behind it; a cell from its edge; beside it; at its corner, of which five of nine pixels show the wall.
    np.testing.assert_array_equal(front[:4], [2.0, 2.0, 5.0, 5.0])
    np.testing.assert_array_equal(inside, [True, True, True, True, False])


def test_visible_landmarks_lie_on_the_person(renders):
    on = []
    for i in range(len(renders)):
        alpha = renders.pixels_of(i)[3]
        at = np.round(renders.landmarks_px[i][renders.visible[i]]).astype(int)
        on.extend(alpha[at[:, 1].clip(0, SIZE - 1), at[:, 0].clip(0, SIZE - 1)] > 0)
    assert len(on) > 200
    assert np.mean(on) > 0.97


PLAIN = replace(
    WHOLE, scale_sd=0, shift_sd=0, rotation_sd_deg=0, tumble=0, second_person=0, occluder=0, mosaic=0, truncate=0
)


def test_crops_have_the_requested_padding(renders):
    compositor = Compositor(renders, make_backgrounds(4, SIZE, 0), 128, 0, PLAIN)
    index = np.arange(16)
    matrix, flip = compositor._placement(renders.box_px[index])
    box = renders.box_px[index]
    side = (box[:, 2:] - box[:, :2]).max(1)
    scale = np.abs(np.linalg.det(matrix[:, :, :2])) ** 0.5
    np.testing.assert_allclose(scale * side, 128 / 1.25, rtol=1e-5)
    middle = np.einsum("nij,nj->ni", matrix[:, :, :2], (box[:, :2] + box[:, 2:]) / 2) + matrix[:, :, 2]
    np.testing.assert_allclose(middle, 63.5, atol=1e-3)
    assert flip.any() and not flip.all()


def test_mirrored_crops_swap_left_and_right(renders):
    """In a mirrored crop the labels keep their sides: a shoulder line that went right to left still does."""
    compositor = Compositor(renders, make_backgrounds(4, SIZE, 0), 128, 1, PLAIN)
    index = np.arange(len(renders))
    matrix, _ = compositor._placement(renders.box_px[index])
    _, as_is, _ = compositor._warp(index, matrix, np.zeros(len(index), bool))
    _, flipped, _ = compositor._warp(index, matrix, np.ones(len(index), bool))
    np.testing.assert_array_equal(flipped[:, BODY23.index("left_knee")], as_is[:, BODY23.index("right_knee")])
    np.testing.assert_array_equal(flipped[:, 0], as_is[:, 0])


def test_labels_follow_pixels_through_the_augmentation(renders):
    """The person's silhouette in the crop covers the visible landmarks after rotation, scale and mirroring."""
    options = AugmentOptions(second_person=0, embrace=0, occluder=0, truncate=0, mosaic=0)
    compositor = Compositor(renders, make_backgrounds(4, SIZE, 0), 128, 2, options)
    index = np.arange(len(renders))
    matrix, flip = compositor._placement(renders.box_px[index])
    person, landmarks, visible = compositor._warp(index, matrix, flip)
    hits = compositor._alpha_at(person[:, 3].numpy(), landmarks)[visible]
    assert np.mean(hits > 0.3) > 0.95


def test_embracing_person_is_behind_or_in_front(renders):
    """Behind, nothing of the subject is lost; before, a part of it is."""

    def seen(**others: float) -> tuple[np.ndarray, np.ndarray]:
        options = replace(PLAIN, clutter=0, faults=False, plate=1, second_person=0, **others)
        batch = Compositor(renders, np.full((2, 3, SIZE, SIZE), 90, np.uint8), 128, 3, options).batch(96)
        return batch.visible.numpy().mean(1), (batch.difference > 20).float().mean((1, 2, 3)).numpy()

    alone, held = seen(), seen(embrace=1.0)
    assert (held[0] < alone[0] - 0.05).mean() > 0.15 and (held[0] > alone[0] - 0.02).mean() > 0.45
    assert held[1].mean() > 1.3 * alone[1].mean()
    assert held[0].mean() > 0.5 * alone[0].mean()


def test_close_ups_frame_the_visible_part(renders):
    rng = np.random.default_rng(0)
    whole = renders.box_px[np.arange(200) % len(renders)]
    boxes, lines = cut_boxes(rng, whole, 1.0)
    kept = np.prod(boxes[:, 2:] - boxes[:, :2], 1) / np.prod(whole[:, 2:] - whole[:, :2], 1)
    assert kept.min() >= 0.29 and kept.max() <= 0.86
    assert ((boxes[:, :2] >= whole[:, :2]) & (boxes[:, 2:] <= whole[:, 2:])).all()
    # A crop map that turns and mirrors: the middle of what is left is on the near side of the cut, the rest beyond.
    turn = np.array([[-0.4, 0.3, 90.0], [0.3, 0.4, 20.0]], np.float32)
    cuts = map_cuts(rng, lines, np.repeat(turn[None], 200, 0), np.zeros(200, bool))

    def beyond(points):
        at = points @ turn[:, :2].T + turn[:, 2]
        return np.einsum("bk,bk->b", at, cuts.line[:, :2]) > cuts.line[:, 2]

    assert not beyond((boxes[:, :2] + boxes[:, 2:]) / 2).any()
    low, high, middle = whole[:, :2], whole[:, 2:], (whole[:, :2] + whole[:, 2:]) / 2
    gone = np.where(boxes[:, :2] > low, low, np.where(boxes[:, 2:] < high, high, middle))
    assert beyond(gone).all()


def test_rendered_close_ups_fill_the_image(close_ups):
    off, beyond = [], []
    for i in range(len(close_ups)):
        # What is left of them fills the picture, in its middle, on this side of the cut.
        box, cut = close_ups.box_px[i], close_ups.cut_px[i]
        low, high = box[:2], box[2:]
        assert abs((high - low).max() - SIZE / 1.375) < 0.15 * SIZE
        assert np.abs((low + high) / 2 - SIZE / 2).max() < 0.1 * SIZE
        assert (np.array([low, high]) @ cut[:2]).max() <= cut[2] + 0.5
        rows, columns = np.nonzero(close_ups.pixels_of(i)[3] > 127)
        kept = np.stack([columns, rows], 1) @ cut[:2] <= cut[2]
        off.append([columns[kept].min() - low[0], columns[kept].max() - high[0]])
        beyond.append((close_ups.landmarks_px[i] @ cut[:2] > cut[2]).mean())
    assert np.median(np.abs(off)) < 5  # clothes, hair and bags reach beyond the body
    assert np.mean(beyond) > 0.2 and len(close_ups.whole) == 0
    batch = Compositor(close_ups, make_backgrounds(4, SIZE, 0), 128, 3, PLAIN).batch(24)
    assert 0.2 < batch.visible.float().mean() < 0.75


def test_parts_beyond_the_border_are_black_and_hidden(renders):
    batch, whole = (
        Compositor(renders, make_backgrounds(4, SIZE, 0), 128, 3, options).batch(64)
        for options in (replace(PLAIN, close_up=1.0), PLAIN)
    )
    assert batch.visible.float().mean() < 0.85 * whole.visible.float().mean()
    at = batch.landmarks_px.numpy().round().astype(int)
    gone = ((at >= 0) & (at < 128)).all(-1) & ~batch.visible.numpy()
    dark = [batch.image[i, :, at[i, j, 1], at[i, j, 0]].max() == 0 for i, j in zip(*np.nonzero(gone), strict=True)]
    assert 0.1 < np.mean(dark) < 0.95


def test_backdrops_tinted_light_and_monochrome_cameras(renders):
    pool = np.random.default_rng(0).integers(0, 255, (4, 3, SIZE, SIZE), np.uint8)
    index = np.flatnonzero(np.isnan(renders.cut_px[:, 0]))[:16]

    def pictures(**options: float) -> np.ndarray:
        made = Compositor(renders, pool, 128, 3, replace(PLAIN, clutter=0, plate=0, **options)).batch(len(index), index)
        return made.image.numpy().astype(float)

    def rough(picture: np.ndarray) -> float:  # of a strip above everybody
        return float(np.abs(np.diff(picture[:, :, :6])).mean())

    assert rough(pictures(faults=False, backdrop=1)) < 0.2 * rough(pictures(faults=False))

    def imbalance(picture: np.ndarray) -> float:
        return float(np.abs(np.log(picture.mean((2, 3)) / picture.mean((1, 2, 3))[:, None])).mean())

    assert imbalance(pictures(tinted=1)) > 2 * imbalance(pictures())
    assert np.ptp(pictures(monochrome=1), axis=1).max() == 0
    assert (np.ptp(pictures(), axis=1).max((1, 2)) > 40).mean() > 0.7


def test_batches_are_seeded(renders):
    pool = make_backgrounds(4, SIZE, 0)
    a, b = (Compositor(renders, pool, 96, 7).batch(8) for _ in range(2))
    assert (a.landmarks_px == b.landmarks_px).all() and (a.visible == b.visible).all()
    assert (a.image == b.image).all()
    assert (a.difference == b.difference).all()
    assert (Compositor(renders, pool, 96, 8).batch(8).image != a.image).any()


def test_background_difference_shows_moving_but_not_static_people(renders, monkeypatch):
    pool = make_backgrounds(4, SIZE, 0)
    whole = np.flatnonzero(np.isnan(renders.cut_px[:, 0]))[:16]
    plain = replace(PLAIN, clutter=0, faults=False)

    def contrast(options, still=0.0):
        """How much more the difference is on the person than around; the crops."""
        for name, share in (("STILL", still), ("PARTLY", 0.0), ("GHOST", 0.0)):
            monkeypatch.setattr(f"muybridge.train.images.background_difference.{name}", share)
        compositor = Compositor(renders, pool, 128, 5, options)
        batch = compositor.batch(len(whole), whole)
        at, seen = batch.landmarks_px.round().long().clamp(0, 127).numpy(), batch.visible.numpy()
        value = batch.difference[np.arange(len(at))[:, None], 0, at[..., 1], at[..., 0]].numpy()
        return float(value[seen].mean()) - float(batch.difference[:, 0, :8].float().mean()), batch

    with_plate, batch = contrast(replace(plain, plate=1.0))
    assert with_plate > 15 and batch.pixels.shape == (len(whole), 4, 128, 128)
    assert abs(contrast(replace(plain, plate=1.0), still=1.0)[0]) < 0.3 * with_plate
    without, other = contrast(replace(plain, plate=0.0))
    assert without == 0 and (other.image == batch.image).all()  # the pictures are the same


def test_a_take_keeps_the_stance_foot(body):
    body.rng = body.poses.rng = np.random.default_rng(4)
    motion = choreograph(body, 1.5, 12.0)
    batch = perform(body, motion)
    assert len(batch.landmarks) == 18
    heel = batch.landmarks[:, BODY23.index("right_heel"), :2]
    assert np.abs(heel - heel[0]).max() < 1e-5
    speed = np.linalg.norm(np.diff(batch.landmarks, axis=0), axis=-1) * 12
    assert 0.1 < speed.max() < 12.0
