"""View-dependent bias of 2D landmarks: with simulated bias, and on a real take."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.view_bias import (
    ViewBias,
    ViewBiasOptions,
    learn_view_bias,
    remove_view_bias,
    trunk_axes,
)

FPS = 30.0
PX = 2.0


@pytest.fixture(scope="module")
def walk(script: Callable[[str], ModuleType]) -> tuple[CameraGroup, FloatArray]:
    """Four cameras, and one person (240, 23, 3) who walks to and fro."""
    bench, rng = script("benchmarks.takes.people"), np.random.default_rng(5)
    return bench.room(4, rng), bench.walkers(1, 240, rng)[0]


def seen(walk: tuple[CameraGroup, FloatArray], size_m: float) -> tuple[FloatArray, FloatArray]:
    """Pixels (C, T, J, 2) of a network with bias of this size, and their variance; every landmark is out of some
    camera's sight in the second half of the take."""
    cameras, truth = walk
    rng = np.random.default_rng(1)
    bias = ViewBias(BODY23, rng.normal(0, size_m, (23, 3, 3)), np.zeros((23, 3)), size_m)
    px = cameras.project(truth) + bias.px(cameras, truth, trunk_axes(truth, BODY23))
    px += rng.normal(0, PX, px.shape)
    hidden = rng.integers(0, 2, (4, 1, 23)).astype(bool)
    hidden &= hidden.cumsum(0) <= 2
    px[:, 120:][np.broadcast_to(hidden, px[:, 120:].shape[:-1])] = np.nan
    return px, np.where(np.isfinite(px[..., 0]), PX**2, np.nan)


@pytest.mark.parametrize(("size_m", "most"), [(0.02, 0.85), (0.008, 0.95), (0.0, 1.02)])
def test_bias_removal_improves_points_with_fewer_views(walk, size_m: float, most: float) -> None:
    cameras, truth = walk
    px, variance = seen(walk, size_m)
    found = triangulate(cameras, px, variance)
    offsets = learn_view_bias(cameras, px, variance, BODY23, FPS, found)
    corrected, better = remove_view_bias(cameras, px, variance, found, offsets)
    assert np.array_equal(np.isfinite(corrected), np.isfinite(px))

    def error(points: FloatArray, frames: slice) -> float:
        return float(np.nanmean(np.linalg.norm(points - truth, axis=-1)[frames]))

    later, before = slice(120, None), slice(0, 120)
    # What all views have in common stays: it is the mean over views, not the truth, that points return to.
    assert error(better.points_world, later) < most * error(found.points_world, later)
    assert error(better.points_world, before) < 1.05 * error(found.points_world, before)
    moved = np.einsum("tba,tjb->tja", trunk_axes(truth, BODY23), better.points_world - found.points_world)
    assert np.linalg.norm(np.nanmedian(moved[before], axis=0), axis=-1).mean() < 0.1 * max(size_m, 0.004)


def test_an_unknown_trunk_is_that_of_the_nearest_frame(walk) -> None:
    _, truth = walk
    axes = trunk_axes(truth, BODY23)
    np.testing.assert_allclose(axes @ axes.swapaxes(1, 2), np.broadcast_to(np.eye(3), axes.shape), atol=1e-9)
    across = truth[:, BODY23.index("left_hip")] - truth[:, BODY23.index("right_hip")]
    assert (np.einsum("ta,ta->t", axes[..., 0], across) > 0).all() and (axes[:, 2, 2] > 0.9).all()
    gaps = truth.copy()
    gaps[:10, BODY23.index("left_hip")] = np.nan
    np.testing.assert_array_equal(trunk_axes(gaps, BODY23)[:10], np.repeat(axes[10:11], 10, axis=0))
    assert trunk_axes(np.full_like(truth, np.nan), BODY23) is None
    assert trunk_axes(truth[:, :5], LandmarkSet("face", BODY23.names[:5], ())) is None


def test_takes_without_information_give_no_bias(walk) -> None:
    cameras, _ = walk
    px, variance = seen(walk, 0.02)
    found = triangulate(cameras, px, variance)
    off = ViewBiasOptions(enabled=False)
    assert learn_view_bias(cameras, px, variance, BODY23, FPS, found, options=off) is None
    pair = cameras.select(cameras.names[:2])
    by_two = triangulate(pair, px[:2], variance[:2])
    assert learn_view_bias(pair, px[:2], variance[:2], BODY23, FPS, by_two) is None
    short = triangulate(cameras, px[:, :5], variance[:, :5])
    assert learn_view_bias(cameras, px[:, :5], variance[:, :5], BODY23, FPS, short) is None
    with pytest.raises(ValueError, match="alike_s"):
        ViewBiasOptions(alike_s=-1.0)


def test_a_long_take_is_sampled_evenly(walk) -> None:
    cameras, _ = walk
    px, variance = seen(walk, 0.02)
    found = triangulate(cameras, px, variance)
    every = learn_view_bias(cameras, px, variance, BODY23, FPS, found)
    some = learn_view_bias(cameras, px, variance, BODY23, FPS, found, options=ViewBiasOptions(most_frames=60))
    # A quarter of the frames, each of which counts four times as much.
    assert np.abs(some.by_view - every.by_view).mean() < 0.25 * np.abs(every.by_view).mean()


def test_unseen_frames_of_a_real_take(real_data: Path, script: Callable[[str], ModuleType]) -> None:
    """Refined cameras and bias of one half, the other half's left-out cameras."""
    bench = script("benchmarks.takes.left_out")
    medians = bench.medians(real_data, {"refined"})
    whole = next(name for _, name, _ in medians if name.startswith("whole"))
    assert max(medians["refined", whole, "known"]) < 12.5
    for name in {name for _, name, _ in medians}:
        without, known = medians["refined", name, ""], medians["refined", name, "known"]
        assert all(k < w for k, w in zip(known, without, strict=True))
