"""What a database of clips holds, what it refuses, and its file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import place_at
from muybridge.motion.matching import FeatureOptions, Ignored, build_database, read_database, write_database
from tests.motion.matching.walks import walk, walks


def test_features_of_a_straight_walk_are_known() -> None:
    database = build_database([walk(still=True)], ["walk"]).database
    features = database.features[60]
    np.testing.assert_allclose(features[:6], [0.396, 0, 0.804, 0, 1.2, 0], atol=1e-6)
    np.testing.assert_allclose(features[6:12], [1, 0, 1, 0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(features[18:].reshape(3, 3), np.tile([1.2, 0, 0], (3, 1)), atol=1e-6)
    left, right = features[12:18].reshape(2, 3)
    assert left[1] > 0.05 and right[1] == pytest.approx(-left[1], abs=1e-6)


def test_features_do_not_know_where_a_walk_is() -> None:
    motion = walk(turn_deg=30)
    there = place_at(motion, 2.0, np.array([5.0, -3.0]))
    one, other = (build_database([m], ["walk"]).database for m in (motion, there))
    np.testing.assert_allclose(one.features, other.features, atol=1e-6)


def test_frames_near_ends_and_in_ignored_parts_are_not_found() -> None:
    motions, names = walks()
    database = build_database(motions, names, ignore=[Ignored(names[1], 1.0, 1.5)]).database
    found = np.flatnonzero(database.searchable)
    assert (database.ends[found] - found > 60).all()
    first = database.starts[1]
    assert database.ignored[first + 60 : first + 91].all() and database.ignored.sum() == 31
    assert not database.searchable[first : first + 91].any() and database.searchable[first + 93]
    assert not database.searchable[database.starts[:-1]].any()


def test_mirrored_clips_turn_the_other_way() -> None:
    database = build_database([walk(turn_deg=40)], ["left"], mirrored=True).database
    assert database.names == ("left", "mirrored left")
    turns = [database.path.yaw[b - 60] - database.path.yaw[a] for a, b in zip(database.starts, database.starts[1:],
                                                                               strict=False)]  # fmt: skip
    assert turns[0] > 1 and turns[1] == pytest.approx(-turns[0], abs=1e-3)


def test_short_clips_are_left_out_by_name() -> None:
    built = build_database([walk(), walk(0.5), walk(0.0)], ["long", "short", "pose"])
    assert built.database.names == ("long",)
    assert any("short is left out: it has 31 of the 63 frames" in n for n in built.notices)
    assert any("pose is left out: it has 1 of the 63 frames" in n for n in built.notices)
    with pytest.raises(MuybridgeError, match=r"no clip is long enough: 63 frames .* short, has 31"):
        build_database([walk(0.5), walk(0.0)], ["short", "pose"])
    shorter = FeatureOptions(horizons=(0.1, 0.3))
    assert build_database([walk(0.5)], ["short"], shorter).database.searchable.any()


def test_other_frame_times_are_resampled_and_said() -> None:
    built = build_database([walk(), walk(fps=100)], ["first", "second"])
    assert built.notices == ("second is resampled from 100 to 60 frames/s",)
    count = np.diff(built.database.starts)
    assert abs(count[0] - count[1]) <= 1


def test_other_skeletons_are_refused_by_name() -> None:
    motion = walk()
    skeleton = motion.skeleton
    longer = replace(skeleton, offsets=skeleton.offsets * np.where(np.arange(len(skeleton)) == 5, 3.0, 1.0)[:, None])
    renamed = replace(skeleton, names=("pelvis", *skeleton.names[1:]))
    for other, what in ((longer, skeleton.names[5]), (renamed, "hips")):
        moved = Motion(other, motion.fps, motion.root_positions_world, motion.quat_wxyz)
        with pytest.raises(MuybridgeError, match=f"b moves another skeleton than a: .*{what}"):
            build_database([motion, moved], ["a", "b"])


def test_bodies_without_feet_are_refused_by_role() -> None:
    motion = walk()
    known = find_motion_roles(motion)
    less = replace(known, roles={r: j for r, j in known.roles.items() if r not in ("left_foot", "hips")})
    with pytest.raises(MuybridgeError, match="a: no joint was found for hips, left_foot"):
        build_database([motion], ["a"], role_map=less)


def test_bad_requests_are_refused() -> None:
    with pytest.raises(MuybridgeError, match="no clip to be matched"):
        build_database([], [])
    with pytest.raises(MuybridgeError, match="two clips are called 'a'"):
        build_database([walk(), walk()], ["a", "a"])
    with pytest.raises(MuybridgeError, match="no clip 'b' to ignore a part of; the clips are a"):
        build_database([walk()], ["a"], ignore=[Ignored("b", 0, 1)])
    with pytest.raises(MuybridgeError, match="must end after it starts"):
        build_database([walk()], ["a"], ignore=[Ignored("a", 2, 1)])
    with pytest.raises(MuybridgeError, match="every frame is in a part to be ignored"):
        build_database([walk()], ["a"], ignore=[Ignored("a", 0, 99)])
    for options in ({"horizons": (1.0, 0.5)}, {"feet": -1.0}, {"horizons": ()}):
        with pytest.raises(ValueError):
            FeatureOptions(**options)


def test_a_file_comes_back(tmp_path: Path) -> None:
    motions, names = walks()
    database = build_database(motions, names, ignore=[Ignored(names[0], 1, 2)]).database
    path = tmp_path / "walks.match"
    write_database(path, database)
    back = read_database(path)
    assert back.names == database.names and back.roles == dict(database.roles) and back.options == database.options
    assert back.fps == database.fps and back.motion.skeleton.names == database.motion.skeleton.names
    np.testing.assert_array_equal(back.searchable, database.searchable)
    np.testing.assert_allclose(back.features, database.features, atol=1e-5)
    gaps = back.motion.joint_positions_world() - database.motion.joint_positions_world()
    assert np.abs(gaps).max() < 1e-5


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "walks.match"
    path.write_bytes(b"nothing")
    with pytest.raises(FormatError, match=r"walks\.match"):
        read_database(path)
    write_database(path, build_database([walk()], ["a"]).database)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match=r"walks\.match"):
        read_database(path)
    path.write_bytes(whole)
    arrays = dict(np.load(path))
    for name, value, what in (
        ("yaw", arrays["yaw"][:-1], "'yaw' has the shape"),
        ("features", arrays["features"] * np.nan, "not numbers"),
        ("starts", arrays["starts"] * 0, "do not fill"),
        ("header", np.frombuffer(b'{"kind": "other"}', np.uint8), "by what it says of itself"),
    ):
        with path.open("wb") as file:
            np.savez(file, **{**arrays, name: value})
        with pytest.raises(FormatError, match=what):
            read_database(path)
