"""Assignment of one frame's detections to predicted bodies, and the 3D update of these bodies.

Each body is projected into every camera and takes the detection nearest to its projection: one linear assignment per
camera, so that the cost grows with the number of cameras and not with the number of their combinations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.tracks import BodyTrack
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import nearest_points, pair_points, ray_directions
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import extent

# Minimum number of common landmarks for a comparison, and the share of them, the nearest, that enters it.
LEAST_LANDMARKS = 4
_SHARE = 0.7
# Bonus for a detection in the slot that the body had in the previous frame, in body sizes.
_SAME_SLOT_BONUS = 0.01
# A view is rejected if the others agree better without it by this factor.
_ODD_VIEW = 3.0
# Largest speed of a body, in body sizes per second; share of the speed lost per second without two views.
_FASTEST, _SLOWING = 6.0, 0.96
# Number of candidate bodies that are examined to start a new one.
_CANDIDATES = 48


@dataclass(frozen=True)
class Detections:
    """Detections of a range of consecutive frames.

    Attributes:
        first: index of the first frame.
        points_px: (C, K, P, J, 2) landmarks, px; NaN where missing or where a detection has too few landmarks.
        rays: (C, K, P, J, 3) unit vectors in the world; NaN where `points_px` is.
        valid: (C, K, P) detections with enough landmarks.
    """

    first: int
    points_px: FloatArray
    rays: FloatArray
    valid: BoolArray

    def __contains__(self, t: int) -> bool:
        return bool(self.first <= t < self.first + self.valid.shape[1])

    def frame(self, t: int) -> FrameDetections:
        """The detections of frame `t`."""
        k = t - self.first
        return FrameDetections(t, self.points_px[:, k], self.rays[:, k], self.valid[:, k])


@dataclass(frozen=True)
class FrameDetections:
    """Detections of frame `t`: `points_px` (C, P, J, 2), `rays` (C, P, J, 3) and `valid` (C, P), see `Detections`."""

    t: int
    points_px: FloatArray
    rays: FloatArray
    valid: BoolArray


def detections_of(cameras: CameraGroup, points_px: FloatArray, first: int) -> Detections:
    """Detections (C, K, P, J, 2) px of K frames, from frame `first` on, with their viewing rays."""
    known = np.asarray(np.isfinite(points_px).all(-1))
    valid = known.sum(-1) >= min(LEAST_LANDMARKS, points_px.shape[3])
    px = np.where(known[..., None] & valid[..., None, None], points_px, np.nan)
    return Detections(first, px, ray_directions(cameras, px), valid)


class DetectionMatcher:
    """Matches detections to bodies and moves the bodies to where they are observed; it has no state of its own."""

    def __init__(self, cameras: CameraGroup, landmarks: LandmarkSet, options: TrackingOptions, fps: float) -> None:
        self._cameras, self._options, self._fps = cameras, options, fps
        self._centers = cameras.centers_world
        self._mirror = np.array(landmarks.mirror)
        self._focal = np.array([camera.camera_matrix[0, 0] for camera in cameras])
        self._size_px = np.array([[camera.width, camera.height] for camera in cameras], dtype=np.float64)
        self._limbs = _limb_pairs(landmarks)

    def follow(self, bodies: list[BodyTrack], frame: FrameDetections, free: BoolArray) -> None:
        """Assign the free detections (C, P) of a frame to bodies and update these; assigned ones cease to be free."""
        away, mirrored = self._distances(np.stack([b.points for b in bodies]), frame)
        chosen = self._assign(bodies, away, frame.t, free)
        self._fix_sides(bodies, chosen, mirrored)
        rays = self._chosen_rays(chosen, mirrored, frame)
        old = np.stack([b.points for b in bodies])
        points, chosen = self._triangulate(old, rays, chosen)
        for n, body in enumerate(bodies):
            seen = chosen[:, n] >= 0
            body.slots[:, frame.t] = chosen[:, n]
            free[seen, chosen[seen, n]] = False
            body.unseen = 0 if seen.any() else body.unseen + 1
            if seen.sum() >= 2:
                self.move(body, points[n], frame.t)
            else:
                body.unmet += 1
                if seen.any():
                    self._slide(body, int(np.flatnonzero(seen)[0]), rays[:, n])
                body.velocity *= (1 - _SLOWING) ** (1 / self._fps)
            if body.met >= 5 and not body.confirmed:
                body.confirmed = True

    def move(self, body: BodyTrack, points: FloatArray, t: int) -> None:
        """Update a body from points (J, 3) that two cameras or more observe; its other landmarks move along."""
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

    def best_start(self, frame: FrameDetections, free: BoolArray) -> tuple[FloatArray, IntArray, int] | None:
        """The new body on which most views agree, from the free detections (C, P).

        Returns:
            Its points (J, 3), each camera's detection (C,), -1 for none, and the number of cameras that have the body
            in their image; None where no two cameras agree.
        """
        guesses = self._guesses(frame, free)
        if not len(guesses):
            return None
        away, mirrored = self._distances(guesses, frame)
        away = np.where(free[:, None], away, np.inf)
        nearest = away.argmin(-1)
        value = np.take_along_axis(away, nearest[..., None], -1)[..., 0]
        gate = self._options.gate
        support = np.where(value < gate, 1 - value / gate, 0.0).sum(0)
        best = int(support.argmax())
        chosen = np.where(value[:, best] < gate, nearest[:, best], -1)
        if (chosen >= 0).sum() < 2:
            return None
        rays = self._chosen_rays(chosen[:, None], mirrored[:, best : best + 1], frame)
        points, rest = self._triangulate(guesses[best : best + 1], rays, chosen[:, None])
        known = np.isfinite(points[0]).all(-1)
        if known.sum() < LEAST_LANDMARKS and known.sum() < points.shape[1]:
            return None
        view = self._cameras.project_seen(points[0])
        inside = ((view >= 0) & (view < self._size_px[:, None])).all(-1).mean(1) > 0.5
        filled = np.where(known[:, None], points[0], np.nanmedian(points[0], axis=0))
        return filled, rest[:, 0], int(inside.sum())

    def _distances(self, points: FloatArray, frame: FrameDetections) -> tuple[FloatArray, BoolArray]:
        """(C, N, P) distance of detections from the projections of bodies (N, J, 3), in body sizes, and whether a
        detection fits with left and right flipped."""
        view = self._cameras.project_seen(points)[:, :, None]
        size = extent(view)
        px = frame.points_px[:, None]
        with np.errstate(invalid="ignore"):
            both = np.stack([_near_mean(np.linalg.norm(p - view, axis=-1)) for p in (px, px[..., self._mirror, :])])
            both = np.nan_to_num(both / size, nan=np.inf)
        # Flip the sides only where the flipped detection is clearly nearer.
        mirrored = both[1] < 0.7 * both[0] - 0.01
        return np.where(mirrored, both[1], both[0]), mirrored

    def _assign(self, bodies: list[BodyTrack], away: FloatArray, t: int, free: BoolArray) -> IntArray:
        """(C, N) the detection of every camera assigned to each body, -1 for none."""
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
            same_slot = last[c][:, None] == columns[None]
            cost = away[c][:, columns] - _SAME_SLOT_BONUS * same_slot
            allowed = away[c][:, columns] < gate[:, None]
            rows, cols = scipy.optimize.linear_sum_assignment(np.where(allowed, cost, 10.0))
            good = allowed[rows, cols]
            chosen[c, rows[good]] = columns[cols[good]]
        return chosen

    def _fix_sides(self, bodies: list[BodyTrack], chosen: IntArray, mirrored: BoolArray) -> None:
        """Flip the left and right of a body whose sides most views contradict; updates `mirrored` (C, N, P)."""
        for n, body in enumerate(bodies):
            cameras = np.flatnonzero(chosen[:, n] >= 0)
            if 2 * mirrored[cameras, n, chosen[cameras, n]].sum() > len(cameras):
                body.points = body.points[self._mirror]
                mirrored[:, n] = ~mirrored[:, n]

    def _chosen_rays(self, chosen: IntArray, mirrored: BoolArray, frame: FrameDetections) -> FloatArray:
        """(C, N, J, 3) rays of the chosen detections (C, N) with correct sides, NaN where there is none."""
        cameras = np.arange(len(chosen))[:, None]
        at = np.maximum(chosen, 0)
        rays = frame.rays[cameras, at]
        flipped = mirrored[cameras, np.arange(chosen.shape[1])[None], at]
        rays = np.where(flipped[..., None, None], rays[:, :, self._mirror], rays)
        return np.where((chosen < 0)[..., None, None], np.nan, rays)

    def _weights(self, points: FloatArray) -> FloatArray:
        """(C, N) relative inverse variance, at the distance of the bodies, of an error of one pixel."""
        middle = np.nan_to_num(np.nanmedian(points, axis=1))
        depth = np.linalg.norm(middle[None] - self._centers[:, None], axis=-1)
        return np.asarray((self._focal[:, None] / np.maximum(depth, 0.1)) ** 2 / self._focal.max() ** 2)

    def _triangulate(self, old: FloatArray, rays: FloatArray, chosen: IntArray) -> tuple[FloatArray, IntArray]:
        """Bodies (N, J, 3) from their rays (C, N, J, 3), and the choice without views that contradict the others.

        Rays of rejected views become NaN in place.
        """
        weights = self._weights(old)
        points, away = nearest_points(self._centers, rays, weights)
        off = _near_mean(away) / np.maximum(extent(points), 1e-6)  # (C, N)
        worst = np.nan_to_num(_nanmax(off))
        doubtful = np.flatnonzero((np.isfinite(off).sum(0) >= 3) & (worst > self._options.odd_view))
        if not len(doubtful):
            return points, chosen
        # A nearby wrong view pulls the body towards itself and has residuals no larger than the others; it is
        # recognised by how well the others agree without it.
        without = np.full((len(rays), len(doubtful)), np.inf)
        for c in range(len(rays)):
            rest = rays[:, doubtful].copy()
            rest[c] = np.nan
            there, gap = nearest_points(self._centers, rest, weights[:, doubtful])
            left = np.nan_to_num(_nanmax(_near_mean(gap)) / np.maximum(extent(there), 1e-6), nan=np.inf)
            without[c] = np.where(np.isfinite(off[c, doubtful]), left, np.inf)
        odd = without.argmin(0)
        rejected = worst[doubtful] > _ODD_VIEW * without[odd, np.arange(len(doubtful))]
        if not rejected.any():
            return points, chosen
        chosen = chosen.copy()
        chosen[odd[rejected], doubtful[rejected]] = -1
        rays[odd[rejected], doubtful[rejected]] = np.nan
        points, _ = nearest_points(self._centers, rays, weights)
        return points, chosen

    def _slide(self, body: BodyTrack, camera: int, rays: FloatArray) -> None:
        """Move a body that one camera sees across that camera's line of sight, at its last distance."""
        offset = body.points - self._centers[camera]
        ray = rays[camera]
        shift = np.sum(offset * ray, axis=-1, keepdims=True) * ray - offset
        known = np.isfinite(shift).all(-1)
        if known.any():
            step = np.median(shift[known], axis=0)
            body.points = body.points + step
            body.velocity = body.velocity + 0.3 * step

    def _guesses(self, frame: FrameDetections, free: BoolArray) -> FloatArray:
        """(G, J, 3) the best candidate bodies from pairs of free detections of different cameras."""
        bodies, errors = [], []
        cameras = [c for c in range(len(free)) if free[c].any()]
        for i, a in enumerate(cameras):
            for b in cameras[:i]:
                rays_a = frame.rays[a][free[a]]
                rays_b = frame.rays[b][free[b]]
                for other in (rays_b, rays_b[:, self._mirror]):
                    points, gap = pair_points(self._centers[a], rays_a, self._centers[b], other)
                    size = extent(points)
                    error = _near_mean(gap) / size
                    good = (error < self._options.start) & self._is_symmetric(points)
                    bodies.append(points[good])
                    errors.append(error[good])
        if not bodies:
            return np.empty((0, frame.rays.shape[2], 3))
        error = np.concatenate(errors)
        return np.asarray(np.concatenate(bodies)[np.argsort(error)[:_CANDIDATES]])

    def _is_symmetric(self, points: FloatArray) -> BoolArray:
        """(...) whether left and right limbs of bodies (..., J, 3) have similar lengths; wrong pairings do not."""
        if not len(self._limbs):
            return np.ones(points.shape[:-2], dtype=np.bool_)
        ends = points[..., self._limbs, :]
        length = np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            uneven = np.abs(np.log(length[..., 0] / length[..., 1]))
        return np.nan_to_num(_near_mean(uneven, least=2), nan=0.0) < 0.6


