"""Styles: what they pull toward, that goals are met, examples, limits, and files."""

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat
from muybridge.motion.style import (
    Examples,
    StyleOptions,
    examples_of,
    learn_style,
    load_style,
    save_style,
    solve_pose,
)
from muybridge.motion.style.examples import farthest_first
from tests.motion.style.styles import ENDS, ROLES, SKELETON, learned, take

LOW, HIGH = -20.0, 60.0


@pytest.fixture(scope="module")
def low():
    return learned(LOW)


@pytest.fixture(scope="module")
def high():
    return learned(HIGH)


def goals_of(motion, names=ENDS):
    places = motion.joint_positions_world()[0]
    return {name: places[ROLES[name]] for name in names}


def test_a_style_pulls_toward_its_takes_and_goals_are_met(low, high):
    """Hands and feet leave open where the elbows are."""
    elbows_of = [ROLES["left_forearm"], ROLES["right_forearm"]]
    for elbows, own, other in ((LOW, low, high), (HIGH, high, low)):
        held_out, away = take(elbows, seed=7), []
        for k in range(0, len(held_out), 30):
            truth = held_out.select([k])
            solved = [solve_pose(style, truth, goals_of(truth)) for style in (own, other)]
            assert max(max(s.errors.values()) for s in solved) < 2e-4
            gaps = [s.motion.joint_positions_world()[0] - truth.joint_positions_world()[0] for s in solved]
            away.append([np.linalg.norm(gap, axis=1)[elbows_of].mean() for gap in gaps])
        mine, others = np.mean(away, axis=0)
        assert mine < 0.04 and others > 3 * mine


def test_a_single_goal_gives_the_rest_of_the_body_to_the_style(low, high):
    pose = take(0.0).select([0])
    goal = goals_of(take(20.0, seed=3), ("right_hand",))
    places = {}
    for name, style in (("low", low), ("high", high)):
        solved = solve_pose(style, pose, goal)
        assert solved.errors["right_hand"] < 2e-4
        assert np.array_equal(solved.motion.quat_wxyz[0, 0], pose.quat_wxyz[0, 0])
        places[name] = solved.motion.joint_positions_world()[0, [ROLES["left_hand"], ROLES["right_forearm"]]]
    assert np.linalg.norm(places["low"] - places["high"], axis=1).min() > 0.1


def test_orientations_are_goals_too(low):
    truth = take(LOW, seed=5).select([30])
    foot = truth.forward()[0, ROLES["left_foot"]]
    turned = foot.copy()
    turned[:3, :3] = exp_so3(np.array([0.1, 0.0, 0.0])) @ foot[:3, :3]
    solved = solve_pose(low, truth, {**goals_of(truth, ("right_hand",)), "left_foot": turned}).motion
    got = solved.forward()[0, ROLES["left_foot"]]
    assert np.linalg.norm(got[:3, 3] - foot[:3, 3]) < 2e-4
    assert np.arccos((np.trace(got[:3, :3].T @ turned[:3, :3]) - 1) / 2) < 2e-3


def test_the_poses_of_the_examples_are_likely_and_hinges_reproduce_them(low):
    motion = take(LOW)
    tree, last, away = low.tree(SKELETON)
    theta = low.prior.means[:1]
    turns, places = tree.forward(theta[0])
    rotations = low.rotations(theta)
    _, ours = SKELETON.forward(np.zeros((1, 3)), rotations)
    for j in range(1, len(SKELETON)):
        place = away[j] if last[j] < 0 else places[last[j]] + turns[last[j]] @ away[j]
        np.testing.assert_allclose(place, ours[0, j], atol=1e-9)
    # A joint that no angle of the style turns stays as it is in the takes.
    still = [j for j in range(1, len(SKELETON)) if j not in low.hinge_joints]
    assert still
    np.testing.assert_allclose(rotations[0, still], matrix_from_quat(motion.quat_wxyz[0, still]), atol=2e-3)


