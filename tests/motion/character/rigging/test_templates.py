"""Templates of people, hands and animals, and what is refused."""

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.motion.character.rigging import RIGS, TEMPLATES, RigOptions, rig_mesh
from muybridge.motion.character.rigging.placement.fingers import place_fingers
from muybridge.motion.character.rigging.templates import joint_names
from tests.motion.character.rigging.figures import HEIGHT, animal, capsule, hand, person, together


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


def test_a_flat_mesh_is_refused():
    vertices, triangles, _ = person(40.0)
    with pytest.raises(MuybridgeError, match="flat"):
        rig_mesh(vertices * [1, 0, 1], triangles)


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
