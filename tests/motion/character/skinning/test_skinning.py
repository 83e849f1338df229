"""Skinning methods on meshes whose right result is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.motion.character import METHODS, Skin, Skinner
from muybridge.motion.character.skinning.rotation_centres import rotation_centres
from muybridge.motion.character.skinning.spherical import joint_sets
from tests.motion.character.skinning.tubes import chain_frames, chained_tube, hinge_frames, hinged_tube, middle_radius

TWIST, BEND = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])


def reference(skin: Skin, frames: np.ndarray) -> np.ndarray:
    """u = sum of w B M^-1 P, as written."""
    shape = np.c_[skin.positions, np.ones(len(skin.positions))]
    maps = (frames @ skin.bind)[:, skin.joints]
    return np.einsum("tvkab,vb,vk->tva", maps, shape, skin.weights)[..., :3]


@pytest.mark.parametrize("method", METHODS)
def test_rest_is_rest_and_rigid_motion_is_rigid(method: str) -> None:
    skin = hinged_tube()
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = Rotation.from_rotvec([0.4, -1.9, 0.7]).as_matrix(), [3, -2, 1]
    rest = hinge_frames(np.zeros((1, 3)))
    posed = Skinner([skin], method).pose(np.concatenate([rest, move @ rest]))[0]
    np.testing.assert_allclose(posed[0], skin.positions, atol=2e-6)
    np.testing.assert_allclose(posed[1], skin.positions @ move[:3, :3].T + move[:3, 3], atol=4e-6)


def test_linear_is_the_sum_it_says() -> None:
    rng = np.random.default_rng(1)
    skin = replace(hinged_tube(), bind=np.tile(np.eye(4), (5, 1, 1)))
    count = len(skin.positions)
    weights = rng.random((count, 9))
    weights[rng.random((count, 9)) < 0.4] = 0
    weights[:, 0] += 0.1
    bind = skin.bind + np.pad(rng.normal(0, 0.2, (5, 3, 4)), ((0, 0), (0, 1), (0, 0)))
    skin = replace(
        skin, joints=rng.integers(0, 5, (count, 9)), weights=weights / weights.sum(1, keepdims=True), bind=bind
    )
    frames = np.tile(np.eye(4), (150, 5, 1, 1))
    frames[..., :3, :3] = Rotation.random(750, rng=2).as_matrix().reshape(150, 5, 3, 3)
    frames[..., :3, 3] = rng.normal(size=(150, 5, 3))
    posed = Skinner([skin]).pose(frames)[0]
    assert posed.dtype == np.float32
    np.testing.assert_allclose(posed, reference(skin, frames), atol=5e-6)
    joined = [v for _, (v,) in Skinner([skin]).blocks(frames, size=40)]
    assert len(joined) == 4 and np.array_equal(np.concatenate(joined), posed)


@pytest.mark.parametrize("method", ["spherical", "dual-quaternion", "rotation-centres"])
def test_twisted_ring_keeps_its_radius(method: str) -> None:
    skin, frames = hinged_tube(), hinge_frames(np.radians([[0], [90], [150], [175]]) * TWIST)
    posed = Skinner([skin], method).pose(frames)[0]
    collapsed = Skinner([skin]).pose(frames)[0]
    assert middle_radius(collapsed[2]) < 0.3 * middle_radius(posed[0])
    for vertices in posed:
        assert middle_radius(vertices) == pytest.approx(0.2, abs=1e-5)


def test_bent_tube_bulges_less_about_rotation_centres() -> None:
    skin, frames = hinged_tube(), hinge_frames(np.radians([[150]]) * BEND)
    reach = {}
    for method in METHODS:
        vertices = Skinner([skin], method).pose(frames)[0][0]
        ring = vertices[16 * 16 : 25 * 16]
        bent = ring - [1.0, 0, 0]
        bent = bent @ Rotation.from_rotvec(np.radians(150) * BEND).as_matrix()
        from_bones = [np.linalg.norm(p - np.clip(p[:, :1], *ends) * [1, 0, 0], axis=1)
                      for p, ends in ((ring, (0, 1)), (bent, (0, 1)))]  # fmt: skip
        reach[method] = float(np.min(from_bones, axis=0).max()) / 0.2
    assert reach["rotation-centres"] < 1.05 < reach["dual-quaternion"]


def test_antipodal_quaternions_are_the_same_rotation() -> None:
    skin = hinged_tube()
    angles = np.radians([[179.0], [181.0], [359.0], [361.0]])
    posed = Skinner([skin], "dual-quaternion").pose(hinge_frames(angles * TWIST))[0]
    nearly, whole, beyond = posed[0], posed[2], posed[3]
    np.testing.assert_allclose(whole, skin.positions, atol=5e-3)
    np.testing.assert_allclose(beyond, skin.positions, atol=5e-3)
    assert middle_radius(nearly) == pytest.approx(0.2, abs=1e-5)


@pytest.mark.parametrize("method", ["spherical", "dual-quaternion", "rotation-centres"])
def test_stretch_of_bind_matrices_is_kept(method: str) -> None:
    skin = hinged_tube()
    bind = skin.bind.copy()
    bind[:, :3, :3] = np.diag([1.0, 1.5, 0.5])
    bind[1, 0, 3] = -1.0
    frames = hinge_frames(np.radians([[0], [40]]) * TWIST)
    skin = replace(skin, bind=bind)
    posed, linear = Skinner([skin], method).pose(frames)[0], Skinner([skin]).pose(frames)[0]
    np.testing.assert_allclose(posed[0], skin.positions * [1, 1.5, 0.5], atol=2e-6)
    rigid = skin.weights.max(axis=1) == 1
    np.testing.assert_allclose(posed[1][rigid], linear[1][rigid], atol=2e-6)


def test_centres_are_on_the_axis_and_common_to_parts() -> None:
    skin = hinged_tube()
    whole = rotation_centres([skin])[0]
    blended = (skin.weights > 0.2).all(axis=1)
    np.testing.assert_allclose(whole[blended][:, 1:], 0, atol=1e-6)
    half = len(skin.triangles) // 2
    parts = [replace(skin, triangles=skin.triangles[:half]), replace(skin, triangles=skin.triangles[half:])]
    for centres in rotation_centres(parts):
        np.testing.assert_allclose(centres[blended], whole[blended], atol=1e-9)


def test_spherical_centre_is_the_joint_of_two_bones() -> None:
    skin = hinged_tube()
    sets = joint_sets(skin.influences, skin.positions)
    turn = Rotation.from_rotvec([0.3, 0.8, -0.5]).as_rotvec()[None]
    two = int(sets.group[np.argmin(np.abs(skin.positions[:, 0] - 1))])
    centre = sets.centres(skin.rigid(hinge_frames(turn)).maps)[0, two]
    # The axis through the joint is not moved; the centre is on it.
    off = centre - [1, 0, 0]
    assert np.linalg.norm(np.cross(off, turn[0] / np.linalg.norm(turn))) < 1e-3


def test_delta_mush_smooths_the_fold_and_leaves_borders_and_seams() -> None:
    skin = hinged_tube(0.05)
    frames = hinge_frames(np.radians([[90]]) * BEND)
    linear, mushed = (Skinner([skin], m).pose(frames)[0][0] for m in ("linear", "delta-mush"))

    def edges(vertices: np.ndarray) -> float:
        along = vertices[:656].reshape(41, 16, 3)
        return float(np.linalg.norm(np.diff(along, 2, axis=0), axis=2).max())

    assert edges(mushed) < 0.7 * edges(linear)
    opened = replace(skin, triangles=skin.triangles[:-16])  # without its last cap
    done = Skinner([opened], "delta-mush").pose(frames)[0][0]
    np.testing.assert_array_equal(done[640:656], linear[640:656])


def test_split_vertices_stay_together() -> None:
    skin = hinged_tube(0.1)
    again = skin.triangles + len(skin.positions)
    half = len(again) // 2
    double = Skin(np.r_[skin.positions, skin.positions], np.r_[skin.triangles[:half], again[half:]],
                  np.r_[skin.joints, skin.joints], np.r_[skin.weights, skin.weights], skin.bind)  # fmt: skip
    posed = Skinner([double], "delta-mush").pose(hinge_frames(np.radians([[120]]) * BEND))[0][0]
    whole = Skinner([skin], "delta-mush").pose(hinge_frames(np.radians([[120]]) * BEND))[0][0]
    np.testing.assert_allclose(posed[: len(skin.positions)], whole, atol=1e-5)
    np.testing.assert_array_equal(posed[: len(skin.positions)], posed[len(skin.positions) :])


def volume(skin: Skin, vertices: np.ndarray) -> float:
    a, b, c = (vertices[skin.triangles[:, k]].astype(float) for k in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6)


def test_volume_of_a_bent_or_twisted_tube_is_kept() -> None:
    skin = hinged_tube()
    angles = np.radians([30, 60, 90, 120, 145])[:, None]
    rest = volume(skin, skin.positions)
    for axis, angle in ((BEND, angles), (TWIST, angles)):
        kept, turned = (Skinner([skin], m).pose(hinge_frames(angle * axis))[0] for m in ("volume", "linear"))
        # The part of the tube within a radius and a half of the joint holds some 0.3 of the whole.
        assert min(volume(skin, v) for v in turned) < 0.97 * rest
        np.testing.assert_allclose([volume(skin, v) / rest for v in kept], 1, atol=5e-3)


def test_folded_tube_touches_itself_and_goes_no_farther() -> None:
    skin = hinged_tube()
    frames = hinge_frames(np.radians([[150]]) * BEND)
    crossed = {}
    for method in ("rotation-centres", "volume"):
        vertices = Skinner([skin], method).pose(frames)[0][0].astype(float)
        ring = vertices[20 * 16 : 21 * 16].mean(axis=0)
        # Along the bones, away from the joint, on both sides; the plane between them is normal to the difference.
        away = np.array([-1.0, 0, 0]), frames[0, 1, :3, 0]
        normal = (away[1] - away[0]) / np.linalg.norm(away[1] - away[0])
        side = np.sign(skin.positions[:, 0] - 1)
        crossed[method] = -float((side * ((vertices - ring) @ normal)).min())
    assert crossed["rotation-centres"] > 0.1
    assert crossed["volume"] < 0.01


def test_joints_bent_together_keep_the_volume_of_the_whole() -> None:
    skin = chained_tube(6)
    frames = chain_frames(skin, np.radians(25) * np.tile(BEND, (6, 1)) * np.array([0, 1, 1, -1, 1, -1])[:, None])
    rest = volume(skin, skin.positions)
    kept, turned = (Skinner([skin], m).pose(frames)[0][0] for m in ("volume", "linear"))
    assert abs(volume(skin, kept) / rest - 1) < 0.5 * abs(volume(skin, turned) / rest - 1)
    assert np.linalg.norm(kept - turned, axis=1).max() < 0.1


def test_mesh_without_bending_joint_is_left_as_it_is() -> None:
    skin = hinged_tube()
    rigid = replace(skin, joints=np.zeros_like(skin.joints[:, :1]), weights=np.ones((len(skin.positions), 1)))
    frames = hinge_frames(np.radians([[90]]) * BEND)
    np.testing.assert_allclose(Skinner([rigid], "volume").pose(frames)[0][0], rigid.positions, atol=2e-6)


def test_unknown_method_lists_those_there_are() -> None:
    with pytest.raises(ValueError, match="linear, spherical, dual-quaternion, rotation-centres, delta-mush, volume"):
        Skinner([hinged_tube()], "quadratic")
