"""Gap filling: a rigid head, a body whose parts move together, and gaps that cannot be filled."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.geometry.smoothing.gaps import GAP_METHODS, GapOptions, fill_gaps
from muybridge.motion.formats.points.c3d import read_c3d

FPS = 50.0


def head_and_body(frames: int = 300) -> FloatArray:
    """(T, 10, 3): four markers on a rigid head, six that swing with one common phase."""
    time = np.arange(frames) / FPS
    centre = np.stack([0.5 * np.sin(time), 0.2 * time, 1.6 + 0.03 * np.sin(9 * time)], axis=1)
    turn = exp_so3(np.stack([0.3 * np.sin(5 * time), 0.2 * np.cos(4 * time), 2 * np.sin(0.7 * time)], axis=1))
    head = np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.12, 0.05], [0, -0.1, 0.08]])
    out = np.empty((frames, 10, 3))
    out[:, :4] = centre[:, None] + np.einsum("tab,jb->tja", turn, head)
    swing = np.sin(6 * time)
    for j in range(4, 10):
        way = np.array([0.1 * (j - 6), 0.15, 0.05 * j - 0.3])
        out[:, j] = centre + np.array([0.02 * j, 0.1, -0.3 * (j - 3)]) + swing[:, None] * way
    return out


def cut(truth: FloatArray, j: int, start: int, stop: int) -> FloatArray:
    out = truth.copy()
    out[start:stop, j] = np.nan
    return out


def error_mm(found: FloatArray, truth: FloatArray) -> float:
    return float(1000 * np.linalg.norm(found - truth, axis=-1).max())


@pytest.mark.parametrize("method", ["auto", *GAP_METHODS])
def test_every_method_fills_gaps_and_keeps_the_rest(method: str) -> None:
    truth = head_and_body()
    holed = cut(cut(truth, 1, 100, 104), 6, 200, 203)
    found = fill_gaps(holed, FPS, method)
    known = np.isfinite(holed[..., 0])
    assert np.array_equal(found[known], holed[known]) and np.isfinite(found).all()
    assert error_mm(found[100:104, 1], truth[100:104, 1]) < 12 and error_mm(found[200:203, 6], truth[200:203, 6]) < 12


def test_a_rigid_body_fills_a_long_gap() -> None:
    truth = head_and_body()
    holed = cut(truth, 1, 100, 160)
    for method in ("rigid", "auto"):
        assert error_mm(fill_gaps(holed, FPS, method)[100:160, 1], truth[100:160, 1]) < 1.0
    assert error_mm(fill_gaps(holed, FPS, "spline")[100:160, 1], truth[100:160, 1]) > 30


def test_low_rank_uses_correlated_motion() -> None:
    truth = head_and_body()
    holed = cut(truth, 6, 100, 160)
    assert error_mm(fill_gaps(holed, FPS, "low_rank")[100:160, 6], truth[100:160, 6]) < 15
    assert error_mm(fill_gaps(holed, FPS, "spline")[100:160, 6], truth[100:160, 6]) > 40


def test_a_pattern_is_shifted_to_meet_both_edges() -> None:
    truth = head_and_body()
    truth[:, 0] = truth[:, 1] + np.linspace(0, 0.05, len(truth))[:, None]
    holed = cut(truth, 0, 150, 190)
    assert error_mm(fill_gaps(holed[:, :2], FPS, "pattern")[150:190, 0], truth[150:190, 0]) < 1e-6


def test_ends_and_long_gaps_stay_open() -> None:
    truth = head_and_body()
    holed = cut(cut(cut(truth, 1, 0, 10), 2, 290, 300), 3, 100, 180)
    found = fill_gaps(holed, FPS, "auto", GapOptions(max_gap=1.0))
    assert np.isnan(found[:10, 1]).all() and np.isnan(found[290:, 2]).all() and np.isnan(found[100:180, 3]).all()
    assert np.isfinite(fill_gaps(holed, FPS, "auto", GapOptions(max_gap=2.0))[100:180, 3]).all()


@pytest.mark.parametrize("method", ["auto", *GAP_METHODS])
def test_too_few_data(method: str) -> None:
    one = np.full((9, 1, 3), np.nan)
    one[2], one[7] = 0.0, 1.0
    assert np.isfinite(fill_gaps(one, FPS, method)[2:8]).all()
    nothing = np.full((20, 12, 3), np.nan)
    assert np.isnan(fill_gaps(nothing, FPS, method)).all()
    partly = head_and_body(20)
    partly[5, :, 1] = np.nan  # one coordinate missing is a point missing
    assert np.isfinite(fill_gaps(partly, FPS, method)).all()
    assert fill_gaps(np.empty((0, 4, 3)), FPS, method).shape == (0, 4, 3)


def test_unknown_methods_are_an_error() -> None:
    with pytest.raises(ValueError, match="choose one of auto, spline"):
        fill_gaps(head_and_body(5), FPS, "magic")


def test_real_markers(real_data: Path) -> None:
    points = read_c3d(real_data / "markers" / "tennis_serve_pig39.c3d")
    truth = points.points_world[300:800]
    rng = np.random.default_rng(0)
    holed, holes = truth.copy(), []
    for j in rng.choice(truth.shape[1], 12, replace=False):
        start = int(rng.integers(20, 440))
        holed[start : start + 15, j] = np.nan
        holes.append((slice(start, start + 15), int(j)))
    errors = {
        method: np.nanmean([np.linalg.norm(found[s, j] - truth[s, j], axis=-1).mean() for s, j in holes])
        for method in ("auto", "spline")
        for found in [fill_gaps(holed, points.fps, method)]
    }
    assert errors["auto"] < 0.015 and errors["auto"] < 0.7 * errors["spline"]