def test_knees_and_elbows_do_not_bend_backward(low):
    """Of a goal that is out of reach the limb points straight at it, no more."""
    truth = take(LOW, seed=5).select([0])
    far = {"right_foot": truth.root_positions_world[0] + [-0.1, 0.0, -2.0]}
    places = solve_pose(low, truth, far).motion.joint_positions_world()[0]
    hip, knee, foot = (places[ROLES[f"right_{part}"]] for part in ("thigh", "shin", "foot"))
    ahead = np.array([0.0, -1.0, 0.0])
    assert (knee - (hip + foot) / 2) @ ahead > -0.02
    assert np.linalg.norm(foot - hip) > 0.99 * (np.linalg.norm(knee - hip) + np.linalg.norm(foot - knee))


def test_examples_are_apart_and_bounded():
    motion = take(LOW, 400)
    found = examples_of("a", motion, apart=0.02)
    again = examples_of("a", motion.select(np.repeat(np.arange(400), 3)), apart=0.02)
    assert len(found) == len(again) and 8 < len(found) < 400
    assert len(examples_of("a", motion, most=30)) == 30
    assert examples_of("a", motion).merged(examples_of("b", motion)).takes == ("a", "b")
    points = np.random.default_rng(0).uniform(size=(500, 2)).astype(np.float32)
    kept = points[farthest_first(points, 0.1, 500)]
    away = np.linalg.norm(kept[:, None] - kept[None], axis=-1) + np.eye(len(kept))
    assert away.min() >= 0.1
    assert np.linalg.norm(points[:, None] - kept[None], axis=-1).min(axis=1).max() < 0.1


def test_mirrored_examples_know_both_sides(low):
    motion = take(LOW)
    only_left = motion.quat_wxyz.copy()
    only_left[:, ROLES["right_forearm"]] = only_left[0, ROLES["right_forearm"]]
    one_sided = replace(motion, quat_wxyz=only_left)
    arms = []
    for mirrored in (False, True):
        style = learn_style(examples_of("a", one_sided, mirrored, ROLES), ROLES)
        arms.append({SKELETON.names[j] for j in style.hinge_joints})
    assert "right_forearm" not in arms[0] and "right_forearm" in arms[1]


def test_files_keep_all_and_equal_styles_are_equal_files(tmp_path, low):
    path, second = tmp_path / "a.style", tmp_path / "b.style"
    save_style(path, low)
    save_style(second, low)
    assert path.read_bytes() == second.read_bytes()
    back = load_style(path)
    assert (back.joints, back.parents, back.roles, back.takes, back.examples, back.prior.names) == (
        low.joints, low.parents, low.roles, low.takes, low.examples, low.prior.names)  # fmt: skip
    for name in ("offsets", "mean_wxyz", "hinge_joints", "hinge_axes", "lower", "upper"):
        np.testing.assert_array_equal(getattr(back, name), getattr(low, name))
    truth = take(LOW, seed=7).select([50])
    one, two = (solve_pose(s, truth, goals_of(truth)).motion.joint_positions_world() for s in (low, back))
    assert np.abs(one - two).max() < 1e-3


def edited(source, target, change=None, about=None):
    """The file with one array changed, or its description."""
    with zipfile.ZipFile(source) as archive:
        entries = {i.filename: archive.read(i) for i in archive.infolist()}
    with zipfile.ZipFile(target, "w") as archive:
        for name, data in entries.items():
            if about is not None and name == "muybridge_style.npy":
                header = data.index(b"\n") + 1
                text = json.dumps({**json.loads(data[header:]), **about}).encode()
                with archive.open(name, "w") as file:
                    np.save(file, np.frombuffer(text, np.uint8))
            elif change is not None and name == f"{change[0]}.npy":
                with archive.open(name, "w") as file:
                    np.save(file, change[1])
            else:
                archive.writestr(name, data)
    return target


