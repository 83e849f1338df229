"""Detection and correction of left-right flips of a 2D network, by comparison with the other cameras.

For every pair of cameras, the epipolar distances of matching landmarks are compared with those of flipped ones. This
gives for every frame a signed matrix of evidence that two cameras label the sides alike; the signs of the cameras that
fit it best are searched (not by enumeration, but from two starting points with single changes). Which of the two sides
is left remains open in each frame; it is decided by the original labels and their continuity in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import extent, row_median
from muybridge.geometry.triangulation.multiview import TriangulateOptions, take_noise, usable_points

_BODY_PARTS = (
    ("shoulder", "elbow", "wrist"),
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe"),
    ("eye", "ear"),
)


@dataclass(frozen=True)
class FlipOptions:
    """When left and right are flipped.

    Attributes:
        min_gain: minimum decrease of the sum of squared, bounded errors (in sigmas) that justifies a flip.
        bound_sigma: limit of an error in sigmas, so that no single landmark decides.
        prior: weight of a camera's own labels in one frame, in squared sigmas.
        stride_share: displacement of a landmark between two frames of slow motion, as a share of the body size.
        parts: landmark names without their side that are flipped together, each group after the whole body; empty for
            the whole body only.
    """

    min_gain: float = 15.0
    bound_sigma: float = 3.0
    prior: float = 4.0
    stride_share: float = 0.03
    parts: tuple[tuple[str, ...], ...] = _BODY_PARTS


def repair_flips(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    landmarks: LandmarkSet,
    options: FlipOptions | None = None,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Correct left-right flips where one camera contradicts the others.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person; NaN where missing.
        variance_px2: (C, T, J) px^2.
        landmarks: the J landmarks, with their left-right pairs.
        options: see `FlipOptions`.

    Returns:
        points_px and variance_px2 with flips corrected, and (C, T, J) the flipped points.

    Raises:
        ValueError: shapes that do not match.
    """
    options = options or FlipOptions()
    px = np.array(points_px, dtype=np.float64)
    variance = np.array(variance_px2, dtype=np.float64)
    if px.ndim != 4 or px.shape[0] != len(cameras) or px.shape[2:] != (len(landmarks), 2):
        raise ValueError(f"points_px must be ({len(cameras)}, T, {len(landmarks)}, 2), not {px.shape}")
    usable = usable_points(px, variance)
    px[~usable], variance[~usable] = np.nan, np.nan
    noise_px, scale = take_noise(cameras, px, variance, TriangulateOptions())
    total = scale * variance + noise_px**2

    def exchange(twins: IntArray, flips: BoolArray) -> None:
        order = np.arange(len(landmarks))
        order[twins[:, 0]], order[twins[:, 1]] = twins[:, 1], twins[:, 0]
        for array in (px, variance, total):
            array[flips] = array[flips][:, order]
        flipped[:, :, twins.ravel()] ^= flips[..., None]

    flipped = np.zeros(usable.shape, dtype=np.bool_)
    whole = _twins(landmarks, None)
    if not whole.size or len(cameras) < 2 or px.shape[1] == 0:
        return px, variance, flipped
    body, _ = _flips(cameras, px, total, whole, options)
    exchange(whole, body)
    parts = [twins for twins in (_twins(landmarks, part) for part in options.parts) if twins.size]
    found = [_flips(cameras, px, total, twins, options) for twins in parts]
    # If a flip of the whole body is undone for one part, parts without evidence of their own return to their labels.
    undone = body & np.any([flips for flips, _ in found], axis=0) if found else body
    for twins, (flips, certain) in zip(parts, found, strict=True):
        exchange(twins, flips | (undone & ~certain))
    return px, variance, flipped


def _twins(landmarks: LandmarkSet, part: Sequence[str] | None) -> IntArray:
    """(K, 2) indices of the left and right landmarks of a part (None: of all)."""
    pairs = [
        (i, twin)
        for i, (name, twin) in enumerate(zip(landmarks.names, landmarks.mirror, strict=True))
        if name.startswith("left_") and (part is None or name[5:] in part)
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _flips(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, twins: IntArray, options: FlipOptions
) -> tuple[BoolArray, BoolArray]:
    """(C, T) whether a camera's labels should be flipped, and (C, T) whether the evidence is sufficient."""
    evidence = _view_evidence(cameras, px, variance, twins, options)
    signs = _best_signs(evidence, options.prior)
    # Flips with little effect are ignored. A camera's own error enters the evidence of all of its pairs, which
    # therefore count no more than two.
    pairs = np.maximum((evidence != 0).sum(axis=2), 2)
    gain = 2 * np.abs(np.einsum("tab,tb->ta", evidence, signs)) * (2 / pairs)
    certain = gain >= options.min_gain
    in_time = _time_evidence(px, variance, twins, options)
    overall = _overall_signs(signs, np.where(certain, 1.0, 0.0), in_time, options.prior)
    flips: BoolArray = (signs * overall[:, None] < 0) & certain
    return flips.T, certain.T


def _bound(u: FloatArray, bound_sigma: float) -> FloatArray:
    result: FloatArray = u / (1.0 + u / bound_sigma**2)
    return result


def _view_evidence(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, twins: IntArray, options: FlipOptions
) -> FloatArray:
    """(T, C, C) half of the excess cost of flipped over matching labels, in squared sigmas; symmetric."""
    count, frames = px.shape[:2]
    slopes = cameras.unproject(px)
    focal2 = np.array([camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1] for camera in cameras])
    noise = variance / focal2[:, None, None]
    evidence = np.zeros((frames, count, count))
    for a in range(count):
        for b in range(a):
            essential = _essential(cameras, a, b)

            def cost(i: int, k: int, a: int = a, b: int = b, essential: FloatArray = essential) -> FloatArray:
                at_a, at_b = twins[:, i], twins[:, k]
                u = _epipolar_u(essential, slopes[a][:, at_a], slopes[b][:, at_b], noise[a][:, at_a], noise[b][:, at_b])
                return _bound(u, options.bound_sigma)

            difference = cost(0, 1) + cost(1, 0) - cost(0, 0) - cost(1, 1)
            evidence[:, a, b] = evidence[:, b, a] = 0.5 * np.nansum(difference, axis=-1)
    return evidence


