"""Filters over time against a known truth, at gaps and ends, and for rotations."""

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat, quat_from_matrix
from muybridge.geometry.smoothing.filters import (
    METHODS,
    FilterOptions,
    hampel,
    residual_cutoff,
    smooth,
    smooth_rotations,
)

FPS = 100.0
# Parameters that suit the signal below.
TUNED = {
    "butterworth": FilterOptions(cutoff_hz=4.0),
    "kalman": FilterOptions(acceleration=15.0),
    "savgol": FilterOptions(window=0.25),
    "gcv_spline": FilterOptions(),
    "one_euro": FilterOptions(min_cutoff_hz=3.0, beta=3.0),
    "gaussian": FilterOptions(sigma=0.03),
    "median": FilterOptions(window=0.07),
    "loess": FilterOptions(window=0.3),
}
# A median is no low-pass.
GAIN = {method: 0.5 for method in METHODS} | {"median": 0.75}
SEEING_AHEAD = [m for m in METHODS if m != "one_euro"]


def signal(frames: int = 400) -> tuple[FloatArray, FloatArray]:
    """(T, 2, 3) a smooth movement and the same with 10 mm of noise."""
    time = np.arange(frames) / FPS
    phase = np.arange(6).reshape(2, 3)
    truth = 0.3 * np.sin(2 * np.pi * 0.8 * time[:, None, None] + phase) + 0.1 * np.sin(9 * time[:, None, None] * 0.7)
    return truth, truth + np.random.default_rng(0).normal(0, 0.01, truth.shape)


@pytest.mark.parametrize("method", SEEING_AHEAD)
def test_noise_is_removed_and_motion_is_kept(method: str) -> None:
    truth, noisy = signal()
    found = smooth(noisy, FPS, method, TUNED[method])
    inside = slice(20, -20)
    before = np.sqrt(np.mean((noisy - truth)[inside] ** 2))
    assert np.sqrt(np.mean((found - truth)[inside] ** 2)) < GAIN[method] * before
    if method != "median":
        jerk = [np.sqrt(np.mean(np.diff(x, 3, axis=0) ** 2)) for x in (found, noisy)]
        assert jerk[0] < 0.35 * jerk[1]


@pytest.mark.parametrize("method", SEEING_AHEAD)
def test_no_lag(method: str) -> None:
    truth, _ = signal()
    found = smooth(truth, FPS, method, TUNED[method])
    lags = range(-5, 6)
    errors = [np.mean((np.roll(found, -k, axis=0) - truth)[30:-30] ** 2) for k in lags]
    assert lags[int(np.argmin(errors))] == 0
    # Backwards in time is the same, but for the median's ties and what starting the Kalman filter takes.
    back = smooth(truth[::-1], FPS, method, TUNED[method])[::-1]
    assert np.abs(back - found)[30:-30].max() < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_lines_and_gaps_are_preserved(method: str) -> None:
    line = np.linspace(0.0, 1.0, 200)[:, None] * np.array([1.0, -2.0])
    line[60:70, 0] = np.nan
    line[0:3, 1] = np.nan
    line[150, 1] = np.nan
    found = smooth(line, FPS, method, TUNED[method])
    assert np.array_equal(np.isnan(found), np.isnan(line))
    off = 0.15 if method == "one_euro" else 0.02 if method in ("median", "gaussian") else 2e-3
    assert np.nanmax(np.abs(found - line)) < off


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("frames", [0, 1, 2, 3, 4, 8])
def test_short_takes(method: str, frames: int) -> None:
    short = signal(20)[1][:frames]
    found = smooth(short, FPS, method, TUNED[method])
    assert found.shape == short.shape and np.isfinite(found).all()
    assert np.isnan(smooth(np.full((frames, 3), np.nan), FPS, method, TUNED[method])).all()


def test_one_euro_smooths_at_rest_and_follows_motion_causally() -> None:
    rng = np.random.default_rng(3)
    path = np.concatenate([np.zeros(200), np.linspace(0, 3, 100)])[:, None]  # rests, then 3 m/s
    noisy = path + rng.normal(0, 0.01, path.shape)
    found = smooth(noisy, FPS, "one_euro", FilterOptions(min_cutoff_hz=1.0, beta=5.0))
    assert np.std(found[50:200]) < 0.4 * np.std(noisy[50:200])
    sluggish = smooth(noisy, FPS, "one_euro", FilterOptions(min_cutoff_hz=1.0, beta=0.0))
    assert np.abs(found - path)[250:].mean() < 0.3 * np.abs(sluggish - path)[250:].mean()
    later = noisy.copy()
    later[150:] += 1.0
    assert np.array_equal(smooth(later, FPS, "one_euro")[:150], smooth(noisy, FPS, "one_euro")[:150])


