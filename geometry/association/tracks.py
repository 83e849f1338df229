"""Tracked bodies: removal of duplicates and reflections, and identification of people who reappear."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import MAD_SIGMA, extent

# Two trunks whose centres are this near, in body sizes, in this share of the frames of one of them, belong to one
# person; so do two where one body takes over from the other.
_DOUBLE_SIZE, _DOUBLE_SHARE = 0.14, 0.8
# Bodies that a camera sees both of in more than this share of their common frames are two people; longest gap, in
# seconds, at which a camera's track passes from one body to another.
_BOTH_SHARE, _HANDED_WITHIN = 0.05, 0.2
# A person stands if the line from the ankles to the shoulders is this near to the vertical (cosine), and then shows
# where the floor is. A body with two thirds of its landmarks below this height, in lengths of that line, is a
# reflection: two thirds of the landmarks of a person lying on the floor reach twice as high.
_STANDING, _FLAT = 0.94, 0.07
# Largest distance from the last position at which a person is identified again, in body sizes: at once, and its growth
# per second.
_NEAR_BY, _STRAYS = 0.3, 3.6


@dataclass(eq=False)
class BodyTrack:
    """A tracked person.

    Attributes:
        points: (J, 3) current landmarks, metres.
        slots: (C, T) detection of each camera in every frame, -1 for none.
        confirmed: whether it is certain enough to be a person.
        first: frame in which it was started.
        velocity: (3,) metres per frame.
        unseen: frames since any camera saw it.
        unmet: frames since two cameras saw it.
        met: number of frames in which two cameras saw it.
        track: landmarks (J, 3) by frame, where two cameras saw it.
    """

    points: FloatArray
    slots: IntArray
    confirmed: bool
    first: int
    velocity: FloatArray = field(default_factory=lambda: np.zeros(3))
    unseen: int = 0
    unmet: int = 0
    met: int = 0
    track: dict[int, FloatArray] = field(default_factory=dict)


def rejoin(
    bodies: list[BodyTrack], landmarks: LandmarkSet, coast: float, same_build: float, fps: float
) -> list[IntArray]:
    """Join bodies that are the same person before and after they were out of sight.

    Args:
        bodies: in any order.
        landmarks: the J landmarks; its edges are the limbs whose lengths are compared.
        coast, same_build: see `muybridge.geometry.association.options.TrackingOptions`.
        fps: frames per second.

    Returns:
        For each person the slots (C, T) of its bodies.
    """
    edges, trunk = np.array(landmarks.edge_indices, dtype=np.int64).reshape(-1, 2), _trunk(landmarks)
    bodies = sorted(bodies, key=lambda b: min(b.track))
    builds = [_build(b, edges) for b in bodies]
    groups: list[list[int]] = []
    for n, body in enumerate(bodies):
        fitting = []
        for group in groups:
            last = bodies[group[-1]]
            end, start = max(last.track), min(body.track)
            if end >= start:
                # A body that takes over while the other is still tracked is the same person if it is in the same
                # place, or if it continues the cameras' tracks of the other.
                if max(body.track) > end and (_inside(body, last, trunk) or _handed_over(last, body, fps)):
                    fitting.append((0.0, group))
                continue
            size = max(float(extent(last.track[end])), 1e-6)
            jump = _jump(last, body) / size
            reach = _NEAR_BY + _STRAYS * (start - end) / fps
            difference = _difference(builds[group[-1]], builds[n])
            # A person who disappears and reappears at once is the same, whatever the measured limb lengths.
            bound = same_build if (start - end) / fps > 2 * coast else 2 * same_build
            if jump < reach and difference < bound:
                fitting.append((difference + 0.05 * jump / reach, group))
        if fitting:
            min(fitting, key=lambda pair: pair[0])[1].append(n)
        else:
            groups.append([n])
    result = []
    for group in groups:
        slots = bodies[group[0]].slots.copy()
        for n in group[1:]:
            slots = np.where(slots >= 0, slots, bodies[n].slots)
        result.append(slots)
    return result


def deduplicate(bodies: list[BodyTrack], landmarks: LandmarkSet) -> list[BodyTrack]:
    """Drop bodies that occupy the place of another one.

    Two trunks cannot intersect, but detectors may find a person twice, such as a lying person and their legs.
    """
    trunk = _trunk(landmarks)
    kept: list[BodyTrack] = []
    for body in sorted(bodies, key=lambda b: -b.met):
        least = _DOUBLE_SHARE * len(body.track)
        if not any(len(body.track.keys() & other.track.keys()) >= least and _inside(body, other, trunk)
                   for other in kept):  # fmt: skip
            kept.append(body)
    return [b for b in bodies if b in kept]


def drop_reflections(bodies: list[BodyTrack], landmarks: LandmarkSet) -> list[BodyTrack]:
    """Drop bodies that lie in the floor or below it: shadows and reflections, in which detectors find people too.

    Needs a standing person as a reference for the floor, and a world whose Z axis points up.
    """
    parts = {n: [k for k, name in enumerate(landmarks.names) if name.endswith(n)] for n in ("shoulder", "ankle")}
    if not all(parts.values()):
        return bodies
    floors, lengths = [], []
    tracks = [np.stack([b.track[t] for t in sorted(b.track)]) if b.track else np.empty((0, len(landmarks), 3))
              for b in bodies]  # fmt: skip
    for points in tracks:
        ankles = points[:, parts["ankle"]].mean(1)
        rise = points[:, parts["shoulder"]].mean(1) - ankles
        length = np.linalg.norm(rise, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            standing = rise[:, 2] / length > _STANDING
        if standing.any():
            floors.append(float(np.nanmedian(np.nanmin(points[standing, :, 2], axis=1))))
            lengths.append(float(np.median(length[standing])))
    if not floors:
        return bodies
    top = min(floors) + _FLAT * float(np.median(lengths))
    return [b for b, points in zip(bodies, tracks, strict=True) if not _beneath(points, top)]


def _beneath(points: FloatArray, height: float) -> bool:
    """Whether two thirds of the landmarks (T, J, 3) are below a height, at the median of the frames with any landmark.

    Not all landmarks, since the feet that cast a shadow are often detected as its own.
    """
    known = points[np.isfinite(points[..., 2]).any(1)]
    return len(known) > 0 and float(np.median(np.nanpercentile(known[..., 2], 67, axis=1))) < height


def drop_stray_end(body: BodyTrack, few: int, gap: float) -> None:
    """Remove the end of a body that was lost, predicted for more than `gap` frames and then matched by accident.

    The end is removed if it has fewer than `few` frames: the body is not where the person is, and would not find them
    again. Changes the body in place.
    """
    frames = np.array(sorted(body.track))
    breaks = np.flatnonzero(np.diff(frames) > max(2.0, gap)) + 1
    while len(breaks) and len(frames) - breaks[-1] < few:
        for t in frames[breaks[-1] :]:
            del body.track[int(t)]
        frames, breaks = frames[: breaks[-1]], breaks[:-1]
        body.met = len(frames)
        body.slots[:, frames[-1] + 1 :] = -1


def _trunk(landmarks: LandmarkSet) -> list[int]:
    """Indices of the shoulders and hips."""
    return [n for n, name in enumerate(landmarks.names) if name.split("_")[-1] in ("shoulder", "hip")]


def _inside(body: BodyTrack, other: BodyTrack, trunk: list[int]) -> bool:
    """Whether a body's trunk is inside the other's in the frames in which both are tracked."""
    common = sorted(body.track.keys() & other.track.keys())
    if not common or not trunk:
        return False
    middles = [np.stack([b.track[t][trunk] for t in common]).mean(1) for b in (body, other)]
    size = np.array([float(extent(other.track[t])) for t in common])
    apart = np.linalg.norm(middles[0] - middles[1], axis=-1) / np.maximum(size, 1e-6)
    known = np.isfinite(apart)
    return bool(known.sum() >= _DOUBLE_SHARE * len(common) and np.median(apart[known]) < _DOUBLE_SIZE)


def _handed_over(before: BodyTrack, after: BodyTrack, fps: float) -> bool:
    """Whether two cameras or more continue their track of one body with the other, and no camera ever saw both.

    Wrong views of a person may start a second body beside the first, which then attracts the correct views as well.
    """
    both = ((before.slots >= 0) & (after.slots >= 0)).any(0).sum()
    together = ((before.slots >= 0).any(0) & (after.slots >= 0).any(0)).sum()
    if both > _BOTH_SHARE * together:
        return False
    handed = 0
    for old, new in zip(before.slots, after.slots, strict=True):
        had = np.flatnonzero(old >= 0)
        if len(had):
            then = np.flatnonzero(new[had[-1] + 1 :] >= 0) + had[-1] + 1
            soon = len(then) > 0 and then[0] - had[-1] <= max(2.0, _HANDED_WITHIN * fps)
            handed += bool(soon and new[then[0]] == old[had[-1]])
    return handed >= 2


def _jump(before: BodyTrack, after: BodyTrack) -> float:
    """Distance between the last positions of one body and the first of another, metres.

    The smallest over a few frames of each, since the last position may be wrong and the reason why the body was lost.
    """
    last, first = (
        np.stack([np.nanmedian(body.track[t], axis=0) for t in frames])
        for body, frames in ((before, sorted(before.track)[-3:]), (after, sorted(after.track)[:3]))
    )
    return float(np.linalg.norm(last[:, None] - first[None], axis=-1).min())


def _build(body: BodyTrack, edges: IntArray) -> tuple[FloatArray, FloatArray]:
    """(L,) median lengths of the limbs, metres, and their standard errors."""
    frames = sorted(body.track)
    points = np.stack([body.track[t] for t in frames[:: max(1, len(frames) // 200)]])
    length = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
    known = np.isfinite(length).sum(0)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.nanmedian(np.where(known > 0, length, 0.0), axis=0)
        spread = MAD_SIGMA * np.nanmedian(np.where(known > 0, np.abs(length - middle), np.inf), axis=0)
        return np.where(known > 0, middle, np.nan), 1.25 * spread / np.sqrt(known)


def _difference(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray]) -> float:
    """Mean relative difference of the limb lengths known for both, weighted by precision; zero where none is."""
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(np.log(a[0] / b[0]))
        weight = 1 / (0.02**2 + (a[1] / a[0]) ** 2 + (b[1] / b[0]) ** 2)
    good = np.isfinite(relative) & np.isfinite(weight)
    return float(np.average(relative[good], weights=weight[good])) if good.any() else 0.0
