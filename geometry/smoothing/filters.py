"""Filters over time for positions and rotations, based on scipy where available.

All filters take arrays with time first and any trailing shape. NaN marks missing values: runs between NaNs are filtered
separately, NaN stays NaN. All but One-Euro have no lag (they use future values). `smooth_points` of
`muybridge.geometry.smoothing.kalman` is recommended for landmarks: it estimates the noise, weights points by their
covariance, removes outliers and fills gaps; the table in docs/explanation/smoothing.md compares the filters.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.geometry.numerics.robust import MAD_SIGMA
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.smoothing._kernel import smooth_all


@dataclass(frozen=True)
class FilterOptions:
    """Parameters of the filters.

    Attributes:
        cutoff_hz: of `butterworth`; None: chosen by residual analysis, one for the whole array.
        order: effective order of `butterworth`, both directions together; even.
        window: full window of `savgol`, `median` and `loess`, seconds.
        degree: of the polynomials of `savgol` and `loess`.
        sigma: of `gaussian`, seconds.
        smoothing: of `gcv_spline`, weight of the squared second derivative, seconds cubed; None: chosen by generalised
            cross validation, separately for each column.
        min_cutoff_hz, beta: of `one_euro`: the cut-off at rest, and its increase with speed (per unit per second).
        noise: standard deviation of a value for `kalman`; None: estimated from third differences.
        acceleration: standard deviation of the acceleration for `kalman`, units per second squared.
    """

    cutoff_hz: float | None = None
    order: int = 4
    window: float = 0.15
    degree: int = 3
    sigma: float = 0.025
    smoothing: float | None = None
    min_cutoff_hz: float = 1.5
    beta: float = 5.0
    noise: float | None = None
    acceleration: float = 12.0


def smooth(values: FloatArray, fps: float, method: str, options: FilterOptions | None = None) -> FloatArray:
    """Filter (T, ...) values along time.

    Args:
        values: any unit; NaN where missing.
        fps: frames per second.
        method: one of METHODS.
        options: see FilterOptions.

    Returns:
        The same shape; NaN where the input is. A run that is too short for the filter is returned unchanged.

    Raises:
        ValueError: an unknown method, or a cut-off that is too high for the frame rate.
    """
    options = options or FilterOptions()
    if method not in METHODS:
        raise ValueError(f"unknown filter {method!r}: choose one of {', '.join(METHODS)}")
    if not fps > 0:
        raise ValueError(f"fps must be above zero, not {fps}")
    flat = _columns(values)
    if method == "butterworth" and options.cutoff_hz is None:
        cutoff = residual_cutoff(flat, fps)
        options = _with_cutoff(options, cutoff)
    out = flat.copy()
    for start, stop, columns in _stretches(np.isfinite(flat)):
        out[start:stop, columns] = METHODS[method](flat[start:stop, columns], fps, options)
    return out.reshape(np.shape(values))


def smooth_rotations(
    quat_wxyz: FloatArray, fps: float, method: str, options: FilterOptions | None = None
) -> FloatArray:
    """Filter (T, ..., 4) quaternions: make signs continuous, filter the four components, normalise.

    On the unit sphere a smooth motion is a smooth curve, without the jumps that angles have at half a turn.

    Returns:
        Unit quaternions of the same shape, continuous in sign; NaN where the input is.
    """
    known = np.asarray(np.isfinite(quat_wxyz).all(axis=-1))
    filled = np.array(quat_wxyz, dtype=np.float64)
    latest = np.maximum.accumulate(
        np.where(known, np.arange(len(known)).reshape(-1, *[1] * (known.ndim - 1)), 0), axis=0
    )
    filled = np.take_along_axis(filled, latest[..., None], axis=0)
    filled = np.where(np.isfinite(filled), filled, np.array([1.0, 0, 0, 0]))
    continuous = np.where(known[..., None], continuous_quat(filled), np.nan)
    out = smooth(continuous, fps, method, options)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def hampel(values: FloatArray, half: int, sigmas: float = 3.0) -> tuple[FloatArray, BoolArray]:
    """Remove outliers: (T, ...) values farther than `sigmas` robust standard deviations from their running median
    become NaN (Hampel 1974).

    Args:
        values: NaN where missing.
        half: frames on each side.
        sigmas: threshold, in scaled median absolute deviations of the window.

    Returns:
        The values without outliers, and a mask of the outliers.
    """
    flat = _columns(values)
    padded = np.pad(flat, ((half, half), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    counted = np.isfinite(windows).any(axis=-1)
    median, spread = np.full(flat.shape, np.nan), np.full(flat.shape, np.nan)
    median[counted] = np.nanmedian(windows[counted], axis=-1)
    spread[counted] = np.nanmedian(np.abs(windows[counted] - median[counted][:, None]), axis=-1)
    with np.errstate(invalid="ignore"):
        far = np.abs(flat - median) > sigmas * MAD_SIGMA * spread + 1e-12
    flat[far] = np.nan
    return flat.reshape(np.shape(values)), far.reshape(np.shape(values))


def residual_cutoff(values: FloatArray, fps: float) -> float:
    """The cut-off frequency of a Butterworth filter by residual analysis, Hz.

    The residual of white noise falls linearly with the cut-off; its extrapolation to 0 Hz estimates the noise, and the
    cut-off is where the residual equals it. Source: D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th
    edition, section 3.4.4.3.
    """
    flat = _columns(values)
    stretches = [s for s in _stretches(np.isfinite(flat)) if s[1] - s[0] > 30]
    if not stretches:
        return min(6.0, 0.4 * fps)
    cutoffs = np.arange(0.01, 0.46, 0.01) * fps
    residual = np.zeros(len(cutoffs))
    for i, cutoff in enumerate(cutoffs):
        total, count = 0.0, 0
        for start, stop, columns in stretches:
            x = flat[start:stop, columns]
            total += float(np.sum((x - _butterworth(x, fps, _with_cutoff(FilterOptions(), float(cutoff)))) ** 2))
            count += x.size
        residual[i] = math.sqrt(total / count)
    tail = slice(len(cutoffs) // 2, None)
    slope, intercept = np.polyfit(cutoffs[tail], residual[tail], 1)
    below = np.flatnonzero(residual <= max(intercept, residual[-1]))
    k = int(below[0]) if len(below) else len(cutoffs) - 1
    if k == 0 or slope >= 0:
        return float(cutoffs[k])
    share = (residual[k - 1] - intercept) / max(residual[k - 1] - residual[k], 1e-12)
    return float(cutoffs[k - 1] + min(max(share, 0.0), 1.0) * (cutoffs[k] - cutoffs[k - 1]))


def _columns(values: FloatArray) -> FloatArray:
    """(T, ...) to a copy of shape (T, N)."""
    return np.array(values, dtype=np.float64).reshape(len(values), math.prod(np.shape(values)[1:]))


def _with_cutoff(options: FilterOptions, cutoff: float) -> FilterOptions:
    return FilterOptions(**{**vars(options), "cutoff_hz": cutoff})


def _stretches(known: BoolArray) -> list[tuple[int, int, IndexArray]]:
    """Runs without a gap: (start, stop, columns that share it)."""
    runs: dict[tuple[int, int], list[int]] = {}
    for column in range(known.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known[:, column], [False]]).astype(np.int8)))
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            runs.setdefault((start, stop), []).append(column)
    return [(a, b, np.array(columns, dtype=np.intp)) for (a, b), columns in runs.items()]


def _odd_frames(seconds: float, fps: float, least: int) -> int:
    return max(2 * round(0.5 * seconds * fps) + 1, least + 1 - least % 2)


# scipy.signal and scipy.interpolate are imported where they are used, because they take longer to load than everything
# else and every command loads this module.


def _butterworth(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    assert o.cutoff_hz is not None
    if not 0 < o.cutoff_hz < 0.5 * fps:
        raise ValueError(f"a cut-off of {o.cutoff_hz:g} Hz needs more than {2 * o.cutoff_hz:g} frames/s, not {fps:g}")
    order = max(o.order // 2, 1)
    # The gain at the cut-off is squared by two passes, so each pass gets a higher cut-off (Winter).
    wide = math.tan(math.pi * o.cutoff_hz / fps) / (math.sqrt(2.0) - 1) ** (1 / (2 * order))
    sections = butter(order, min(math.atan(wide) / math.pi * 2, 0.999), output="sos")
    # Mirrored at the ends for longer than the filter's memory.
    pad = min(math.ceil(2 * fps / o.cutoff_hz), len(x) - 1)
    return np.asarray(sosfiltfilt(sections, x, axis=0, padlen=pad)) if len(x) > 3 else x


def _savgol(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    from scipy.signal import savgol_filter

    window = _odd_frames(o.window, fps, o.degree + 1)
    return np.asarray(savgol_filter(x, window, o.degree, axis=0, mode="interp")) if len(x) >= window else x


def _gcv_spline(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    from scipy.interpolate import make_smoothing_spline

    if len(x) < 5:
        return x
    # In frames, not seconds: scipy's search for the best parameter is designed for unit spacing.
    time = np.arange(len(x), dtype=np.float64)
    lam = None if o.smoothing is None else o.smoothing * fps**3
    return np.stack([make_smoothing_spline(time, column, lam=lam)(time) for column in x.T], axis=1)


def _gaussian(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    return np.asarray(scipy.ndimage.gaussian_filter1d(x, o.sigma * fps, axis=0, mode="nearest"))


def _median(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    return np.asarray(scipy.ndimage.median_filter(x, size=(_odd_frames(o.window, fps, 1), 1), mode="nearest"))


def _loess(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    """Local polynomials with tricube weights (Cleveland 1979); frames are evenly spaced, so the weights are fixed."""
    window = _odd_frames(o.window, fps, o.degree + 2)
    if len(x) < window:
        return x
    half = window // 2
    out = np.empty_like(x)
    kernels = {at: _loess_kernel(window, at, o.degree) for at in range(window)}
    views = np.lib.stride_tricks.sliding_window_view(x, window, axis=0)
    out[half : len(x) - half] = views @ kernels[half]
    for k in range(half):
        out[k] = kernels[k] @ x[:window]
        out[len(x) - 1 - k] = kernels[window - 1 - k] @ x[-window:]
    return out


def _loess_kernel(window: int, at: int, degree: int) -> FloatArray:
    """(window,) weights of the values in the local polynomial's value at frame `at`."""
    frames = np.arange(window) - at
    weight = (1 - (np.abs(frames) / (np.abs(frames).max() + 1)) ** 3) ** 3
    design = np.vander(frames / window, degree + 1, increasing=True)
    weighted = design * weight[:, None]
    return np.asarray(np.linalg.solve(design.T @ weighted, weighted.T)[0])


