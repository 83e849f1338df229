"""Scenes of several people and things in one render, and shards of them."""

import pathlib
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")
pytest.importorskip("moderngl")

from muybridge.errors import SessionError  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel  # noqa: E402
from muybridge.train.synthesis.clothing.sample import sample_outfit  # noqa: E402
from muybridge.train.synthesis.rendering import scene_shards, store  # noqa: E402
from muybridge.train.synthesis.rendering.framing import sample_view  # noqa: E402
from muybridge.train.synthesis.rendering.renderer import Renderer  # noqa: E402
from muybridge.train.synthesis.rendering.scene_renderer import SceneRenderer  # noqa: E402
from muybridge.train.synthesis.rendering.thing_buffers import corners  # noqa: E402
from muybridge.train.synthesis.rendering.view import View, look_at  # noqa: E402
from muybridge.train.synthesis.things.scene import Posed, Scene, Thing  # noqa: E402
from muybridge.train.synthesis.things.together import TOGETHER  # noqa: E402

SIDE = 128
TRUNK = [BODY23.index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "hip")]


def box(low: list[float], high: list[float]) -> Thing:
    """A box between two corners, faces outwards."""
    unit = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])
    vertices = (np.array(low) + unit * (np.array(high) - np.array(low))).astype(np.float32)
    return Thing("box", vertices, faces, np.full((12, 3), 0.5, np.float32), np.zeros(12, int), np.zeros(12, np.float32))


@pytest.fixture(scope="module")
def scenes(renderer: Renderer) -> SceneRenderer:
    return SceneRenderer(renderer)


@pytest.fixture(scope="module")
def person(body: BodyModel) -> Posed:
    """A person who stands and faces -y."""
    poses = np.zeros((1, len(body.bones), 3))
    body.rng = np.random.default_rng(2)
    batch = body.pose(poses, body.sample_phenotypes(1), np.zeros(1, int))
    return Posed(batch.vertices[0], batch.landmarks[0], float(batch.gender[0]))


@pytest.fixture(scope="module")
def front() -> View:
    """From 4 m before the person, who fills most of the image."""
    pose = look_at(np.array([0.0, -4.0, 1.2]), np.array([0.0, 0.0, 0.9]))
    return View(pose, 200.0, ((SIDE - 1) / 2,) * 2, SIDE, SIDE)


def moved(person: Posed, x: float, y: float) -> Posed:
    by = np.array([x, y, 0], np.float32)
    return replace(person, vertices=person.vertices + by, landmarks=person.landmarks + by)


def outfits(count: int) -> list:
    return [sample_outfit(np.random.default_rng(k), k % 2, "suit") for k in range(count)]


def test_a_person_alone_looks_as_without_a_scene(
    renderer: Renderer, scenes: SceneRenderer, person: Posed, front: View
) -> None:
    outfit = outfits(1)[0]
    renderer.load(person.vertices)
    alone = renderer.render(front, outfit, person.landmarks)
    scenes.load(Scene("alone", (person,)))
    render = scenes.render(front, [outfit])
    for name in ("rgba", "shadow", "landmarks_px", "visible", "box_px", "markers_px", "markers_visible"):
        np.testing.assert_array_equal(getattr(render, name), getattr(alone, name), name)
    assert not render.things.any() and np.isnan(render.others_px).all() and not render.others_visible.any()


def test_a_thing_hides_what_is_behind_it(scenes: SceneRenderer, person: Posed, front: View) -> None:
    scenes.load(Scene("alone", (person,)))
    before = scenes.render(front, outfits(1))
    assert before.visible[TRUNK].all()
    for y, hides in ((-0.6, True), (0.6, False)):
        scenes.load(Scene("table", (person,), (box([-0.6, y - 0.1, 0.6], [0.6, y + 0.1, 1.05]),)))
        render = scenes.render(front, outfits(1))
        hips = [BODY23.index("left_hip"), BODY23.index("right_hip")]
        assert (~render.visible[hips]).all() == hides and render.visible[TRUNK[0]]
        assert (render.markers_visible.sum() < before.markers_visible.sum()) == hides
        np.testing.assert_array_equal(render.landmarks_px, before.landmarks_px)
        np.testing.assert_array_equal(render.box_px, before.box_px)
        assert (render.things > 250).sum() > 400 and (render.things <= render.rgba[..., 3]).all()
        assert (render.shadow > 0).sum() > (before.shadow > 0).sum()
        x, y_px = np.round(render.landmarks_px[hips[0]]).astype(int)
        assert (render.things[y_px, x] > 0) == hides


