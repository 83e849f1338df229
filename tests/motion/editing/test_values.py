"""What single edits make of a motion, in numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.motion.editing import (
    extract_root_motion,
    in_place,
    lowest_height,
    move,
    put_on_floor,
    reduce_keys,
    rename_joints,
    resample,
    scale,
    smooth,
    trim,
    turn,
)
from muybridge.motion.editing.steps import edit_take, parse_steps
from muybridge.motion.formats.gltf.read import read_gltf
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.take import Take
from tests.geometry.roles.bodies import human
from tests.motion.editing.clips import CLIPS, FPS, moved_by, points, turned_by, walk
from tests.motion.retargeting.test_retarget import moving


def test_resampling_follows_the_movement() -> None:
    fine = walk(200)
    coarse = fine.select(slice(0, None, 4))
    again = resample(replace(coarse, fps=FPS / 4), FPS)
    assert len(again) == 197
    # Far less than the straight lines between frames 67 ms apart.
    assert moved_by(again, fine.select(slice(0, 197))) < 2e-3
    # Smooth where frames were: no step in velocity stands out.
    steps = np.linalg.norm(np.diff(again.joint_positions_world(), 2, axis=0), axis=-1).max(axis=1)
    assert steps[3::4].max() < 1.5 * np.delete(steps, slice(3, None, 4)).max()


def test_resampling_points_leaves_gaps_and_frames() -> None:
    before = points()
    after = resample(before, 2 * before.fps)
    np.testing.assert_array_equal(after.points_world[::2], before.points_world)
    known = np.isfinite(before.points_world[..., 0])
    np.testing.assert_array_equal(np.isfinite(after.points_world[1::2, :, 0]), known[:-1] & known[1:])


def test_trim_is_half_open_and_checks_its_times() -> None:
    motion = walk(60)
    np.testing.assert_array_equal(trim(motion, 0.5, 0.75).root_positions_world, motion.root_positions_world[30:45])
    for start, end, words in (
        (0.5, 0.5, "later than the start"),
        (-1.0, None, "begins at 0 s, after -1 s"),
        (0.0, 2.0, "ends at 1 s, before 2 s"),
    ):
        with pytest.raises(MuybridgeError, match=words):
            trim(motion, start, end)


def test_in_place_stays_and_keeps_its_swaying() -> None:
    motion = walk()
    still, exact = in_place(motion), in_place(motion, smoothing=0.0)
    assert np.ptp(motion.root_positions_world[:, 1]) > 3.0
    assert np.abs(still.root_positions_world[:, :2]).max() < 0.05
    assert np.ptp(still.root_positions_world[:, 0]) > 0.02
    np.testing.assert_allclose(exact.root_positions_world[:, :2], 0, atol=1e-12)
    np.testing.assert_array_equal(still.root_positions_world[:, 2], motion.root_positions_world[:, 2])


def test_the_root_bone_is_named() -> None:
    motion = walk()
    assert extract_root_motion(motion).skeleton.names[0] == "root"
    taken = replace(motion, skeleton=replace(motion.skeleton, names=("root", *motion.skeleton.names[1:])))
    assert extract_root_motion(taken).skeleton.names[:2] == ("root_motion", "root")
    with pytest.raises(MuybridgeError, match="there is a joint 'hips' already"):
        extract_root_motion(motion, "hips")
    bone = CLIPS["with_root_bone"]()
    assert extract_root_motion(bone).skeleton.names == bone.skeleton.names
    feet = extract_root_motion(motion).skeleton.rest_positions[:, 2]
    assert feet.min() >= -1e-9  # at rest, too, the body stands over the bone


def test_turn_and_move() -> None:
    motion = walk()
    start = motion.root_positions_world[0]
    left = turn(motion, np.pi / 2)
    np.testing.assert_allclose(left.root_positions_world[0], start, atol=1e-12)
    way, turned = (m.root_positions_world[-1] - m.root_positions_world[0] for m in (motion, left))
    np.testing.assert_allclose(turned, [-way[1], way[0], way[2]], atol=1e-12)
    about = turn(motion, np.pi, "origin").root_positions_world
    np.testing.assert_allclose(about, motion.root_positions_world * (-1, -1, 1), atol=1e-12)
    home = move(motion, 0.0, 1.0, start="origin").root_positions_world[0]
    np.testing.assert_allclose(home, [0.0, 1.0, start[2]], atol=1e-12)
    for bad in (
        lambda: turn(motion, np.nan),
        lambda: move(motion, np.inf),
        lambda: scale(motion, -1.0),
        lambda: resample(motion, 0.0),
    ):
        with pytest.raises(MuybridgeError):
            bad()


def test_floor_puts_the_lowest_point_at_a_height() -> None:
    for thing in (walk(), points(), CLIPS["two_roots"]()):
        assert abs(lowest_height(put_on_floor(thing, 0.02)) - 0.02) < 1e-9


def test_smoothing_takes_noise_away() -> None:
    clean = walk()
    noise = np.random.default_rng(0).normal(0, 0.004, clean.root_positions_world.shape)
    noisy = replace(clean, root_positions_world=clean.root_positions_world + noise)
    middle = slice(10, -10)
    for out in (smooth(noisy, 6.0), smooth(noisy), smooth(noisy, method="gaussian")):
        error = (out.root_positions_world - clean.root_positions_world)[middle]
        assert np.sqrt((error**2).mean()) < 0.7 * np.sqrt((noise[middle] ** 2).mean())
    with pytest.raises(MuybridgeError, match="no cut-off"):
        smooth(noisy, 6.0, "gaussian")
    with pytest.raises(MuybridgeError, match="between 0 and half"):
        smooth(noisy, 30.0)


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize("tolerance", [5e-4, 2e-3, 1e-2])
def test_reduced_keys_stay_within_the_tolerance(name: str, tolerance: float) -> None:
    motion, angle = CLIPS[name](), np.radians(1.0)
    out = reduce_keys(motion, tolerance, angle)
    places = np.linalg.norm(out.motion.joint_positions_world() - motion.joint_positions_world(), axis=-1)
    assert places.max() <= tolerance and out.error == pytest.approx(places.max())
    assert turned_by(out.motion, motion) <= angle + 1e-9
    assert out.keys.count < 0.5 * (out.keys.rotations.size + out.keys.positions.size)
    assert out.keys.rotations[[0, -1]].all() and out.keys.positions[[0, -1]].all()


def test_more_tolerance_leaves_fewer_keys() -> None:
    counts = [reduce_keys(walk(), tolerance).keys.count for tolerance in (1e-4, 1e-3, 1e-2)]
    assert counts[0] > counts[1] > counts[2]
    # What never moves keeps its two ends.
    head = walk().skeleton.index("head")
    assert reduce_keys(walk()).keys.rotations[:, head].sum() == 2


@pytest.mark.parametrize("name", CLIPS)
def test_a_glb_holds_the_keys_alone(name: str, tmp_path: Path) -> None:
    motion = CLIPS[name]()
    out = reduce_keys(motion, 2e-3)
    write_glb(tmp_path / "few.glb", out.motion, out.keys)
    write_glb(tmp_path / "all.glb", out.motion)
    few, every = (read_gltf(tmp_path / f"{kind}.glb") for kind in ("few", "all"))
    assert (tmp_path / "few.glb").stat().st_size < 0.8 * (tmp_path / "all.glb").stat().st_size
    assert len(few) == len(every) == len(motion) and few.fps == every.fps
    assert moved_by(few, every) < 2e-5  # of single precision
    order = [few.skeleton.index(name) for name in motion.skeleton.names]  # a file has its nodes in an order of its own
    apart = few.joint_positions_world()[:, order] - motion.joint_positions_world()
    assert np.linalg.norm(apart, axis=-1).max() < 2e-3 + 2e-5


def test_renaming_to_every_profile() -> None:
    motion = walk()
    for profile, table in PROFILES.items():
        names = rename_joints(motion, profile).skeleton.names
        assert names[0] == table["hips"] and names[motion.skeleton.index("left_shin")] == table["left_shin"]
    assert rename_joints(rename_joints(motion, "vrm"), "muybridge").skeleton.names == motion.skeleton.names
    with pytest.raises(MuybridgeError, match="choose one of muybridge"):
        rename_joints(motion, "maya")
    unknown = tuple(f"b{k}" for k in range(len(motion.skeleton)))
    of_shape = rename_joints(replace(motion, skeleton=replace(motion.skeleton, names=unknown)), "muybridge")
    assert of_shape.skeleton.names == motion.skeleton.names
    nobody = replace(motion, skeleton=replace(motion.skeleton, names=unknown, offsets=0 * motion.skeleton.offsets))
    with pytest.raises(MuybridgeError, match="not known, neither by their names"):
        rename_joints(nobody, "vrm")
    taken = ("hips", "Spine", *motion.skeleton.names[2:])
    clash = replace(motion, skeleton=replace(motion.skeleton, names=taken))
    if "Spine" not in PROFILES["humanik"].values():
        pytest.fail("the name of the test is one of humanik")
    names = rename_joints(clash, "vrm").skeleton.names
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("spine", [1, 2, 3, 4])
def test_renaming_again_changes_nothing(spine: int) -> None:
    rng = np.random.default_rng(spine)
    for motion in (walk(), moving(human(rng, spine=spine, fingers=2).build(None, 1.0, rng)[0], size=0.1)):
        for profile in PROFILES:
            once = rename_joints(motion, profile)
            assert rename_joints(once, profile).skeleton.names == once.skeleton.names


def test_another_joint_of_a_new_name_gets_a_free_one() -> None:
    motion = walk()
    names = ("hips", *motion.skeleton.names[1:-2], "root", "root_2")
    taken = Take(motion=replace(motion, skeleton=replace(motion.skeleton, names=names)))
    out, (note,) = edit_take(taken, parse_steps(["rename", "asf"]))
    assert out.motion is not None and out.motion.skeleton.names[0] == "root"
    assert out.motion.skeleton.names[-2:] == ("root_3", "root_2")
    assert "another joint of the name root is now root_3" in note