def _one_euro(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    return np.asarray(one_euro(np.ascontiguousarray(x), 1 / fps, o.min_cutoff_hz, o.beta, 1.0))


@compiled
def one_euro(x: FloatArray, dt: float, min_cutoff: float, beta: float, rate_cutoff: float) -> FloatArray:
    """(T, N) low-pass filter for live use whose cut-off rises with the speed (Casiez, Roussel, Vogel 2012)."""
    out = np.empty_like(x)
    rate = np.zeros(x.shape[1])
    for t in range(len(x)):
        for n in range(x.shape[1]):
            if t == 0:
                out[t, n] = x[t, n]
                continue
            slow = 1.0 / (1.0 + 1.0 / (2 * math.pi * rate_cutoff * dt))
            rate[n] += slow * ((x[t, n] - x[t - 1, n]) / dt - rate[n])
            cutoff = min_cutoff + beta * abs(rate[n])
            share = 1.0 / (1.0 + 1.0 / (2 * math.pi * cutoff * dt))
            out[t, n] = out[t - 1, n] + share * (x[t, n] - out[t - 1, n])
    return out


def _kalman(x: FloatArray, fps: float, o: FilterOptions) -> FloatArray:
    """Position and velocity with white-noise acceleration, forwards and backwards (Rauch, Tung, Striebel 1965)."""
    noise = o.noise
    if noise is None:
        third = np.diff(x, 3, axis=0)
        noise = float(np.median(np.abs(third)) / 0.6745 / math.sqrt(20)) if third.size else 1.0
    columns = -(-x.shape[1] // 3)
    padded = np.zeros((len(x), columns * 3))
    padded[:, : x.shape[1]] = x
    covariance = np.tile(np.eye(3) * max(noise, 1e-9) ** 2, (len(x), columns, 1, 1))
    places = padded.reshape(len(x), columns, 3)
    out, _, _ = smooth_all(places, covariance, np.ones((len(x), columns), np.bool_), 1 / fps, o.acceleration)
    return np.asarray(out.reshape(len(x), -1)[:, : x.shape[1]])


METHODS: dict[str, Callable[[FloatArray, float, FilterOptions], FloatArray]] = {
    "butterworth": _butterworth,
    "kalman": _kalman,
    "savgol": _savgol,
    "gcv_spline": _gcv_spline,
    "one_euro": _one_euro,
    "gaussian": _gaussian,
    "median": _median,
    "loess": _loess,
}