@pytest.mark.parametrize("subject", [0, 1])
def test_the_nearer_person_hides_the_other(scenes: SceneRenderer, person: Posed, front: View, subject: int) -> None:
    people = (person, moved(person, 0.05, -0.7))
    scenes.load(Scene("queue", people))
    render = scenes.render(front, outfits(2), subject)
    assert render.visible[TRUNK].all() == (subject == 1)
    assert not render.things.any()
    # The other's box, and how much of the other is seen.
    px, _ = front.project(people[1 - subject].vertices[:BODY_VERTICES])
    np.testing.assert_allclose(render.others_px[0], [*px.min(0), *px.max(0)], atol=1e-3)
    assert np.isnan(render.others_px[1:]).all() and not render.others_visible[1:].any()
    assert render.others_visible[0] > 0.9 if subject == 0 else render.others_visible[0] < 0.3
    # As the pixels say: those of both, less those of the nearer one, of those of the other alone.
    alone = []
    for one in people:
        scenes.load(Scene("alone", (one,)))
        alone.append(int((scenes.render(front, outfits(1), 0).rgba[..., 3] > 127).sum()))
    both = int((render.rgba[..., 3] > 127).sum())
    share = 1.0 if subject == 0 else (both - alone[1]) / alone[0]
    assert abs(render.others_visible[0] - share) < 0.1


def test_a_scene_without_people_has_no_labels_of_them(scenes: SceneRenderer, front: View) -> None:
    scenes.load(Scene("things", (), (box([-0.3, -0.3, 0.0], [0.3, 0.3, 0.8]),)))
    render = scenes.render(front, outfits(1))
    assert render.rgba[..., 3].any() and (render.things == render.rgba[..., 3]).all()
    assert np.isnan(render.landmarks_px).all() and np.isnan(render.box_px).all() and not render.visible.any()
    assert np.isnan(render.markers_px).all() and not render.markers_visible.any()


def test_boxes_have_edges_and_tubes_are_round() -> None:
    table = corners(box([0, 0, 0], [1, 2, 3]))
    assert table.shape == (36, 11)
    np.testing.assert_allclose(np.abs(table[:, 3:6]).max(1), 1, atol=1e-6)
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    vertices = np.concatenate([np.c_[ring, np.zeros(24)], np.c_[ring, np.ones(24)]])
    i, j = np.arange(24), np.roll(np.arange(24), -1)
    faces = np.concatenate([np.stack([i, j, j + 24], 1), np.stack([i, j + 24, i + 24], 1)])
    tube = Thing("tube", vertices, faces, np.ones((48, 3)), np.zeros(48, int), np.zeros(48))
    table = corners(tube)
    outwards = (table[:, 3:5] * table[:, :2]).sum(1)
    assert (outwards > 0.99).all() and np.abs(table[:, 5]).max() < 1e-6


def test_unusual_views_look_from_above_from_below_and_from_near(person: Posed) -> None:
    body = person.vertices[:BODY_VERTICES].astype(float)
    center = (body.min(0) + body.max(0)) / 2
    reach = np.linalg.norm(body - center, axis=1).max()
    elevations, distances = [], []
    for seed in range(60):
        view = sample_view(person.vertices, np.random.default_rng(seed), 256, 1.2, 1.0)
        eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
        px, depth = view.project(body)
        assert eye[2] > 0 and depth.min() > 0.1 and px.min() > 0 and px.max() < 255
        elevations.append(np.degrees(np.arcsin((eye - center)[2] / np.linalg.norm(eye - center))))
        distances.append(np.linalg.norm(eye - center) / reach)
    assert max(elevations) > 70 and min(elevations) < -15 and min(distances) < 1.5
    usual = sample_view(person.vertices, np.random.default_rng(1))
    again = sample_view(person.vertices, np.random.default_rng(1), unusual=0.0)
    np.testing.assert_array_equal(usual.cam_from_world, again.cam_from_world)


