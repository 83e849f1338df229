import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from muybridge.geometry.numerics.rotations import (
    continuous_quat,
    exp_so3,
    kabsch,
    left_jacobian_so3,
    log_so3,
    matrix_from_quat,
    matrix_from_swing_twist,
    quat_from_matrix,
    quat_from_rotation,
    swing_twist_from_matrix,
)

vectors = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


@settings(max_examples=60, deadline=None)
@given(v=vectors, small=st.sampled_from([1.0, 1e-3, 1e-8, 0.0]), axis=st.integers(0, 2))
def test_round_trips(v, small, axis):
    v = v * small
    matrix = exp_so3(v)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(v).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(log_so3(matrix), v, atol=1e-7)
    np.testing.assert_allclose(matrix_from_quat(quat_from_matrix(matrix)), matrix, atol=1e-13)
    np.testing.assert_allclose(matrix_from_swing_twist(swing_twist_from_matrix(matrix, axis), axis), matrix, atol=1e-9)
    swing = np.delete(v, axis)
    if np.linalg.norm(swing) < 3.1:
        back = swing_twist_from_matrix(matrix_from_swing_twist(v, axis), axis)
        np.testing.assert_allclose(back, v, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(v=vectors, d=vectors, small=st.sampled_from([1.0, 1e-3, 0.0]))
def test_left_jacobian_by_finite_differences(v, d, small):
    v, step = v * small, 1e-6
    change = (exp_so3(v + step * d) @ exp_so3(v - step * d).T - np.eye(3)) / (2 * step)
    expected = left_jacobian_so3(v) @ d
    np.testing.assert_allclose([change[2, 1], change[0, 2], change[1, 0]], expected, atol=1e-5)


def test_continuous_quat_keeps_rotations_and_removes_flips():
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 12, 200)[:, None, None]
    quat = quat_from_matrix(exp_so3(angle * np.array([[0.3, 0.9, 0.1], [1.0, 0, 0]])))
    flipped = quat * rng.choice([-1.0, 1.0], quat.shape[:2])[..., None]
    smooth = continuous_quat(flipped)
    assert (np.sum(smooth[1:] * smooth[:-1], axis=-1) > 0.99).all()
    np.testing.assert_allclose(matrix_from_quat(smooth), matrix_from_quat(quat), atol=1e-12)
    assert continuous_quat(np.empty((0, 3, 4))).shape == (0, 3, 4)


def test_kabsch_gives_proper_rotations():
    rng = np.random.default_rng(1)
    source = rng.normal(size=(20, 5, 3))
    turn = Rotation.random(20, random_state=2).as_matrix()
    target = np.einsum("tij,tnj->tni", turn, source)
    target[:, 4] += 100.0
    weights = np.array([1.0, 2, 1, 1, 0])
    np.testing.assert_allclose(kabsch(source, target, np.tile(weights, (20, 1))), turn, atol=1e-10)
    mirrored = kabsch(source, source * [-1, 1, 1], np.ones((20, 5)))
    assert np.linalg.det(mirrored) == pytest.approx(1.0)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi, 5.0])
def test_quaternions_of_exact_rotations_are_those_of_matrices(angle):
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, -0.8, 0], [0.48, 0.6, -0.64]])
    matrices = exp_so3(angle * axes)
    quat = quat_from_rotation(matrices)
    np.testing.assert_allclose(matrix_from_quat(quat), matrices, atol=1e-12)
    assert (np.abs((quat * quat_from_matrix(matrices)).sum(-1)) > 1 - 1e-12).all()
