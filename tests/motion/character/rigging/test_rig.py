"""Skeletons put into figures whose joints are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import MuybridgeError
from muybridge.motion.character.rigging import RIGS, TEMPLATES, RigOptions, rig_mesh
from muybridge.motion.character.rigging.placement.fingers import place_fingers
from muybridge.motion.character.rigging.templates import joint_names
from tests.motion.character.rigging.figures import HEIGHT, animal, capsule, hand, person, together

TURNS = {
    "lying on its back": Rotation.from_euler("x", 90, degrees=True),
    "lying on its side": Rotation.from_euler("y", 90, degrees=True),
    "facing away": Rotation.from_euler("z", 180, degrees=True),
    "turned by 33 degrees": Rotation.from_euler("z", 33, degrees=True),
}


def errors(rig, joints, matrix=None):
    """Role -> share of the height between the joints found and the true ones, which `matrix` moves."""
    matrix = np.eye(4) if matrix is None else matrix
    return {r: float(np.linalg.norm(rig.places[r] - (matrix[:3, :3] @ p + matrix[:3, 3]))) / HEIGHT
            for r, p in joints.items()}  # fmt: skip


@pytest.mark.parametrize("below", [0.0, 40.0, 70.0])
def test_joints_of_a_person(below):
    vertices, triangles, joints = person(below)
    found = errors(rig_mesh(vertices, triangles), joints)
    assert np.mean(list(found.values())) < 0.02
    assert max(found.values()) < 0.04, found


@pytest.mark.parametrize("how", TURNS)
def test_a_body_that_lies_or_faces_elsewhere_is_stood_up_and_turned(how):
    vertices, triangles, joints = person(40.0)
    matrix = np.eye(4)
    matrix[:3, :3] = TURNS[how].as_matrix()
    rig = rig_mesh(vertices @ matrix[:3, :3].T, triangles)
    found = errors(rig, joints, rig.new_from_old @ matrix)
    assert max(found.values()) < 0.06, found
    feet = [rig.places[f"{side}_foot"] for side in ("left", "right")]
    assert feet[0][0] > feet[1][0] and rig.places["head"][2] > rig.places["hips"][2] > feet[0][2]
    assert all(rig.places[f"{side}_toe"][1] < rig.places[f"{side}_foot"][1] for side in ("left", "right"))
    assert len(rig.notices) == 1 and "so it was" in rig.notices[0]


def test_a_body_stays_where_it_is_if_asked():
    vertices, triangles, joints = person(40.0)
    turn = TURNS["facing away"].as_matrix()
    rig = rig_mesh(vertices @ turn.T, triangles, RigOptions(turn=False))
    assert np.array_equal(rig.new_from_old, np.eye(4))
    assert max(np.linalg.norm(rig.places[r] - turn @ p) for r, p in joints.items()) < 0.06 * HEIGHT


def test_faces_that_point_inwards_are_turned_and_reported():
    vertices, triangles, joints = person(40.0)
    rig = rig_mesh(vertices, triangles[:, ::-1])
    assert rig.inside_out and any("inwards" in note for note in rig.notices)
    assert max(errors(rig, joints).values()) < 0.04


def test_holes_duplicates_and_flat_faces_do_no_harm():
    vertices, triangles, joints = person(40.0)
    kept = triangles[np.random.default_rng(0).random(len(triangles)) > 0.02]
    apart = vertices[kept.reshape(-1)]
    broken = np.concatenate([np.arange(len(apart)).reshape(-1, 3), [[0, 0, 1]]])
    rig = rig_mesh(apart, broken)
    assert max(errors(rig, joints).values()) < 0.05
    assert any("without area" in note for note in rig.notices)


def test_two_sides_of_a_symmetric_body_agree():
    vertices, triangles, _ = person(40.0)
    rig = rig_mesh(vertices, triangles)
    for role, place in rig.places.items():
        if role.startswith("left_"):
            other = rig.places["right_" + role.removeprefix("left_")] * [-1, 1, 1]
            assert np.linalg.norm(place - other) < 0.01 * HEIGHT, role


def test_a_prop_in_one_hand_is_rigid_to_it_and_misleads_nothing():
    vertices, triangles, joints = person(0.0)
    hand = joints["right_hand"] + [-0.08, 0, 0]
    sword = capsule(hand + [0, 0.1, 0], hand + [0, -0.9, 0.05], 0.03, 0.02)
    rig = rig_mesh(*together([(vertices, triangles), sword]))
    held = rig.held[len(vertices) :]
    assert (held == rig.roles["right_hand"]).all()
    assert (rig.held[: len(vertices)] == -1).all()
    assert max(errors(rig, joints).values()) < 0.04
    assert any("rigid to right_hand" in note for note in rig.notices)


def test_an_animal_is_refused_as_a_person_and_rigged_as_an_animal():
    vertices, triangles = animal()
    with pytest.raises(MuybridgeError, match="four legs") as raised:
        rig_mesh(vertices, triangles)
    assert raised.value.remedy == "rig_quadruped"
    rig = rig_mesh(vertices, triangles, RigOptions(template="quadruped"))
    assert rig.places["head"][1] < rig.places["chest"][1] < rig.places["hips"][1] < rig.places["tail_1"][1]
    for side, sign in (("left", 1), ("right", -1)):
        chain = [rig.places[f"{side}_{part}"] for part in ("back_thigh", "back_shin", "back_ankle", "back_foot")]
        assert all(a[2] > b[2] for a, b in zip(chain, chain[1:], strict=False))
        assert all(0.05 < sign * p[0] < 0.2 for p in chain)


def test_a_person_is_refused_as_an_animal():
    vertices, triangles, _ = person(40.0)
    with pytest.raises(MuybridgeError, match="four legs"):
        rig_mesh(vertices, triangles, RigOptions(template="quadruped"))


def test_two_bodies_in_one_mesh_are_refused():
    vertices, triangles, _ = person(70.0)
    with pytest.raises(MuybridgeError, match="2 bodies"):
        rig_mesh(*together([(vertices, triangles), (vertices + [1.6, 0, 0], triangles)]))


def test_what_is_no_body_is_refused():
    with pytest.raises(MuybridgeError, match="no body"):
        rig_mesh(*capsule([0, 0, 0], [0, 0, 1], 0.3, 0.3))


def test_an_unknown_template_and_a_rig_without_names_are_refused():
    vertices, triangles, _ = person(40.0)
    with pytest.raises(MuybridgeError, match="valid are human"):
        rig_mesh(vertices, triangles, RigOptions(template="octopus"))
    with pytest.raises(MuybridgeError, match="names of ue5"):
        rig_mesh(vertices, triangles, RigOptions(template="quadruped", rig="ue5"))


@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_are_trees_with_names_of_their_own(name):
    template = TEMPLATES[name]
    seen = [""]
    for role, parent in template.parents.items():
        assert parent in seen
        seen.append(role)
    for rig in RIGS:
        names = joint_names(template, rig)
        assert len(set(names)) == len(names) == len(template.roles)


def test_five_fingers_are_told_apart():
    vertices, triangles, wrist, tip, fingers = hand()
    found, seen = place_fingers(vertices, triangles, wrist, tip, np.array([0.0, -1.0, 0.0]))
    assert seen
    for finger, (knuckle, end) in fingers.items():
        joints = np.stack([found[f"{finger}_{k}"] for k in (1, 2, 3)])
        line = end - knuckle
        share = (joints - knuckle) @ line / (line @ line)
        off = np.linalg.norm(joints - knuckle - share[:, None] * line, axis=1)
        assert off.max() < 0.015 and (np.diff(share) > 0.15).all() and share[0] < 0.3 and 0.5 < share[2] < 0.95, finger


def test_a_closed_hand_gets_usual_fingers_with_the_thumb_ahead():
    vertices, triangles = capsule([0, 0, 0], [0.15, 0, 0], 0.03, 0.03)
    found, seen = place_fingers(vertices, triangles, np.zeros(3), np.array([0.18, 0, 0]), np.array([0.0, -1.0, 0.0]))
    assert not seen and len(found) == 15
    assert found["thumb_3"][1] < found["index_3"][1] < found["little_3"][1]


def test_a_person_without_fingers_gets_their_joints_and_a_notice():
    vertices, triangles, _ = person(0.0)
    rig = rig_mesh(vertices, triangles, RigOptions(template="human-with-fingers", rig="ue5"))
    assert "index_03_l" in rig.names and any("not apart" in note for note in rig.notices)
    assert np.linalg.norm(rig.places["left_index_1"] - rig.places["left_hand"]) < 0.15 * HEIGHT