def test_damaged_files_are_refused_with_their_name(tmp_path, low):
    path, bad = tmp_path / "a.style", tmp_path / "bad.style"
    save_style(path, low)
    n = len(low.hinge_joints)
    for change in (("offsets", np.full((len(SKELETON), 3), np.nan)), ("lower", np.zeros(n - 1)),
                   ("hinge_joints", np.full(n, 999)), ("upper", low.lower - 1), ("hinge_axes", np.zeros((n, 3))),
                   ("factors", np.zeros_like(low.prior.precisions)), ("means", np.zeros((1, 2)))):  # fmt: skip
        with pytest.raises(FormatError, match=r"bad\.style: is damaged as a style"):
            load_style(edited(path, bad, change=change))
    for about, text in (({"version": 2}, "version 2"), ({"roles": {"head": 999}}, "damaged"),
                        ({"parents": [0] * len(SKELETON)}, "damaged")):  # fmt: skip
        with pytest.raises(FormatError, match=text):
            load_style(edited(path, bad, about=about))
    bad.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(FormatError, match="is no style"):
        load_style(bad)
    np.savez(bad.open("wb"), other=np.zeros(3))
    with pytest.raises(FormatError, match="is no style"):
        load_style(bad)
    middle = bytearray(path.read_bytes())
    middle[middle.index(b"means.npy") + 200] ^= 0xFF
    bad.write_bytes(middle)
    with pytest.raises(FormatError, match=r"bad\.style"):
        load_style(bad)


def test_other_skeletons_are_refused_and_other_proportions_are_not(low):
    tall = take(LOW, stature=1.95).select([0])
    assert solve_pose(low, tall, goals_of(tall)).errors["left_hand"] < 2e-4
    names = tuple(f"j{k}" for k in range(len(SKELETON)))
    renamed = replace(tall, skeleton=replace(tall.skeleton, names=names))
    with pytest.raises(MuybridgeError, match=r"the style is of another skeleton: the motion has no joint 'hips'"):
        solve_pose(low, renamed, goals_of(tall))
    offsets = SKELETON.offsets.copy()
    offsets[ROLES["left_forearm"]] = [0.0, 0.0, -0.3]
    hanging = replace(tall, skeleton=replace(SKELETON, offsets=offsets))
    with pytest.raises(MuybridgeError, match="'left_forearm' points 90 degrees elsewhere"):
        solve_pose(low, hanging, goals_of(tall))


def test_goals_that_cannot_be_are_refused(low):
    pose = take(LOW).select([0])
    for goals, text in (({}, "at least one goal"), ({"tail": np.zeros(3)}, "no joint 'tail'"),
                        ({"left_hand": np.zeros(2)}, "left_hand: a goal is a place"),
                        ({"left_hand": np.full(3, np.nan)}, "finite"), ({"hips": np.zeros(3)}, "nothing that moves it"),
                        ({"left_thigh": np.zeros(3)}, "nothing that moves it")):  # fmt: skip
        with pytest.raises(MuybridgeError, match=text):
            solve_pose(low, pose, goals)


def test_takes_without_movement_are_refused():
    with pytest.raises(MuybridgeError, match=r"one\.bvh: has one frame; a style is learned from movement"):
        examples_of("one.bvh", take(LOW, 1))
    still = take(LOW).select(np.zeros(50, int))
    with pytest.raises(MuybridgeError, match=r"still: 1 different pose; a style needs at least 8"):
        learn_style(examples_of("still", still))
    with pytest.raises(MuybridgeError, match=r"empty"):
        examples_of("empty", take(LOW).select(slice(0, 0)))
    rest = np.zeros((20, len(SKELETON), 4))
    rest[..., 0] = 1.0
    with pytest.raises(MuybridgeError, match="no joint turns"):
        learn_style(Examples(SKELETON, rest, ("rest",), np.zeros(20, int)))


def test_components_are_bounded_by_the_examples():
    found = examples_of("a", take(LOW, 60), most=12)
    assert len(learn_style(found, options=StyleOptions(components=40)).prior.means) == 12
    assert len(learn_style(found).prior.means) == 1
