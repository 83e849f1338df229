"""Roles by names, by a file's own table, by a user's map and by geometry alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import CORE_ROLES, find_roles, load_role_map, suggest_role_map
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.motion.character import read_character
from muybridge.motion.formats.registry import read_file
from tests.geometry.roles.bodies import HABITS, Builder, four_legged, human, lower_arms


def _core(found):
    return {role: found.roles.get(role) for role in CORE_ROLES}


@pytest.mark.parametrize("habit", HABITS)
def test_geometry_finds_the_roles_of_bodies_of_many_makers(habit):
    for seed, angle in enumerate((0, 45, 80)):
        rng = np.random.default_rng(seed)
        options = {"legs": rng.uniform(0.85, 1.15), "arms": rng.uniform(0.9, 1.1)} | HABITS[habit]
        turn = Rotation.random(random_state=seed)
        skeleton, truth = lower_arms(human(rng, **options), angle).build(turn, (1, 100, 0.01)[seed], rng)
        found = find_roles(skeleton)
        assert found.how == "geometry" and found.kind == "human"
        assert _core(found) == {role: truth[role] for role in CORE_ROLES}, f"arms {angle} degrees down"


def test_a_body_without_front_is_taken_to_face_minus_y():
    rng = np.random.default_rng(0)
    body = human(rng, toes=False, clavicles=False)
    for k in range(len(body.places)):
        body.places[k][1] = 0.0
    skeleton, truth = body.build(None, 1.0, rng)
    found = find_roles(skeleton)
    assert _core(found) == {role: truth[role] for role in CORE_ROLES}
    assert len(found.notes) == 1 and "faced -Y" in found.notes[0]


def test_sides_that_the_names_state_count_before_geometry():
    rng = np.random.default_rng(0)
    skeleton, truth = human(rng).build(None, 1.0, rng)
    names = list(skeleton.names)
    for role, j in truth.items():
        if role.startswith(("left", "right")):
            names[j] = f"q{j}_{'R' if role.startswith('left') else 'L'}"
    found = find_roles(replace(skeleton, names=tuple(names)))
    assert found.roles["left_foot"] == truth["right_foot"] and found.how == "geometry"


def test_animals_on_four_legs_have_no_roles_whatever_their_names():
    rng = np.random.default_rng(0)
    skeleton, _ = four_legged(rng).build(Rotation.random(random_state=0), 1.0, rng)
    found = find_roles(skeleton)
    assert found.kind == "quadruped" and not found.roles
    with pytest.raises(MuybridgeError, match="hound.glb: .* four legs"):
        found.require("hound.glb")


@pytest.mark.parametrize("profile", [p for p in PROFILES if p not in ("opensim",)])
def test_names_of_every_program_are_known(profile):
    table = PROFILES[profile]
    rng = np.random.default_rng(0)
    skeleton, truth = human(rng, fingers=5, spine=3).build(None, 1.0, rng)
    names = list(skeleton.names)
    for role in CORE_ROLES:
        names[truth[role]] = table[role]
    found = find_roles(replace(skeleton, names=tuple(names)))
    assert "names, which are those of " in found.source and "words" not in found.source
    assert found.how.startswith("names:") and _core(found) == {role: truth[role] for role in CORE_ROLES}


@pytest.mark.parametrize(
    ("thigh", "side"), [("upper_leg.{}", "LR"), ("rig|{}_UpLeg", "LR"), ("Thigh{}", ("Left", "Right"))]
)
def test_names_are_matched_by_their_words(thigh, side):
    rng = np.random.default_rng(0)
    skeleton, truth = human(rng).build(None, 1.0, rng)
    names = list(skeleton.names)
    names[truth["hips"]] = "Pelvis"
    parts = {"thigh": thigh, "shin": "calf_{}", "foot": "{}Ankle", "upper_arm": "{}-upper-arm", "forearm": "{}.elbow",
             "hand": "Wrist {}"}  # fmt: skip
    for part, pattern in parts.items():
        for mark, which in zip(side, ("left", "right"), strict=True):
            names[truth[f"{which}_{part}"]] = pattern.format(mark)
    found = find_roles(replace(skeleton, names=tuple(names)))
    assert found.how == "names:words" and _core(found) == {role: truth[role] for role in CORE_ROLES}


def test_names_that_do_not_fit_the_tree_are_passed_over():
    rng = np.random.default_rng(1)
    skeleton, truth = human(rng).build(None, 1.0, rng)
    names = list(PROFILES["mixamo"].values())[: len(skeleton)]
    found = find_roles(replace(skeleton, names=tuple(names)))
    assert found.how == "geometry" and _core(found) == {role: truth[role] for role in CORE_ROLES}


def test_a_name_that_means_another_joint_in_another_program_is_not_taken():
    rng = np.random.default_rng(0)
    skeleton, truth = human(rng).build(None, 1.0, rng)
    names = list(skeleton.names)
    for role in CORE_ROLES:
        names[truth[role]] = PROFILES["rigify"][role]
    names[truth["hips"]], names[truth["spine"]] = "hips", "spine"  # Rigify's hips are called spine
    found = find_roles(replace(skeleton, names=tuple(names)))
    assert _core(found) == {role: truth[role] for role in CORE_ROLES}


def test_a_files_own_table_counts_before_names():
    rng = np.random.default_rng(0)
    skeleton, truth = human(rng).build(None, 1.0, rng)
    table = {PROFILES["vrm"][role]: skeleton.names[truth[role]] for role in CORE_ROLES}
    found = find_roles(skeleton, table)
    assert found.how == "vrm" and found.roles == {role: truth[role] for role in CORE_ROLES}


def test_a_suggested_map_reads_back_as_the_roles_it_was_made_of(tmp_path):
    rng = np.random.default_rng(0)
    skeleton, _ = human(rng, fingers=5, hair=2).build(None, 1.0, rng)
    found = find_roles(skeleton)
    path = tmp_path / "map.toml"
    path.write_text(suggest_role_map(skeleton, found))
    again = find_roles(skeleton, map=load_role_map(path))
    assert again.how == "map" and again.roles == found.roles
    assert "Joints without a role" in path.read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('hips = "a"\nleft_thigh = "a"', "hips and left_thigh are both given to the joint 'a'"),
        ('hip = "a"', "unknown role 'hip'"),
        ("hips = 3", "lines role = "),
        ("hips", "map of roles"),
    ],
)
def test_bad_maps_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        load_role_map(path)
    assert "\n" not in str(caught.value) and "map.toml" in str(caught.value)


def test_a_map_of_a_joint_that_is_not_there_is_refused():
    skeleton, _ = human(np.random.default_rng(0)).build()
    with pytest.raises(MuybridgeError, match="gives hips to 'pelvis', and the skeleton has no such joint, but b0"):
        find_roles(skeleton, map={"hips": "pelvis"})


def test_real_characters_with_scrambled_names(real_data):
    """Truth are the names as their makers gave them."""
    right, kinds = {}, {}
    for name in ("characters/kaykit_knight.glb", "characters/mesh2motion_bunny.glb",
                 "characters/mesh2motion_female.glb",
                 "characters/vrmc_mtoon_test.vrm", "characters/three_vrm_test.vrma", "motion/01_01.bvh",
                 "motion/02_03.amc", "motion/cmu_91_48.fbx", "characters/mesh2motion_dog.glb",
                 "characters/mesh2motion_fox_animations.glb"):  # fmt: skip
        motion = read_file(real_data / name).motion
        places = motion.joint_positions_world()
        truth = find_roles(motion.skeleton, positions=places)
        rng = np.random.default_rng(0)
        scrambled = replace(motion.skeleton, names=tuple(f"bone{k}" for k in rng.permutation(len(motion.skeleton))))
        found = find_roles(scrambled, positions=places)
        kinds[name] = found.kind
        assert found.how == ("geometry" if found.kind == "human" else "none")
        right[name] = [role for role in CORE_ROLES if found.roles.get(role) == truth.roles.get(role)]
    assert [n for n, kind in kinds.items() if kind == "quadruped"] == list(kinds)[-2:]
    # Of the knight's wrist and hand, geometry takes the wrist for the hand's joint.
    assert [len(roles) for roles in right.values()] == [11, 13, 13, 13, 13, 13, 13, 13, 13, 13]


def test_clavicles_and_toes_are_found_by_geometry():
    rng = np.random.default_rng(0)
    skeleton, roles = human(rng, fingers=5, root=True).build(Rotation.random(random_state=1), 1.0, rng)
    found = find_roles(skeleton)
    assert found.how == "geometry"
    for side in ("left", "right"):
        assert found.roles[f"{side}_clavicle"] == skeleton.parents[roles[f"{side}_upper_arm"]]
        assert skeleton.parents[found.roles[f"{side}_toe"]] == roles[f"{side}_foot"]


def blocks(turn=None, seed=None):
    """A toy: a trunk, with a leg and an arm of one piece on either side."""
    b = Builder()
    root = b.add("root", "", (0, 0, 0))
    trunk = b.add("trunk", root, (0, 0, 0.2))
    for s, side in ((1, "left"), (-1, "right")):
        b.add(f"{side}_leg", root, (0.12 * s, 0.02, 0.2))
        b.add(f"{side}_arm", trunk, (0.3 * s, 0.02, 0.38 - 0.05 * (s < 0)))
    b.add("antenna", trunk, (0, 0, 0.8))
    return b.build(turn, 1.0, None if seed is None else np.random.default_rng(seed))[0]


def test_a_figure_with_limbs_of_one_piece_is_refused_with_the_reason():
    for skeleton in (blocks(), blocks(Rotation.random(random_state=2), 2)):
        found = find_roles(skeleton)
        assert found.kind == "one piece" and not found.roles
    with pytest.raises(MuybridgeError, match="without joints for knees, ankles, elbows and wrists"):
        found.require("toy.glb")
    assert find_roles(four_legged(np.random.default_rng(0)).build()[0]).kind == "quadruped"


def test_a_real_figure_of_blocks_is_refused_with_the_reason(real_data):
    kenney = find_roles(read_character(real_data / "characters" / "kenney_character.glb").skeleton)
    with pytest.raises(MuybridgeError, match="legs: leg-left, leg-right; arms: arm-left, arm-right"):
        kenney.require("kenney_character.glb")
