"""Faults of marker recordings, drawn for a batch of frames at once.

Placement jitter, soft tissue, occlusion (random, of whole regions, by geometry), ghosts near and far, missing markers,
a second person's markers, swaps, broken trajectories, other sizes and headings. Real recordings are never used.
"""

import math
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IntArray
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE, MarkerSet
from muybridge.train.synthesis.bodies.surface_markers import marker_table
from muybridge.train.synthesis.markers.trajectories import FPS, MarkerClips

# Largest number of points of a frame.
POINTS = 52
GHOSTS = 6
OTHERS = 14
DUST = len(SURFACE)

# Markers that laboratories place anywhere along a segment: marker, ends of the segment, standard deviation as a share
# of its length.
_ALONG = (
    ("upper_arm_proximal", "acromion", "elbow_lateral", 0.14), ("upper_arm_distal", "acromion", "elbow_lateral", 0.14),
    ("forearm_proximal", "elbow_lateral", "radial_styloid", 0.14),
    ("forearm_distal", "elbow_lateral", "radial_styloid", 0.14),
    ("thigh_proximal", "trochanter", "knee_lateral", 0.14), ("thigh_distal", "trochanter", "knee_lateral", 0.14),
    ("shank_proximal", "knee_lateral", "malleolus_lateral", 0.14),
    ("shank_distal", "knee_lateral", "malleolus_lateral", 0.14),
    ("metacarpal_2", "radial_styloid", "metacarpal_2", 0.2), ("toe", "heel", "toe", 0.07),
    ("asis", "asis", "psis", 0.08), ("psis", "psis", "asis", 0.06),
)  # fmt: skip
# Markers whose position varies more than examiners' placement at a palpated point, metres.
LOOSE = {"left_scapula": 0.035, "right_scapula": 0.035, "t10": 0.03, "xiphoid": 0.02, "c7": 0.015,
          "left_acromion": 0.015, "right_acromion": 0.015}  # fmt: skip
# Marker, share on a wand, largest distance from the skin, metres: older guides have wands on thigh and shank.
_WANDS = (("thigh", 0.08, 0.1), ("shank", 0.08, 0.09))
# Share of recordings with the wrist's markers at the ends of a bar, and how far each stands out, metres.
_BARS = (0.25, 0.05)
_HEAD = [SURFACE.index(f"{s}_{e}_head") for s in ("left", "right") for e in ("front", "back")]
_OPTIONAL = ("upper_arm", "forearm", "scapula", "metacarpal", "thigh", "shank", "t10", "xiphoid", "head")


@dataclass(frozen=True)
class CloudOptions:
    """Difficulty of the clouds.

    Attributes:
        sets: marker sets with their shares; the rest are random sets.
        window_lost: share of the frames without any known trajectory.
    """

    sets: tuple[tuple[MarkerSet, float], ...] = ((PLUG_IN_GAIT, 0.5), (CMU, 0.3))
    window_lost: float = 0.35


