"""Triangulation of all frames of a take at once: 2D points of several cameras, the motion of landmarks, and bone
lengths.

Minimises, over every landmark in every frame, the robust reprojection error of `geometry.triangulation.multiview` (so
that a wrong camera has no influence here either) plus

- the deviation from a smooth path, under Student's t: a landmark stays near a path of little acceleration, with
deviations as large as the take shows, in rare frames much larger;
- changes of bone lengths, as far as the take's bones keep theirs;
- the deviation from other frames in which the whole body and its motion are the same within the noise.

The weight of each is measured from the take, not set: the noise of single frames is known from triangulation, and
second differences over one to twelve frames separate motion, which makes them grow, from jitter, which does not.
Sources: Rauch, Tung, Striebel 1965 (the path); A. Buades, B. Coll, J.-M. Morel, "A non-local algorithm for image
denoising", CVPR 2005 (other frames).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.smoothing._kernel import smooth_all
from muybridge.geometry.triangulation.multiview import (
    TriangulateOptions,
    Triangulation,
    in_chunks,
    limits_of,
    triangulate,
    views_of,
)
from scripts.benchmarks.geometry.whole_take_kernel import likeliest_points

_CHI2_3_MEDIAN = 2.366
_LAGS = (1, 2, 3, 4, 6, 8, 12)


@dataclass(frozen=True)
class TakeOptions:
    """Options of the triangulation of a whole take.

    Attributes:
        triangulate: of the single frames.
        student_dof: of Student's t: the smaller, the more readily single frames leave the path.
        rounds: number of times the path is estimated.
        bone_sigma: metres, least standard deviation of a bone's length.
        recurrences: most other frames that a frame is compared with; 0 disables this.
        patch: frames to each side that have to be similar, too.
        alike: largest mean square difference of similar frames beyond noise, in units of the noise.
    """

    triangulate: TriangulateOptions = field(default_factory=TriangulateOptions)
    student_dof: float = 4.0
    rounds: int = 3
    bone_sigma: float = 0.002
    recurrences: int = 16
    patch: int = 2
    alike: float = 0.5


@dataclass
class _Cloud:
    """Points of the take as they get better; T frames, J landmarks."""

    known: BoolArray  # (T, J)
    xyz: FloatArray  # (T, J, 3), 0 where unknown
    covariance: FloatArray  # (T, J, 3, 3), 1 where unknown
    typical: FloatArray  # (J, 3, 3) median covariance


def triangulate_take(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    bones: Sequence[tuple[int, int]] = (),
    options: TakeOptions | None = None,
) -> Triangulation:
    """Triangulates a take of evenly spaced frames as a whole.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px; NaN where a camera has no point.
        variance_px2: (C, T, J) variance of each coordinate.
        bones: pairs of landmarks whose distance changes little; how little is measured.
        options: see TakeOptions.

    Returns:
        As `triangulate`: the same points are NaN, the residuals are the new ones', inliers those of the frames.

    Raises:
        ValueError: as `triangulate`, or a bone that joins no two landmarks.
    """
    options = options or TakeOptions()
    single = triangulate(cameras, points_px, variance_px2, options.triangulate)
    frames, landmarks = single.points_world.shape[:2]
    for a, b in bones:
        if not (0 <= a < landmarks and 0 <= b < landmarks and a != b):
            raise ValueError(f"bone {a}-{b}: there are landmarks 0 to {landmarks - 1}")
    cloud = _cloud(single)
    if frames < 3 or not cloud.known.any():
        return single
    again, again_info = _recurrences(cloud, options)
    path, of_path, level = _paths(_with(cloud, again, again_info), cloud, options)
    views, info = views_of(cameras, points_px, variance_px2, single, options.triangulate)
    path_info: FloatArray = np.asarray(np.linalg.inv(level), dtype=np.float64).reshape(-1, 3, 3)
    points, covariance = single.points_world.reshape(-1, 3).copy(), np.full((frames * landmarks, 3, 3), np.nan)
    for joined in ((), bones) if bones else ((),):
        # Bones come second: before, points that are wrong would pull their neighbours.
        other, other_info = _with_bones(again, again_info, points.reshape(frames, landmarks, 3), cloud, joined, options)
        work = partial(
            likeliest_points, views.rig, limits_of(views, options.triangulate), views.seen, info, path.reshape(-1, 3),
            path_info, other.reshape(-1, 3), other_info.reshape(-1, 3, 3), options.student_dof, points, covariance,
        )  # fmt: skip
        in_chunks(len(points), options.triangulate, work)
    # The path is not known exactly either; by so much it moves the point.
    share = covariance @ path_info
    covariance = covariance + share @ of_path.reshape(-1, 3, 3) @ np.swapaxes(share, -1, -2)
    xyz = points.reshape(frames, landmarks, 3)
    residual = np.linalg.norm(cameras.project(xyz) - np.asarray(points_px, dtype=np.float64), axis=-1)
    residual[~np.isfinite(single.residual_px)] = np.nan
    return replace(single, points_world=xyz, covariance_world=covariance.reshape(frames, landmarks, 3, 3),
                   residual_px=residual)  # fmt: skip


def _cloud(single: Triangulation) -> _Cloud:
    known = np.asarray(np.isfinite(single.points_world).all(axis=-1))
    xyz = np.where(known[..., None], single.points_world, 0.0)
    covariance = np.where(known[..., None, None], single.covariance_world, np.eye(3))
    typical = np.tile(np.eye(3) * 1e-4, (known.shape[1], 1, 1))
    for j in np.flatnonzero(known.any(axis=0)):
        typical[j] = np.median(covariance[known[:, j], j], axis=0) + 1e-10 * np.eye(3)
    return _Cloud(known, xyz, covariance, typical)


def _with(cloud: _Cloud, other: FloatArray, info: FloatArray) -> _Cloud:
    """The cloud's points together with what else is said about them."""
    own = np.linalg.inv(cloud.covariance)
    covariance = np.linalg.inv(own + info)
    both = np.einsum("tjab,tjb->tja", own, cloud.xyz) + np.einsum("tjab,tjb->tja", info, other)
    xyz = np.where(cloud.known[..., None], np.einsum("tjab,tjb->tja", covariance, both), 0.0)
    return replace(cloud, xyz=xyz, covariance=np.where(cloud.known[..., None, None], covariance, np.eye(3)))


