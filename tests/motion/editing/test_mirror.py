"""Mirroring: who is whose counterpart, and where limbs point afterwards."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing import find_sides, mirror, pair_names
from tests.motion.editing.clips import own_axes, points, uneven, walk, with_root_bone


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("LeftArm", "RightArm"),
        ("left_arm", "right_arm"),
        ("mixamorig:LeftArm", "mixamorig:RightArm"),
        ("upperarm_l", "upperarm_r"),
        ("arm.L", "arm.R"),
        ("J_Bip_L_Hand", "J_Bip_R_Hand"),
        ("Bip01 L Thigh", "Bip01 R Thigh"),
        ("lfemur", "rfemur"),
        ("LSHO", "RSHO"),
        ("rig|LElb", "rig|RElb"),
        ("armL", "armR"),
        ("hand.l.001", "hand.r.001"),
        ("Arm_Left_2", "Arm_Right_2"),
        ("L1Toe", "R1Toe"),
    ],
)
def test_names_of_many_programs_are_paired(left: str, right: str) -> None:
    assert pair_names(["Hips", right, left]) == {2: 1}


def test_names_that_are_no_pairs() -> None:
    assert pair_names(["lowerback", "upperback", "neck", "leftover", "Rlowerback"]) == {}


@pytest.mark.parametrize("clip", [walk, own_axes, with_root_bone])
def test_joints_go_where_the_images_of_their_counterparts_are(clip) -> None:
    motion = clip()
    sides = find_sides(motion.skeleton)
    out = mirror(motion, "x")
    images = motion.joint_positions_world()[:, list(sides.partner)] * (-1, 1, 1)
    # But for the hand that slides on one side alone.
    far = np.abs(out.joint_positions_world() - images).max(axis=(0, 2)) > 1e-6
    assert not far.any(), [n for n, f in zip(motion.skeleton.names, far, strict=True) if f]


def test_limbs_point_where_the_images_point_on_an_uneven_rest_pose() -> None:
    motion = uneven()
    skeleton = motion.skeleton
    places, out = motion.joint_positions_world() * (-1, 1, 1), mirror(motion, "x").joint_positions_world()
    for side, other in (("left", "right"), ("right", "left")):
        for upper, lower in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot")):
            mine = out[:, skeleton.index(f"{side}_{lower}")] - out[:, skeleton.index(f"{side}_{upper}")]
            image = places[:, skeleton.index(f"{other}_{lower}")] - places[:, skeleton.index(f"{other}_{upper}")]
            cosine = (mine * image).sum(1) / np.linalg.norm(mine, axis=1) / np.linalg.norm(image, axis=1)
            assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.1


def test_start_keeps_place_and_heading() -> None:
    motion = walk()
    out = mirror(motion)
    np.testing.assert_allclose(out.root_positions_world[0], motion.root_positions_world[0], atol=1e-9)
    way, image = (m.root_positions_world[-1] - m.root_positions_world[0] for m in (motion, out))
    assert np.degrees(np.arccos(way @ image / (way @ way))) < 5


def _scrambled(skeleton: Skeleton) -> Skeleton:
    return replace(skeleton, names=tuple(f"bone {k}" for k in np.random.default_rng(0).permutation(len(skeleton))))


@pytest.mark.parametrize("clip", [walk, uneven, with_root_bone])
def test_pairs_are_found_without_names(clip) -> None:
    skeleton = clip().skeleton
    if clip is uneven:  # an arm that hangs is nobody's image: the rest is
        skeleton = replace(skeleton, offsets=walk().skeleton.offsets
                           + np.random.default_rng(1).normal(0, 0.003, skeleton.offsets.shape))  # fmt: skip
    by_names, by_places = find_sides(skeleton), find_sides(_scrambled(skeleton))
    assert by_places.partner == by_names.partner
    assert sum(by_places.how.values()) == sum(by_names.how.values()) > 5
    np.testing.assert_allclose(np.abs(by_places.normal), [1, 0, 0])


def test_a_skeleton_that_faces_elsewhere_has_its_plane_there() -> None:
    skeleton = walk().skeleton
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(skeleton, offsets=skeleton.offsets @ quarter.T, tips=skeleton.tips @ quarter.T)
    for kind in (turned, _scrambled(turned)):
        np.testing.assert_allclose(np.abs(find_sides(kind).normal), [0, 1, 0], atol=1e-9)


def test_what_has_no_two_sides_is_refused() -> None:
    chain = Skeleton(("a", "b"), (-1, 0), np.array([[0.0, 0, 0], [0, 0, 1]]), np.full((2, 3), np.nan), (2, 2),
                     np.zeros((2, 3)), np.zeros((2, 3)))  # fmt: skip
    with pytest.raises(MuybridgeError, match="no joint has a counterpart"):
        find_sides(chain)
    cloud = points()
    names = tuple(f"M{k}" for k in range(len(cloud.landmarks)))
    with pytest.raises(MuybridgeError, match="no point has a counterpart"):
        mirror(replace(cloud, landmarks=LandmarkSet("markers", names, ())))


def test_points_exchange_names_and_keep_gaps() -> None:
    before = points()
    after = mirror(before, "y")
    names = before.landmarks.names
    a, b = names.index("left_hand"), names.index("right_hand")
    np.testing.assert_allclose(after.points_world[:, a], before.points_world[:, b] * (1, -1, 1))
    assert np.isnan(after.points_world).sum() == np.isnan(before.points_world).sum()
