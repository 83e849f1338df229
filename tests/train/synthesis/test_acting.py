"""Acted scenes: hands and feet stay where they hold and stand, things move with them, pictures fit the truth."""

import numpy as np
import pytest

from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things import shapes
from muybridge.train.synthesis.things.built import Built, pivot, spot

PAINT = shapes.Surface((0.5, 0.2, 0.1))
TIMES = np.arange(0.0, 4.5, 0.5)


def _landmarks(scenes, person=0):
    return np.stack([s.people[person].landmarks for s in scenes]).astype(float)


def _of(points, name):
    return points[:, BODY23.index(name)]


def _act(body, name, times=TIMES):
    from muybridge.train.synthesis.acting.acts import ACTS

    return ACTS[name](body, np.random.default_rng(3), times)


def _distance(thing, point):
    """Metres from a point to the nearest vertex of a thing."""
    return float(np.linalg.norm(thing.vertices_world - point, axis=1).min())


def test_crank_carries_a_pedal_that_keeps_its_direction():
    arm, pedal = shapes.box((0.1, 0.1, 1), (0, 0, 0.5), PAINT), shapes.box((0.2, 0.1, 0.02), (0, 0, 1), PAINT)
    turning = pivot([], [arm, pedal], (0, 0, 0))
    pivots = {"crank": turning, "pedal": pivot([arm], [pedal], (0, 0, 1))}
    pivots["crank"] = type(turning)(turning.at, turning.axis, turning.vertices, ("pedal",))
    made = Built("crank", shapes.join(arm, pedal), {"pedal": spot((0, 0, 1.01))}, pivots)
    moved = made.placed(90, (3, 0, 0)).spun("crank", 90).spun("pedal", -90)
    # At heading 90 the axle is along y, and a turn of 90 degrees brings what was above to the front at +x.
    np.testing.assert_allclose(moved.spots["pedal"].at, [4, 0, 0.01], atol=1e-9)
    level = shapes.box((0.2, 0.1, 0.02), (0, 0, 0), PAINT).turned(rot(2, 90)).moved((4, 0, 0))
    np.testing.assert_allclose(moved.mesh.vertices[pivots["pedal"].vertices], level.vertices, atol=1e-9)


def test_feet_stay_on_pedals_that_go_round(body):
    scenes = _act(body, "cyclist", np.arange(0, 0.8, 0.1))
    points = _landmarks(scenes)
    for side in ("left", "right"):
        toe = _of(points, f"{side}_big_toe")
        assert np.ptp(toe[:, 2]) > 0.25  # the crank is 0.15 to 0.18 m long
        assert max(_distance(s.things[0], p) for s, p in zip(scenes, toe, strict=True)) < 0.12
    assert np.ptp(_of(points, "left_wrist"), axis=0).max() < 0.03
    assert np.ptp(scenes[0].things[0].vertices_world - scenes[2].things[0].vertices_world) > 0.2


def test_wheelchair_rolls_under_its_user(body):
    scenes = _act(body, "wheelchair")
    points = _landmarks(scenes)
    chair = np.stack([s.things[0].vertices_world.mean(0) for s in scenes])
    assert np.linalg.norm(chair[-1] - chair[0]) == pytest.approx(1.3, abs=0.05)
    seat = (_of(points, "left_hip") + _of(points, "right_hip")) / 2 - chair
    assert np.ptp(seat, axis=0).max() < 0.06
    pushing = (TIMES > 0.35) & (TIMES < 0.95) | (TIMES > 1.6) & (TIMES < 2.2)
    for t in np.flatnonzero(pushing):
        assert _distance(scenes[t].things[0], _of(points, "left_wrist")[t]) < 0.13
    assert _of(points, "right_wrist")[8, 2] > _of(points, "right_wrist")[0, 2] + 0.3


def test_therapist_keeps_hold_of_the_leg(body):
    scenes = _act(body, "therapist")
    patient, therapist = _landmarks(scenes), _landmarks(scenes, 1)
    moved = {s: np.ptp(_of(patient, f"{s}_knee"), axis=0).max() for s in ("left", "right")}
    near = max(moved, key=lambda s: moved[s])
    assert moved[near] > 0.25 > 0.01 > min(moved.values())
    for joint in ("knee", "ankle"):
        gaps = [np.linalg.norm(_of(therapist, f"{s}_wrist") - _of(patient, f"{near}_{joint}"), axis=1) for s in moved]
        assert np.min(gaps, axis=0).max() < 0.22
    assert np.ptp(_of(therapist, "left_heel"), axis=0).max() < 0.02


def test_cup_goes_from_hand_to_hand(body):
    times = np.array([0.95, 1.4, 1.85, 2.55, 3.0, 3.5])
    scenes = _act(body, "table", times)
    cups = np.stack([s.things[-1].vertices_world.mean(0) for s in scenes])
    one, two = _landmarks(scenes), _landmarks(scenes, 1)
    assert np.linalg.norm(_of(one, "right_wrist") - cups, axis=1)[:3].max() < 0.16
    assert np.linalg.norm(_of(two, "left_wrist") - cups, axis=1)[3:].max() < 0.16
    assert np.linalg.norm(_of(one, "right_wrist") - cups, axis=1)[-1] > 0.25
    front = [_of(p, "nose")[:, 1] - (_of(p, "left_ear")[:, 1] + _of(p, "right_ear")[:, 1]) / 2 for p in (one, two)]
    assert (np.sign(front[0]) == -np.sign(front[1])).all()


def test_pictures_show_people_where_the_truth_projects(body, renderer):
    from muybridge.train.synthesis.clothing.sample import sample_outfit
    from muybridge.train.synthesis.rendering.multi_person_takes import sample_rig, view_of
    from muybridge.train.synthesis.rendering.scene_renderer import SceneRenderer, share_light
    from muybridge.train.synthesis.rendering.takes import draw_scene

    scene = _act(body, "cyclist", np.array([0.3]))[0]
    rng = np.random.default_rng(1)
    camera = sample_rig(rng, 4, (160, 120), 4.2, 0.9, 2.4).cameras[0]
    plate = np.full((120, 160, 3), 7.0, np.float32)
    outfits = share_light([sample_outfit(rng, p.gender) for p in scene.people])
    picture = draw_scene(SceneRenderer(renderer), plate, view_of(camera), scene, outfits)
    drawn = np.abs(picture - plate).max(2) > 3
    x, y = np.round(camera.project(scene.people[0].landmarks[None].astype(float))[0]).astype(int).T
    assert drawn[y, x].mean() > 0.9
    assert 0.05 < drawn.mean() < 0.6
