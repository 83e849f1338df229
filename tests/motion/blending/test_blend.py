"""One motion between several."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import Weights, blend_motions, place_at, plant_blend, register
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.footskate import measure_footskate
from muybridge.motion.editing.resampling import motion_at
from tests.motion.editing.clips import walk


def longer_steps(share: float) -> Motion:
    """The walk, so much faster over the ground and higher."""
    motion = walk(150)
    return replace(motion, root_positions_world=motion.root_positions_world * [1.0, 1 + share, 1 + 0.05 * share])


def test_a_blend_with_itself_is_itself() -> None:
    motion = walk(150)
    curve = register([motion, place_at(motion, 0.7, np.array([1.0, 4.0]))], ["a", "b"])
    out = blend_motions(curve, Weights.checked([0.3, 0.7], 2))
    np.testing.assert_allclose(out.frames[0], out.frames[1], atol=1e-6)
    truth = motion_at(motion, out.frames[0]).joint_positions_world()
    assert np.abs(out.motion.joint_positions_world() - truth).max() < 2e-3


@pytest.mark.parametrize("which", [0, 1])
def test_the_whole_weight_gives_one_of_the_motions(which: int) -> None:
    motions = [longer_steps(0.0), longer_steps(0.5)]
    out = blend_motions(register(motions, ["a", "b"]), Weights.checked(np.eye(2)[which], 2)).motion
    speeds = [np.linalg.norm(np.diff(m.root_positions_world[[0, -1], :2], axis=0)) / len(m) for m in (*motions, out)]
    assert speeds[2] == pytest.approx(speeds[which], rel=0.02)
    assert out.root_positions_world[:, 2].mean() == pytest.approx(
        motions[which].root_positions_world[:, 2].mean(), abs=2e-3
    )


def test_half_the_weight_is_half_way_in_speed_and_height() -> None:
    motions = [longer_steps(0.0), longer_steps(0.5)]
    out = blend_motions(register(motions, ["a", "b"]), Weights.checked([0.5, 0.5], 2)).motion
    speeds = [np.linalg.norm(np.diff(m.root_positions_world[[0, -1], :2], axis=0)) / len(m) for m in (*motions, out)]
    assert speeds[2] == pytest.approx(0.5 * (speeds[0] + speeds[1]), rel=0.02)


def test_weights_that_change_go_from_one_motion_to_the_other() -> None:
    motions = [longer_steps(0.0), longer_steps(0.5)]
    out = blend_motions(register(motions, ["a", "b"]), Weights.checked([1, 0, 0, 1], 2))
    steps = np.linalg.norm(np.diff(out.motion.root_positions_world[:, :2], axis=0), axis=1)
    assert out.weights[0, 0] == 1 and out.weights[-1, 1] > 0.99
    assert steps[-20:].mean() / steps[:20].mean() == pytest.approx(1.5, rel=0.1)
    assert np.linalg.norm(np.diff(out.motion.joint_positions_world(), 2, axis=0), axis=-1).max() < 0.02


def test_planted_feet_of_a_blend_do_not_slide() -> None:
    curve = register([longer_steps(0.0), longer_steps(0.3)], ["a", "b"])
    planted = plant_blend(blend_motions(curve, Weights.checked([0.5, 0.5], 2)), curve)
    places = feet_of_motion(planted.motion).places
    for foot, point in np.ndindex(2, 2):
        contact = planted.contacts.contact[:, foot, point]
        assert measure_footskate(places[:, foot, point], contact, planted.motion.fps).extent < 3e-3


@pytest.mark.parametrize(("values", "message"), [
    ([1.5, -0.5], "from 0 to 1, not -0.5"), ([0.0, 0.0], "0 0 are all zero"), ([np.inf, 0.0], "not inf"),
    ([0.5, 0.6], r"sum to 1\.1, not to 1; 0\.4545 0\.5455 do"), ([1.0], "1 weights do not fit 2 motions"),
    ([np.nan, 1.0], "not nan"),
])  # fmt: skip
def test_weights_that_are_none_are_refused(values: list[float], message: str) -> None:
    with pytest.raises(MuybridgeError, match=message):
        Weights.checked(values, 2)


def test_times_of_weights_must_fit_and_increase() -> None:
    with pytest.raises(MuybridgeError, match="2 sets of weights need as many times"):
        Weights.checked([1, 0, 0, 1], 2, [0.5])
    with pytest.raises(MuybridgeError, match="each later"):
        Weights.checked([1, 0, 0, 1], 2, [0.5, 0.2])
    held = Weights.checked([1, 0, 0, 1], 2, [0.5, 1.0])
    assert held.at(0.1, 0.0).tolist() == [1, 0] and held.at(3.0, 1.0).tolist() == [0, 1]
    assert held.at(0.75, 0.5).tolist() == [0.5, 0.5]
