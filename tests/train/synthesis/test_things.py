"""Things that people use: sound meshes, on the floor, and people who touch them where they should."""

import numpy as np
import pytest

from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.synthesis.things import shapes
from muybridge.train.synthesis.things.built import MATERIALS, surface
from muybridge.train.synthesis.things.catalogue import THINGS

RNG = np.random.default_rng
# Landmarks by the side of the ankles, the wrists and the hips.
HIPS, ANKLES, WRISTS = ([BODY23.index(f"{s}_{n}") for s in ("left", "right")] for n in ("hip", "ankle", "wrist"))


def _volume(mesh: shapes.Mesh) -> float:
    """Signed volume, positive where faces look outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def _open_edges(mesh: shapes.Mesh) -> int:
    """Directed edges without the opposite one."""
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    numbers = edges[:, 0] * len(mesh.vertices) + edges[:, 1]
    return len(np.setxor1d(numbers, edges[:, 1] * len(mesh.vertices) + edges[:, 0]))


PAINT = shapes.Surface((0.5, 0.2, 0.1))
GRID = np.stack([*np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij"), np.zeros((3, 4))], -1)
SHAPES = {
    "box": (shapes.box((1, 2, 3), (4, 5, 6), PAINT), 6.0),
    "bevelled box": (shapes.box((1, 2, 3), (4, 5, 6), PAINT, 0.02), 6.0),
    "tube": (shapes.tube([(0, 0, 0), (0, 1, 0), (1, 1, 1)], 0.1, PAINT, 16), None),
    "ring": (shapes.tube([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)], 0.1, PAINT, closed=True), None),
    "rod": (shapes.rod((1, 2, 3), (1, 2, 5), 0.5, PAINT, 64), 2 * np.pi * 0.25),
    "capsule": (shapes.capsule((0, 0, 1), (0, 3, 1), (0.2, 0.1), PAINT), None),
    "ellipsoid": (shapes.ellipsoid((1, 2, 3), (3, 0, 0), PAINT, 48), 8 * np.pi),
    "disc": (shapes.disc(1.0, 0.2, (1, 1, 1), PAINT, 48, (1, 0, 0)), 0.2 * np.pi),
    "sheet": (shapes.sheet(GRID, 0.1, PAINT), 0.6),
    "plate": (shapes.prism([(0, 0), (2, 0), (2, 1), (0, 1)], 0.5, PAINT, "yz"), 1.0),
    "plate across": (shapes.prism([(0, 0), (2, 0), (2, 1), (0, 1)], 0.5, PAINT, "xz"), 1.0),
    "beam": (shapes.strut((0, 0, 0), (0, 0, 2), 0.5, 0.25, PAINT), 0.25),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shape_is_closed_and_looks_outward(name):
    mesh, volume = SHAPES[name]
    assert _open_edges(mesh) == 0
    assert _volume(mesh.moved((7, -3, 2))) > 0
    if volume is not None:
        assert _volume(mesh) == pytest.approx(volume, rel=0.05)


def test_mirror_image_still_looks_outward():
    mesh = SHAPES["capsule"][0].mirrored()
    assert _volume(mesh) > 0


@pytest.mark.parametrize("name", MATERIALS)
def test_material_has_a_colour(name):
    made = surface(RNG(1), name)
    assert 0 <= min(made.colour) and max(made.colour) <= 1 and 0 <= made.gloss <= 1


@pytest.mark.parametrize("kind", THINGS)
def test_thing_is_sound_and_on_the_floor(kind):
    for seed in range(3):
        built = THINGS[kind](RNG(seed))
        thing = built.thing()
        assert np.isfinite(thing.vertices_world).all()
        assert thing.faces.min() >= 0 and thing.faces.max() < len(thing.vertices_world)
        assert _open_edges(built.mesh) == 0
        assert thing.colour.min() >= 0 and thing.colour.max() <= 1
        assert thing.pattern.min() >= 0 and thing.pattern.max() <= 5
        assert abs(thing.vertices_world[:, 2].min()) < 0.05
        assert 0.01 < np.ptp(thing.vertices_world, 0).max() < 8
        again = THINGS[kind](RNG(seed)).thing()
        np.testing.assert_array_equal(thing.vertices_world, again.vertices_world)


def test_turned_thing_keeps_its_places():
    built = THINGS["wheelchair"](RNG(2))
    moved = built.placed(90, (1, 2, 0))
    seat, was = moved.spots["seat"], built.spots["seat"]
    np.testing.assert_allclose(seat.at, [1 - was.at[1], 2 + was.at[0], was.at[2]], atol=1e-9)
    np.testing.assert_allclose(seat.axis, [1, 0, 0], atol=1e-9)


def _scene(body, kind, seed):
    from muybridge.train.synthesis.things.uses import USES

    body.rng = body.poses.rng = RNG(seed)
    return USES[kind](body, body.rng)


def _kinds():
    from muybridge.train.synthesis.things import uses

    return list(uses.USES)


@pytest.mark.parametrize("kind", _kinds())
def test_person_with_a_thing_is_not_in_the_floor(body, kind):
    scene = _scene(body, kind, 3)
    assert scene.people and scene.things
    for person in scene.people:
        low = person.vertices[:13380, 2].min()
        assert low > -0.06
        assert np.isfinite(person.landmarks).all()
        # Somebody who uses a thing is beside it, on it or in it.
        assert min(_gap(person.landmarks, t.vertices_world) for t in scene.things) < 0.3


def _gap(points, vertices):
    """Least distance of points from the box around a thing."""
    low, high = vertices.min(0), vertices.max(0)
    return float(np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=1).min())


def test_scene_follows_from_its_seed(body):
    one, two = (_scene(body, "desk", 7) for _ in range(2))
    np.testing.assert_array_equal(one.people[0].vertices, two.people[0].vertices)
    np.testing.assert_array_equal(one.things[1].vertices_world, two.things[1].vertices_world)


@pytest.mark.parametrize("kind", ["chair", "wheelchair", "desk", "bicycle", "motorbike", "horse", "car seat"])
def test_hips_are_over_the_seat(body, kind, monkeypatch):
    from muybridge.train.synthesis.things.using import riding, sitting

    seats = []
    settle, mount = sitting.settle, riding.mount
    monkeypatch.setattr(sitting, "settle", lambda f, seat, *a, **k: (seats.append(seat), settle(f, seat, *a, **k))[1])
    monkeypatch.setattr(riding, "mount", lambda f, seat, *a, **k: (seats.append(seat), mount(f, seat, *a, **k))[1])
    for seed in range(3):
        scene = _scene(body, kind, seed)
        hips = scene.people[0].landmarks[HIPS].mean(0)
        over = hips - seats[-1].at
        assert 0.02 < over[2] < 0.35
        assert np.linalg.norm(over[:2]) < 0.5


def test_feet_and_hands_are_on_pedals_and_bars(body):
    from muybridge.train.synthesis.things.using.figure import Figure
    from muybridge.train.synthesis.things.using.riding import ride_bicycle

    far_hands = []
    for seed in range(6):
        body.rng = body.poses.rng = RNG(seed)
        f = Figure(body, body.rng)
        bike = ride_bicycle(f, rollers=bool(seed % 2))
        for side in "LR":
            rotation, ankle = f.frame("foot." + side)
            ball = ankle + rotation @ (f.sole["ball"] * [1 if side == "L" else -1, 1, 1])
            assert np.linalg.norm(ball - bike.spots["pedal" + side].at) < 0.05
            far_hands.append(np.linalg.norm(f.grip(side)[1] - bike.spots["grip" + side].at))
    # One hand may be elsewhere; the others close about the bar.
    assert np.median(far_hands) < 0.02
    assert np.sort(far_hands)[-3] < 0.06


def test_hand_reaches_where_it_is_sent(body):
    from muybridge.train.synthesis.things.using.figure import Figure

    body.rng = body.poses.rng = RNG(4)
    f = Figure(body, body.rng)
    f.trunk(30.0, lean=10)
    for side, sign in (("L", 1), ("R", -1)):
        shoulder = f.at("upperarm01." + side)
        place = shoulder + 0.45 * f.k * np.array([0.5, -0.7, -0.5])
        assert f.hand(side, place, axis=(1, 0, 0.2 * sign)) < 0.02
        np.testing.assert_allclose(f.grip(side)[1], place, atol=0.02)


def test_foot_tells_what_is_out_of_reach(body):
    from muybridge.train.synthesis.things.using.figure import Figure

    body.rng = body.poses.rng = RNG(4)
    f = Figure(body, body.rng)
    f.trunk()
    assert f.foot("L", (0.1, 0.0, 0.1), 0.0) == 0.0
    assert f.foot("L", (0.1, 0.0, -0.4), 0.0) == pytest.approx(0.4, abs=0.1)


def test_things_alone_have_no_people():
    from muybridge.train.synthesis.things.uses import scene_of_things

    for seed in range(6):
        scene = scene_of_things(RNG(seed))
        assert not scene.people and 1 <= len(scene.things) <= 4