def _essential(cameras: CameraGroup, a: int, b: int) -> FloatArray:
    """(3, 3) E with x_b' E x_a = 0 for normalised homogeneous coordinates."""
    pose_a, pose_b = cameras[a].cam_from_world, cameras[b].cam_from_world
    rotation = pose_b[:, :3] @ pose_a[:, :3].T
    x, y, z = pose_b[:, 3] - rotation @ pose_a[:, 3]
    essential: FloatArray = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    return essential


def _epipolar_u(
    essential: FloatArray, a: FloatArray, b: FloatArray, noise_a: FloatArray, noise_b: FloatArray
) -> FloatArray:
    """Squared epipolar distance in units of its variance; points (..., 2), variances (...)."""
    ray_a = np.concatenate([a, np.ones((*a.shape[:-1], 1))], axis=-1)
    ray_b = np.concatenate([b, np.ones((*b.shape[:-1], 1))], axis=-1)
    line_b, line_a = ray_a @ essential.T, ray_b @ essential
    error = np.sum(ray_b * line_b, axis=-1)
    spread = np.sum(line_a[..., :2] ** 2, axis=-1) * noise_a + np.sum(line_b[..., :2] ** 2, axis=-1) * noise_b
    u: FloatArray = error**2 / np.maximum(spread, 1e-30)
    return u


def _time_evidence(px: FloatArray, variance: FloatArray, twins: IntArray, options: FlipOptions) -> FloatArray:
    """(T - 1, C) the same between one camera's consecutive frames."""
    if px.shape[1] < 2:
        return np.zeros((0, len(px)))

    def moved2(i: int, k: int) -> FloatArray:
        return np.asarray(np.sum((px[:, 1:, twins[:, i]] - px[:, :-1, twins[:, k]]) ** 2, axis=-1))

    # Slow motion, or the usual motion of these landmarks in this take: at low frame rates, displacements are large.
    mostly = np.nan_to_num(row_median(row_median(np.concatenate([moved2(0, 0), moved2(1, 1)], axis=-1))))[:, None, None]
    stride2 = np.fmax((options.stride_share * extent(px)[:, 1:, None]) ** 2, mostly)

    def cost(i: int, k: int) -> FloatArray:
        spread = variance[:, 1:, twins[:, i]] + variance[:, :-1, twins[:, k]] + stride2
        # Noise is independent between landmarks and cameras; a fast motion is common to all of them.
        worth = 1 / (1 + (len(px) * len(twins) - 1) * mostly / (spread + mostly))
        return worth * _bound(moved2(i, k) / spread, options.bound_sigma)

    difference = cost(0, 1) + cost(1, 0) - cost(0, 0) - cost(1, 1)
    evidence: FloatArray = 0.5 * np.nansum(difference, axis=-1).T
    return evidence


def _best_signs(evidence: FloatArray, prior: float) -> FloatArray:
    """(T, C) signs s, 1 or -1, that maximise the sum of E_ab s_a s_b (a < b) plus the prior."""
    frames, count = evidence.shape[:2]
    _, vectors = np.linalg.eigh(evidence)
    leading = np.where(vectors[:, :, -1] < 0, -1.0, 1.0)
    leading *= np.where(leading.sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    best = np.ones((frames, count))
    best_value = np.full(frames, -np.inf)
    for start in (np.ones((frames, count)), leading):
        signs = start.copy()
        for _ in range(2 * count):
            pull = np.einsum("tab,tb->ta", evidence, signs) + prior
            loss = signs * pull  # loss of a change of the sign
            worst = np.argmin(loss, axis=1)
            change = loss[np.arange(frames), worst] < -1e-9
            if not change.any():
                break
            signs[change, worst[change]] *= -1
        value = 0.5 * np.einsum("ta,tab,tb->t", signs, evidence, signs) + prior * signs.sum(axis=1)
        better = value > best_value
        best[better], best_value[better] = signs[better], value[better]
    return best


def _overall_signs(signs: FloatArray, certain: FloatArray, in_time: FloatArray, prior: float) -> FloatArray:
    """(T,) the sign of each frame as a whole: the best path through the take."""
    frames = signs.shape[0]
    own = prior * (signs * certain).sum(axis=1)
    bond = np.sum(in_time * signs[1:] * signs[:-1], axis=1)
    value = np.zeros((frames, 2))  # of the best path that ends with sign +1, -1
    came = np.zeros((frames, 2), dtype=np.int64)
    value[0] = own[0], -own[0]
    for t in range(1, frames):
        for k in range(2):
            steps = value[t - 1] + np.where(np.arange(2) == k, bond[t - 1], -bond[t - 1])
            came[t, k] = int(np.argmax(steps))
            value[t, k] = steps[came[t, k]] + (own[t] if k == 0 else -own[t])
    state = int(np.argmax(value[-1]))
    overall = np.empty(frames)
    for t in range(frames - 1, -1, -1):
        overall[t] = 1.0 if state == 0 else -1.0
        state = int(came[t, state])
    return overall
