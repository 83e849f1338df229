"""The shape prior against plain triangulation, with a known truth."""

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.smoothing.kalman import smooth_points
from muybridge.geometry.triangulation.multiview import Triangulation, triangulate
from muybridge.geometry.triangulation.shape_prior import PosePriorOptions, apply_pose_prior

PX = 4.0


@pytest.fixture(scope="module")
def bench(script: Callable[[str], ModuleType]) -> ModuleType:
    """The benchmark's model of people and cameras."""
    return script("benchmarks.takes.people")


@pytest.fixture(scope="module")
def walk(bench: ModuleType) -> tuple[CameraGroup, FloatArray]:
    """Four cameras, and one person (150, 23, 3) who walks and, in frames 70 to 75 alone, lifts the left arm."""
    rng = np.random.default_rng(21)
    cameras, person = bench.room(4, rng), bench.walkers(1, 150, rng)[0]
    for name, up in (("left_elbow", 0.55), ("left_wrist", 1.05)):
        person[70:76, BODY23.index(name), 2] += up
    return cameras, person


def seen(cameras: CameraGroup, truth: FloatArray, gross: float = 0.03, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Noisy pixels (C, T, J, 2), some of them grossly wrong, and their variance."""
    rng = np.random.default_rng(seed)
    px = cameras.project(truth) + rng.normal(0, PX, (len(cameras), *truth.shape[:2], 2))
    px += (rng.random(px.shape[:-1]) < gross)[..., None] * rng.normal(0, 60, px.shape)
    return px, np.full(px.shape[:-1], PX**2)


# Every point is helped, what all cameras see too.
EVERYWHERE = PosePriorOptions(enough=99)


def solved(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, options: PosePriorOptions = EVERYWHERE
) -> tuple[Triangulation, Triangulation]:
    """Without and with the shape prior."""
    variance = np.where(np.isfinite(px).all(-1), variance, np.nan)
    alone = triangulate(cameras, px, variance)
    return alone, apply_pose_prior(cameras, px, variance, BODY23, 30.0, alone, options=options)


def error_mm(found: Triangulation, truth: FloatArray) -> FloatArray:
    return np.asarray(1000 * np.linalg.norm(found.points_world - truth, axis=-1))


def test_points_are_nearer_to_the_truth(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    alone, helped = (error_mm(f, truth) for f in solved(cameras, *seen(cameras, truth)))
    assert np.isfinite(helped).mean() > 0.995
    assert np.nanmean(helped) < 0.7 * np.nanmean(alone)
    # Gross errors that two cameras cannot tell are gone: the tail is shorter still.
    px, variance = seen(cameras, truth)
    px[2:, 30:110] = np.nan
    alone, helped = (error_mm(f, truth)[30:110] for f in solved(cameras, px, variance))
    assert np.nanmean(helped) < 0.6 * np.nanmean(alone)
    assert np.nanquantile(helped, 0.99) < 0.5 * np.nanquantile(alone, 0.99)


def test_points_of_three_cameras_are_kept(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth)
    px[2:, 30:110:2] = np.nan
    alone, helped = solved(cameras, px, variance, PosePriorOptions())
    enough = np.isfinite(px).all(-1).sum(0) >= 3
    assert 0.3 < enough.mean() < 0.9
    for before, after in ((alone.points_world, helped.points_world), (alone.covariance_world, helped.covariance_world)):
        np.testing.assert_array_equal(after[enough], before[enough])
    np.testing.assert_array_equal(helped.inlier[:, enough], alone.inlier[:, enough])
    off = [np.nanmean(error_mm(f, truth)[~enough]) for f in (alone, helped)]
    assert off[1] < 0.6 * off[0]


def test_unique_poses_are_kept(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    arm = [BODY23.index("left_elbow"), BODY23.index("left_wrist")]
    alone, helped = (error_mm(f, truth)[70:76, arm] for f in solved(cameras, *seen(cameras, truth, gross=0.0)))
    assert helped.mean() < 1.2 * alone.mean()


def test_single_views_are_used_near_full_frames_only(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth)
    px[1:, 80:100] = np.nan
    px[:, 110:] = np.nan
    alone, helped = solved(cameras, px, variance)
    assert np.isnan(alone.points_world[80:100]).all()
    assert np.isfinite(helped.points_world[80:100]).all(-1).mean() > 0.9
    points = Points3D(BODY23, helped.points_world, helped.covariance_world, helped.residual_px, helped.inlier, 30.0)
    gap = np.linalg.norm(smooth_points(points).points_world - truth, axis=-1)[80:100]
    assert np.nanmedian(gap) < 0.06
    assert np.isnan(helped.points_world[110:]).all()
    # Farther from two views than allowed there is nothing.
    brief = PosePriorOptions(one_view=3)
    known = np.where(np.isfinite(px).all(-1), variance, np.nan)
    short = apply_pose_prior(cameras, px, known, BODY23, 30.0, alone, options=brief).points_world
    assert np.isnan(short[84:95]).all() and np.isfinite(short[81]).any()


@pytest.mark.filterwarnings("error")
def test_a_landmark_that_no_camera_sees_does_not_affect_others(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth)
    hidden = BODY23.index("left_wrist")
    px[:, :, hidden] = np.nan
    alone, helped = solved(cameras, px, variance)
    others = np.arange(len(BODY23)) != hidden
    assert np.isfinite(helped.points_world[:, others]).mean() > 0.99
    assert np.nanmedian(error_mm(helped, truth)[:, others]) < np.nanmedian(error_mm(alone, truth)[:, others])


def test_single_views_of_unlearned_landmarks_are_not_used(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth)
    feet = [j for j, name in enumerate(BODY23.names) if any(part in name for part in ("ankle", "toe", "heel"))]
    px[1:, 5:, feet] = np.nan  # five frames show the feet, in the rest one camera claims to
    alone, helped = solved(cameras, px, variance)
    assert np.isfinite(helped.points_world[:5, feet]).mean() > 0.9
    assert np.isnan(helped.points_world[5:, feet]).all()
    others = [j for j in range(len(BODY23)) if j not in feet]
    assert np.isfinite(helped.points_world[:, others]).mean() > 0.99
    assert np.nanmean(error_mm(helped, truth)[:, others]) < 0.7 * np.nanmean(error_mm(alone, truth)[:, others])


def test_covariance_matches_the_error_with_the_prior(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth, gross=0.0)
    px[2:, ::2] = np.nan
    helped = solved(cameras, px, variance)[1]
    off = helped.points_world - truth
    far = np.einsum("tja,tjab,tjb->tj", off, np.linalg.inv(helped.covariance_world), off)
    assert 0.4 < np.nanmedian(far) / 2.366 < 1.6


def test_short_takes_are_unchanged(walk: tuple[CameraGroup, FloatArray]) -> None:
    cameras, truth = walk
    px, variance = seen(cameras, truth[:20])
    alone = triangulate(cameras, px, variance)
    assert apply_pose_prior(cameras, px, variance, BODY23, 30.0, alone) is alone
    px, variance = seen(cameras, truth[:60])
    alone = triangulate(cameras, px, variance)
    off = PosePriorOptions(enabled=False)
    assert apply_pose_prior(cameras, px, variance, BODY23, 30.0, alone, options=off) is alone
    nothing = np.full_like(px, np.nan), np.full_like(variance, np.nan)
    empty = triangulate(cameras, *nothing)
    assert apply_pose_prior(cameras, *nothing, BODY23, 30.0, empty) is empty
