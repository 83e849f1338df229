"""Clothes cover the skin, do not change labels, and depend only on the seed."""

import dataclasses

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")
pytest.importorskip("moderngl")

from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES  # noqa: E402
from muybridge.train.synthesis.clothing import fabrics, garments  # noqa: E402
from muybridge.train.synthesis.clothing.sample import KINDS, Outfit, bare_outfit, sample_outfit  # noqa: E402
from muybridge.train.synthesis.rendering.labels import LUMA  # noqa: E402
from muybridge.train.synthesis.rendering.store import sample_view  # noqa: E402

PEOPLE = 6
SKIN = (0.0, 1.0, 0.0)  # no cloth of these tests is green
EVEN = {
    "light_colour": (0.0, 0.0, 0.0), "fill_colour": (0.0, 0.0, 0.0), "ambient_up": (0.7,) * 3,
    "ambient_down": (0.7,) * 3,
}  # fmt: skip


@pytest.fixture(scope="module")
def people(body):
    """Bodies in poses that bend clothes most."""
    body.rng = body.poses.rng = np.random.default_rng(7)
    poses = body.poses.sample(PEOPLE, kinds=("crouch", "sit", "kick", "reach", "crawl"))
    return body.pose(poses.rotvec, body.sample_phenotypes(PEOPLE), poses.kinds)


def suit(seed: int) -> Outfit:
    """All skin but head and hands under grey cloth, skin and nothing else green."""
    outfit = sample_outfit(np.random.default_rng(seed), 0.0, "suit")
    grey = {k: (0.3, 0.3, 0.3) for k in outfit.values if k.endswith(("_a", "_b", "_c")) or k == "shoe_colour"}
    plain = {"skin": SKIN, "hair_colour": (0.3, 0.3, 0.3), "sole_colour": (0.3,) * 3, "glove": 9.0, "shoe_top": -0.74,
             "print_layer": -1, "straps": 0, "covered": 0, "beard": 0}  # fmt: skip
    parts = frozenset({"shirt", "trousers", "shoes"})
    return Outfit("suit", parts, outfit.light, outfit.values | grey | EVEN | plain, (), (0, 0))


def green(rgba: np.ndarray) -> np.ndarray:
    colour = rgba.astype(int)
    return (colour[..., 3] > 0) & (colour[..., 1] > colour[..., 0] + 40) & (colour[..., 1] > colour[..., 2] + 40)


def poking(renderer, people, i: int, outfit: Outfit, bare: np.ndarray) -> float:
    """Share of the person's pixels that are green and farther than 4 px from where the vertices `bare` project."""
    view = sample_view(people.vertices[i], np.random.default_rng(i))
    renderer.load(people.vertices[i])
    shot = renderer.render(view, outfit, people.landmarks[i])
    px, _ = view.project(people.vertices[i][:BODY_VERTICES][bare])
    allowed = np.zeros((view.height + 8, view.width + 8), bool)
    x, y = np.round(px).astype(int).T
    inside = (x >= 0) & (x < view.width) & (y >= 0) & (y < view.height)
    for dx in range(-4, 5):
        for dy in range(-4, 5):
            allowed[y[inside] + dy + 4, x[inside] + dx + 4] = True
    shown = green(shot.rgba)
    assert shown.any()
    return float((shown & ~allowed[4:-4, 4:-4]).sum() / (shot.rgba[..., 3] > 0).sum())


def test_no_skin_pokes_through_clothes(renderer, people):
    """Skin shows at head and hands alone: nowhere nearer to the projected trunk, arms, legs than to those."""
    rest, arm = renderer.body.rest[:BODY_VERTICES], renderer.body.arm_weight[:BODY_VERTICES] > 0.5
    bare = (rest[:, 2] > 0.55) & ~arm | (arm & (np.abs(rest[:, 0]) > 0.39))
    assert max(poking(renderer, people, i, suit(i), bare) for i in range(PEOPLE)) <= 0.002