def test_the_hidden_share_is_that_of_whom_others_cover(person: Posed, front: View) -> None:
    people = [p.vertices[:BODY_VERTICES:3] for p in (person, moved(person, 0, -0.8), moved(person, 2.5, 0))]
    behind, before, aside = scene_shards.hidden_shares(people, front)
    assert behind > 0.7 and before < 0.1 and aside == 0


def test_kinds_of_scene_are_named_by_group_or_one_by_one() -> None:
    assert scene_shards.scene_kinds(["together"]) == tuple(TOGETHER)
    assert scene_shards.scene_kinds(["hug", "alone"]) == ("hug", "alone")
    assert set(TOGETHER) < set(scene_shards.scene_kinds(["all"])) and scene_shards.scene_kinds([]) == ()
    with pytest.raises(SessionError, match=r"unknown kind of scene hugs; known are all, .*together.*, hug"):
        scene_shards.scene_kinds(["hugs"])


@pytest.mark.parametrize("kind", TOGETHER)
def test_people_together_touch_and_stand_on_the_floor(body: BodyModel, kind: str) -> None:
    rng = np.random.default_rng(4)
    body.rng = body.poses.rng = rng
    scene = TOGETHER[kind](body, rng)
    assert scene.kind == kind and 2 <= len(scene.people) <= 4
    skins = [p.vertices[:BODY_VERTICES] for p in scene.people]
    lowest = min(skin[:, 2].min() for skin in skins)
    assert -0.03 < lowest < 0.03
    trunks = [p.landmarks[TRUNK].mean(0) for p in scene.people]
    for i, a in enumerate(trunks):
        assert np.isfinite(scene.people[i].landmarks).all()
        for b in trunks[i + 1 :]:
            assert 0.12 < np.linalg.norm(a - b) < 2.2
    if kind != "crowd":  # somebody touches somebody
        from scipy.spatial import cKDTree

        assert cKDTree(skins[0]).query(skins[1])[0].min() < 0.12


def test_shards_of_scenes_are_seeded_and_read_beside_others(
    tmp_path: pathlib.Path, body: BodyModel, renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "SHARD", 3)
    for folder in ("once", "again"):
        (tmp_path / folder).mkdir()
        maker = store._ShardMaker(tmp_path / folder, 3, (), False, ("handshake",))
        maker.__dict__["_equipment"] = (body, renderer)
        maker.make(1)
    first = np.load(tmp_path / "once" / "renders-00001.npy")
    assert first.shape == (3, 6, 256, 256)
    np.testing.assert_array_equal(first, np.load(tmp_path / "again" / "renders-00001.npy"))
    labels = np.load(tmp_path / "once" / "renders-00001.npz")
    # A shard without things, as older versions wrote it.
    np.save(tmp_path / "once" / "renders-00000.npy", first[:, :5])
    np.savez(tmp_path / "once" / "renders-00000.npz", **{k: labels[k] for k in ("landmarks_px", "visible", "box_px")})
    renders = store.load_renders(tmp_path / "once")
    assert len(renders) == 6 and list(renders.kind) == [""] * 3 + ["handshake"] * 3
    for i in range(3):
        np.testing.assert_array_equal(renders.pixels_of(i)[:5], renders.pixels_of(3 + i)[:5])
    assert renders.pixels_of(1).shape == (6, 256, 256) and not renders.pixels_of(1)[5].any()
    assert np.isfinite(renders.others_px[3:, 0]).all() and np.isnan(renders.others_px[:3]).all()
    assert len(renders.whole) == 6 and not len(renders.unattended)


def test_scenes_exclude_kinds_of_motion(tmp_path: pathlib.Path) -> None:
    with pytest.raises(SessionError, match="neither kinds of motion nor close-ups"):
        store.make_renders(tmp_path, range(3), 3, close_ups=True, scenes=["hug"])
