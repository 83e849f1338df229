"""The centre of mass of a body."""

import numpy as np
import pytest

from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.mass import SEGMENTS, centre_of_mass
from muybridge.geometry.skeleton.profiles import roles_of


def test_shares_are_of_the_whole_body():
    assert sum(s.share for s in SEGMENTS) == pytest.approx(1.0, abs=2e-3)


def test_where_the_centre_of_mass_of_a_standing_body_is():
    skeleton = BODY.skeleton(prior_shape(1.7))
    rest = skeleton.rest_positions
    joints = roles_of(skeleton.names)
    centre = centre_of_mass(rest[None], joints)[0]
    sole = rest[:, 2].min()
    # In a T-pose, a little higher than the 55 to 57 % of stature that lie with the arms down.
    assert 0.53 < (centre[2] - sole) / 1.7 < 0.62 and abs(centre[0]) < 1e-9
    shifted = centre_of_mass(rest[None] + [1.0, 2.0, 3.0], joints)[0]
    np.testing.assert_allclose(shifted - centre, [1, 2, 3], atol=1e-12)


def test_a_raised_leg_takes_it_along():
    skeleton = BODY.skeleton(prior_shape(1.7))
    joints, rest = roles_of(skeleton.names), skeleton.rest_positions
    raised = rest.copy()
    leg = [joints[f"left_{p}"] for p in ("shin", "foot", "toe")]
    raised[leg] += [0, 0, 0.3]
    moved = centre_of_mass(raised[None], joints)[0] - centre_of_mass(rest[None], joints)[0]
    # The thigh's far end moves, and all of shank and foot.
    np.testing.assert_allclose(moved, [0, 0, 0.3 * (0.1416 * 0.41 + 0.0433 + 0.0137)], atol=2e-4)


def test_joints_that_are_missing():
    skeleton = BODY.skeleton(prior_shape(1.7))
    joints, rest = roles_of(skeleton.names), skeleton.rest_positions[None]
    no_toes = {role: j for role, j in joints.items() if not role.endswith("toe")}
    assert np.abs(centre_of_mass(rest, no_toes) - centre_of_mass(rest, joints)).max() < 0.005
    no_head = {role: j for role, j in joints.items() if role != "head"}
    with pytest.raises(ValueError, match="needs the joint 'head'"):
        centre_of_mass(rest, no_head)
