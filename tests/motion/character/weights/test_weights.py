"""Weights of meshes whose right weights are known, and of artists' rigs."""

import numpy as np
import pytest

from muybridge.motion.character import WEIGHT_METHODS, WeightOptions, read_character, skin_weights
from muybridge.motion.character.surface import join_vertices
from muybridge.motion.character.weights import packed_weights
from muybridge.motion.character.weights.bones import bones_in
from muybridge.motion.character.weights.names import without_flesh
from muybridge.motion.character.weights.rays import RayGrid
from tests.motion.character.skinning.tubes import tube
from tests.paths import SHARED

JOINTS, PARENTS = np.array([[0.1, 0, 0], [1.0, 0, 0], [1.9, 0, 0]]), np.array([-1, 0, 1])


def sphere(centre: tuple[float, float, float], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A ball of a few triangles."""
    points, triangles = tube(9, 12, 2.0, 1.0)
    points = points - [1, 0, 0]
    points[:, 1:] *= np.sqrt(np.maximum(1 - points[:, :1] ** 2, 0))
    return radius * points + centre, triangles


def joined(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(p) for p, _ in parts)])
    return np.concatenate([p for p, _ in parts]), np.concatenate(
        [t + n for (_, t), n in zip(parts, starts[:-1], strict=True)]
    )


@pytest.mark.parametrize("method", WEIGHT_METHODS)
def test_tube_follows_its_bones(method: str) -> None:
    points, triangles = tube()
    weights = skin_weights(points, triangles, JOINTS, PARENTS, method)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    x = points[:, 0]
    assert weights[x < 0.6, 0].min() > 0.85 and weights[x > 1.4, 1:].sum(axis=1).min() > 0.85
    middle = np.abs(x - 1.0) < 1e-9
    np.testing.assert_allclose(weights[middle, 0], 0.5, atol=0.1)


@pytest.mark.parametrize("method", ["heat", "voxels"])
def test_other_leg_is_not_moved(method: str) -> None:
    left, right = tube(), tube()
    mesh = joined((left[0] + [0, 0.3, 0], left[1]), (right[0] - [0, 0.3, 0], right[1]), sphere((-0.2, 0, 0), 0.5))
    joints = np.array([[-0.3, 0, 0], [0.1, 0.3, 0], [1.0, 0.3, 0], [0.1, -0.3, 0], [1.0, -0.3, 0]])
    weights = skin_weights(*mesh, joints, np.array([-1, 0, 1, 0, 3]), method)
    far = mesh[0][:, 0] > 0.8
    assert weights[far & (mesh[0][:, 1] > 0)][:, 3:].max() < 0.02
    assert weights[far & (mesh[0][:, 1] < 0)][:, 1:3].max() < 0.02


def test_loose_button_is_rigid_and_goes_with_the_surface() -> None:
    points, triangles = tube(radius=0.3)
    button = sphere((0.5, 0.31, 0), 0.015)
    mesh = joined((points, triangles), button)
    weights = skin_weights(*mesh, JOINTS, PARENTS)
    on_button = weights[len(points) :]
    np.testing.assert_allclose(on_button, on_button[:1].repeat(len(on_button), 0), atol=1e-9)
    near = np.argmin(np.linalg.norm(points - [0.5, 0.3, 0], axis=1))
    np.testing.assert_allclose(on_button[0], weights[near], atol=0.05)


def test_roots_on_the_floor_and_targets_outside_get_nothing() -> None:
    points, triangles = tube()
    joints = np.vstack([[[0.0, 0, -2.0]], JOINTS, [[1.0, 0.9, 0]]])
    weights = skin_weights(points, triangles, joints, np.array([-1, 0, 1, 2, 0]))
    assert not weights[:, [0, 4]].any()


@pytest.mark.parametrize("method", WEIGHT_METHODS)
def test_a_slot_for_a_weapon_inside_of_the_hand_gets_nothing(method: str) -> None:
    points, triangles = tube()
    joints, parents = np.array([[0.1, 0, 0], [1.0, 0, 0], [1.7, 0, 0.05]]), np.array([-1, 0, 1])
    unnamed = skin_weights(points, triangles, joints, parents, method)
    assert unnamed[:, 2].max() > 0.5
    weights = skin_weights(points, triangles, joints, parents, method, names=("arm.l", "hand.l", "handslot.l"))
    assert not weights[:, 2].any()
    assert weights[points[:, 0] > 1.4, 1].min() > 0.85
    # With a finger below it, the joint is a bone, whatever its name.
    joints, parents = np.vstack([joints, [[1.95, 0, 0.05]]]), np.array([-1, 0, 1, 2])
    fingers = skin_weights(points, triangles, joints, parents, method, names=("arm", "hand", "ik_hand", "finger"))
    assert fingers[:, 2].max() > 0.3


def test_names_tell_slots_targets_controls_and_ends() -> None:
    others = ("handslot.l", "kneeIK.r", "IK-foot.l", "control-toe-roll.l", "mixamorig:HeadTop_End", "weapon_r",
              "Bip01 HeadNub", "shoulder_target")  # fmt: skip
    bones = ("hand.l", "propeller", "spike", "mixamorig:Spine", "tail_1", "bend.l", "Weaponless")
    assert without_flesh(others, np.full(len(others), -1)).all()
    assert not without_flesh(bones, np.full(len(bones), -1)).any()
    assert without_flesh(("root_ctrl", "prop", "hand"), np.array([-1, 2, 0])).tolist() == [False, True, False]


def test_any_mesh_gets_weights(recwarn: pytest.WarningsRecorder) -> None:
    rng = np.random.default_rng(3)
    soup = rng.random((90, 3)), np.arange(90).reshape(-1, 3)
    loose = np.vstack([soup[0], [[9.0, 9, 9]]])  # of no triangle
    for method in WEIGHT_METHODS:
        weights = skin_weights(loose, soup[1], JOINTS - 0.5, PARENTS, method)
        np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    far = skin_weights(*tube(), JOINTS + 50, PARENTS)
    np.testing.assert_allclose(far.sum(axis=1), 1, atol=1e-6)
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]])
    np.testing.assert_allclose(skin_weights(flat, np.array([[0, 1, 2]]), JOINTS, PARENTS).sum(axis=1), 1, atol=1e-6)
    assert not [str(w.message) for w in recwarn if "invalid" in str(w.message) or "divide" in str(w.message)]


@pytest.mark.parametrize("most", [1, 2, 4])
def test_influences_are_as_few_as_asked(most: int) -> None:
    points, triangles = tube()
    joints = np.stack([np.linspace(0.1, 1.9, 9), np.zeros(9), np.zeros(9)], axis=1)
    weights = skin_weights(points, triangles, joints, np.arange(-1, 8), options=WeightOptions(influences=most))
    assert np.count_nonzero(weights, axis=1).max() <= most
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)


def test_packed_weights_are_the_heaviest_joints_first():
    weights = np.random.default_rng(0).dirichlet(np.ones(9), 50)
    weights[np.arange(50)[:, None], np.argsort(weights, axis=1)[:, :5]] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    joints, values = packed_weights(weights, 4)
    assert joints.shape == values.shape == (50, 4) and np.allclose(values.sum(axis=1), 1.0)
    assert (np.diff(values, axis=1) <= 0).all()
    back = np.zeros_like(weights)
    np.put_along_axis(back, joints, values, axis=1)
    assert np.array_equal(back, weights)


def test_large_meshes_are_weighted_like_small_ones() -> None:
    fine, coarse = tube(360, 160), tube(41, 16)
    weights = skin_weights(*fine, JOINTS, PARENTS)
    assert len(fine[0]) > 50_000
    small = skin_weights(*coarse, JOINTS, PARENTS)
    for x in (0.5, 0.9, 1.0, 1.1, 1.5):
        ring, own = np.abs(fine[0][:, 0] - x).argmin(), np.abs(coarse[0][:, 0] - x).argmin()
        np.testing.assert_allclose(weights[ring, 0], small[own, 0], atol=0.08)


def test_share_of_a_way_outside() -> None:
    surface = join_vertices(*joined(sphere((0, 0, 0), 1.0), sphere((4, 0, 0), 1.0)))
    rays = RayGrid(surface.points, surface.triangles)
    begin, end = np.array([[0.01, 0.02, 0.03]]), np.array([[4.01, 0.02, 0.03]])
    assert rays.outside(begin, end)[0] == pytest.approx(0.5, abs=0.02)
    assert rays.exits(begin, end)[0] == pytest.approx(0.25, abs=0.01)
    assert rays.outside(begin, begin + 0.2)[0] == 0 and rays.exits(begin, begin + 0.2)[0] == np.inf


def test_bone_without_child_goes_to_the_end_of_the_mesh() -> None:
    surface = join_vertices(*tube())
    bones = bones_in(surface, JOINTS[:2], PARENTS[:2])
    assert bones.end[bones.joint == 1][0, 0] > 1.6


@pytest.mark.parametrize(("change", "message"), [
    ({"method": "magic"}, "auto, heat, voxels, distance"), ({"parents": np.array([-1, 0])}, "joints must be"),
    ({"triangles": np.array([[0, 1, 9999]])}, "vertex 9999"), ({"parents": np.array([-1, 1, 1])}, "another joint"),
    ({"triangles": np.zeros((0, 3), int)}, "at least one"), ({"joints": JOINTS * np.nan}, "finite"),
])  # fmt: skip
def test_bad_arrays_are_named(change: dict, message: str) -> None:
    points, triangles = tube(5, 6)
    with pytest.raises(ValueError, match=message):
        skin_weights(**({"vertices": points, "triangles": triangles, "joints": JOINTS, "parents": PARENTS} | change))


@pytest.mark.parametrize("name", ["kaykit_knight", "mesh2motion_female", "mesh2motion_bunny", "mesh2motion_dog"])
def test_weights_are_near_an_artist_s(name: str) -> None:
    path = SHARED / "data" / "characters" / f"{name}.glb"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    character = read_character(path)
    meshes = [m for m in character.meshes if not m.rigid]
    vertices, triangles = joined(*((m.positions, m.triangles) for m in meshes))
    artist = np.zeros((len(vertices), len(character.skeleton)))
    start = 0
    for mesh in meshes:
        rows = start + np.arange(len(mesh.positions))[:, None]
        np.add.at(artist, (rows, mesh.joints), mesh.weights)
        start += len(rows)
    joints = character.rest_motion().joint_positions_world()[0]
    names = character.skeleton.names
    weights = skin_weights(vertices, triangles, joints, np.array(character.skeleton.parents), names=names)
    assert not weights[:, [k for k, n in enumerate(names) if "slot" in n or "IK" in n]].any()
    assert np.abs(weights - artist).sum(axis=1).mean() < 0.42
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
