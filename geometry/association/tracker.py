"""People followed in 3D: every camera's detections are given, frame by frame, to the bodies that they fit.

A body is predicted from its last frames, seen from every camera, and takes in each the detection nearest to that
view (one assignment a camera, so that the effort grows with the number of cameras and not with their combinations).
Detections that nobody takes begin bodies where views agree, and the more views the better: two rays meet easily by
accident, three do not. No appearance is used, and the cameras' own tracks only break ties: at crossings bodies part in
3D where their pictures lie on each other.

The idea of assigning detections to predicted bodies rather than views to views is that of Zhang et al. 2020 (4D
Association Graph) and Chen et al. 2020 (Cross-view tracking); here without appearance and without a graph.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.association.tracks import Body, deduplicate, drop_reflections, rejoined, without_stray_end
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import nearest_points, pair_points, ray_directions
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.numerics.robust import extent

# Landmarks that a comparison needs, and the share of them, the nearest, that it is made with.
_LEAST_LANDMARKS = 4
_SHARE = 0.7
# Frames worked on between two calls to the cameras' models.
_CHUNK = 128
# What it is worth, in body sizes, that a camera's own tracker stayed with a detection.
_LOYALTY = 0.01
# A view that lies this much farther off than the others' is of someone else.
_ODD_VIEW = 3.0
# Seconds in which two cameras see a body, at least, for it not to be an accident; and somebody, in all of the take: a
# shadow that is taken for a person for a moment agrees between cameras as well as people do. So many times as long
# where never three of three cameras or more do: two that face each other agree on nearly anything between them.
_LEAST_SEEN, _LEAST_IN_ALL, _TWO_ALONE = 0.3, 0.5, 2
# Seconds between two frames of the same track up to which what lies between is taken too.
_BRIDGE = 0.2
# A body is no faster than this, in body sizes a second, and loses so much of its speed in a second without two views.
_FASTEST, _SLOWING = 6.0, 0.96
# Bodies that share no view and lie this near each other, in body sizes, are one.
_SAME_BODY = 0.12
# Views that agree this near to somebody whom no view fits any more are of them.
_SAME_PLACE = 0.35


@dataclass(frozen=True)
class TrackingOptions:
    """How detections of several cameras become people. Sizes are the longer side of a person's landmarks.

    Attributes:
        gate: distance of a detection from a body's predicted view, in body sizes, up to which it may be its own.
        gate_growth: how the gate widens with every second in which the body was not seen.
        gate_slack: how much wider it is for every second between two frames beyond a thirtieth: more can happen.
        start: distance of two views' rays, in body sizes, up to which they may begin a body.
        odd_view: distance of a view's rays from a body, in body sizes, from which it is of someone else where the
            others agree well without it.
        min_frames: people seen by two cameras in fewer frames (or for less than 0.3 s at a time, 0.5 s in all, 1 s
            where no third camera ever does) are dropped as accidents.
        coast: seconds for which a body is predicted without being seen, before it is looked for as a new one.
        same_build: mean difference of limbs' lengths up to which someone who comes back is who left.
    """

    gate: float = 0.12
    gate_growth: float = 0.45
    gate_slack: float = 0.5
    start: float = 0.06
    odd_view: float = 0.05
    min_frames: int = 5
    coast: float = 1.0
    same_build: float = 0.04


class PeopleTracker:
    """Follows people through a take; see `track_people`."""

    def __init__(self, cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions, fps: float) -> None:
        self._cameras, self._keypoints, self._options, self._fps = cameras, keypoints, options, fps
        self._centers = cameras.centers_world
        self._mirror = np.array(keypoints.landmarks.mirror)
        self._focal = np.array([camera.camera_matrix[0, 0] for camera in cameras])
        self._size_px = np.array([[camera.width, camera.height] for camera in cameras], dtype=np.float64)
        self._limbs = _limb_pairs(keypoints)
        self._patience = max(3.0, options.coast * fps)
        self._taken = np.zeros(keypoints.points_px.shape[:3], dtype=np.bool_)
        self._bodies: list[Body] = []
        self._ended: list[Body] = []
        self._chunk = -1
        self._px = self._rays = np.empty((len(cameras), 0, 0, 0, 0))
        self._there: BoolArray = np.empty((len(cameras), 0, 0), dtype=np.bool_)

    def run(self) -> list[Body]:
        """Everyone, forwards through the take and then back to where each was first seen."""
        frames = self._keypoints.points_px.shape[1]
        for t in range(frames):
            self._load(t)
            self._step(t)
        bodies = [*self._ended, *self._bodies]
        least = _least_frames(self._options, _LEAST_SEEN * self._fps, frames)
        for body in bodies:
            without_stray_end(body, self._options.min_frames, _BRIDGE * self._fps)
        bodies = [b for b in bodies if b.met >= least and (b.confirmed or frames < 2 * self._options.min_frames)]
        # Before anybody is followed back: what others have is not free, whoever's turn comes first.
        for body in bodies:
            seen = np.nonzero(body.slots >= 0)
            self._taken[(*seen, body.slots[seen])] = True
        for body in bodies:
            self._backwards(body)
        self._bridge(bodies)
        return deduplicate(bodies, self._keypoints.landmarks)

    def _load(self, t: int) -> None:
        """Rays of the frames around t."""
        if self._chunk >= 0 and self._chunk <= t < self._chunk + self._rays.shape[1]:
            return
        self._chunk = (t // _CHUNK) * _CHUNK
        px = self._keypoints.points_px[:, self._chunk : self._chunk + _CHUNK]
        known = np.asarray(np.isfinite(px).all(-1))
        enough = known.sum(-1) >= min(_LEAST_LANDMARKS, px.shape[3])
        self._px = np.where(known[..., None] & enough[..., None, None], px, np.nan)
        self._rays = ray_directions(self._cameras, self._px)
        self._there = enough

    def _step(self, t: int) -> None:
        k = t - self._chunk
        free = self._there[:, k].copy()
        for body in self._bodies:
            body.points = body.points + body.velocity
        for confirmed in (True, False):
            bodies = [b for b in self._bodies if b.confirmed == confirmed]
            if bodies:
                self._follow(bodies, t, free)
        self._begin(t, free)
        self._merge(t)
        self._retire()

    def _follow(self, bodies: list[Body], t: int, free: BoolArray) -> None:
        """Gives the free detections (C, P) of a frame to the bodies and moves these to where they are seen."""
        k = t - self._chunk
        away, mirrored = self._distances(np.stack([b.points for b in bodies]), k)
        chosen = self._assign(bodies, away, t, free)
        self._face(bodies, chosen, mirrored)
        rays = self._chosen_rays(chosen, mirrored, k)
        old = np.stack([b.points for b in bodies])
        points, chosen = self._meet(old, rays, chosen)
        for n, body in enumerate(bodies):
            seen = chosen[:, n] >= 0
            body.slots[:, t] = chosen[:, n]
            free[seen, chosen[seen, n]] = False
            body.unseen = 0 if seen.any() else body.unseen + 1
            if seen.sum() >= 2:
                self._moved(body, points[n], t)
            else:
                body.unmet += 1
                if seen.any():
                    self._slide(body, int(np.flatnonzero(seen)[0]), rays[:, n])
                body.velocity *= (1 - _SLOWING) ** (1 / self._fps)
            if body.met >= 5 and not body.confirmed:
                body.confirmed = True

    def _distances(self, points: FloatArray, k: int) -> tuple[FloatArray, BoolArray]:
        """(C, N, P) distance of detections from the views of bodies (N, J, 3), in body sizes, and whether a
        detection fits with its sides exchanged."""
        view = self._cameras.project_seen(points)[:, :, None]
        size = extent(view)
        px = self._px[:, k][:, None]
        with np.errstate(invalid="ignore"):
            both = np.stack([_near_mean(np.linalg.norm(p - view, axis=-1)) for p in (px, px[..., self._mirror, :])])
            both = np.nan_to_num(both / size, nan=np.inf)
        # Sides are exchanged only where that is clearly better.
        mirrored = both[1] < 0.7 * both[0] - 0.01
        return np.where(mirrored, both[1], both[0]), mirrored

    def _assign(self, bodies: list[Body], away: FloatArray, t: int, free: BoolArray) -> IntArray:
        """(C, N) the detection of every camera that each body takes, -1 for none."""
        options = self._options
        slack = options.gate_slack * max(0.0, 1 / self._fps - 1 / 30)
        growth = options.gate_growth / self._fps
        gate = np.array([options.gate + slack + growth * b.unseen for b in bodies]).clip(max=0.4)
        chosen = np.full(away.shape[:2], -1, dtype=np.int64)
        last = np.stack([b.slots[:, t - 1] for b in bodies], 1) if t else chosen
        for c in range(len(away)):
            columns = np.flatnonzero(free[c])
            if not len(columns):
                continue
            loyal = last[c][:, None] == columns[None]
            cost = away[c][:, columns] - _LOYALTY * loyal
            allowed = away[c][:, columns] < gate[:, None]
            rows, cols = linear_sum_assignment(np.where(allowed, cost, 10.0))
            good = allowed[rows, cols]
            chosen[c, rows[good]] = columns[cols[good]]
        return chosen

    def _face(self, bodies: list[Body], chosen: IntArray, mirrored: BoolArray) -> None:
        """Sides are as most views have them: a body that most views would have to be exchanged for is exchanged."""
        for n, body in enumerate(bodies):
            cameras = np.flatnonzero(chosen[:, n] >= 0)
            if 2 * mirrored[cameras, n, chosen[cameras, n]].sum() > len(cameras):
                body.points = body.points[self._mirror]
                mirrored[:, n] = ~mirrored[:, n]

    def _chosen_rays(self, chosen: IntArray, mirrored: BoolArray, k: int) -> FloatArray:
        """(C, N, J, 3) rays of the chosen detections (C, N), sides put back, NaN where there is none."""
        cameras = np.arange(len(chosen))[:, None]
        at = np.maximum(chosen, 0)
        rays = self._rays[cameras, k, at]
        flipped = mirrored[cameras, np.arange(chosen.shape[1])[None], at]
        rays = np.where(flipped[..., None, None], rays[:, :, self._mirror], rays)
        return np.where((chosen < 0)[..., None, None], np.nan, rays)

    def _weights(self, points: FloatArray) -> FloatArray:
        """(C, N) inverse variance of a pixel's error at the bodies' distance, relative."""
        middle = np.nan_to_num(np.nanmedian(points, axis=1))
        depth = np.linalg.norm(middle[None] - self._centers[:, None], axis=-1)
        return np.asarray((self._focal[:, None] / np.maximum(depth, 0.1)) ** 2 / self._focal.max() ** 2)

    def _meet(self, old: FloatArray, rays: FloatArray, chosen: IntArray) -> tuple[FloatArray, IntArray]:
        """Bodies (N, J, 3) from their rays, without views that contradict the others."""
        weights = self._weights(old)
        points, away = nearest_points(self._centers, rays, weights)
        off = _near_mean(away) / np.maximum(extent(points), 1e-6)  # (C, N)
        worst = np.nan_to_num(_nanmax(off))
        doubtful = np.flatnonzero((np.isfinite(off).sum(0) >= 3) & (worst > self._options.odd_view))
        if not len(doubtful):
            return points, chosen
        # A near view that is wrong pulls the body to itself and looks no worse than the others: what tells is how
        # well they agree without it.
        without = np.full((len(rays), len(doubtful)), np.inf)
        for c in range(len(rays)):
            rest = rays[:, doubtful].copy()
            rest[c] = np.nan
            there, gap = nearest_points(self._centers, rest, weights[:, doubtful])
            left = np.nan_to_num(_nanmax(_near_mean(gap)) / np.maximum(extent(there), 1e-6), nan=np.inf)
            without[c] = np.where(np.isfinite(off[c, doubtful]), left, np.inf)
        odd = without.argmin(0)
        gone = worst[doubtful] > _ODD_VIEW * without[odd, np.arange(len(doubtful))]
        if not gone.any():
            return points, chosen
        chosen = chosen.copy()
        chosen[odd[gone], doubtful[gone]] = -1
        rays[odd[gone], doubtful[gone]] = np.nan
        points, _ = nearest_points(self._centers, rays, weights)
        return points, chosen

    def _moved(self, body: Body, points: FloatArray, t: int) -> None:
        """A body as it is seen by two cameras or more; landmarks that are not move along."""
        known = np.isfinite(points).all(-1) & np.isfinite(body.points).all(-1)
        shift = np.median((points - body.points)[known], axis=0) if known.any() else np.zeros(3)
        body.velocity = body.velocity + 0.5 * shift / (body.unmet + 1)
        limit = _FASTEST / self._fps * max(float(extent(points)), 1e-6) if np.isfinite(extent(points)) else np.inf
        speed = float(np.linalg.norm(body.velocity))
        body.velocity *= min(1.0, limit / max(speed, 1e-9))
        body.points = np.where(np.isfinite(points), points, body.points + shift)
        body.track[t] = points
        body.unmet = 0
        body.met += 1

    def _slide(self, body: Body, camera: int, rays: FloatArray) -> None:
        """One view moves a body across its line of sight, at the distance that it had."""
        offset = body.points - self._centers[camera]
        ray = rays[camera]
        shift = np.sum(offset * ray, axis=-1, keepdims=True) * ray - offset
        known = np.isfinite(shift).all(-1)
        if known.any():
            step = np.median(shift[known], axis=0)
            body.points = body.points + step
            body.velocity = body.velocity + 0.3 * step

    def _begin(self, t: int, free: BoolArray) -> None:
        """New bodies from detections that nobody took."""
        k = t - self._chunk
        while (free.any(axis=1)).sum() >= 2:
            found = self._best_start(k, free)
            if found is None:
                return
            points, chosen, visible = found
            seen = chosen >= 0
            free[seen, chosen[seen]] = False
            if self._regained(points, chosen, t):
                continue
            if any(_apart(points, b.points) < _SAME_BODY for b in self._bodies if b.confirmed):
                continue
            sure = seen.sum() >= 3 or visible <= 2
            slots = np.full(self._taken.shape[:2], -1, dtype=np.int64)
            slots[:, t] = chosen
            body = Body(points, slots, bool(sure), t, met=1)
            body.track[t] = points
            self._bodies.append(body)

    def _regained(self, points: FloatArray, chosen: IntArray, t: int) -> bool:
        """Whether the detections `chosen` (C,), which meet in `points`, are of somebody whom no view fits any more:
        one bad view had led them astray."""
        lost = [b for b in self._bodies if b.confirmed and (b.slots[:, t] < 0).all()]
        if not lost:
            return False
        nearest = min(lost, key=lambda b: _apart(points, b.points))
        if _apart(points, nearest.points) > _SAME_PLACE:
            return False
        nearest.slots[:, t] = chosen
        nearest.unseen = 0
        self._moved(nearest, points, t)
        return True

    def _best_start(self, k: int, free: BoolArray) -> tuple[FloatArray, IntArray, int] | None:
        """The points (J, 3) on which most views agree, each camera's detection (C,), and how many cameras look
        that way; None where no two agree."""
        guesses = self._guesses(k, free)
        if not len(guesses):
            return None
        away, mirrored = self._distances(guesses, k)
        away = np.where(free[:, None], away, np.inf)
        nearest = away.argmin(-1)
        value = np.take_along_axis(away, nearest[..., None], -1)[..., 0]
        gate = self._options.gate
        support = np.where(value < gate, 1 - value / gate, 0.0).sum(0)
        best = int(support.argmax())
        chosen = np.where(value[:, best] < gate, nearest[:, best], -1)
        if (chosen >= 0).sum() < 2:
            return None
        rays = self._chosen_rays(chosen[:, None], mirrored[:, best : best + 1], k)
        points, rest = self._meet(guesses[best : best + 1], rays, chosen[:, None])
        known = np.isfinite(points[0]).all(-1)
        if known.sum() < _LEAST_LANDMARKS and known.sum() < points.shape[1]:
            return None
        view = self._cameras.project_seen(points[0])
        inside = ((view >= 0) & (view < self._size_px[:, None])).all(-1).mean(1) > 0.5
        filled = np.where(known[:, None], points[0], np.nanmedian(points[0], axis=0))
        return filled, rest[:, 0], int(inside.sum())

    def _guesses(self, k: int, free: BoolArray) -> FloatArray:
        """(G, J, 3) bodies that two free detections of different cameras would make, the best few dozen."""
        bodies, errors = [], []
        cameras = [c for c in range(len(free)) if free[c].any()]
        for i, a in enumerate(cameras):
            for b in cameras[:i]:
                rays_a = self._rays[a, k][free[a]]
                rays_b = self._rays[b, k][free[b]]
                for other in (rays_b, rays_b[:, self._mirror]):
                    points, gap = pair_points(self._centers[a], rays_a, self._centers[b], other)
                    size = extent(points)
                    error = _near_mean(gap) / size
                    good = (error < self._options.start) & self._symmetric(points)
                    bodies.append(points[good])
                    errors.append(error[good])
        if not bodies:
            return np.empty((0, self._rays.shape[3], 3))
        error = np.concatenate(errors)
        return np.asarray(np.concatenate(bodies)[np.argsort(error)[:48]])

    def _symmetric(self, points: FloatArray) -> BoolArray:
        """(...) whether left and right limbs of bodies (..., J, 3) are about equally long: accidents are not."""
        if not len(self._limbs):
            return np.ones(points.shape[:-2], dtype=np.bool_)
        ends = points[..., self._limbs, :]
        length = np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            uneven = np.abs(np.log(length[..., 0] / length[..., 1]))
        return np.nan_to_num(_near_mean(uneven, least=2), nan=0.0) < 0.6

    def _merge(self, t: int) -> None:
        """Younger bodies that lie in an older one and share no view with it are the older one, unless a camera has seen
        both beside each other: then one passes the other, and hides them."""
        bodies = sorted(self._bodies, key=lambda b: (not b.confirmed, b.first))
        for i, old in enumerate(bodies):
            for young in bodies[i + 1 :]:
                both = (old.slots[:, t] >= 0) & (young.slots[:, t] >= 0)
                if young in self._bodies and not both.any() and _apart(old.points, young.points) < _SAME_BODY:
                    if ((old.slots >= 0) & (young.slots >= 0)).any(0).sum() >= self._options.min_frames:
                        continue
                    self._bodies.remove(young)
                    if (young.slots[:, t] >= 0).sum() >= 2 > (old.slots[:, t] >= 0).sum():
                        old.points, old.velocity, old.unmet, old.unseen = young.points, young.velocity, 0, 0
                        old.track[t] = young.points
                        old.met += 1
                    old.slots[:, t] = np.where(old.slots[:, t] >= 0, old.slots[:, t], young.slots[:, t])

    def _retire(self) -> None:
        """Bodies that were not seen for long end; doubtful ones soon."""
        kept: list[Body] = []
        for body in self._bodies:
            patience = self._patience if body.confirmed else 3
            gone = body.unseen > patience or body.unmet > 2 * patience
            (self._ended if gone else kept).append(body)
        self._bodies = kept

    def _backwards(self, body: Body) -> None:
        """The frames before a body was begun, as long as free detections fit it."""
        if not body.track:
            return
        frames = sorted(body.track)
        probe = Body(body.track[frames[0]], body.slots, True, body.first)
        probe.points = np.where(np.isfinite(probe.points), probe.points, np.nanmedian(probe.points, axis=0))
        later = [f for f in frames if f <= frames[0] + 5]
        if len(later) > 1:
            moved = np.nanmedian(body.track[later[-1]] - body.track[later[0]], axis=0) / (later[-1] - later[0])
            probe.velocity = -np.nan_to_num(moved)
        t = frames[0] - 1
        while t >= 0 and probe.unmet <= self._patience and probe.unseen < 3:
            self._load(t)
            free = self._there[:, t - self._chunk] & ~self._taken[:, t]
            probe.points = probe.points + probe.velocity
            before = probe.met
            self._follow([probe], t, free)
            if probe.met > before:
                body.track[t] = probe.track[t]
            seen = body.slots[:, t] >= 0
            self._taken[seen, t, body.slots[seen, t]] = True
            t -= 1

    def _bridge(self, bodies: list[Body]) -> None:
        """Gives a body the detections that it left out between two of the same camera track, where nobody has them:
        a bad frame is for the triangulation to judge."""
        there = np.asarray(np.isfinite(self._keypoints.points_px).all(-1).any(-1))
        taken = np.zeros_like(there)
        for body in bodies:
            camera, frame = np.nonzero(body.slots >= 0)
            taken[camera, frame, body.slots[camera, frame]] = True
        for body in bodies:
            for c, row in enumerate(body.slots):
                frames = np.flatnonzero(row >= 0)
                for a, b in zip(frames[:-1], frames[1:], strict=True):
                    if 1 < b - a <= max(2.0, _BRIDGE * self._fps) and row[a] == row[b]:
                        gap = np.arange(a + 1, b)
                        free = there[c, gap, row[a]] & ~taken[c, gap, row[a]]
                        row[gap[free]] = row[a]
                        taken[c, gap[free], row[a]] = True


def track_people(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions | None = None, fps: float = 30.0
) -> list[IntArray]:
    """The slots (C, T) of everyone whom two cameras see, -1 where a camera does not see them.

    Args:
        cameras: C calibrated cameras.
        keypoints: their detections; a slot is a camera's own track, which need not be right.
        options: see `TrackingOptions`.
        fps: frames a second.
    """
    options = options or TrackingOptions()
    bodies = drop_reflections(PeopleTracker(cameras, keypoints, options, fps).run(), keypoints.landmarks)
    groups = rejoined(bodies, keypoints.landmarks, options.coast, options.same_build, fps)
    frames = keypoints.points_px.shape[1]
    found = []
    for group in groups:
        views = (group >= 0).sum(axis=0)
        wanted = _LEAST_IN_ALL * fps * (1 if views.max() >= min(3, len(cameras)) else _TWO_ALONE)
        if (views >= 2).sum() >= _least_frames(options, wanted, frames):
            found.append(np.asarray(group))
    return found


def _least_frames(options: TrackingOptions, wanted: float, frames: int) -> float:
    """In how many of a take's frames two cameras have to see somebody."""
    return min(max(options.min_frames, wanted), max(1, frames // 4))


def _limb_pairs(keypoints: Keypoints2D) -> IntArray:
    """(L, 2, 2) limbs of the left side and their twins on the right, as indices of landmarks."""
    landmarks, mirror = keypoints.landmarks, keypoints.landmarks.mirror
    left = [(a, b) for a, b in landmarks.edge_indices if all(landmarks.names[i].startswith("left_") for i in (a, b))]
    return np.array([[(a, b), (mirror[a], mirror[b])] for a, b in left], dtype=np.int64).reshape(-1, 2, 2)


def _apart(a: FloatArray, b: FloatArray) -> float:
    """Median distance of two bodies' landmarks, in body sizes."""
    size = max(float(np.nan_to_num(extent(a))), 1e-6)
    away = np.linalg.norm(a - b, axis=-1)
    return float(np.nanmedian(away)) / size if np.isfinite(away).any() else np.inf


def _near_mean(values: FloatArray, least: int = _LEAST_LANDMARKS) -> FloatArray:
    """(...) mean of the smaller numbers of the last axis without its NaNs; NaN with fewer than `least`."""
    known = np.isfinite(values)
    count = known.sum(-1)
    ordered = np.sort(np.where(known, values, np.inf), axis=-1)
    used = np.ceil(_SHARE * count)
    inside = np.arange(values.shape[-1]) < used[..., None]
    total = np.where(inside, ordered, 0.0).sum(-1)
    enough = count >= min(least, values.shape[-1])
    return np.where(enough, total / np.maximum(used, 1), np.nan)


def _nanmax(values: FloatArray) -> FloatArray:
    """Over the first axis; NaN where all are."""
    best = np.where(np.isfinite(values), values, -np.inf).max(0)
    return np.where(np.isfinite(best), best, np.nan)