class CloudSampler:
    """Draws frames with faults from clips.

    Args:
        clips: marker trajectories.
        window: times relative to a frame, seconds.
        seed: random seed.
        options: of the clouds.
    """

    def __init__(self, clips: MarkerClips, window: tuple[float, ...], seed: int, options: CloudOptions) -> None:
        self.clips, self.options = clips, options
        self.rng = np.random.default_rng(seed)
        self.offsets = np.rint(np.array([0.0, *window]) * FPS).astype(int)
        sigma = marker_table().tolerance_m.astype(np.float64)
        for name, value in LOOSE.items():
            sigma[SURFACE.index(name)] = value
        self.sigma = sigma
        self.wands = [([SURFACE.index(n) for n in SURFACE.names if stem in n], often, far)
                      for stem, often, far in _WANDS]  # fmt: skip
        self.arms = [tuple(SURFACE.index(f"{s}_{x}") for x in ("acromion", "elbow_lateral", "scapula", "radial_styloid",
                     "ulnar_styloid")) for s in ("left", "right")]  # fmt: skip
        self.c7 = SURFACE.index("c7")
        self.along = [([SURFACE.index(f"{s}_{x}") for x in (marker, a, b)], share)
                      for marker, a, b, share in _ALONG for s in ("left", "right")]  # fmt: skip

    def batch(self, count: int) -> tuple[Float32Array, Float32Array, Float32Array, IntArray]:
        """`count` frames: points (B, 1 + W, N, 3), seen (B, 1 + W, N), asked (B, L), labels (B, N), -1 for padding.

        A batch is of one marker set (or entirely of random sets), so that it needs little padding.
        """
        at, normals = self._draw_frames(count)
        asked, present = self._sets(count)
        at = self._jitter(self._soft_tissue(at, normals))
        present &= ~self._occluded(at, normals[:, 0], present)
        others = self._second_person(count, at)
        ghosts, ghost_there = self._ghosts(at, present)
        points = np.concatenate([at, others[0], ghosts], 2)
        there = np.concatenate([present, others[1], ghost_there], 1)
        labels = np.full(there.shape, DUST, np.int64)
        labels[:, :DUST] = np.arange(DUST)
        seen = self._windows(points, there)
        points = self._rotate(points)
        return self._pack(points, seen, there, asked, labels)

    def _draw_frames(self, count: int) -> tuple[FloatArray, FloatArray]:
        rng, reach = self.rng, int(np.abs(self.offsets).max())
        clip = rng.integers(0, len(self.clips.points), count)
        frame = rng.integers(reach, self.clips.points.shape[1] - reach, count)
        # Motion is slowed down or sped up.
        times = frame[:, None] + np.rint(self.offsets * rng.choice([0.34, 0.67, 1.0, 1.0], (count, 1))).astype(int)
        at = self.clips.points[clip[:, None], times].astype(np.float64)
        normals = self.clips.normals[clip[:, None], times].astype(np.float64) / 127
        return at, normals

    def _sets(self, count: int) -> tuple[BoolArray, BoolArray]:
        """Labels of the marker set and markers that are present, both (B, L)."""
        rng, size = self.rng, len(SURFACE)
        asked = np.zeros((count, size), bool)
        kind = int(np.searchsorted(np.cumsum([share for _, share in self.options.sets]), rng.random(), "right"))
        if kind < len(self.options.sets):
            asked[:, self.options.sets[kind][0].surface_indices] = True
        else:
            asked[:] = rng.random((count, size)) < rng.uniform(0.25, 0.6, (count, 1))
            lower = np.array([_is_lower(n) for n in SURFACE.names])
            asked[rng.random(count) < 0.3] &= lower
        present = asked.copy()
        # Some markers are left out on both sides for the whole recording; in half of these cases the declared set lacks
        # them too.
        for stem in _OPTIONAL:
            left_out = rng.random(count) < 0.06
            declared = left_out & (rng.random(count) < 0.5)
            group = np.array([stem in n for n in SURFACE.names])
            present[np.ix_(left_out, group)] = False
            asked[np.ix_(declared, group)] = False
        # Some people wear half of the set, of which all labels are requested.
        half = rng.random(count)
        lower = np.array([_is_lower(n) for n in SURFACE.names])
        present[half < 0.03] &= lower
        present[half > 0.98] &= ~lower
        return asked, present

    def _soft_tissue(self, at: FloatArray, normals: FloatArray) -> FloatArray:
        """Markers on wands, and the skin of the shoulder moving with a raised arm, where skinning leaves the scapula in
        place."""
        rng, count = self.rng, len(at)
        moved = at.copy()
        for markers, often, far in self.wands:
            out = np.where(rng.random((count, 1, 1, 1)) < often, rng.uniform(0.02, far, (count, 1, 1, 1)), 0.0)
            moved[:, :, markers] += normals[:, :, markers] * out
        bar = rng.random((count, 1, 1)) < _BARS[0]
        for shoulder, elbow, scapula, thumb, little in self.arms:
            across = _unit(at[:, :, thumb] - at[:, :, little])
            moved[:, :, thumb] += across * np.where(bar, rng.uniform(0, _BARS[1], (count, 1, 1)), 0.0)
            moved[:, :, little] -= across * np.where(bar, rng.uniform(0, _BARS[1], (count, 1, 1)), 0.0)
            raised = ((_unit(at[:, :, elbow] - at[:, :, shoulder])[..., 2:] + 0.2) / 1.2).clip(0, 1)
            inward = _unit(at[:, :, self.c7] - at[:, :, shoulder])
            moved[:, :, shoulder] += inward * raised * rng.uniform(0, 0.04, (count, 1, 1))
            outward = _unit(at[:, :, shoulder] - at[:, :, scapula])
            moved[:, :, scapula] += outward * raised * rng.uniform(0, 0.05, (count, 1, 1))
        return moved

    def _jitter(self, at: FloatArray) -> FloatArray:
        rng, count = self.rng, len(at)
        moved = at.copy()
        for (marker, a, b), share in self.along:
            slide = rng.normal(0, share, (count, 1, 1)).clip(-2.2 * share, 2.2 * share)
            moved[:, :, marker] += slide * (at[:, :, b] - at[:, :, a])
        head = at[:, :, _HEAD]
        middle = head.mean(2, keepdims=True)
        wide = rng.uniform(0.92, 1.2, (count, 1, 1, 1))
        moved[:, :, _HEAD] = middle + (head - middle) * wide + rng.normal(0, 0.02, (count, 1, 1, 3))
        hard = rng.uniform(0.5, 1.5, (count, 1, 1, 1))
        moved += rng.normal(0, 1, (count, 1, moved.shape[2], 3)) * self.sigma[:, None] * hard
        # Skin slides with the motion, and every measurement has noise.
        slack = rng.uniform(0.0, 0.008, (count, 1, 1, 1))
        moved += rng.normal(0, 1, moved.shape) * slack
        # Sizes beyond those of the bodies, also because the unit of length may be inexact.
        return moved * np.exp(rng.normal(0, 0.07, (count, 1, 1, 1)))

    def _occluded(self, at: FloatArray, normals: FloatArray, present: BoolArray) -> BoolArray:
        rng, (count, size) = self.rng, present.shape
        style = rng.random(count)
        number = np.where(style < 0.25, 0, rng.integers(0, 7, count))
        number = np.where(style > 0.93, rng.integers(6, 16, count), number)
        order = np.argsort(np.argsort(np.where(present, rng.random((count, size)), 2.0), 1), 1)
        hidden: BoolArray = np.asarray(order < number[:, None])
        # One region is hidden: the markers nearest to some point.
        near = np.asarray(rng.random(count) < 0.12)
        centre = at[np.arange(count), 0, rng.integers(0, size, count)]
        distance = np.linalg.norm(at[:, 0] - centre[:, None], axis=-1)
        hidden |= near[:, None] & (distance < rng.uniform(0.08, 0.35, (count, 1)))
        # By geometry: fewer than two of the cameras around see the front of the skin.
        facing = np.asarray(rng.random(count) < 0.15)
        azimuth = rng.uniform(0, 2 * math.pi, (count, 6))
        cameras = np.stack([np.cos(azimuth), np.sin(azimuth), np.full_like(azimuth, 0.35)], -1)
        views = (np.einsum("bmc,bkc->bmk", normals, cameras) > 0.25).sum(2)
        return np.asarray(hidden | (facing[:, None] & (views < 2)))

    def _second_person(self, count: int, at: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Some markers of a second person nearby."""
        rng = self.rng
        other = self._draw_frames(count)[0]
        angle = rng.uniform(0, 2 * math.pi, (count, 1, 1))
        away = rng.uniform(0.4, 2.0, (count, 1, 1)) * np.concatenate([np.cos(angle), np.sin(angle), 0 * angle], -1)
        shift = at[:, :1].mean(2) * [1, 1, 0] - other[:, :1].mean(2) * [1, 1, 0] + away
        start = rng.integers(0, other.shape[2], count)
        gap = np.linalg.norm(other[:, 0] - other[np.arange(count), 0, start][:, None], axis=-1)
        chosen = np.argsort(gap + rng.random(gap.shape) * 0.3, 1)[:, :OTHERS]
        picked = np.take_along_axis(other, chosen[:, None, :, None], 2) + shift[:, :, None]
        # Only in some batches, which are padded for it.
        share = 0.5 if rng.random() < 0.15 else 0.0
        there = (rng.random(count) < share)[:, None] & (rng.random((count, OTHERS)) < rng.random((count, 1)))
        return picked, there

    def _ghosts(self, at: FloatArray, present: BoolArray) -> tuple[FloatArray, BoolArray]:
        rng, count = self.rng, len(at)
        now = np.where(present[:, :, None], at[:, 0], np.nan)
        number = np.maximum(present.sum(1), 1)[:, None]
        centre = np.nansum(now, 1) / number
        spread = np.sqrt(np.nansum((now - centre[:, None]) ** 2, 1) / number) + 0.1
        wide = spread[:, None] * rng.uniform(0.4, 2, (count, 1, 1))
        place = centre[:, None] + rng.normal(0, 1, (count, GHOSTS, 3)) * wide
        beside = at[np.arange(count)[:, None], 0, rng.integers(0, at.shape[2], (count, GHOSTS))]
        beside = beside + rng.normal(0, 1, beside.shape) * rng.uniform(0.02, 0.15, (count, GHOSTS, 1))
        place = np.where(rng.random((count, GHOSTS, 1)) < 0.4, beside, place)
        speed = rng.normal(0, 1, (count, 1, GHOSTS, 3)) * rng.choice([0.0, 0.2, 1.5], (count, 1, GHOSTS, 1))
        ghosts = place[:, None] + speed * (self.offsets / FPS)[:, None, None]
        number = np.where(rng.random(count) < 0.4, 0, rng.integers(0, GHOSTS + 1, count))
        return ghosts, np.arange(GHOSTS) < number[:, None]

    def _windows(self, points: FloatArray, there: BoolArray) -> BoolArray:
        """(B, 1 + W, S) where the window knows a point; swaps some trajectories in place."""
        rng, (count, size) = self.rng, there.shape
        w = len(self.offsets)
        seen = np.repeat(there[:, None], w, 1)
        lost = rng.random(count) < self.options.window_lost
        broken = rng.uniform(0, 0.3, (count, 1, 1)) * (rng.random((count, 1, 1)) < 0.7)
        # A broken trajectory stays broken: times farther away are lost too.
        span = np.abs(self.offsets)
        for sign in (-1, 1):
            reach = np.where(rng.random((count, size)) < broken[:, 0], rng.choice([0, 0.5, 1.5], (count, size)), 9.0)
            side = np.nonzero(np.sign(self.offsets) == sign)[0]
            nearest = span[side].min()
            for i in side:
                seen[:, i] &= span[i] <= reach * nearest
        # Ghosts are short.
        seen[:, 1:, -GHOSTS:] &= rng.random((count, w - 1, GHOSTS)) < 0.4
        seen[lost, 1:] = False
        self._swap_trajectories(points, there)
        return seen

    def _swap_trajectories(self, points: FloatArray, there: BoolArray) -> None:
        rng, count = self.rng, len(there)
        which = np.nonzero(rng.random(count) < 0.12)[0]
        one = rng.integers(0, points.shape[2], len(which))
        gap = np.linalg.norm(points[which, 0] - points[which, 0, one][:, None], axis=-1)
        gap[~there[which]] = np.inf
        gap[np.arange(len(which)), one] = np.inf
        two = gap.argmin(1)
        later = np.sign(self.offsets)[None] == rng.choice([-1, 1], (len(which), 1))
        for i in range(1, len(self.offsets)):
            b = which[later[:, i]]
            a, c = one[later[:, i]], two[later[:, i]]
            points[b, i, a], points[b, i, c] = points[b, i, c].copy(), points[b, i, a].copy()

    def _rotate(self, points: FloatArray) -> FloatArray:
        """Any heading, and a vertical direction that is only approximately known."""
        rng, count = self.rng, len(points)
        angle = rng.uniform(0, 2 * math.pi, count)
        tilt = np.radians(rng.normal(0, 3, (count, 2)))
        c, s, one, zero = np.cos(angle), np.sin(angle), np.ones(count), np.zeros(count)
        yaw = np.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).reshape(-1, 3, 3)
        x, y = tilt.T
        lean = np.stack([one, zero, y, zero, one, -x, -y, x, one], -1).reshape(-1, 3, 3)
        return np.asarray(points @ (lean @ yaw).transpose(0, 2, 1)[:, None])

    def _pack(self, points: FloatArray, seen: BoolArray, there: BoolArray, asked: BoolArray,
              labels: IntArray) -> tuple[Float32Array, Float32Array, Float32Array, IntArray]:  # fmt: skip
        """Shuffled, existing points first, cut to `POINTS`, padded to the fullest frame."""
        fullest = max(16, min(POINTS, int(there.sum(1).max())))
        order = np.argsort(np.where(there, self.rng.random(there.shape), 2.0), 1)[:, :fullest]
        points = np.take_along_axis(points, order[:, None, :, None], 2)
        seen = np.take_along_axis(seen, order[:, None], 2)
        labels = np.where(np.take_along_axis(there, order, 1), np.take_along_axis(labels, order, 1), -1)
        points = np.where(seen[..., None], points, 0.0)
        return points.astype(np.float32), seen.astype(np.float32), asked.astype(np.float32), labels


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-9))


def _is_lower(name: str) -> bool:
    stems = ("asis", "psis", "sacrum", "iliac", "troch", "thigh", "knee", "patella", "tibial", "shank", "malleolus",
             "heel", "metatarsal", "toe", "hallux")  # fmt: skip
    return any(s in name for s in stems)
