"""Joint centres from surface markers: against known centres, with noise, missing markers and too little motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.skeleton.functional_centres import score_centre, segment_poses, sphere_centre
from muybridge.geometry.skeleton.joint_centres import (
    centres_from_markers,
    hip_in_pelvis,
    midpoint,
    pelvis_frame,
    plane_centre,
)

CENTRE = np.array([0.02, 0.09, -0.08])


def swinging(frames: int, degrees: float, rng: np.random.Generator) -> np.ndarray:
    """Rotations of a limb that circles: (T, 3, 3)."""
    t = np.linspace(0, 4 * np.pi, frames)
    angles = np.stack([np.sin(t), np.cos(1.3 * t), 0.4 * np.sin(0.7 * t)], -1) * degrees + rng.normal(0, 1, (frames, 3))
    return Rotation.from_euler("xyz", angles, degrees=True).as_matrix()


def test_midpoint_and_missing() -> None:
    a, b = np.array([[0.0, 0, 0], [0, 0, 0]]), np.array([[0.1, 0, 0], [np.nan] * 3])
    assert np.allclose(midpoint(a, b)[0], [0.05, 0, 0])
    assert np.isnan(midpoint(a, b)[1]).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_plane_of_three_finds_the_elbow_inside(side: float) -> None:
    bend = np.radians(np.linspace(20, 120, 50))
    elbow = np.tile([side * 0.04, 0, 0], (50, 1))
    upper = elbow + [0, 0, 0.3]
    lower = elbow + 0.25 * np.stack([0 * bend, -np.sin(bend), -np.cos(bend)], -1)
    found = plane_centre(upper, elbow, lower, 0.04, np.tile([-side, 0.2, 0.1], (50, 1)))
    assert np.allclose(found, 0, atol=1e-9)
    straight = plane_centre(upper, elbow, elbow - [0, 0.01, 0.25], 0.04, np.tile([-side, 0, 0], (50, 1)))
    assert np.isnan(straight).all()


def test_pelvis_frame_is_anatomical() -> None:
    left, right, back = np.array([[0.12, -0.1, 1]]), np.array([[-0.12, -0.1, 1]]), np.array([[0.0, 0.06, 1.0]])
    front, axes, width, depth = pelvis_frame(left, right, back)
    assert np.allclose(front, [[0, -0.1, 1]]) and np.isclose(width, 0.24) and np.isclose(depth, 0.16)
    assert np.allclose(axes[0], np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).T)  # columns: forward, left, up


def test_hip_regressions_give_the_published_numbers() -> None:
    # Pelvis 240 mm wide and 150 mm deep, leg of 900 mm: by hand from the papers' equations.
    assert np.allclose(hip_in_pelvis("harrington", 0.24, 0.15), [-0.0459, 0.0865, -0.0829])
    assert np.allclose(hip_in_pelvis("bell", 0.24, 0.15), [-0.0528, 0.0864, -0.072])
    c, back = 0.115 * 0.9 - 0.0153, -(0.1288 * 0.9 - 0.04856) - 0.007
    davis = hip_in_pelvis("davis", 0.24, 0.15, 0.9)
    assert np.allclose(davis[1], 0.12 - c * np.sin(np.radians(28.4)))
    assert np.allclose(davis[0], back * np.cos(np.radians(18)) + c * np.cos(np.radians(28.4)) * np.sin(np.radians(18)))
    assert -0.12 < davis[2] < -0.05
    with pytest.raises(ValueError, match="leg"):
        hip_in_pelvis("davis", 0.24, 0.15)


def test_score_finds_the_shared_point_of_two_moving_bones() -> None:
    rng = np.random.default_rng(0)
    first = swinging(200, 15, rng)
    origin = rng.normal(0, 0.3, (200, 3))
    second = first @ swinging(200, 30, rng)
    in_second = np.array([0.01, 0.0, 0.4])
    joint = origin + first @ CENTRE
    places = joint - second @ in_second + rng.normal(0, 0.002, (200, 3))
    places[::10] += rng.normal(0, 0.1, (20, 3))  # frames in which a cluster was wrong
    places[5] = np.nan
    found = score_centre(first, origin, second, places)
    assert np.linalg.norm(found.in_first - CENTRE) < 0.003
    assert np.linalg.norm(found.in_second - in_second) < 0.003
    assert np.linalg.norm(found.in_first - CENTRE) < 5 * np.linalg.norm(found.sigma_m) + 1e-4
    with pytest.raises(ValueError, match="4 frames"):
        score_centre(first[:3], origin[:3], second[:3], places[:3])


def test_spheres_have_one_centre_and_noise_does_not_draw_it_in() -> None:
    """Where the motion is small, noise draws the closed form towards the markers, and the distances hardly."""
    rng = np.random.default_rng(1)
    turns = swinging(2000, 15, rng)
    markers = np.array([[0.05, 0.02, -0.25], [0.06, 0.0, -0.38]])
    points = CENTRE + np.einsum("tij,kj->tki", turns, markers)
    assert np.linalg.norm(sphere_centre(points)[0] - CENTRE) < 1e-6
    noisy = points + rng.normal(0, 0.006, points.shape)
    noisy[::7, 1] = np.nan
    plain, corrected = sphere_centre(noisy, rounds=0)[0], sphere_centre(noisy)[0]
    assert np.linalg.norm(plain - CENTRE) > 0.05
    assert np.linalg.norm(corrected - CENTRE) < 0.012
    with pytest.raises(ValueError, match="hardly move"):
        sphere_centre(np.repeat(points[:1], 50, axis=0))


def test_segment_poses_survive_missing_markers() -> None:
    rng = np.random.default_rng(2)
    turns, places = swinging(60, 40, rng), rng.normal(0, 1, (60, 3))
    cluster = rng.normal(0, 0.1, (4, 3))
    points = np.einsum("tij,kj->tki", turns, cluster) + places[:, None]
    points[10:20, 0] = np.nan
    points[30, :2] = np.nan
    found, at, reference = segment_poses(points)
    again = np.einsum("tij,kj->tki", found, reference) + at[:, None]
    known = np.isfinite(points[..., 0]) & (np.arange(60) != 30)[:, None]
    assert np.abs(again - points)[known].max() < 1e-6
    assert np.isnan(found[30]).all()


def test_methods_for_a_marker_set() -> None:
    """A leg that circles about a hip of its own: the functional centre is nearer to it than the regression."""
    rng = np.random.default_rng(3)
    frames = 400
    pelvis = {"left_asis": [0.12, -0.1, 1], "right_asis": [-0.12, -0.1, 1], "left_psis": [0.05, 0.06, 1.02],
              "right_psis": [-0.05, 0.06, 1.02]}  # fmt: skip
    hip = np.array([0.105, -0.03, 0.90])
    turns = swinging(frames, 25, rng)
    leg = {"left_thigh_distal": [0.06, 0, -0.28], "left_knee_lateral": [0.06, 0, -0.4]}
    index = {n: i for i, n in enumerate([*pelvis, *leg])}
    points = np.concatenate([np.tile(np.array(list(pelvis.values())), (frames, 1, 1)),
                             hip + np.einsum("tij,kj->tki", turns, np.array(list(leg.values())))], 1)  # fmt: skip
    points += rng.normal(0, 0.001, points.shape)
    moved = centres_from_markers(points, index, ("functional", "harrington"))
    place = moved.names.index("left_thigh")
    assert np.linalg.norm(moved.points_world[:, place] - hip, axis=-1).mean() < 0.006
    regressed = centres_from_markers(points, index, ("harrington",))
    assert regressed.names == ("left_thigh", "right_thigh")
    # Harrington's equation by hand: the pelvis is 240 mm wide and leans forward.
    front, depth = np.array([0, -0.16, -0.02]), np.hypot(0.16, 0.02)
    forward, up = front / depth, np.array([0, -0.02, 0.16]) / depth
    wanted = [0, -0.1, 1] + 0.0865 * np.array([1, 0, 0]) - (0.24 * depth + 0.0099) * forward - 0.0829 * up
    found = regressed.points_world[:, 0].mean(0)
    assert np.abs(found - wanted).max() < 0.001
    assert np.linalg.norm(found - hip) > 0.006
    with pytest.raises(ValueError, match="choose"):
        centres_from_markers(points, index, ("guess",))
