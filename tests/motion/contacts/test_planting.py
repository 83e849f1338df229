"""Planted feet: they stand, roll over the ball, stay out of the floor, and leave the rest as it was."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from muybridge.geometry.ik.two_bone import move_two_bone
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.blending import blend
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.planting import Planted, PlantOptions, plant_feet

FPS, FRAMES = 60.0, 240


def standing(noise: float = 0.0, heel_up_deg: float = 0.0) -> tuple[Motion, np.ndarray]:
    """Somebody who stands with bent knees and lifts the left foot in the middle, and (T, 2, 2) what stands.

    Before the lift the left heel rises by `heel_up_deg`; `noise` in radians is on all joints of the legs, and five
    times as many millimetres on the root.
    """
    skeleton = BODY.skeleton(prior_shape(1.7))
    t = np.arange(FRAMES) / FPS
    swing = np.clip(1 - np.abs(t - 2.0) / 0.5, 0, 1)
    swing = swing**2 * (3 - 2 * swing)
    roll = np.clip((t - 1.0) / 0.5, 0, 1) * (t < 1.5) + (1 - np.clip((t - 1.5) / 0.3, 0, 1)) * (t >= 1.5)
    turns = np.tile(np.eye(3), (FRAMES, len(skeleton), 1, 1))
    for side, lift in (("left", swing), ("right", 0 * swing)):
        rolled = np.radians(heel_up_deg) * roll * (side == "left")
        for part, angle in (("thigh", -0.25 - 0.6 * lift), ("shin", 0.5 + 0.9 * lift), ("foot", -0.25 + rolled)):
            about_x = np.broadcast_to(angle, FRAMES)[:, None] * np.array([1.0, 0, 0])
            turns[:, skeleton.index(f"{side}_{part}")] = exp_so3(about_x)
    motion = Motion(skeleton, FPS, np.tile([0.0, 0.0, 0.9], (FRAMES, 1)), continuous_quat(quat_from_matrix(turns)))
    low = feet_of_motion(motion).places[0, 1, 1, 2]
    motion = replace(motion, root_positions_world=motion.root_positions_world - [0, 0, low - 0.02])
    rng = np.random.default_rng(3)

    def slow(*shape: int) -> np.ndarray:
        out = gaussian_filter1d(rng.normal(size=(FRAMES, *shape)), 7, axis=0, mode="wrap")
        return out / out.std()

    for j, name in enumerate(skeleton.names):
        if name.endswith(("thigh", "shin", "foot")):
            turns[:, j] = turns[:, j] @ exp_so3(noise * slow(3))
    shaken = replace(motion, quat_wxyz=continuous_quat(quat_from_matrix(turns)),
                     root_positions_world=motion.root_positions_world + noise * 0.5 * slow(3))  # fmt: skip
    stands = np.ones((FRAMES, 2, 2), bool)
    stands[(t > 1.5) & (t < 2.5), 0] = False
    if heel_up_deg:
        stands[(t > 1.0) & (t < 2.5), 0, 0] = False
    return (shaken if noise else motion), stands


def plant(motion: Motion, stands: np.ndarray) -> Planted:
    return plant_feet(motion, Contacts.of_feet(stands, FPS, Floor(), np.full((2, 2), 0.02)))


def test_feet_stand_and_nothing_jumps():
    motion, stands = standing(noise=0.01)
    planted = plant(motion, stands)
    before, after = (feet_of_motion(m).places for m in (motion, planted.motion))
    assert np.ptp(before[stands[:, 0, 0]][:60, 0, 1], axis=0).max() > 0.01, "there is something to do"
    for k, first, last in ((0, 0, 90), (0, 150, 240), (1, 0, 240)):
        assert np.ptp(after[first:last, k], axis=0).max() < 1e-4
        assert after[first:last, k, :, 2] == pytest.approx(0.02, abs=1e-4)
    assert after[..., 2].min() > 0.02 - 2e-3 and planted.unreached_m < 1e-4
    step = [np.abs(np.diff(m.joint_positions_world(), 2, axis=0)).max() for m in (motion, planted.motion)]
    assert step[1] < 1.2 * step[0]
    truth = standing()[0].joint_positions_world()
    away = [np.linalg.norm(m.joint_positions_world() - truth, axis=-1).mean() for m in (motion, planted.motion)]
    assert away[1] < away[0]


def test_what_stands_already_is_left_alone():
    motion, stands = standing()
    planted = plant(motion, stands)
    assert np.abs(planted.motion.joint_positions_world() - motion.joint_positions_world()).max() < 1e-3
    none = plant(motion, np.zeros_like(stands))
    assert np.abs(none.motion.joint_positions_world() - motion.joint_positions_world()).max() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_feet_that_were_planted_stay_where_they_are(seed):
    first = plant_feet(standing(noise=0.012 + 0.004 * seed, heel_up_deg=15.0 * seed)[0])
    assert first.moved_feet_m > 0.005, "there is something to do"
    motion = first.motion
    for _ in range(2):
        rounded = replace(motion, quat_wxyz=motion.quat_wxyz.astype(np.float32).astype(np.float64),
                          root_positions_world=np.round(motion.root_positions_world, 6))  # fmt: skip
        again = plant_feet(rounded)
        assert again.moved_feet_m < 1e-3 and again.moved_root_m < 1e-3
        motion = again.motion


def test_a_foot_rolls_over_its_ball():
    motion, stands = standing(noise=0.01, heel_up_deg=25)
    planted = plant(motion, stands)
    places = feet_of_motion(planted.motion).places[:90, 0]
    assert np.ptp(places[:, 1], axis=0).max() < 1e-4, "the ball stays"
    assert places[85, 0, 2] > 0.05, "the heel rises"


def test_a_foot_under_the_floor_is_lifted():
    motion, stands = standing()
    sunk = replace(motion, root_positions_world=motion.root_positions_world - [0, 0, 0.03])
    nothing = Contacts.of_feet(np.zeros_like(stands), FPS, Floor(), np.full((2, 2), 0.02))
    assert feet_of_motion(plant_feet(sunk, nothing).motion).places[..., 2].min() > 0.02 - 1e-3


def test_a_foot_may_be_in_the_floor_where_it_was_before():
    motion, stands = standing()
    sunk = replace(motion, root_positions_world=motion.root_positions_world - [0, 0, 0.03])
    nothing = Contacts.of_feet(np.zeros_like(stands), FPS, Floor(), np.full((2, 2), 0.02))
    low = feet_of_motion(sunk).places[..., 2]
    left_alone = plant_feet(sunk, nothing, under=np.maximum(0.02 - low, 0.0).max(axis=-1)).motion
    assert np.abs(left_alone.joint_positions_world() - sunk.joint_positions_world()).max() < 1e-9
    half = plant_feet(sunk, nothing, under=np.full((FRAMES, 2), 0.015)).motion
    assert feet_of_motion(half).places[..., 2].min() == pytest.approx(0.005, abs=1e-3)


def test_a_contact_stands_where_it_does_beside_the_frames_that_are_planted():
    motion, _ = standing()
    where = np.zeros(FRAMES, bool)
    where[20:80] = True
    aside = np.where(where, 0.03, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    moved = replace(motion, root_positions_world=motion.root_positions_world + aside)
    contacts = Contacts.of_feet(standing()[1], FPS, Floor(), np.full((2, 2), 0.02))
    planted = feet_of_motion(plant_feet(moved, contacts, where=where).motion).places
    assert planted[:90] == pytest.approx(feet_of_motion(motion).places[:90], abs=1e-4)


def test_a_foot_on_something_keeps_its_height():
    motion, stands = standing(noise=0.005)
    contacts = Contacts.of_feet(stands, FPS, Floor(-0.03), np.full((2, 2), 0.02))
    raised = feet_of_motion(plant_feet(motion, contacts).motion).places[:, 1, :, 2]
    assert raised.mean() == pytest.approx(feet_of_motion(motion).places[:, 1, :, 2].mean(), abs=3e-3)
    assert np.ptp(raised, axis=0).max() < 1e-4
    lowered = feet_of_motion(plant_feet(motion, contacts, PlantOptions(step=np.inf)).motion).places[:, 1, :, 2]
    assert lowered == pytest.approx(-0.01, abs=1e-4)


def test_bones_keep_their_lengths_and_other_joints_their_turns():
    motion, stands = standing(noise=0.02)
    planted = plant(motion, stands).motion
    assert planted.skeleton is motion.skeleton and planted.translations is None
    legs = [j for j, n in enumerate(motion.skeleton.names) if n.endswith(("thigh", "shin", "foot"))]
    others = np.setdiff1d(np.arange(len(motion.skeleton)), legs)
    assert np.array_equal(planted.quat_wxyz[:, others], motion.quat_wxyz[:, others])


def test_contacts_of_another_take_are_refused():
    motion, stands = standing()
    with pytest.raises(ValueError, match="contacts of 239 frames do not belong to a motion of 240"):
        plant(motion, stands[1:])
    assert len(plant_feet(motion.select(slice(0, 0)), Contacts.of_feet(stands[:0], FPS)).motion) == 0


def test_two_bones_move_to_where_they_shall():
    rng = np.random.default_rng(0)
    root, ahead = rng.normal(size=(2, 300, 3))
    middle = root + rng.normal(size=(300, 3))
    end = middle + rng.normal(size=(300, 3))
    upper, lower, short = move_two_bone((root, middle, end), root, end, ahead)
    assert max(np.abs(m - np.eye(3)).max() for m in (upper, lower)) < 1e-6 and np.abs(short).max() < 1e-9
    new_root, new_end = root + 0.2 * rng.normal(size=(300, 3)), end + 0.2 * rng.normal(size=(300, 3))
    upper, lower, short = move_two_bone((root, middle, end), new_root, new_end, ahead)
    reached = new_root + (upper @ (middle - root)[..., None] + lower @ (end - middle)[..., None])[..., 0]
    assert np.linalg.norm(reached - new_end, axis=1) == pytest.approx(np.abs(short), abs=1e-6)
    assert (np.abs(short) < 1e-6).mean() > 0.7


def test_corrections_fade_without_swinging_over():
    known = np.zeros(200)
    known[80:120] = 1
    out = blend(np.full((200, 1), 0.02), known, 60.0, 0.15)[:, 0]
    assert out[80:120] == pytest.approx(0.02, abs=1e-5) and np.abs(out[[30, 170]]).max() < 1e-3
    assert out.max() < 0.0201 and out.min() > -1e-4
    assert not blend(np.ones((50, 2)), np.zeros(50), 60.0, 0.1).any()
