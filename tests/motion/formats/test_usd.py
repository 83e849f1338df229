"""USD Skel: what OpenUSD reads of what we write."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh
from muybridge.motion.formats.skeletal.usd import joint_paths, write_usda

TO_WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def make_motion(frames: int = 12, seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, 2, frames)[:, None, None]
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, 59.94, root, quat_from_matrix(exp_so3(turn)))


def test_paths_are_identifiers():
    skeleton = BODY.skeleton(prior_shape(1.7))
    odd = replace(skeleton, names=("1 hips", "a b", "a_b", *skeleton.names[3:]))
    paths = joint_paths(odd)
    assert paths[:2] == ["_1_hips", "_1_hips/a_b"] and len(set(paths)) == len(paths)


def test_openusd_sees_the_motion(tmp_path):
    pytest.importorskip("pxr", reason="OpenUSD (the extra usd) is not installed")
    from pxr import Usd, UsdGeom, UsdSkel

    motion = make_motion()
    write_usda(tmp_path / "m.usda", motion)
    stage = Usd.Stage.Open(str(tmp_path / "m.usda"))
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert stage.GetTimeCodesPerSecond() == pytest.approx(59.94) and stage.GetEndTimeCode() == 11
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(stage.GetDefaultPrim())
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(binding.GetSkeleton())
    at = motion.joint_positions_world()
    mesh = bone_mesh(motion.skeleton)
    local = mesh.positions - motion.skeleton.rest_positions[mesh.joints]
    for t in range(len(motion)):
        joints = np.array(query.ComputeJointSkelTransforms(t))
        np.testing.assert_allclose(joints[:, 3, :3] @ TO_WORLD.T, at[t], atol=1e-5)
        (skin,) = binding.GetSkinningTargets()
        points = UsdGeom.Mesh(skin.GetPrim()).GetPointsAttr().Get()
        assert skin.ComputeSkinnedPoints(query.ComputeSkinningTransforms(t), points, t)
        world = motion.forward()[t][mesh.joints]
        wanted = np.einsum("vij,vj->vi", world[:, :3, :3], local) + world[:, :3, 3]
        np.testing.assert_allclose(np.array(points) @ TO_WORLD.T, wanted, atol=1e-5)
