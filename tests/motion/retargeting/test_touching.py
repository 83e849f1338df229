"""Hands on the body and on each other, and arms that stay out of it, on bodies of other shapes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Mesh
from muybridge.motion.retargeting import RetargetOptions, retarget
from muybridge.motion.retargeting.body_parts import find_parts, place_part, radius_at, see
from muybridge.motion.retargeting.rig import make_rig, pose_rig
from muybridge.motion.retargeting.touching import _arm, _palm
from tests.geometry.roles.bodies import human
from tests.motion.retargeting.test_retarget import character

FRAMES, FPS = 60, 30.0
APART = RetargetOptions(plant=False, touch=False)
TOUCHING = RetargetOptions(plant=False)


def arms_posed(skeleton, roles, inward_deg, share=None):
    """A motion that goes from the T-pose to upper arms that hang, and forearms level, ahead or inward."""
    share = np.ones(FRAMES) if share is None else share
    quat = np.tile([1.0, 0, 0, 0], (FRAMES, len(skeleton), 1))
    for side, sign in (("left", 1), ("right", -1)):
        down = Rotation.from_euler("y", sign * 75, degrees=True)
        level = Rotation.from_euler("z", -sign * (90 + inward_deg), degrees=True)
        for part, turn in (("upper_arm", down), ("forearm", down.inv() * level)):
            turns = Rotation.from_rotvec(np.multiply.outer(share, turn.as_rotvec()))
            quat[:, roles[f"{side}_{part}"]] = turns.as_quat()[:, [3, 0, 1, 2]]
    return Motion(skeleton, FPS, np.tile([0.0, 0.0, 0.95], (FRAMES, 1)), quat)


def gaps(motion, roles, skeleton, root=None):
    """(T,) metres of the left hand's middle from the trunk's surface, of a body without mesh."""
    rig = make_rig(skeleton, roles, root)
    posed = pose_rig(rig, motion)
    trunk = find_parts(rig)["trunk"]
    seen = see(place_part(trunk, posed), _palm(posed, _arm(rig, "left")))
    return seen.far - radius_at(trunk, seen)


def touching_pose(skeleton, roles, share=None):
    """Of such poses the one with the hand nearest to touching the trunk."""
    poses = [arms_posed(skeleton, roles, angle, share) for angle in range(0, 80, 2)]
    return min(poses, key=lambda m: abs(gaps(m, roles, skeleton)[-1] - 0.02))


@pytest.fixture(scope="module")
def take():
    skeleton, roles = human(np.random.default_rng(0)).build()
    return touching_pose(skeleton, roles), roles


@pytest.mark.parametrize("shape", [{"arms": 1.3}, {"arms": 0.75}])
def test_a_hand_on_the_trunk_stays_there_on_a_body_of_other_proportions(take, shape):
    motion, roles = take
    hero, names = character(human(np.random.default_rng(1), **shape))
    plain, kept = (retarget(motion, roles, hero, names, options) for options in (APART, TOUCHING))
    before = gaps(motion, roles, motion.skeleton) * kept.scale
    off, near = (np.abs(gaps(r.motion, names, hero.skeleton, hero.root_at_rest) - before) for r in (plain, kept))
    assert near.max() < 0.015 and off.max() > 2 * near.max()
    assert kept.moved_hands_m[:, 0].min() > 0.02


def test_hands_that_touch_each_other_still_do_on_longer_arms():
    skeleton, roles = human(np.random.default_rng(0)).build()
    poses = [arms_posed(skeleton, roles, angle) for angle in range(0, 60, 2)]

    def apart(motion, names, rest):
        rig = make_rig(rest, names)
        posed = pose_rig(rig, motion)
        palms = [_palm(posed, _arm(rig, side)) for side in ("left", "right")]
        return np.linalg.norm(palms[0] - palms[1], axis=1)

    motion = min(poses, key=lambda m: abs(apart(m, roles, skeleton)[0] - 0.06))
    hero, names = character(human(np.random.default_rng(1), arms=0.8))
    plain, kept = (retarget(motion, roles, hero, names, options).motion for options in (APART, TOUCHING))
    wanted = apart(motion, roles, skeleton)
    off, near = (np.abs(apart(m, names, hero.skeleton) - wanted).max() for m in (plain, kept))
    assert near < 0.02 and off > 2 * near


def test_touching_begins_smoothly_and_leaves_other_frames_as_they_are(take):
    motion, roles = take
    share = np.clip((np.arange(FRAMES) - 15) / 25, 0, 1)
    share = share**2 * (3 - 2 * share)
    motion = touching_pose(motion.skeleton, roles, share)
    hero, names = character(human(np.random.default_rng(1), arms=1.3))
    moved = retarget(motion, roles, hero, names, TOUCHING).moved_hands_m
    assert moved[:15].max() < 1e-9 and moved[-1].min() > 0.02
    assert np.abs(np.diff(moved, axis=0)).max() < 0.25 * moved.max()


def drum(hero, roles, radius):
    """The character with a drum of a trunk."""
    rest = hero.rest_motion().forward()[0]
    chest = hero.skeleton.parents[hero.skeleton.parents[roles["left_upper_arm"]]]
    low, high = rest[roles["left_thigh"], 2, 3], rest[roles["left_upper_arm"], 2, 3]
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 40, endpoint=False), np.linspace(low, high, 20))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    bind = np.tile(np.eye(4), (len(rest), 1, 1))
    bind[:, :3, 3] = -rest[:, :3, 3]
    mesh = Mesh("drum", points, np.zeros((0, 3), int), np.full((len(points), 1), chest), np.ones((len(points), 1)),
                bind)  # fmt: skip
    return replace(hero, meshes=(mesh,)), chest


def test_hands_stay_out_of_a_wide_body():
    skeleton, roles = human(np.random.default_rng(0)).build()
    quat = arms_posed(skeleton, roles, 0).quat_wxyz
    quat[:, [roles[f"{side}_forearm"] for side in ("left", "right")]] = [1.0, 0, 0, 0]  # arms that hang
    motion = Motion(skeleton, FPS, np.tile([0.0, 0.0, 0.95], (FRAMES, 1)), quat)
    hero, names = character(human(np.random.default_rng(1), arms=1.2))
    hero, chest = drum(hero, names, 0.45)
    rest = hero.rest_motion().forward()[0, chest, :3, 3]

    def depth(result):
        frames = result.motion.forward()
        wrist = frames[:, names["left_hand"], :3, 3] - frames[:, chest, :3, 3]
        local = (np.swapaxes(frames[:, chest, :3, :3], -1, -2) @ wrist[..., None])[..., 0] + rest
        return 0.45 - np.hypot(local[:, 0], local[:, 1])

    plain, kept = (retarget(motion, roles, hero, names, options) for options in (APART, TOUCHING))
    assert depth(plain).max() > 0.05
    assert depth(kept).max() < 0.01


def test_a_body_on_its_own_skeleton_keeps_its_hands(take):
    motion, roles = take
    hero, names = character(human(np.random.default_rng(0)))
    done = retarget(motion, roles, hero, names, TOUCHING)
    assert done.moved_hands_m.max() < 1e-6
