"""A reach with a style: the hand arrives, hips and legs stay, and the rest of the body is that of the style."""

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.motion.signals.reaching import reach
from tests.motion.editing.clips import turned_by
from tests.motion.style.styles import ROLES, learned, take

LEGS = ("left_thigh", "right_thigh", "left_shin", "right_shin", "left_foot", "right_foot")


def test_the_hand_arrives_and_the_rest_differs_with_the_style():
    motion = take(20.0, seed=3)
    world = motion.joint_positions_world()
    place = world[120, ROLES["right_hand"]] + [0.02, -0.05, 0.06]
    out = {}
    for elbows in (-20.0, 60.0):
        made = reach(motion, "right_hand", 2.0, place, style=learned(elbows))
        places = made.joint_positions_world()
        assert np.linalg.norm(places[120, ROLES["right_hand"]] - place) < 2e-3
        assert np.abs(places[:, [ROLES[n] for n in LEGS]] - world[:, [ROLES[n] for n in LEGS]]).max() < 1e-9
        assert turned_by(made.select([0, 239]), motion.select([0, 239])) < 1e-6
        out[elbows] = places[120]
    plain = reach(motion, "right_hand", 2.0, place).joint_positions_world()[120]
    elbow = ROLES["right_forearm"]
    assert np.linalg.norm(out[-20.0][elbow] - out[60.0][elbow]) > 0.1
    other = ROLES["left_hand"]
    assert np.allclose(plain[other], world[120, other], atol=1e-9)
    assert np.linalg.norm(out[60.0][other] - world[120, other]) > 0.1


def test_a_foot_reaches_and_the_other_leg_stays():
    motion = take(20.0, seed=3)
    world = motion.joint_positions_world()
    place = world[120, ROLES["left_foot"]] + [0.05, -0.1, 0.1]
    places = reach(motion, "left_foot", 2.0, place, style=learned(-20.0)).joint_positions_world()
    assert np.linalg.norm(places[120, ROLES["left_foot"]] - place) < 2e-3
    right = [ROLES[n] for n in LEGS if n.startswith("right")]
    assert np.abs(places[:, right] - world[:, right]).max() < 1e-9


def test_what_is_out_of_reach_or_of_another_skeleton_is_refused():
    motion, style = take(20.0), learned(-20.0)
    with pytest.raises(MuybridgeError, match=r"right_hand cannot reach 9, 0, 1 at 2 s with hips and feet where they"):
        reach(motion, "right_hand", 2.0, np.array([9.0, 0, 1]), style=style)
    without = learned(-20.0)
    object.__setattr__(without, "roles", {})
    with pytest.raises(MuybridgeError, match="the style knows no joint to be right_hand"):
        reach(motion, "right_hand", 2.0, np.zeros(3), style=without)
