"""Smoothing of points over time: noise, gaps, outliers, flips, covariance."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.smoothing.kalman import SmoothOptions, clean_points, smooth_points

LEFT = [i for i, n in enumerate(BODY23.names) if n.startswith("left_")]


def take(frames: int = 240, fps: float = 60.0, sigma: float | None = None) -> Points3D:
    """Landmarks of a figure that turns slowly and waves: sides 0.3 m apart, within 4 m/s^2."""
    time = np.arange(frames)[:, None] / fps
    j = np.arange(23)
    side = np.array([1.0 if n.startswith("left") else -1.0 if n.startswith("right") else 0.0 for n in BODY23.names])
    across = 0.15 * side
    to_front = {"nose": 0.12, "big_toe": 0.15, "small_toe": 0.12, "heel": -0.06}
    ahead = np.array([next((v for k, v in to_front.items() if n.endswith(k)), 0.0) for n in BODY23.names])
    height = 1.7 - 0.07 * j
    xyz = np.stack(
        [
            across * np.cos(time) + ahead * np.sin(time) + 0.1 * np.sin(3 * time + j),
            across * np.sin(time) - ahead * np.cos(time) + 0.4 * time,
            height + 0.2 * np.sin(2 * time + 0.3 * j),
        ],
        axis=-1,
    )
    covariance = np.full((frames, 23, 3, 3), np.nan)
    if sigma is not None:
        covariance[:] = np.eye(3) * sigma**2
    return Points3D(BODY23, xyz, covariance, np.empty((0, frames, 23)), np.empty((0, frames, 23), bool), fps)


def walk(seconds: float, fps: float) -> Points3D:
    """A figure that walks at 1.4 m/s, 108 steps a minute: its feet pass each other at 4 m/s."""
    time = np.arange(round(seconds * fps)) / fps
    phase = 2 * np.pi * 0.9 * time
    # Half as wide, ahead, height, how far they swing, and with which foot.
    parts = {
        "nose": (0, 0.1, 1.62, 0, 1), "eye": (0.03, 0.09, 1.66, 0, 1), "ear": (0.07, 0, 1.65, 0, 1),
        "shoulder": (0.18, 0, 1.45, 0.03, -1), "elbow": (0.2, 0, 1.15, 0.1, -1), "wrist": (0.22, 0, 0.9, 0.25, -1),
        "hip": (0.1, 0, 0.95, 0.03, 1), "knee": (0.1, 0.03, 0.5, 0.2, 1), "ankle": (0.1, 0, 0.09, 0.36, 1),
        "heel": (0.1, -0.05, 0.03, 0.36, 1), "big_toe": (0.09, 0.15, 0.03, 0.36, 1),
        "small_toe": (0.14, 0.12, 0.03, 0.36, 1),
    }  # fmt: skip
    xyz = np.empty((len(time), 23, 3))
    for j, name in enumerate(BODY23.names):
        half, ahead, height, swing, foot = next(v for k, v in parts.items() if name.endswith(k))
        side = name.startswith("left_") - name.startswith("right_")
        xyz[:, j] = np.stack([half * side + 0 * time, 1.4 * time + ahead + foot * side * swing * np.sin(phase),
                              height + 0.02 * np.sin(2 * phase)], axis=-1)  # fmt: skip
    xyz[..., :2] = -xyz[..., :2]  # forward is -y, so that the left is +x
    xyz[..., 0] = -xyz[..., 0]
    none = np.empty((0, *xyz.shape[:2]))
    return Points3D(BODY23, xyz, np.tile(np.eye(3) * 0.015**2, (*xyz.shape[:2], 1, 1)), none, none > 0, fps)


def with_points(points: Points3D, xyz: np.ndarray) -> Points3D:
    return replace(points, points_world=xyz)


def error(points: Points3D, truth: Points3D) -> np.ndarray:
    return np.linalg.norm(points.points_world - truth.points_world, axis=-1)


@pytest.mark.parametrize(("sigma", "stated"), [(0.03, 0.03), (0.03, 0.006), (0.03, None), (0.003, 0.03)])
def test_noise_is_reduced_for_wrong_covariances(sigma, stated):
    truth = take(sigma=stated)
    noisy = with_points(truth, truth.points_world + np.random.default_rng(0).normal(0, sigma, (240, 23, 3)))
    smooth = smooth_points(noisy)
    assert error(smooth, truth).mean() < 0.55 * error(noisy, truth).mean()


def test_clean_points_stay_where_they_are_without_lag():
    truth = take(sigma=0.01)
    assert error(smooth_points(truth), truth).max() < 0.006


def test_covariance_matches_the_error():
    truth = take(sigma=0.02)
    noisy = with_points(truth, truth.points_world + np.random.default_rng(1).normal(0, 0.02, (240, 23, 3)))
    noisy.points_world[100:120, 3] = np.nan
    smooth = smooth_points(noisy)
    off = smooth.points_world - truth.points_world
    far = np.einsum("tji,tjik,tjk->tj", off, np.linalg.inv(smooth.covariance_world), off)
    assert 1.0 < np.median(far) < 4.0
    spread = np.trace(smooth.covariance_world, axis1=-2, axis2=-1)
    assert spread[110, 3] > 5 * spread[50, 3] and spread[110, 3] > spread[102, 3]


def test_gaps_are_filled_up_to_a_length():
    truth = take()
    points = truth.points_world.copy()
    points[50:60, 0] = np.nan
    points[100:160, 1] = np.nan
    points[:20, 2] = np.nan
    points[200:, 2] = np.nan
    points[:, 4] = np.nan
    points[70, 5, 1] = np.nan
    smooth = smooth_points(with_points(truth, points), SmoothOptions(max_gap=0.5))
    known = np.isfinite(smooth.points_world).all(axis=-1)
    assert known[:, 0].all() and known[:, 5].all() and error(smooth, truth)[50:60, 0].max() < 0.03
    assert known[:100, 1].all() and not known[100:160, 1].any() and known[160:, 1].all()
    assert not known[:20, 2].any() and known[20:200, 2].all() and not known[200:, 2].any()
    assert not known[:, 4].any()
    assert np.isnan(smooth.covariance_world[~known]).all() and np.isfinite(smooth.covariance_world[known]).all()
    whole = smooth_points(with_points(truth, points), SmoothOptions(max_gap=np.inf, extrapolate=True))
    filled = np.isfinite(whole.points_world).all(axis=-1)
    assert filled[:, [0, 1, 2, 5]].all() and not filled[:, 4].any()
    np.testing.assert_array_equal(whole.points_world[:20, 2], whole.points_world[[20] * 20, 2])


def test_outliers_are_dropped_and_fast_motion_is_not():
    truth = take(sigma=0.01)
    rng = np.random.default_rng(2)
    points = truth.points_world + rng.normal(0, 0.01, truth.points_world.shape)
    bad = rng.random(points.shape[:2]) < 0.08
    points[bad] += rng.choice([-1, 1], (bad.sum(), 3)) * rng.uniform(0.15, 0.6, (bad.sum(), 3))
    cleaned = clean_points(with_points(truth, points))
    gone = np.isnan(cleaned.points_world[..., 0])
    assert gone[bad].mean() > 0.97 and gone[~bad].mean() < 0.01
    assert np.nanmean(error(smooth_points(with_points(truth, points)), truth)) < 0.012
    time = np.arange(120) / 60
    punch = truth.points_world[:120].copy()
    punch[:, 9, 1] -= 0.7 * np.exp(-(((time - 1) / 0.12) ** 2))
    fast = with_points(take(120, sigma=0.01), punch)
    assert np.isfinite(clean_points(fast).points_world).all()
    assert error(smooth_points(fast), fast)[:, 9].max() < 0.12


@pytest.mark.parametrize("what", ["everything", "legs", "one pair"])
def test_flips_are_corrected(what):
    truth = take(sigma=0.03)
    points = truth.points_world + np.random.default_rng(3).normal(0, 0.02, truth.points_world.shape)
    words = {"everything": "", "legs": ("knee", "ankle", "hip", "toe", "heel"), "one pair": "wrist"}[what]
    sides = [i for i in range(23) if BODY23.names[i].endswith(words)] if words else list(range(23))
    twins = [BODY23.mirror[i] for i in sides]
    right_way = points.copy()
    for start, length in ((40, 3), (90, 15), (170, 20)):
        points[start : start + length, sides] = points[start : start + length, twins]
    points[np.random.default_rng(4).random(points.shape[:2]) < 0.1] = np.nan
    back = clean_points(with_points(truth, points), SmoothOptions(hampel_window=0)).points_world
    known = np.isfinite(back[..., 0])
    assert (np.abs(back - right_way).max(axis=-1)[known] < 1e-9).mean() > 0.97
    untouched = clean_points(with_points(truth, points), SmoothOptions(unflip=False, hampel_window=0))
    np.testing.assert_array_equal(untouched.points_world, points)


def test_correct_sides_are_kept():
    truth = take(sigma=0.03)
    points = truth.points_world + np.random.default_rng(5).normal(0, 0.03, truth.points_world.shape)
    back = clean_points(with_points(truth, points), SmoothOptions(hampel_window=0)).points_world
    assert (back == points).all(axis=-1).mean() > 0.99


@pytest.mark.parametrize("fps", [5.0, 6.0, 8.0, 12.0, 60.0])
def test_legs_that_pass_between_two_frames_are_not_flipped(fps):
    truth = walk(12, fps)
    points = truth.points_world + np.random.default_rng(6).normal(0, 0.015, truth.points_world.shape)
    back = clean_points(with_points(truth, points), SmoothOptions(hampel_window=0)).points_world
    assert (back == points).all(axis=-1).mean() > 0.99


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_short_takes(frames):
    points = take(frames, sigma=0.01)
    smooth = smooth_points(points)
    assert smooth.points_world.shape == (frames, 23, 3) and np.isfinite(smooth.points_world).all()


def test_all_missing_stays_missing_and_bad_covariances_do_no_harm():
    truth = take(30)
    nothing = smooth_points(with_points(truth, np.full((30, 23, 3), np.nan)))
    assert np.isnan(nothing.points_world).all() and np.isnan(nothing.covariance_world).all()
    odd = take(60, sigma=0.02)
    odd.covariance_world[::3] = 0.0
    odd.covariance_world[1::3] = -np.eye(3)
    odd.covariance_world[5, 5] = np.eye(3) * 1e300
    smooth = smooth_points(odd)
    assert np.isfinite(smooth.points_world).all() and error(smooth, odd).max() < 0.1


def test_landmarks_without_sides_and_frame_rates():
    marker = LandmarkSet("m", ("LASI",), ())
    for fps in (25.0, 240.0):
        points = take(int(2 * fps), fps, sigma=0.02)
        one = replace(
            points, landmarks=marker, points_world=points.points_world[:, :1],
            covariance_world=points.covariance_world[:, :1],
        )  # fmt: skip
        assert error(smooth_points(one), one).max() < 0.03
    with pytest.raises(ValueError, match="fps"):
        smooth_points(replace(points, fps=0.0))


@pytest.mark.parametrize("method", ["butterworth", "savgol", "loess"])
def test_other_filters_use_the_same_cleaning(method):
    truth = take()
    xyz = truth.points_world + np.random.default_rng(4).normal(0, 0.01, truth.points_world.shape)
    xyz[40:44, 2] = np.nan
    xyz[70, 3] += 1.0
    stated = {"cutoff_hz": 6.0} if method == "butterworth" else {}
    off = error(smooth_points(with_points(truth, xyz), SmoothOptions(method=method, **stated)), truth)
    assert np.isfinite(off).all() and off[70, 3] < 0.05
    assert np.sqrt(np.mean(off[5:-5] ** 2)) < 0.85 * 0.01 * np.sqrt(3)


def test_impossible_cutoffs_are_refused():
    with pytest.raises(MuybridgeError, match="needs more than 1000 frames/s"):
        smooth_points(take(), SmoothOptions(method="butterworth", cutoff_hz=500.0))
    with pytest.raises(ValueError, match="goes with method butterworth"):
        SmoothOptions(cutoff_hz=6.0)
