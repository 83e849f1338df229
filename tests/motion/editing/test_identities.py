"""Edits that undo each other leave a motion as it was, on every kind of skeleton."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing import (
    extract_root_motion,
    ground_path,
    in_place,
    join,
    mirror,
    move,
    resample,
    scale,
    trim,
    turn,
    with_path,
    without_path,
)
from muybridge.motion.formats.registry import read_file
from tests.motion.editing.clips import CLIPS, moved_by, points, turned_by
from tests.paths import DATA

TINY = 1e-9
FILES = ("motion/02_03.amc", "motion/cmu_91_48.fbx", "characters/kaykit_knight.glb",
         "characters/mesh2motion_fox_animations.glb", "characters/three_vrm_test.vrma")  # fmt: skip


@pytest.fixture(scope="module", params=[*CLIPS, *FILES])
def clip(request: pytest.FixtureRequest) -> Motion:
    if request.param in CLIPS:
        return CLIPS[request.param]()
    if not (DATA / request.param).is_file():
        pytest.skip(f"../shared/data/{request.param} is not here")
    motion = read_file(DATA / request.param).motion
    assert motion is not None
    return motion.select(slice(0, 120))


def test_mirror_twice(clip: Motion) -> None:
    for plane in ("start", "x", "y"):
        once = mirror(clip, plane)
        twice = mirror(once, plane)
        assert moved_by(once, clip) > 1e-3
        assert turned_by(twice, clip) < TINY and moved_by(twice, clip) < TINY


def test_trim_and_join(clip: Motion) -> None:
    cuts = [0.0, 0.25, 0.7, None]
    parts = [trim(clip, a, b) for a, b in zip(cuts[:-1], cuts[1:], strict=True) if a is not None]
    again = join(parts)
    assert len(again) == len(clip) and all(len(p) < len(clip) for p in parts)
    assert turned_by(again, clip) < TINY and moved_by(again, clip) < TINY


def test_resample_up_and_back(clip: Motion) -> None:
    for factor in (2, 2.5):
        fine = resample(clip, clip.fps * factor)
        back = resample(resample(clip, clip.fps * factor * 2), clip.fps) if factor == 2.5 else resample(fine, clip.fps)
        assert len(back) == len(clip) and back.fps == clip.fps
        assert turned_by(back, clip) < TINY and moved_by(back, clip) < TINY


def test_path_times_body(clip: Motion) -> None:
    path = ground_path(clip)
    body = without_path(clip, path)
    assert moved_by(with_path(body, path), clip) < 1e-6
    assert moved_by(body, in_place(clip, turning=True)) == 0.0


def test_root_motion_keeps_every_joint_in_its_place(clip: Motion) -> None:
    out = extract_root_motion(clip)
    added = len(out.skeleton) - len(clip.skeleton)
    bone = out.forward()[:, 0]
    assert np.allclose(bone[:, 2, 3], 0) and np.allclose(bone[:, 2, 2], 1)  # on the ground, upright
    kept = slice(1 - added, None)  # a bone that was there has gone to the path
    assert np.abs(out.forward()[:, added:][:, kept] - clip.forward()[:, kept]).max() < 1e-6
    assert out.skeleton.names[added:] == clip.skeleton.names
    assert len(out.skeleton.roots) == 1
    # The body is what is left over the bone.
    assert np.abs(np.linalg.inv(bone)[:, None] @ clip.forward()
                  - without_path(clip, ground_path(clip)).forward())[:, kept].max() < 1e-6  # fmt: skip


def test_turn_and_move_and_scale_there_and_back(clip: Motion) -> None:
    there = move(turn(scale(clip, 1.7), 1.1), 0.3, -2.0, 0.1)
    assert moved_by(there, clip) > 0.01
    back = scale(turn(move(there, -0.3, 2.0, -0.1), -1.1), 1 / 1.7)
    assert turned_by(back, clip) < TINY and moved_by(back, clip) < 1e-6


def test_points_likewise() -> None:
    before = points()
    after = resample(resample(mirror(mirror(before)), 4 * before.fps), before.fps)
    np.testing.assert_allclose(after.points_world, before.points_world, atol=TINY)
    np.testing.assert_allclose(after.covariance_world, before.covariance_world, atol=1e-15)
    again = scale(move(turn(turn(before, 0.7), -0.7), 1.0), 2.0)
    np.testing.assert_allclose(again.points_world, 2 * (before.points_world + [1.0, 0, 0]), atol=TINY)
    np.testing.assert_allclose(again.covariance_world, 4 * before.covariance_world, atol=1e-15)


def test_join_refuses_clips_that_differ() -> None:
    clip = CLIPS["body"]()
    longer = replace(clip, skeleton=replace(clip.skeleton, offsets=clip.skeleton.offsets * 1.1))
    for other, words in ((replace(clip, fps=30.0), "frames/s"), (longer, "lengths"), (CLIPS["two_roots"](), "joints")):
        with pytest.raises(Exception, match=words):
            join([clip, other])
