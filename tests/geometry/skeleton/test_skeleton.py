"""Skeletons with own axes, sliding joints and several roots, and their motions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.fitting.skeleton_fit import fit_take
from muybridge.geometry.ik.tree import tree_of_skeleton
from muybridge.geometry.numerics.rotations import quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.local_frames import motion_frames, rest_frames
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import with_limits
from muybridge.geometry.skeleton.skeleton import Skeleton

FREE = np.full((6, 3), np.inf)


def rig(frames: int = 7, seed: int = 0) -> Motion:
    """A root bone over moving hips, a knee that slides, and a second root with a child."""
    rng = np.random.default_rng(seed)
    skeleton = Skeleton(
        ("root", "hips", "knee", "toe", "prop", "tip"), (-1, 0, 1, 2, -1, 4),
        np.array([[0, 0, 0], [0, 0, 0.9], [0.1, 0, -0.4], [0, -0.1, -0.4], [1, 0, 0.5], [0, 0, 0.3]]),
        np.full((6, 3), np.nan), (2,) * 6, -FREE, FREE,
        axes=Rotation.random(6, rng=rng).as_matrix(), sliding=(1, 2, 4),
    )  # fmt: skip
    turns = Rotation.random(frames * 6, rng=rng).as_matrix().reshape(frames, 6, 3, 3)
    slides = skeleton.offsets[[1, 2, 4]] + rng.normal(0, 0.1, (frames, 3, 3))
    return Motion(skeleton, 30.0, rng.normal(0, 1, (frames, 3)), quat_from_matrix(turns), slides)


def file_places(motion: Motion, world_from_file: np.ndarray | None = None) -> np.ndarray:
    """(T, J, 4, 4) as a program multiplies the local transforms that its file stores."""
    rotations, translations = motion_frames(motion, world_from_file)
    out = np.zeros((*rotations.shape[:2], 4, 4))
    for j, parent in enumerate(motion.skeleton.parents):
        local = np.zeros((len(motion), 4, 4))
        local[:, :3, :3], local[:, :3, 3], local[:, 3, 3] = rotations[:, j], translations[:, j], 1.0
        out[:, j] = local if parent < 0 else out[:, parent] @ local
    return out


def test_forward_kinematics_of_a_rig():
    motion = rig()
    at = motion.joint_positions_world()
    turns = motion.forward()[..., :3, :3]
    slides = motion.translations
    assert np.array_equal(at[:, 0], motion.root_positions_world)
    np.testing.assert_allclose(at[:, 1] - at[:, 0], np.einsum("tij,tj->ti", turns[:, 0], slides[:, 0]), atol=1e-12)
    np.testing.assert_allclose(at[:, 2] - at[:, 1], np.einsum("tij,tj->ti", turns[:, 1], slides[:, 1]), atol=1e-12)
    np.testing.assert_allclose(at[:, 3] - at[:, 2], turns[:, 2] @ motion.skeleton.offsets[3], atol=1e-12)
    np.testing.assert_allclose(at[:, 4], slides[:, 2], atol=1e-12)
    np.testing.assert_allclose(at[:, 5] - at[:, 4], turns[:, 4] @ motion.skeleton.offsets[5], atol=1e-12)


def test_local_transforms_in_own_axes_are_the_same_motion():
    motion = rig()
    np.testing.assert_allclose(file_places(motion), motion.joint_frames(), atol=1e-12)
    np.testing.assert_allclose(motion.joint_frames()[..., :3, 3], motion.joint_positions_world(), atol=1e-12)
    still = replace(
        motion, root_positions_world=np.zeros((1, 3)), quat_wxyz=np.tile([1.0, 0, 0, 0], (1, 6, 1)),
        translations=motion.skeleton.offsets[None, [1, 2, 4]],
    )  # fmt: skip
    np.testing.assert_allclose(still.joint_positions_world()[0], motion.skeleton.rest_positions, atol=1e-12)
    np.testing.assert_allclose(still.joint_frames()[0, :, :3, :3], motion.skeleton.axes, atol=1e-12)
    for moved, rest in zip(motion_frames(still), rest_frames(motion.skeleton), strict=True):
        np.testing.assert_allclose(moved[0], rest, atol=1e-12)


def test_a_skeleton_without_axes_stores_world_axes():
    motion = rig()
    plain = replace(motion, skeleton=replace(motion.skeleton, axes=None))
    assert np.array_equal(plain.joint_positions_world(), motion.joint_positions_world())
    assert np.array_equal(plain.joint_frames(), plain.forward())
    np.testing.assert_allclose(file_places(plain), plain.forward(), atol=1e-12)
    assert (rest_frames(plain.skeleton)[0] == np.eye(3)).all()


def test_local_transforms_in_a_file_with_axes_of_its_own():
    file_from_world = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    for motion in (rig(), replace(rig(), skeleton=replace(rig().skeleton, axes=None))):
        at = file_places(motion, file_from_world.T)[..., :3, 3]
        np.testing.assert_allclose(at @ file_from_world, motion.joint_positions_world(), atol=1e-12)
    turns, _ = rest_frames(motion.skeleton, file_from_world.T)
    assert (turns == np.eye(3)).all(), "without axes of its own a joint has the file's"


def test_what_a_skeleton_must_be():
    good = rig().skeleton
    for change, says in (
        ({"sliding": (1, 2)}, "root 'prop' is not the first joint"),
        ({"sliding": (0, 4)}, "ascending indices from 1 to 5"),
        ({"sliding": (4, 1)}, "ascending indices from 1 to 5"),
        ({"axes": np.zeros((6, 3, 3))}, "rotation matrices"),
        ({"axes": np.zeros((5, 3, 3))}, r"shape \(6, 3, 3\)"),
        ({"parents": (-1, 0, 3, 2, -1, 4)}, "parent must come before it"),
    ):
        with pytest.raises(ValueError, match=says):
            replace(good, **change)
    motion = rig()
    with pytest.raises(ValueError, match=r"translations must be \(7, 3, 3\)"):
        replace(motion, translations=None)
    with pytest.raises(ValueError, match="3 joints of this skeleton slide"):
        good.forward(np.zeros((1, 3)), np.tile(np.eye(3), (1, 6, 1, 1)))


def test_selecting_frames_and_holding_bones():
    motion = rig()
    assert np.array_equal(motion.select(slice(1, 5, 2)).forward(), motion.forward()[1:5:2])
    with pytest.raises(ValueError, match=r"2 roots \(root, prop\)"):
        motion.with_rigid_bones()
    one = Skeleton(
        motion.skeleton.names[:4], motion.skeleton.parents[:4], motion.skeleton.offsets[:4],
        motion.skeleton.tips[:4], (2,) * 4, -FREE[:4], FREE[:4], sliding=(1, 2),
    )  # fmt: skip
    tree = Motion(one, 30.0, motion.root_positions_world, motion.quat_wxyz[:, :4], motion.translations[:, :2])
    with pytest.raises(ValueError, match=r"joint '(hips|knee)' slides by \d+\.\d mm"):
        tree.with_rigid_bones()
    near = replace(tree, translations=one.offsets[1:3] + 0.001 * (tree.translations - one.offsets[1:3]))
    held = near.with_rigid_bones()
    assert held.translations is None and held.skeleton.sliding == ()
    np.testing.assert_allclose(held.joint_positions_world(), near.joint_positions_world(), atol=2e-3)
    body = Motion(
        BODY.skeleton(prior_shape(1.7)), 1.0, np.zeros((1, 3)), np.tile([1.0, 0, 0, 0], (1, len(BODY.parents), 1))
    )
    assert body.with_rigid_bones() is body


def test_solvers_refuse_what_they_cannot_move():
    motion = rig()
    points = motion.joint_positions_world()
    with pytest.raises(ValueError, match="a body fit needs a skeleton with one root, not 2"):
        fit_take(motion.skeleton, points, 30.0)
    with pytest.raises(ValueError, match="inverse kinematics needs a skeleton with one root"):
        tree_of_skeleton(with_limits(motion.skeleton))
