"""The analytic limb: places that can be reached are reached, others are pointed at; limits and poles hold."""

import numpy as np
import pytest

from muybridge.geometry.ik.two_bone import solve_two_bone
from muybridge.geometry.numerics.rotations import exp_so3

UPPER, LOWER, HINGE = np.array([0.03, -0.03, -0.44]), np.array([0.04, 0.03, -0.45]), np.array([1.0, 0, 0])


def end_of(rotation: np.ndarray, angle: np.ndarray) -> np.ndarray:
    bend = exp_so3(np.radians(angle)[:, None] * HINGE)
    return np.einsum("tij,tj->ti", rotation, UPPER + bend @ LOWER)


def places(low: float, high: float, count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(0)
    reach = rng.normal(size=(count, 3))
    return reach * rng.uniform(low, high, (count, 1)) / np.linalg.norm(reach, axis=1, keepdims=True)


def test_what_can_be_reached_is_reached():
    reach = places(0.3, 0.87)
    rotation, angle = solve_two_bone(UPPER, LOWER, HINGE, reach, np.tile([1.0, 0.2, 0.1], (200, 1)), (-7, 158))
    assert np.abs(end_of(rotation, angle) - reach).max() < 1e-9
    np.testing.assert_allclose(rotation @ np.swapaxes(rotation, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-10)
    assert np.allclose(np.linalg.det(rotation), 1)


def test_out_of_reach_the_limb_points_there_within_its_limits():
    reach = places(1.2, 2.0)
    rotation, angle = solve_two_bone(UPPER, LOWER, HINGE, reach, np.tile([1.0, 0.2, 0.1], (200, 1)), (-7, 158))
    end = end_of(rotation, angle)
    along = (end * reach).sum(1) / np.linalg.norm(end, axis=1) / np.linalg.norm(reach, axis=1)
    assert along.min() > 1 - 1e-9
    near = places(0.05, 0.1)
    _, angle = solve_two_bone(UPPER, LOWER, HINGE, near, np.tile([1.0, 0.2, 0.1], (200, 1)), (10, 90))
    assert angle.min() >= 10 and angle.max() <= 90 and angle.max() == pytest.approx(90)


def test_the_hinge_is_as_near_to_the_pole_as_it_can_be():
    reach, pole = np.tile([0.1, -0.2, -0.6], (1, 1)), np.array([[0.3, 0.9, 0.1]])
    rotation, angle = solve_two_bone(UPPER, LOWER, HINGE, reach, pole, (-7, 158))
    towards = (rotation @ HINGE)[0] @ pole[0]
    axis = reach[0] / np.linalg.norm(reach[0])
    for turn in np.linspace(0, 2 * np.pi, 73):
        other = exp_so3(axis[None] * turn)[0] @ rotation[0]
        assert np.abs(end_of(other[None], angle) - reach).max() < 1e-9, "it only swivels the limb"
        assert (other @ HINGE) @ pole[0] <= towards + 1e-9