def _limb_pairs(landmarks: LandmarkSet) -> IntArray:
    """(L, 2, 2) landmark indices of the limbs of the left side and of their counterparts on the right."""
    mirror = landmarks.mirror
    left = [(a, b) for a, b in landmarks.edge_indices if all(landmarks.names[i].startswith("left_") for i in (a, b))]
    return np.array([[(a, b), (mirror[a], mirror[b])] for a, b in left], dtype=np.int64).reshape(-1, 2, 2)


def _near_mean(values: FloatArray, least: int = LEAST_LANDMARKS) -> FloatArray:
    """(...) mean of the smallest known values of the last axis, `_SHARE` of them; NaN with fewer than `least`."""
    known = np.isfinite(values)
    count = known.sum(-1)
    ordered = np.sort(np.where(known, values, np.inf), axis=-1)
    used = np.ceil(_SHARE * count)
    inside = np.arange(values.shape[-1]) < used[..., None]
    total = np.where(inside, ordered, 0.0).sum(-1)
    enough = count >= min(least, values.shape[-1])
    return np.where(enough, total / np.maximum(used, 1), np.nan)


def _nanmax(values: FloatArray) -> FloatArray:
    """Maximum over the first axis; NaN where all values are."""
    best = np.where(np.isfinite(values), values, -np.inf).max(0)
    return np.where(np.isfinite(best), best, np.nan)
