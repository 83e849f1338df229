"""Triangulation of a whole take: against single frames, with the truth known."""

from pathlib import Path

import numpy as np
import pytest

import scripts.benchmarks.geometry.triangulation as bench
from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import midpoint, ray_directions
from muybridge.geometry.triangulation.multiview import triangulate
from scripts.benchmarks.geometry.whole_take import TakeOptions, triangulate_take

PX = 3.0


def rods(frames: int = 150, rate: float = 0.05) -> FloatArray:
    """(T, 8, 3): four rods of 0.4 m that wander and turn."""
    time = np.arange(frames) * rate
    out = np.empty((frames, 8, 3))
    for k in range(4):
        out[:, k] = np.stack([0.4 * np.sin(time + k), 0.3 * np.cos(1.3 * time + 2 * k), 0.8 + 0.2 * k + 0 * time], 1)
        angle = 1.7 * time + k
        out[:, 4 + k] = out[:, k] + 0.4 * np.stack([np.cos(angle), 0 * time, np.sin(angle)], axis=1)
    return out


def seen(
    truth: FloatArray, cameras: int = 4, outliers: float = 0.05, seed: int = 0
) -> tuple[CameraGroup, FloatArray, FloatArray]:
    """A ring of cameras, what they see of it, and its variance."""
    group: CameraGroup = bench.synthetic(cameras, frames=1)[0]
    rng = np.random.default_rng(seed)
    px = group.project(truth) + rng.normal(0, PX, (cameras, *truth.shape[:2], 2))
    wrong = rng.random(px.shape[:-1]) < outliers
    px[wrong] += rng.normal(0, 80, (int(wrong.sum()), 2))
    return group, px, np.full(px.shape[:-1], PX**2)


def error_mm(points: FloatArray, truth: FloatArray) -> FloatArray:
    return np.asarray(1000 * np.linalg.norm(points - truth, axis=-1))


def test_bars_on_the_real_rig(real_data: Path) -> None:
    cameras, px, truth = bench.load_case(real_data / "triangulation_case.npz")
    variance = np.full(px.shape[:-1], 9.0)
    error = error_mm(triangulate_take(cameras, px, variance).points_world, truth)
    assert np.isfinite(error).mean() > 0.999
    assert np.nanmedian(error) < 5.0 and np.sqrt(np.nanmean(error**2)) < 8.0
    # The take is a hundred frames, ten times over; one of the ten has nothing to be compared with.
    once = error_mm(triangulate_take(cameras, px[:, :100], variance[:, :100]).points_world, truth[:100])
    single = error_mm(triangulate(cameras, px[:, :100], variance[:, :100]).points_world, truth[:100])
    assert np.nanmedian(once) < 0.9 * np.nanmedian(single)


def test_smooth_movement_gains_and_is_told_its_covariance() -> None:
    truth = rods()
    cameras, px, variance = seen(truth)
    single, whole = triangulate(cameras, px, variance), triangulate_take(cameras, px, variance)
    before, after = error_mm(single.points_world, truth), error_mm(whole.points_world, truth)
    assert np.nanmedian(after) < 0.6 * np.nanmedian(before)
    assert np.sqrt(np.nanmean(after**2)) < 0.6 * np.sqrt(np.nanmean(before**2))
    off = whole.points_world - truth
    far = np.einsum("tja,tjab,tjb->tj", off, np.linalg.inv(whole.covariance_world), off)
    assert 1.5 < np.nanmedian(far) < 3.5  # 2.4 if it were exact


def test_bones_that_keep_their_length_help() -> None:
    truth = rods(rate=0.3)  # fast, so that the paths say little
    cameras, px, variance = seen(truth)
    bones = [(k, k + 4) for k in range(4)]
    plain = error_mm(triangulate_take(cameras, px, variance).points_world, truth)
    joined = triangulate_take(cameras, px, variance, bones).points_world
    assert np.nanmean(error_mm(joined, truth)) < 0.97 * np.nanmean(plain)
    # Where the "bone" joins points that have nothing to do with each other, it is given no weight.
    loose = triangulate_take(cameras, px, variance, [(0, 5), (1, 6)]).points_world
    assert np.nanmean(error_mm(loose, truth)) < 1.05 * np.nanmean(plain)


