"""Matching of unlabelled 2D points of several cameras to unlabelled 3D points, by epipolar geometry, without ghosts.

Two rays that nearly intersect propose a point. A marker is where the rays of three cameras or more intersect, and every
2D point belongs to one marker: points are accepted in the order of the number of agreeing cameras, so that fewer 2D
points remain for accidental intersections. Two cameras suffice where a marker was just before, or where neither 2D
point fits any other point.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import ray_directions


@dataclass(frozen=True)
class MatchOptions:
    """How 2D points become 3D points.

    Attributes:
        near_m: largest distance between two rays that propose a point, metres.
        error_px: largest distance of a 2D point from the projection of its 3D point, px.
        views: minimum number of agreeing cameras.
        known_views: minimum number of agreeing cameras where a marker was in the previous or next frame.
        known_m: largest distance from such a marker, metres.
        pair_px: largest error at which two cameras suffice for a new point, where neither 2D point fits any other.
    """

    near_m: float = 0.006
    error_px: float = 2.0
    views: int = 3
    known_views: int = 2
    known_m: float = 0.03
    pair_px: float = 0.7


@dataclass(frozen=True, eq=False)
class Matched:
    """3D points of one frame.

    Attributes:
        points: (N, 3) metres.
        members: (N, C) index of each camera's 2D point, -1 where it has none.
        error_px: (N,) root mean square distance of the 2D points from the projection, px.
    """

    points: FloatArray
    members: IndexArray
    error_px: FloatArray


def match_points(cameras: CameraGroup, seen: list[FloatArray], known: FloatArray | None = None,
                 options: MatchOptions = MatchOptions()) -> Matched:  # fmt: skip
    """Match the 2D points of one frame.

    Args:
        cameras: C cameras.
        seen: C arrays (K, 2) px.
        known: (P, 3) expected positions of markers, metres.
        options: see `MatchOptions`.
    """
    width = max((len(s) for s in seen), default=0)
    count = len(cameras)
    if width == 0:
        return Matched(np.zeros((0, 3)), np.zeros((0, count), np.intp), np.zeros(0))
    px = np.full((count, width, 2), np.nan)
    for c, points in enumerate(seen):
        px[c, : len(points)] = points[:, :2]
    rays = ray_directions(cameras, px)
    centres = cameras.centers_world
    candidates = [_meeting(centres, rays, a, b, options.near_m) for a in range(count) for b in range(a + 1, count)]
    proposed = np.concatenate([*candidates, *([known] if known is not None and len(known) else [])])
    members = _members(cameras, px, proposed, 2 * options.error_px)
    members = np.unique(members[(members >= 0).sum(1) >= 2], axis=0)
    points, members, error = _locate(cameras, centres, px, rays, members, options.error_px)
    used, kept = np.zeros((count, width), bool), Matched(np.zeros((0, 3)), np.zeros((0, count), np.intp), np.zeros(0))
    for _ in range(4):
        chosen, left = _best(points, members, error, used, known, options)
        kept = _join(kept, Matched(points[chosen], members[chosen], error[chosen]))
        if not len(left):
            break
        # 2D points that a better point has taken are removed, and the rest is examined again.
        points, members, error = _locate(cameras, centres, px, rays, np.unique(left, axis=0), options.error_px)
    chosen = np.array(_lonely_pairs(members, error, used, options), dtype=np.intp)
    return _join(kept, Matched(points[chosen], members[chosen], error[chosen]))


def _best(
    points: FloatArray,
    members: IndexArray,
    error: FloatArray,
    used: BoolArray,
    known: FloatArray | None,
    options: MatchOptions,
) -> tuple[IndexArray, IndexArray]:
    """Indices of points whose 2D points no other point has, best first, and members of the remaining candidates.

    Marks the 2D points of the former as used; the latter have lost some of their members and may still be points.
    """
    views = (members >= 0).sum(1)
    expected = np.zeros(len(points), bool)
    if known is not None and len(known) and len(points):
        expected = np.linalg.norm(points[:, None] - known[None], axis=-1).min(1) < options.known_m
    good = (views >= options.views) | (expected & (views >= options.known_views))
    # An additional camera that fits badly is accidental.
    order = np.argsort(error / (0.5 * options.error_px) - views - 0.5 * expected, kind="stable")
    kept, left = [], []
    for k in order:
        own = np.nonzero(members[k] >= 0)[0]
        taken = used[own, members[k, own]]
        if not taken.any():
            if good[k]:
                used[own, members[k, own]] = True
                kept.append(k)
            else:
                left.append(members[k])
        elif (~taken).sum() >= 2:
            rest = members[k].copy()
            rest[own[taken]] = -1
            left.append(rest)
    # Points accepted later may have taken more.
    for rest in left:
        own = np.nonzero(rest >= 0)[0]
        rest[own[used[own, rest[own]]]] = -1
    remaining = [rest for rest in left if (rest >= 0).sum() >= 2]
    return np.array(kept, dtype=np.intp), np.array(remaining, dtype=np.intp).reshape(-1, members.shape[1])


def _join(one: Matched, other: Matched) -> Matched:
    return Matched(np.concatenate([one.points, other.points]), np.concatenate([one.members, other.members]),
                   np.concatenate([one.error_px, other.error_px]))  # fmt: skip


def _lonely_pairs(members: IndexArray, error: FloatArray, used: BoolArray, options: MatchOptions) -> list[int]:
    """Points of two cameras whose 2D points belong to no other point; marks them as used."""
    own = [np.nonzero(m >= 0)[0] for m in members]
    left = [k for k in range(len(members)) if len(own[k]) >= 2 and not used[own[k], members[k, own[k]]].any()]
    times = np.zeros(used.shape, np.intp)
    for k in left:
        times[own[k], members[k, own[k]]] += 1
    out = []
    for k in left:
        if error[k] < options.pair_px and (times[own[k], members[k, own[k]]] == 1).all():
            used[own[k], members[k, own[k]]] = True
            out.append(k)
    return out


def _meeting(centres: FloatArray, rays: FloatArray, a: int, b: int, near: float) -> FloatArray:
    """(N, 3) midpoints between the rays of two cameras that pass near one another, in front of both."""
    first, second = rays[a][np.isfinite(rays[a, :, 0])], rays[b][np.isfinite(rays[b, :, 0])]
    base = centres[b] - centres[a]
    cosine = first @ second.T
    along, across = first @ base, second @ base
    determinant = np.maximum(1 - cosine**2, 1e-9)
    s = (along[:, None] - cosine * across[None]) / determinant
    t = (cosine * along[:, None] - across[None]) / determinant
    one = centres[a] + s[..., None] * first[:, None]
    two = centres[b] + t[..., None] * second[None]
    good = (np.linalg.norm(one - two, axis=-1) < near) & (s > 0) & (t > 0) & (determinant > 1e-4)
    return np.asarray((one + two)[good] / 2)


def _members(cameras: CameraGroup, px: FloatArray, points: FloatArray, reach: float) -> IndexArray:
    """(N, C) nearest 2D point of each camera to the projections of (N, 3) points within `reach` px, else -1."""
    out = np.full((len(points), len(cameras)), -1, dtype=np.intp)
    if not len(points):
        return out
    at = cameras.project(points)
    for c in range(len(cameras)):
        gap = np.linalg.norm(at[c][:, None] - px[c][None], axis=-1)
        gap = np.where(np.isfinite(gap), gap, np.inf)
        best = gap.argmin(1)
        near = gap[np.arange(len(points)), best] < reach
        out[near, c] = best[near]
    return out


def _locate(cameras: CameraGroup, centres: FloatArray, px: FloatArray, rays: FloatArray, members: IndexArray,
            reach: float) -> tuple[FloatArray, IndexArray, FloatArray]:  # fmt: skip
    """Points (N, 3) where rays intersect, without 2D points farther than `reach` px; updated members, and errors."""
    count, members = len(cameras), members.copy()
    points, error = np.full((len(members), 3), np.nan), np.full(len(members), np.inf)
    for _ in range(3):
        has = members >= 0
        d = np.where(has[..., None], rays[np.arange(count), np.maximum(members, 0)], 0.0)
        points = intersect_rays(centres, d, has)
        at = np.moveaxis(cameras.project(points), 0, 1)
        off = np.linalg.norm(at - px[np.arange(count), np.maximum(members, 0)], axis=-1)
        off = np.where(has & np.isfinite(off), off, np.where(has, np.inf, np.nan))
        worst = np.where(np.isnan(off), -1.0, off).argmax(1)
        far = off[np.arange(len(off)), worst] > reach
        members[np.nonzero(far)[0], worst[far]] = -1
        error = np.sqrt(np.nanmean(np.where(has, off, np.nan) ** 2, axis=1)) if len(off) else np.zeros(0)
        if not far.any():
            break
    good = ((members >= 0).sum(1) >= 2) & np.isfinite(points).all(1) & (error < reach)
    points, members, error = points[good], members[good], error[good]
    members, first = np.unique(members, axis=0, return_index=True)
    return points[first], members, error[first]


def intersect_rays(centres: FloatArray, rays: FloatArray, known: BoolArray) -> FloatArray:
    """(N, 3) points nearest to their rays (N, C, 3), where `known` (N, C); nearer cameras have more weight."""
    weight = known.astype(np.float64)
    out = np.zeros((len(rays), 3))
    for _ in range(2):
        projector = weight[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
        matrix = projector.sum(1) + 1e-12 * np.eye(3)
        out = np.linalg.solve(matrix, np.einsum("ncij,cj->ni", projector, centres)[..., None])[..., 0]
        weight = known / np.maximum(np.sum((out[:, None] - centres) ** 2, axis=-1), 1e-2)
    return out


def follow_points(cameras: CameraGroup, seen: list[list[FloatArray]], fps: float,
                  options: MatchOptions = MatchOptions()) -> tuple[FloatArray, list[Matched]]:  # fmt: skip
    """Match all frames, each with the predicted positions of the markers in the frames before and then after it.

    Args:
        cameras: C cameras.
        seen: for each of T frames C arrays (K, 2) px.
        fps: frames per second.
        options: see `MatchOptions`.

    Returns:
        (T, N, 3) metres, unlabelled and in no particular order, padded with NaN; and the matches of each frame.
    """
    frames: list[Matched] = []
    memory = _Memory(fps)
    for now in seen:
        frames.append(match_points(cameras, now, memory.expected(), options))
        memory.update(frames[-1].points)
    # Backwards as well: a marker that is certain later was there before.
    memory = _Memory(fps)
    for t in range(len(seen) - 1, -1, -1):
        known = np.concatenate([frames[t].points, memory.expected()])
        frames[t] = match_points(cameras, seen[t], known, options)
        memory.update(frames[t].points)
    most = max((len(f.points) for f in frames), default=0)
    out = np.full((len(frames), most, 3), np.nan)
    for t, frame in enumerate(frames):
        out[t, : len(frame.points)] = frame.points
    return out, frames


class _Memory:
    """Recent positions and velocities of markers."""

    def __init__(self, fps: float, longest_s: float = 0.1, fastest: float = 12.0) -> None:
        self.at, self.step, self.age = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
        self.longest, self.reach = max(longest_s * fps, 2.0), max(fastest / fps, 0.02)

    def expected(self) -> FloatArray:
        """(P, 3) predicted positions in the next frame, metres."""
        return self.at + self.step

    def update(self, points: FloatArray) -> None:
        """Add the points of a frame."""
        ahead = self.expected()
        step, alone = np.zeros((len(points), 3)), np.ones(len(ahead), bool)
        if len(points) and len(ahead):
            gap = np.linalg.norm(points[:, None] - ahead[None], axis=-1)
            nearest = gap.argmin(1)
            near = gap[np.arange(len(points)), nearest] < self.reach
            step[near] = 0.5 * self.step[nearest[near]] + 0.5 * (points - self.at[nearest])[near] / (
                1 + self.age[nearest[near], None])  # fmt: skip
            alone[nearest[near]] = False
        alone &= self.age + 1 < self.longest
        self.at = np.concatenate([points, ahead[alone]])
        self.step = np.concatenate([step, self.step[alone]])
        self.age = np.concatenate([np.zeros(len(points)), self.age[alone] + 1])


def find_real_markers(points: FloatArray, track: IndexArray, least: int, fps: float) -> BoolArray:
    """(T, S) samples of trajectories that belong to markers on a person, not to flicker or lamps.

    Args:
        points: (T, S, 3) metres in slots.
        track: (T, S) number of the trajectory, -1 for none.
        least: minimum length of a trajectory, frames.
        fps: frames per second.
    """
    good = track >= 0
    numbers = np.unique(track[good])
    spread = {}
    for n in numbers:
        at = points[track == n]
        if len(at) < least:
            good[track == n] = False
        else:
            spread[n] = float(np.sqrt(np.mean(np.var(at, axis=0).sum())))
    # A lamp does not move, nor does anything near it; a planted foot stands still below a knee that moves.
    still = np.array([spread[n] < 0.002 for n in spread], bool)
    if still.any() and not still.all():
        apart = _apart(points, track, list(spread))
        reached = ~still
        while (new := ~reached & (apart[:, reached] < 0.45).any(1)).any():
            reached |= new
        for n, near in zip(spread, reached, strict=True):
            good[track == n] &= bool(near)
    return good


def _apart(points: FloatArray, track: IndexArray, numbers: list[int], samples: int = 60) -> FloatArray:
    """(N, N) smallest distance of trajectories at common frames of a sample; infinite where there are none."""
    place = {n: i for i, n in enumerate(numbers)}
    out = np.full((len(numbers), len(numbers)), np.inf)
    for t in np.unique(np.linspace(0, len(points) - 1, samples).astype(int)):
        slots = np.array([s for s in np.nonzero(track[t] >= 0)[0] if int(track[t, s]) in place], dtype=np.intp)
        own = np.array([place[int(track[t, s])] for s in slots], dtype=np.intp)
        gap = np.linalg.norm(points[t, slots][:, None] - points[t, slots][None], axis=-1)
        grid = np.ix_(own, own)
        out[grid] = np.minimum(out[grid], gap)
    return out