def test_butterworth_has_half_its_power_at_the_cutoff() -> None:
    time = np.arange(2000) / FPS
    for hertz, gain in ((1.0, 1.0), (6.0, np.sqrt(0.5)), (20.0, 0.0)):
        wave = np.sin(2 * np.pi * hertz * time)[:, None]
        found = smooth(wave, FPS, "butterworth", FilterOptions(cutoff_hz=6.0))[300:-300]
        assert abs(np.sqrt(2 * np.mean(found**2)) - gain) < 0.02


def test_residual_analysis_finds_a_sensible_cutoff() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(1200) / FPS
    slow = np.sin(2 * np.pi * 0.5 * time)[:, None] * np.ones(6) + rng.normal(0, 0.01, (1200, 6))
    quick = slow + 0.2 * np.sin(2 * np.pi * 6.0 * time)[:, None]
    low, high = residual_cutoff(slow, FPS), residual_cutoff(quick, FPS)
    assert 0.5 < low < 4.0 and 6.0 < high < 14.0
    assert np.allclose(smooth(quick, FPS, "butterworth"),
                       smooth(quick, FPS, "butterworth", FilterOptions(cutoff_hz=high)))  # fmt: skip


def test_cross_validation_does_not_depend_on_the_frame_rate() -> None:
    truth, noisy = (x[:, :1] for x in signal(200))
    for fps in (30.0, 500.0):
        found = smooth(noisy, fps, "gcv_spline")
        assert np.sqrt(np.mean((found - truth)[20:-20] ** 2)) < 0.005


def test_hampel_drops_only_outliers() -> None:
    truth, noisy = signal()
    spoiled = noisy.copy()
    frames = np.arange(10, 390, 19)
    spoiled[frames, 0, 1] += 0.5
    kept, out = hampel(spoiled, half=3, sigmas=4.0)
    assert out[frames, 0, 1].all() and np.isnan(kept[frames, 0, 1]).all()
    assert out.mean() < (len(frames) / out.size) + 0.02
    assert np.array_equal(kept[~out], spoiled[~out])
    empty, none = hampel(np.full((30, 2), np.nan), half=3)
    assert np.isnan(empty).all() and not none.any()


@pytest.mark.parametrize("method", SEEING_AHEAD)
def test_rotations_are_continuous_across_half_a_turn(method: str) -> None:
    time = np.arange(300) / FPS
    turn = 2.5 * time  # through pi and beyond
    axis = np.array([0.0, 0.6, 0.8])
    truth = exp_so3(turn[:, None] * axis)
    rng = np.random.default_rng(2)
    noisy = truth @ exp_so3(rng.normal(0, 0.03, (300, 3)))
    quat = quat_from_matrix(noisy)
    quat[::7] *= -1
    quat[100:104] = np.nan
    found = smooth_rotations(quat, FPS, method, TUNED[method])
    known = np.isfinite(found[:, 0])
    assert (~known).sum() == 4 and np.allclose(np.linalg.norm(found[known], axis=-1), 1)
    assert (np.sum(found[1:] * found[:-1], axis=-1)[known[1:] & known[:-1]] > 0.9).all()

    def angle(matrices: FloatArray) -> float:
        cosine = (np.trace(np.swapaxes(truth[known], -1, -2) @ matrices, axis1=-2, axis2=-1) - 1) / 2
        return float(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2)))

    assert angle(matrix_from_quat(found[known])) < GAIN[method] * 1.15 * angle(noisy[known])


def test_invalid_arguments() -> None:
    _, noisy = signal(50)
    with pytest.raises(ValueError, match="choose one of butterworth"):
        smooth(noisy, FPS, "butterwoth")
    with pytest.raises(ValueError, match="needs more than 120 frames/s"):
        smooth(noisy, FPS, "butterworth", FilterOptions(cutoff_hz=60.0))
    with pytest.raises(ValueError, match="fps"):
        smooth(noisy, 0.0, "median")
