"""Skeletons put into figures whose joints are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.motion.character.rigging import RigOptions, rig_mesh
from tests.motion.character.rigging.figures import HEIGHT, capsule, person, together

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


def test_a_mesh_of_two_sides_is_rigged_as_one_of_one_side():
    vertices, triangles, joints = person()
    both = rig_mesh(*together([(vertices, triangles), (vertices, triangles[:, ::-1])]))
    one = rig_mesh(vertices, triangles)
    assert max(np.linalg.norm(both.places[r] - one.places[r]) for r in one.places) < 1e-6 * HEIGHT
    assert not both.inside_out


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


def test_strands_of_hair_are_no_arms():
    vertices, triangles, joints = person(70.0)
    angles = np.linspace(0.3, 2 * np.pi + 0.3, 18, endpoint=False)
    roots = np.stack([0.09 * np.cos(angles), 0.09 * np.sin(angles) - 0.02, np.full(18, 1.62)], axis=1)
    strands = [capsule(root, root * [2.6, 2.6, 1] - [0, 0, 0.12], 0.014, 0.01) for root in roots]
    found = errors(rig_mesh(*together([(vertices, triangles), *strands])), joints)
    assert max(found.values()) < 0.05, found


def test_a_long_skirt_makes_nobody_a_cartoon_figure():
    vertices, triangles, joints = person(0.0)
    skirt = capsule([0, 0, 0.95], [0, 0, 0.55], 0.15, 0.22)
    rig = rig_mesh(*together([(vertices, triangles), skirt]))
    assert not rig.notices
    assert max(errors(rig, joints).values()) < 0.05