def test_a_jump_is_believed_when_the_cameras_agree() -> None:
    truth = rods()
    truth[80:] += [0.5, -0.3, 0.1]
    truth[40, 2] += [0.0, 0.4, 0.0]
    cameras, px, variance = seen(truth, outliers=0.0)
    error = error_mm(triangulate_take(cameras, px, variance).points_world, truth)
    assert error[78:82].max() < 40 and error[40, 2] < 40


def test_the_path_decides_between_two_and_two_cameras() -> None:
    truth = rods()
    cameras, px, variance = seen(truth, outliers=0.0)
    elsewhere = truth[60, 1] + [0.25, 0.1, 0.0]
    px[:2, 60, 1] = cameras.project(elsewhere[None])[:2, 0]
    error = error_mm(triangulate_take(cameras, px, variance).points_world, truth)
    assert error[60, 1] < 20


def test_frames_that_come_again_help_and_others_do_no_harm() -> None:
    still = np.tile(rods(12)[:1], (200, 1, 1)) + np.random.default_rng(5).normal(0, 0.012, (200, 8, 3))
    periodic = np.tile(still[:25], (8, 1, 1))
    cameras, px, variance = seen(periodic)
    without = triangulate_take(cameras, px, variance, options=TakeOptions(recurrences=0)).points_world
    within = triangulate_take(cameras, px, variance).points_world
    assert np.nanmedian(error_mm(within, periodic)) < 0.8 * np.nanmedian(error_mm(without, periodic))
    truth = rods(200)
    cameras, px, variance = seen(truth)
    without = triangulate_take(cameras, px, variance, options=TakeOptions(recurrences=0)).points_world
    within = triangulate_take(cameras, px, variance).points_world
    assert np.nanmedian(error_mm(within, truth)) < 1.03 * np.nanmedian(error_mm(without, truth))


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 7])
def test_short_takes(frames: int) -> None:
    truth = rods(max(frames, 1))[:frames]
    cameras, px, variance = seen(truth, outliers=0.0)
    found = triangulate_take(cameras, px, variance, [(0, 4)])
    assert found.points_world.shape == truth.shape
    assert (error_mm(found.points_world, truth) < 60).all()


def test_missing_stays_missing_and_mistakes_are_named() -> None:
    truth = rods(60)
    cameras, px, variance = seen(truth, outliers=0.0)
    px[:, 20:30] = np.nan
    px[:, :, 7] = np.nan
    px[1:, 5, 2] = np.nan
    found = triangulate_take(cameras, px, variance, [(3, 7)])
    lost = np.isnan(found.points_world).any(axis=-1)
    assert lost[20:30].all() and lost[:, 7].all() and lost[5, 2] and lost.sum() == 10 * 8 + 50 + 1
    assert np.isnan(found.covariance_world[lost]).all() and np.isfinite(found.covariance_world[~lost]).all()
    nothing = triangulate_take(cameras, np.full_like(px, np.nan), variance)
    assert np.isnan(nothing.points_world).all()
    with pytest.raises(ValueError, match="bone 3-9"):
        triangulate_take(cameras, px, variance, [(3, 9)])


def test_midpoint_of_two_rays_is_perpendicular_to_both() -> None:
    truth = rods(40)
    cameras, px, _ = seen(truth, cameras=2, outliers=0.0)
    rays, centers = ray_directions(cameras, px), cameras.centers_world
    middle, gap = midpoint(centers[0], rays[0], centers[1], rays[1])
    way = 2 * (middle - centers[0] - np.sum((middle - centers[0]) * rays[0], axis=-1, keepdims=True) * rays[0])
    assert np.allclose(np.linalg.norm(way, axis=-1), gap, atol=1e-9)
    assert np.abs(np.sum(way * rays[0], axis=-1)).max() < 1e-9 and np.abs(np.sum(way * rays[1], axis=-1)).max() < 1e-9
    rays = ray_directions(cameras, cameras.project(truth))
    middle, gap = midpoint(centers[0], rays[0], centers[1], rays[1])
    assert error_mm(middle, truth).max() < 1e-3 and gap.max() < 1e-6
    parallel, _ = midpoint(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), np.array([0, 0, 2.0]))
    behind, _ = midpoint(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, -5]), np.array([-1.0, 0, 0.1]))
    assert np.isnan(parallel).all() and np.isnan(behind).all()