def test_trousers_do_not_poke_through_the_shirt(body, renderer):
    """However wide they are under a tight shirt that hangs over them: it is seen as if they were not there."""
    body.rng = body.poses.rng = np.random.default_rng(8)
    poses = body.poses.sample(4, kinds=("stand",))
    batch = body.pose(poses.rotvec, body.sample_phenotypes(4), poses.kinds)
    values = {"hem": 0.0, "waist": 0.17, "puff_trousers": 0.02, "drape_trousers": 1.2, "bulge": 0.03, "fold_depth": 0.0,
              "trousers_style": 0, "shirt_style": 0, "skin": (0.3,) * 3}  # fmt: skip
    values |= {f"trousers_{c}": SKIN for c in "abc"} | {f"shirt_{c}": (0.0, 0.0, 1.0) for c in "abc"}
    for i in range(4):
        renderer.load(batch.vertices[i])
        view = sample_view(batch.vertices[i], np.random.default_rng(i))
        wide = dataclasses.replace(suit(i), values=suit(i).values | values)
        without = dataclasses.replace(wide, parts=wide.parts - {"trousers"})
        dressed, bare = (renderer.render(view, o, batch.landmarks[i]).rgba.astype(int) for o in (wide, without))
        shirt = (bare[..., 2] > bare[..., 1] + 40) & (bare[..., 3] == 255)
        assert shirt.sum() > 500 and green(dressed).sum() > 500
        inner = cv2.erode(shirt.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0  # within its outline and hem
        assert (inner & green(dressed)).sum() <= 0.002 * inner.sum()


def test_clothes_do_not_move_labels(renderer, people):
    rng = np.random.default_rng(1)
    for i in range(3):
        renderer.load(people.vertices[i])
        view = sample_view(people.vertices[i], rng)
        bare = renderer.render(view, bare_outfit(np.random.default_rng(i)), people.landmarks[i])
        for seed in range(4):
            dressed = renderer.render(view, sample_outfit(np.random.default_rng(seed), 1.0), people.landmarks[i])
            for name in ("landmarks_px", "box_px", "markers_px"):
                np.testing.assert_array_equal(getattr(bare, name), getattr(dressed, name))
        np.testing.assert_array_equal(bare.landmarks_px, view.project(people.landmarks[i])[0].astype(np.float32))


def test_the_same_seed_gives_the_same_pixels(renderer, people):
    def draw(seed: int) -> list[np.ndarray]:
        rng = np.random.default_rng(seed)
        renderer.load(people.vertices[0])
        view = sample_view(people.vertices[0], rng)
        return [renderer.render(view, sample_outfit(rng, 1.0), people.landmarks[0]).rgba for _ in range(6)]

    for first, second in zip(draw(3), draw(3), strict=True):
        np.testing.assert_array_equal(first, second)
    assert any((a != b).any() for a, b in zip(draw(3), draw(4), strict=True))


def test_exposure_keeps_people_visible(renderer, people):
    """Exposure keeps the person's mean luma in range, however dark skin, clothes and light are."""
    rng = np.random.default_rng(2)
    lumas = []
    for i in range(24):
        renderer.load(people.vertices[i % PEOPLE])
        outfit = sample_outfit(rng, float(i % 2))
        if i % 4 == 0:
            black = {k: (0.005,) * 3 for k in outfit.values if k.endswith(("_a", "_b", "_c", "_colour"))}
            outfit = dataclasses.replace(outfit, values=outfit.values | black | {"skin": (0.02,) * 3})
        shot = renderer.render(sample_view(people.vertices[i % PEOPLE], rng), outfit, people.landmarks[i % PEOPLE])
        person = shot.rgba[shot.rgba[..., 3] > 0, :3]
        lumas.append(float(person.mean(0) @ [0.299, 0.587, 0.114]))
    assert min(lumas) > 0.8 * LUMA[0]
    assert max(lumas) < 1.05 * LUMA[1]
    assert np.ptp(lumas) > 40  # dark people remain darker than light ones


def test_every_kind_of_outfit_has_its_garments():
    kinds = [sample_outfit(np.random.default_rng(s), s % 2).kind for s in range(200)]
    assert set(kinds) == set(KINDS)
    for seed in range(60):
        suit_ = sample_outfit(np.random.default_rng(seed), seed % 2, "suit")
        assert {"shirt", "trousers"} <= suit_.parts
        assert len(suit_.accessories) <= garments.SLOTS
        man = sample_outfit(np.random.default_rng(seed), 0.0, "no_shirt")
        assert "shirt" not in man.parts


def test_accessories_follow_the_head(renderer, people):
    """A grid of points on the head at rest lies where the head is, turned and scaled with it."""
    anchors = garments.Anchors(renderer.body.rest, renderer.body.arm_weight, BODY_VERTICES)
    rest = renderer.body.rest
    head = np.nonzero(renderer.body.is_head[:BODY_VERTICES] > 0.5)[0][::40]
    item = garments.Accessory("head", rest[head][None].astype(float), (0.5, 0.5, 0.5))
    for i in range(PEOPLE):
        found = anchors.carry(item, people.vertices[i])
        gap = np.linalg.norm(found - people.vertices[i][head], axis=1)
        assert np.median(gap) < 0.01  # heads differ in shape, not only in size


def test_hanging_accessories_stay_upright(renderer, people):
    anchors = garments.Anchors(renderer.body.rest, renderer.body.arm_weight, BODY_VERTICES)
    column = np.array([[[-0.435, -0.25, 0.175 - k] for k in (0.0, 0.2)]])
    for i in range(PEOPLE):
        top, bottom = anchors.carry(
            garments.Accessory("right_hand", column, (0.5,) * 3, frozen=1.0), people.vertices[i]
        )
        fall = (bottom - top) / np.linalg.norm(bottom - top)
        assert fall[2] < -0.999


def test_textures_tile_and_are_seeded():
    folds, patterns, prints = fabrics.make_folds(), fabrics.make_patterns(), fabrics.make_prints()
    np.testing.assert_array_equal(folds, fabrics.make_folds())
    assert len(patterns) == len(fabrics.PATTERNS) and len(folds) == len(fabrics.FOLDS)
    assert len(prints) == 3 * len(fabrics.PRINTS)
    height = folds[0, ..., 2].astype(int)
    inner, seam = np.abs(np.diff(height, axis=0)).mean(), np.abs(height[0] - height[-1]).mean()
    assert seam < 2 * inner
    cover = prints[..., 0].mean((1, 2)) / 255
    assert ((cover > 0.005) & (cover < 0.8)).all()
