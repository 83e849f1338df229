"""Implausible limbs and uncertain points."""

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.triangulation.plausibility import stretched_limbs, uncertain_points

AT = BODY23.index


@pytest.fixture
def standing() -> FloatArray:
    """(40, 23, 3) a person of average size, with a centimetre of noise."""
    places = {
        "shoulder": (0.2, 0.0, 1.45), "elbow": (0.25, 0.0, 1.15), "wrist": (0.27, -0.05, 0.9), "hip": (0.1, 0.0, 0.95),
        "knee": (0.1, -0.02, 0.5), "ankle": (0.1, 0.0, 0.08),
    }  # fmt: skip
    body = np.zeros((23, 3))
    for name, (x, y, z) in places.items():
        body[AT(f"left_{name}")], body[AT(f"right_{name}")] = (x, y, z), (-x, y, z)
    return body + np.random.default_rng(0).normal(0, 0.01, (40, 23, 3))


def test_the_first_joint_that_is_too_far_out_is_rejected(standing) -> None:
    assert not stretched_limbs(standing, BODY23).any()
    points = standing.copy()
    points[5, AT("left_elbow")] += [0.6, 0, 0]  # the wrist is where it was
    points[6, AT("left_elbow"), 0] += 0.6
    points[6, AT("left_wrist"), 0] += 0.6  # the arm's end is elsewhere
    points[7, AT("right_ankle"), 1] -= 0.8
    points[8, AT("right_knee")] = np.nan
    expected = np.zeros((40, 23), bool)
    for frame, name in ((5, "left_elbow"), (6, "left_elbow"), (6, "left_wrist"), (7, "right_ankle")):
        expected[frame, AT(name)] = True
    np.testing.assert_array_equal(stretched_limbs(points, BODY23), expected)


def test_unknown_lengths_reject_nothing(standing) -> None:
    points = standing.copy()
    points[5, AT("left_elbow")] += 1.0
    points[1:, AT("right_elbow")] = points[6:, AT("left_elbow")] = np.nan
    assert not stretched_limbs(points, BODY23)[:, AT("left_elbow")].any()
    assert not stretched_limbs(points[:, :5], LandmarkSet("face", BODY23.names[:5], ())).any()


def test_impossibly_long_bones_are_rejected_without_known_lengths(standing) -> None:
    points = standing.copy()
    rng = np.random.default_rng(1)
    for name in ("left_knee", "right_knee"):
        points[:, AT(name), 2] += rng.uniform(-0.17, 0.17, 40)
    points[5, AT("left_knee")] += [1.2, 0, 0]
    points[6, AT("left_knee")], points[6, AT("left_ankle")] = points[6, AT("left_hip")] + [0, 0, -1.0], [0.1, 0, -1.3]
    wrong = stretched_limbs(points, BODY23)
    assert wrong[[5, 6], AT("left_knee")].all() and not wrong[5, AT("left_ankle")] and wrong[6, AT("left_ankle")]
    assert wrong.sum() == 3
    assert not stretched_limbs(3 * points, BODY23)[6, AT("left_ankle")]  # not in metres: no limit applies


def test_uncertain_points_are_detected_in_any_unit(standing) -> None:
    sure = np.tile(1e-4 * np.eye(3), (40, 23, 1, 1))
    sure[5, AT("left_knee")] = np.diag([0.3, 0.1, 0.1]) ** 2
    sure[6, AT("left_knee")] = np.diag([0.2, 0.1, 0.1]) ** 2  # a depth that is a guess alone is not enough
    expected = np.zeros((40, 23), bool)
    expected[5, AT("left_knee")] = True
    np.testing.assert_array_equal(uncertain_points(standing, sure, BODY23), expected)
    np.testing.assert_array_equal(uncertain_points(1000 * standing, 1e6 * sure, BODY23), expected)
    sure[7] = standing[7] = np.nan
    np.testing.assert_array_equal(uncertain_points(standing, sure, BODY23), expected)
    standing[8:] = np.nan
    assert uncertain_points(standing, sure, BODY23).sum() == 0  # the trunk is known in seven frames
