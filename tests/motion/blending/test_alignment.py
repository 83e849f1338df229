"""Motions laid over each other on the ground, and inertialised transitions between them."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_rotvec
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import (
    cloud_windows,
    inertial_decay,
    inertialise,
    place_at,
    planar_alignment,
    point_cloud,
    same_skeleton,
)


def _swaying(frames: int = 60, fps: float = 60.0, phase: float = 0.0) -> Motion:
    skeleton = BODY.skeleton(prior_shape(1.74))
    t = np.arange(frames)[:, None, None] / fps
    rates = np.linspace(0.3, 0.8, len(skeleton))[:, None]
    turns = 0.2 * np.sin(2 * np.pi * rates * t * 0.5 + phase + np.arange(3.0))
    places = np.stack([0.5 * t[:, 0, 0], 0.1 * np.sin(3 * t[:, 0, 0] + phase), 1 + 0 * t[:, 0, 0]], axis=1)
    return Motion(skeleton, fps, places, continuous_quat(quat_from_rotvec(turns)))


def test_a_cloud_that_was_turned_and_shifted_is_laid_back() -> None:
    motion = _swaying()
    moved = place_at(motion, 2.1, np.array([3.0, -1.0]))
    clouds = [cloud_windows(point_cloud(m), 9) for m in (motion, moved)]
    found = planar_alignment(clouds[0], clouds[1])
    assert found.yaw.shape == (52,)
    np.testing.assert_allclose(found.yaw, -2.1, atol=1e-9)
    assert found.distance.max() < 1e-9
    back = place_at(moved, found.yaw[0], found.shift[0])
    np.testing.assert_allclose(back.joint_positions_world(), motion.joint_positions_world(), atol=1e-9)


def test_the_alignment_is_the_best_one_and_its_distance_is_what_is_left() -> None:
    rng = np.random.default_rng(1)
    a, b, w = rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), rng.uniform(0.1, 1, 40)
    found = planar_alignment(a, b, w)

    def left(yaw: float, shift: np.ndarray) -> float:
        c, s = np.cos(yaw), np.sin(yaw)
        turned = b @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*shift, 0]
        return float((w * ((a - turned) ** 2).sum(axis=1)).sum())

    best = left(float(found.yaw), found.shift)
    assert best == pytest.approx(float(found.distance), rel=1e-9)
    for _ in range(50):
        assert left(float(found.yaw) + rng.normal() * 0.05, found.shift + rng.normal(size=2) * 0.02) >= best - 1e-12


def test_a_decay_has_the_derivatives_that_it_was_given_and_ends_at_rest() -> None:
    times = np.arange(0, 0.5, 1e-4)
    out = inertial_decay(np.array([2.0]), np.array([-3.0]), np.array([5.0]), 0.4, times)[:, 0]
    assert out[0] == 2.0
    assert np.gradient(out, times)[0] == pytest.approx(-3.0, abs=1e-2)
    assert np.gradient(np.gradient(out, times), times)[2] == pytest.approx(5.0, abs=0.5)
    assert np.abs(out[times >= 0.4]).max() < 1e-12
    assert abs(np.gradient(out, times)[times < 0.4][-1]) < 1e-3


def test_a_transition_continues_the_old_motion_and_arrives_in_the_new_one() -> None:
    old, new = _swaying(phase=0.0), _swaying(phase=1.3)
    out = inertialise(old, new, 0.4)
    joined = np.concatenate([old.joint_positions_world(), out.joint_positions_world()[1:]])
    np.testing.assert_allclose(out.joint_positions_world()[0], old.joint_positions_world()[-1], atol=1e-9)
    steps = np.linalg.norm(np.diff(joined, axis=0), axis=2)
    bends = np.linalg.norm(np.diff(joined, n=2, axis=0), axis=2).max(axis=1) * 60**2
    jump = np.linalg.norm(old.joint_positions_world()[-1] - new.joint_positions_world()[0], axis=1).max()
    assert jump > 0.2  # metres in one frame, without the transition
    assert steps.max() < 0.06
    assert bends[58] < 1.5 * bends.max(where=np.arange(len(bends)) != 58, initial=0.0)
    np.testing.assert_allclose(out.quat_wxyz[30:], new.quat_wxyz[30:], atol=1e-12)


def test_motions_are_brought_to_one_frame_rate_and_other_skeletons_are_refused() -> None:
    motion = _swaying()
    slow, notes = same_skeleton([motion, _swaying(30, 30.0)], ["a.bvh", "b.bvh"])
    assert slow[1].fps == 60.0
    assert notes == ["b.bvh is resampled from 30 to 60 frames/s"]
    offsets = motion.skeleton.offsets.copy()
    offsets[5] *= 1.5
    longer = replace(motion, skeleton=replace(motion.skeleton, offsets=offsets))
    with pytest.raises(MuybridgeError, match=rf"c\.bvh moves another skeleton.*{motion.skeleton.names[5]}.*differs"):
        same_skeleton([motion, longer], ["a.bvh", "c.bvh"])
    with pytest.raises(MuybridgeError, match=r"c\.bvh: the clip is empty"):
        same_skeleton([motion, motion.select(slice(0, 0))], ["a.bvh", "c.bvh"])
