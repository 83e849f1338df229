"""Labelled 3D points over time: swapped sides, outliers, gaps and noise.

The smoother is a Kalman filter run forwards and backwards (Rauch, Tung, Striebel 1965) on position and
velocity with white-noise acceleration: it has no lag, weighs every point by its covariance, fills gaps
with growing uncertainty and gives a covariance for what comes out. Its bandwidth follows the noise: about
`sqrt(acceleration / noise) / 2 pi` Hz.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import MuybridgeError
from muybridge.geometry.smoothing.filters import FilterOptions, smooth
from muybridge.geometry.landmarks.arrays import LandmarkSet, Points3D
from muybridge.geometry.smoothing._kernel import exchanged_path, smooth_all

Array = NDArray[np.float64]
Method = Literal["kalman", "butterworth", "savgol", "gcv_spline", "gaussian", "median", "loess"]

_CHI2_3_MEDIAN = 2.366  # median of the squared length of a standard normal vector in 3D


@dataclass(frozen=True)
class SmoothOptions:
    """How points are cleaned.

    Attributes:
        unswap: exchange a left and a right landmark where they have changed places for a while.
        swap_share: prior probability that a pair is swapped in a frame; smaller leaves longer bursts alone.
        hampel_window: seconds to each side of a point that its running median sees; 0 switches it off.
        hampel_sigmas: a point further from it than this many robust standard deviations is dropped.
        hampel_floor: metres; nearer ones are never dropped.
        top_speed: metres per second; a point that its neighbour reaches at this speed is no outlier.
        max_gap: seconds; a longer stretch without a point stays NaN, as do the ends beyond the first and the
            last known point, unless `extrapolate`. Infinity fills everything between known points.
        extrapolate: hold the first and the last known position towards the ends of the take.
        acceleration: metres per second squared, standard deviation of a landmark's acceleration: larger
            follows faster motion and lets more noise through.
        passes: how often the smoother is run; after each, noise is measured again and outliers lose weight.
        default_sigma: metres, noise of a coordinate where the covariance is unknown.
        method: `kalman` is the recommended smoother, described above; or another of `muybridge.geometry.smoothing.filters`, which
            then is given the points with outliers dropped and gaps filled.
        cutoff_hz: of `butterworth`; none: chosen by residual analysis.
    """

    unswap: bool = True
    swap_share: float = 0.1
    hampel_window: float = 0.2
    hampel_sigmas: float = 4.0
    hampel_floor: float = 0.04
    top_speed: float = 8.0
    max_gap: float = 0.5
    extrapolate: bool = False
    acceleration: float = 12.0
    passes: int = 3
    default_sigma: float = 0.03
    method: Method = "kalman"
    cutoff_hz: float | None = None

    def __post_init__(self) -> None:
        if self.cutoff_hz is not None and (self.method != "butterworth" or not self.cutoff_hz > 0):
            raise ValueError(f"cutoff_hz must be above zero and goes with method butterworth, not with {self.method}")


def smooth_points(points: Points3D, options: SmoothOptions | None = None) -> Points3D:
    """Clean and smooth points over time.

    Args:
        points: (T, J, 3) metres, NaN where missing, with their covariance (NaN: unknown).
        options: see SmoothOptions.

    Returns:
        Points3D with the same landmarks and frames, its covariance that of the smoothed position.
        Residuals and inliers are the input's: they belong to the measurement.

    Raises:
        MuybridgeError: the frame rate is too low for the cut-off.
    """
    options = options or SmoothOptions()
    if options.cutoff_hz is not None and options.cutoff_hz >= 0.5 * points.fps:
        raise MuybridgeError(f"a cut-off of {options.cutoff_hz:g} Hz needs more than {2 * options.cutoff_hz:g} frames/s"
                             f" and the take has {points.fps:g}: choose a lower one")  # fmt: skip
    cleaned = clean_points(points, options)
    if not len(points.points_world):
        return cleaned
    xyz, covariance = known_points(cleaned, options.default_sigma)
    out, out_covariance = _smooth(xyz, covariance, points.fps, options)
    known = np.isfinite(xyz[..., 0])
    unknown = ~_within_reach(known, points.fps, options)
    if options.method != "kalman":
        filled = np.where((known & ~unknown)[..., None], xyz, np.where(unknown[..., None], np.nan, out))
        out = smooth(filled, points.fps, options.method, FilterOptions(cutoff_hz=options.cutoff_hz))
    out[unknown], out_covariance[unknown] = np.nan, np.nan
    return replace(points, points_world=out, covariance_world=out_covariance)


def clean_points(points: Points3D, options: SmoothOptions | None = None) -> Points3D:
    """The part of `smooth_points` that moves nothing: sides exchanged back, outliers NaN, gaps left open.

    Its residuals and inliers are still the input's, in the input's columns.
    """
    options = options or SmoothOptions()
    if not points.fps > 0:
        raise ValueError(f"fps must be above zero, not {points.fps}")
    xyz, covariance = known_points(points, options.default_sigma)
    if options.unswap:
        xyz, covariance = _unswap(points.landmarks, xyz, covariance, points.fps, options.swap_share)
    xyz = np.where(_outliers(xyz, points.fps, options)[..., None], np.nan, xyz)
    return replace(points, points_world=xyz, covariance_world=covariance)


def known_points(points: Points3D, default_sigma: float) -> tuple[Array, Array]:
    """Positions (T, J, 3), NaN in all coordinates where missing, and a usable covariance (T, J, 3, 3) for
    each.

    A covariance that is unknown, not positive or absurdly small becomes `default_sigma` squared, or is
    floored at one square millimetre.
    """
    xyz = np.array(points.points_world, dtype=np.float64)
    xyz[~np.all(np.isfinite(xyz), axis=-1)] = np.nan
    covariance = np.array(points.covariance_world, dtype=np.float64)
    usable = np.all(np.isfinite(covariance), axis=(-2, -1))
    covariance[~usable] = np.eye(3) * default_sigma**2
    values, vectors = np.linalg.eigh(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
    bad = values[..., 2] <= 0
    values = np.clip(values, 1e-6, 1e4)
    values[bad] = default_sigma**2
    return xyz, (vectors * values[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def _unswap(
    landmarks: LandmarkSet, xyz: Array, covariance: Array, fps: float, swap_share: float
) -> tuple[Array, Array]:
    """Exchange sides where that makes both paths smoother, first of the whole body, then limbs, then pairs.

    A network that takes the front for the back exchanges everything at once, and all pairs together show the
    jump far better than one of them; what is left are crossed legs and single joints.
    """
    names = landmarks.names
    pairs = [
        (i, names.index("right_" + name[5:]))
        for i, name in enumerate(names)
        if name.startswith("left_") and "right_" + name[5:] in names
    ]
    if len(xyz) < 3 or not pairs:
        return xyz, covariance
    xyz, covariance = xyz.copy(), covariance.copy()
    left, right = np.array(pairs, dtype=np.intp).T
    limb = np.array([_limb_of(names[i]) for i in left])
    rare = float(np.log((1 - swap_share) / swap_share))
    # The body tells where its front is, and so which leg is which by its hips and which arm by its shoulders.
    hips, shoulders = _facing(landmarks, xyz, ("hip",)), _facing(landmarks, xyz, ("shoulder",))
    of_limb = np.stack([hips, shoulders, np.zeros_like(hips)], axis=1)[:, np.unique(limb)]
    # All at once is the network's own mistake and not rare.
    whole = 0.4 * rare + _facing(landmarks, xyz, ("hip", "shoulder"))[:, None]
    for group, prior in (
        (np.zeros(len(left), dtype=np.intp), whole),
        (limb, rare + of_limb),
        (np.arange(len(left)), np.full((1, 1), rare)),
    ):
        swapped = _swap_paths(xyz[:, left], xyz[:, right], covariance[:, left], group, fps, prior)
        t, k = np.nonzero(swapped)
        for array in (xyz, covariance):
            array[t, left[k]], array[t, right[k]] = array[t, right[k]], array[t, left[k]]
    return xyz, covariance


def _facing(landmarks: LandmarkSet, xyz: Array, across: Sequence[str]) -> Array:
    """(T,) log odds that left is left of the pairs `across`, from where nose and toes point: left is up x forward. 0
    where unknown."""

    def at(name: str) -> Array:
        return xyz[:, landmarks.names.index(name)] if name in landmarks.names else np.full_like(xyz[:, 0], np.nan)

    up = at("left_shoulder") + at("right_shoulder") - at("left_hip") - at("right_hip")
    head = 2 * at("nose") - at("left_ear") - at("right_ear")
    feet = [at(f"{side}_big_toe") - at(f"{side}_heel") for side in ("left", "right")]
    forward = np.nansum([head, *feet], axis=0)
    left = np.cross(up / np.maximum(np.linalg.norm(up, axis=-1, keepdims=True), 1e-9), forward)
    reach = np.linalg.norm(left, axis=-1)
    wide = np.sum([at(f"left_{pair}") - at(f"right_{pair}") for pair in across], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        width = np.sum(left * wide, axis=-1) / reach
    # Hips and shoulders are each a quarter of a metre wide, and nose and feet reach half a metre to the front; noise
    # alone makes about half of that.
    usual = 0.125 * len(across)
    return np.asarray(np.nan_to_num(np.clip(width / usual, -2.0, 2.0) * np.minimum(reach / 0.3, 1.0)))


def _limb_of(name: str) -> int:
    words = (("hip", "knee", "ankle", "heel", "toe", "foot"), ("shoulder", "elbow", "wrist", "hand"))
    return next((i for i, limb in enumerate(words) if name.endswith(limb)), len(words))


def _swap_paths(
    a: Array, b: Array, covariance: Array, group: NDArray[np.intp], fps: float, prior: Array
) -> NDArray[np.bool_]:
    """Per group of pairs the most likely two-state path (Viterbi 1967).

    Args:
        a, b: (T, N, 3) the left and the right landmark of each pair.
        covariance: (T, N, 3, 3) of the left ones.
        group: (N,) pairs with the same number are exchanged together.
        prior: (T, G) or what broadcasts to it, what a frame in exchanged state costs (log odds).

    Returns:
        (T, N) whether a pair is exchanged.
    """
    known = np.isfinite(a[..., 0]) & np.isfinite(b[..., 0])
    t_count = len(a)
    latest = np.maximum.accumulate(np.where(known, np.arange(t_count)[:, None], -1), axis=0)
    before = np.concatenate([np.full((1, a.shape[1]), -1), latest[:-1]])
    usable = known & (before >= 0)
    column = np.arange(a.shape[1])
    # What the covariance claims, or the noise that is seen where that is more: points that are jumpy anyway
    # say little about sides.
    claimed = np.trace(covariance, axis1=-2, axis2=-1) / 3
    variance = np.maximum(claimed, np.fmax(_jump_variance(a), _jump_variance(b)))
    # How far a landmark gets between two frames without a swap: its noise and 1.5 m/s; more than the cap
    # of a mistaken step says nothing more.
    seconds = (np.arange(t_count)[:, None] - before) / fps
    moves = (1.5 * seconds) ** 2
    scale = np.where(usable, variance + variance[before, column], 1.0) + moves
    number = np.unique(group, return_inverse=True)[1]
    # Noise is every landmark's own, movement the limb's: what a foot says of it, heel and toes don't say again.
    worth = 1 / (1 + (np.bincount(number)[number] - 1) * moves / scale)

    def step(now: Array, then: Array) -> Array:
        far = np.sum((now - then[before, column]) ** 2, axis=-1) / (2 * scale)
        return np.where(usable, worth * np.minimum(far, 8.0), 0.0)

    costs = np.stack([step(a, a) + step(b, b), step(b, a) + step(a, b)], axis=-1)
    member = (number == np.arange(number.max() + 1)[:, None]).astype(np.float64)
    prior = np.broadcast_to(prior, (t_count, len(member))) * (known @ member.T > 0)
    path = exchanged_path(np.ascontiguousarray(costs), known, number.astype(np.int64), np.ascontiguousarray(prior))
    return np.asarray(path[:, number] & known)


def _jump_variance(xyz: Array) -> Array:
    """(T, N, 3) -> (N,) variance of a coordinate, robustly from each point's distance to its neighbours' middle.

    Zero where there are no three frames in a row.
    """
    off = xyz[1:-1] - 0.5 * (xyz[2:] + xyz[:-2])
    median = _median_known(np.sum(off**2, axis=-1))
    return np.nan_to_num(median / (1.5 * _CHI2_3_MEDIAN))


def _outliers(xyz: Array, fps: float, options: SmoothOptions) -> NDArray[np.bool_]:
    """(T, J) points far from their running median (Hampel 1974) that no possible motion leads to.

    Far is meant in units of the running median distance. A quick blow is far from the median too, but it comes
    by way of its neighbours: what can be reached from one that is near enough stays.
    """
    half = round(options.hampel_window * fps)
    if half < 1 or len(xyz) < 3:
        return np.zeros(xyz.shape[:2], dtype=np.bool_)
    centre = _running_median(xyz, half)
    distance = np.linalg.norm(xyz - centre, axis=-1)
    # The median length of an isotropic normal vector is 1.54 standard deviations of a coordinate.
    sigma = _running_median(distance[..., None], half)[..., 0] / 1.54
    bound = np.maximum(options.hampel_sigmas * sigma * np.sqrt(3), options.hampel_floor)
    far = distance > bound
    known = np.isfinite(xyz[..., 0])
    for _ in range(2 * half):
        near = known & ~far
        reached = far & (
            _reached(xyz, near, sigma, fps, options.top_speed)
            | _reached(xyz[::-1], near[::-1], sigma[::-1], fps, options.top_speed)[::-1]
        )
        if not reached.any():
            break
        far &= ~reached
    return np.asarray(far)


def _reached(xyz: Array, near: NDArray[np.bool_], sigma: Array, fps: float, top_speed: float) -> NDArray[np.bool_]:
    """(T, J) whether `top_speed` and the noise explain the way from the latest `near` point before."""
    frames, columns = np.arange(len(xyz))[:, None], np.arange(xyz.shape[1])
    latest = np.maximum.accumulate(np.where(near, frames, -1), axis=0)
    way = np.linalg.norm(xyz - xyz[latest, columns], axis=-1)
    allowed = top_speed * (frames - latest) / fps + 2 * np.sqrt(3) * sigma
    return np.asarray((latest >= 0) & (way <= allowed) & ((frames - latest) / fps < 0.1))


def _running_median(values: Array, half: int) -> Array:
    """(T, J, K): median over 2 half + 1 frames of what is not NaN; in blocks, for the windows are large."""
    padded = np.pad(values, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    block = 1000
    parts = [_window_median(padded[s : s + block + 2 * half], half) for s in range(0, len(values), block)]
    return np.concatenate(parts)


def _window_median(padded: Array, half: int) -> Array:
    windows = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0), axis=-1)
    count = np.isfinite(windows).sum(axis=-1)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, windows.shape[-1] - 1)
    picked = [np.take_along_axis(windows, k[..., None], axis=-1)[..., 0] for k in (low, high)]
    return np.where(count > 0, 0.5 * (picked[0] + picked[1]), np.nan)


def _smooth(xyz: Array, covariance: Array, fps: float, options: SmoothOptions) -> tuple[Array, Array]:
    """The smoother in `passes`, with the noise's scale measured and far points weighed down between them.

    The scale is one factor a landmark, by which the squared distance from what the filter predicts exceeds
    what the covariances say; weights are those of Student's t with four degrees of freedom.
    """
    known = np.isfinite(xyz[..., 0])
    scale, weight = np.ones(xyz.shape[1]), np.ones(known.shape)
    freedom = 4.0
    out = out_covariance = np.empty(0)
    for k in range(max(options.passes, 1)):
        noise = covariance * (scale / weight)[..., None, None]
        xyz = np.ascontiguousarray(xyz)
        out, out_covariance, surprise = smooth_all(xyz, noise, known, 1 / fps, options.acceleration)
        out = _hold_ends(out, known)
        if k == options.passes - 1:
            break
        with np.errstate(invalid="ignore"):
            ratio = _median_known(surprise) / _CHI2_3_MEDIAN
        scale = np.clip(scale * np.where(np.isfinite(ratio), ratio, 1.0), 0.02, 400.0)
        error = np.where(known[..., None], xyz - out, 0.0)
        solved = np.linalg.solve(covariance * scale[:, None, None], error[..., None])[..., 0]
        weight = (freedom + 3) / (freedom + np.sum(error * solved, axis=-1))
    return out, out_covariance


def _median_known(values: Array) -> Array:
    """(T, J) -> (J,) median of what is finite; NaN where nothing is."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    return np.where(count > 0, middle, np.nan)


def _hold_ends(positions: Array, known: NDArray[np.bool_]) -> Array:
    """Before the first and after the last known point a path holds still: constant velocity would fly off."""
    out = positions.copy()
    frames, columns = np.arange(len(known))[:, None], np.arange(known.shape[1])
    first = np.argmax(known, axis=0)
    last = len(known) - 1 - np.argmax(known[::-1], axis=0)
    return np.asarray(out[np.clip(frames, first, last), columns])


def _within_reach(known: NDArray[np.bool_], fps: float, options: SmoothOptions) -> NDArray[np.bool_]:
    """(T, J): known, or in a gap of at most `max_gap`, or at an end that is to be extrapolated."""
    t_count = len(known)
    frames = np.arange(t_count)[:, None]
    before = np.maximum.accumulate(np.where(known, frames, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, frames, t_count)[::-1], axis=0)[::-1]
    inside = (before >= 0) & (after < t_count)
    short = inside & (after - before - 1 <= options.max_gap * fps)
    ends = ~inside & ((before >= 0) | (after < t_count))
    return np.asarray(known | short | (ends if options.extrapolate else False))