def _motion(cloud: _Cloud) -> tuple[FloatArray, FloatArray]:
    """(J,) how large jitter is, in typical covariances, and (J,) m per frame^2 of acceleration, per axis.

    The variance of x[t+k] - 2 x[t] + x[t-k] is 6 (noise + jitter) + acceleration (2 k^3 + k) / 3.
    """
    white = np.linalg.cholesky(np.linalg.inv(cloud.typical))
    points = np.einsum("jba,tjb->tja", white, np.where(cloud.known[..., None], cloud.xyz, np.nan))
    ratio = np.trace(np.linalg.solve(cloud.typical, np.eye(3)[None]), axis1=1, axis2=2) / 3
    lags = [k for k in _LAGS if 4 * k < len(points)] or [1]
    moments = []
    for k in lags:
        second = np.sort(np.abs(points[2 * k :] - 2 * points[k:-k] + points[: -2 * k]), axis=0)
        count = np.isfinite(second).sum(axis=0)
        middle = np.take_along_axis(second, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
        moments.append(np.mean(np.nan_to_num(middle / 0.6745) ** 2, axis=1) / 6)
    measured, growth = np.array(moments), np.array([(2 * k**3 + k) / 18 for k in lags])
    level, acceleration = np.zeros(len(ratio)), np.zeros(len(ratio))
    for j in range(len(ratio)):
        weight = 1 / (measured[:, j] + 1e-9)
        design = np.stack([np.ones(len(lags)), growth], axis=1) * weight[:, None]
        (level[j], square), _ = nnls(design, np.maximum(measured[:, j] - 1, 0) * weight)
        acceleration[j] = np.sqrt(max(square, 1e-6) / ratio[j])
    return np.maximum(level, 0.02), acceleration


def _paths(cloud: _Cloud, single: _Cloud, options: TakeOptions) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(T, J, 3) smooth paths, (T, J, 3, 3) their covariance, and (T, J, 3, 3) how far points are beside them."""
    level, acceleration = _motion(single)
    jitter = np.broadcast_to(level[:, None, None] * cloud.typical, cloud.covariance.shape)
    path, of_path, scale = cloud.xyz, cloud.covariance, np.ones(cloud.known.shape)
    for _ in range(options.rounds):
        noise = cloud.covariance + jitter * scale[..., None, None]
        columns = [
            smooth_all(np.ascontiguousarray(cloud.xyz[:, j : j + 1]), np.ascontiguousarray(noise[:, j : j + 1]),
                       np.ascontiguousarray(cloud.known[:, j : j + 1]), 1.0, float(acceleration[j]))
            for j in range(cloud.known.shape[1])
        ]  # fmt: skip
        path = np.where(cloud.known[..., None], np.concatenate([c[0] for c in columns], axis=1), 0.0)
        of_path = np.where(cloud.known[..., None, None], np.concatenate([c[1] for c in columns], axis=1), np.eye(3))
        # What is likely beside the path and how sure that is; is it more than usual?
        share = jitter * scale[..., None, None] @ np.linalg.inv(noise)
        beside = np.einsum("tjab,tjb->tja", share, cloud.xyz - path)
        far = np.einsum("tja,tjab,tjb->tj", beside, np.linalg.inv(jitter), beside)
        far += scale * (3 - np.trace(share, axis1=-2, axis2=-1))
        scale = (options.student_dof + far) / (options.student_dof + 3)
    return path, of_path, np.array(jitter)


def _recurrences(cloud: _Cloud, options: TakeOptions) -> tuple[FloatArray, FloatArray]:
    """(T, J, 3) mean and (T, J, 3, 3) information of each point in other frames that are alike; 0 where none is."""
    frames, landmarks = cloud.known.shape
    mean, info = np.zeros((frames, landmarks, 3)), np.zeros((frames, landmarks, 3, 3))
    near = 4 * options.patch + 2
    if not options.recurrences or frames < 2 * near:
        return mean, info
    white = np.einsum("jba,tjb->tja", np.linalg.cholesky(np.linalg.inv(cloud.typical)), cloud.xyz)
    for t, others in enumerate(_candidates(cloud, options, near)):
        others = others[np.abs(others - t) > near][: options.recurrences]
        beyond = _unlike(white, cloud.known, t, others, options.patch)
        others, beyond = others[beyond < options.alike], beyond[beyond < options.alike]
        if len(others):
            mean[t], info[t] = _average(cloud, t, others, max(float(beyond.mean()), 0.1))
    return mean, info


def _candidates(cloud: _Cloud, options: TakeOptions, near: int, most: int = 4000) -> IndexArray:
    """(T, K) frames with the most similar poses, nearest first."""
    frames = len(cloud.known)
    poses = cloud.xyz.copy()
    time = np.arange(frames)
    for j in np.flatnonzero(~cloud.known.all(axis=0) & cloud.known.any(axis=0)):
        for i in range(3):
            poses[:, j, i] = np.interp(time, time[cloud.known[:, j]], cloud.xyz[cloud.known[:, j], j, i])
    flat = poses.reshape(frames, -1) - poses.reshape(frames, -1).mean(axis=0)
    flat = np.clip(flat, *np.percentile(flat, [1, 99], axis=0))
    _, axes = np.linalg.eigh(flat.T @ flat)
    flat = flat @ axes[:, -12:]
    chosen = np.linspace(0, frames - 1, min(frames, most)).astype(np.intp)
    count = min(len(chosen), options.recurrences + 2 * near + 1)
    return np.asarray(chosen[cKDTree(flat[chosen]).query(flat, count)[1]])


def _unlike(white: FloatArray, known: BoolArray, t: int, others: IndexArray, patch: int) -> FloatArray:
    """(K,) median square difference of frames and their neighbours beyond noise, in units of the noise.

    Args:
        white: (T, J, 3) points in units of their landmark's typical noise.
        known: (T, J).
        t, others: the frame, and those it is compared with. Infinite where too little is known.
    """
    around = np.arange(-patch, patch + 1)
    a, b = t + around, others[:, None] + around
    inside = (a >= 0) & (a < len(white)) & (b >= 0) & (b < len(white))
    a, b = np.clip(a, 0, len(white) - 1), np.clip(b, 0, len(white) - 1)
    both = known[a] & known[b] & inside[..., None]
    off = white[b] - white[a]
    far = np.where(both, np.einsum("kfja,kfja->kfj", off, off) / 2, np.inf).reshape(len(others), -1)
    count = both.reshape(len(others), -1).sum(axis=1)
    middle = np.take_along_axis(np.sort(far, axis=1), (np.maximum(count - 1, 0) // 2)[:, None], axis=1)[:, 0]
    return np.where(count >= 12, np.maximum(middle / _CHI2_3_MEDIAN - 1, 0.0), np.inf)


def _average(cloud: _Cloud, t: int, others: IndexArray, beyond: float) -> tuple[FloatArray, FloatArray]:
    """(J, 3) mean of points in other frames and its (J, 3, 3) information; far ones count little."""
    off = cloud.xyz[others] - cloud.xyz[t]
    total = cloud.covariance[others] + cloud.covariance[t]
    far = np.einsum("uja,uja->uj", off, np.linalg.solve(total, off[..., None])[..., 0])
    weight = np.where(cloud.known[others] & cloud.known[t], 7 / (4 + far) * (far < 30), 0.0)
    parts = weight[..., None, None] * np.linalg.inv(cloud.covariance[others])
    summed = parts.sum(axis=0)
    seen = weight.sum(axis=0) > 0.5
    spread = np.linalg.inv(np.where(seen[:, None, None], summed, np.eye(3)))
    mean = np.einsum("jab,jb->ja", spread, np.einsum("ujab,ujb->ja", parts, cloud.xyz[others]))
    # That the frames are not quite alike is the same for all of them: no number of frames averages it out.
    info = np.linalg.inv(spread + 2 * beyond * cloud.typical)
    return np.where(seen[:, None], mean, 0.0), np.where(seen[:, None, None], info, 0.0)


def _with_bones(
    other: FloatArray,
    info: FloatArray,
    points: FloatArray,
    cloud: _Cloud,
    bones: Sequence[tuple[int, int]],
    options: TakeOptions,
) -> tuple[FloatArray, FloatArray]:
    """What recurrences say, and what the lengths of bones say from where their other ends are."""
    total, pull = info.copy(), np.einsum("tjab,tjb->tja", info, other)
    for a, b in bones:
        along = points[:, a] - points[:, b]
        length = np.linalg.norm(along, axis=-1)
        known = cloud.known[:, a] & cloud.known[:, b] & (length > 1e-6)
        if known.sum() < 10:
            continue
        n = along[known] / length[known, None]
        noise = [np.einsum("ta,tab,tb->t", n, cloud.covariance[known, end], n) for end in (a, b)]
        usual = float(np.median(length[known]))
        spread = (float(np.median(np.abs(length[known] - usual))) / 0.6745) ** 2
        sigma2 = max(spread - float(np.median(noise[0] + noise[1])), options.bone_sigma**2)
        for end, far, sign, of_far in ((a, b, 1.0, noise[1]), (b, a, -1.0, noise[0])):
            # A bone that is far from its length has a wrong end, and nobody knows which.
            trust = 5 / (4 + (length[known] - usual) ** 2 / (sigma2 + noise[0] + noise[1]))
            worth = np.where(trust > 0.25, trust, 0.0) / (sigma2 + of_far)
            precision = n[:, :, None] * n[:, None, :] * worth[:, None, None]
            total[known, end] += precision
            target = points[known, far] + sign * usual * n
            pull[known, end] += np.einsum("tab,tb->ta", precision, target)
    solvable = total + 1e-9 * np.eye(3)
    return np.linalg.solve(solvable, pull[..., None])[..., 0], total
