"""People of a take, tracked over all cameras, and the selection of the person of interest.

People whom two cameras see are tracked in 3D (`muybridge.geometry.association.tracker`), whatever the cameras' own
tracks say. The remaining detections are people seen by one camera, which have no 3D position. No appearance is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import SessionError
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.tracker import track_people
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.numerics.robust import extent, row_median
from muybridge.geometry.triangulation.multiview import triangulate


@dataclass(frozen=True)
class Person:
    """One person.

    Attributes:
        slots: (C, T) index into the P slots of the keypoints, -1 where the camera does not see the person.
        cameras: names of the cameras that see the person.
        seen_share: share of the frames in which two cameras or more see the person.
        size_px: median size in the image.
        motion: distance travelled in the image, in body sizes.
        agreement: 0 to 1, how well the cameras agree (1: exactly).
        rank: product of these that decides who is the person of interest.
    """

    slots: IntArray
    cameras: tuple[str, ...]
    seen_share: float
    size_px: float
    motion: float
    agreement: float
    rank: float


@dataclass(frozen=True)
class PersonSelection:
    """The person of interest.

    Attributes:
        slots: (C, T) index into the P slots, or -1 where this camera does not see the person in this frame.
        reason: one sentence: why this person, and how many others there are.
        people: everyone, the person of interest first, people seen by one camera last.
    """

    slots: IntArray
    reason: str
    people: tuple[Person, ...]


def find_people(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions | None = None, fps: float = 30.0
) -> tuple[Person, ...]:
    """Associate the cameras' detections to people.

    Args:
        cameras: C calibrated cameras.
        keypoints: their detections.
        options: see `TrackingOptions`.
        fps: frames per second.

    Returns:
        Everyone, by decreasing rank; people whom only one camera sees have a rank of zero.

    Raises:
        ValueError: keypoints that do not have one row for each camera.
    """
    options = options or TrackingOptions()
    if keypoints.points_px.shape[0] != len(cameras):
        raise ValueError(f"keypoints have {keypoints.points_px.shape[0]} cameras, the calibration {len(cameras)}")
    tracked = track_people(cameras, keypoints, options, fps)
    people = [_describe_person(cameras, keypoints, slots, _agreement(cameras, keypoints, slots)) for slots in tracked]
    people += [_describe_person(cameras, keypoints, slots, 0.0) for slots in _single_view_pieces(keypoints, tracked)]
    people.sort(key=lambda person: (-person.rank, -float((person.slots >= 0).sum() * person.size_px)))
    return tuple(people)


def select_person(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions | None = None, fps: float = 30.0
) -> PersonSelection:
    """Select the person of interest: seen by most cameras, large, moving.

    Args:
        cameras: C calibrated cameras.
        keypoints: their detections.
        options: see `TrackingOptions`.
        fps: frames per second.

    Raises:
        SessionError: nobody was detected, or only one camera sees anybody.
        ValueError: keypoints that do not have one row for each camera.
    """
    people = find_people(cameras, keypoints, options, fps)
    frames = keypoints.points_px.shape[1]
    seen_by = {name for person in people for name in person.cameras}
    if not people:
        raise SessionError(
            f"no person was found in any of the {len(cameras)} cameras ({', '.join(cameras.names)}): the "
            "whole person should be in view, upright and at least 100 px tall; look at the videos"
        )
    if len(seen_by) < 2:
        raise SessionError(
            f"a person was found only by camera {next(iter(seen_by))}, and 3D needs two cameras: check that "
            f"the others ({', '.join(n for n in cameras.names if n not in seen_by)}) have the person in view"
        )
    best = people[0]
    if best.rank > 0:
        reason = _reason(best, people[1:], len(cameras), frames)
        return PersonSelection(best.slots, reason, people)
    # No two cameras agree on anybody: fall back to the most prominent track of each camera.
    fallback = _one_from_each(people)
    reason = (
        "no two cameras agree on a person, so the most prominent person of each camera was used: "
        "the calibration or the synchronisation is probably wrong"
    )
    return PersonSelection(fallback, reason, people)


def take_person(
    keypoints: Keypoints2D, selection: PersonSelection | Person
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Select the 2D landmarks of one person.

    Returns:
        points_px (C, T, J, 2) and variance_px2 (C, T, J), NaN where missing, and score (C, T, J), zero there.
    """
    return take_slots(keypoints, selection.slots)


def take_slots(keypoints: Keypoints2D, slots: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Select 2D landmarks by a person's slots (C, T), -1 where a camera does not see them; see `take_person`."""
    return (
        _select(keypoints.points_px, slots, np.nan),
        _select(keypoints.variance_px2, slots, np.nan),
        _select(keypoints.score, slots, 0.0),
    )


def _select(values: FloatArray, slots: IntArray, missing: float) -> FloatArray:
    """(C, T, ...) values (C, T, P, ...) in the slots (C, T), `missing` where a slot is -1."""
    slots = slots.reshape(*slots.shape, *(1,) * (values.ndim - 2))
    return np.where(slots[:, :, 0] < 0, missing, np.take_along_axis(values, np.maximum(slots, 0), axis=2)[:, :, 0])


def _reason(best: Person, others: tuple[Person, ...], cameras: int, frames: int) -> str:
    """Why this person was selected, in one sentence."""
    share = round(100 * best.seen_share)
    sentence = f"followed by {len(best.cameras)} of {cameras} cameras in {share} % of {frames} frames"
    if not others:
        return sentence + "; nobody else was found"
    several = [p for p in others if len(p.cameras) > 1]
    single = len(others) - len(several)
    if all(best.motion >= p.motion for p in others):
        sentence += ", moves most"
    elif all(best.size_px >= p.size_px for p in others):
        sentence += ", largest in the image"
    besides = []
    if several:
        most = max(len(p.cameras) for p in several)
        who = "1 other person is" if len(several) == 1 else f"{len(several)} other people are"
        besides.append(f"{who} seen by {'up to ' if len(several) > 1 else ''}{most} cameras")
    if single:
        who = "1 track is" if single == 1 else f"{single} tracks are"
        besides.append(f"{who} seen by one camera only")
    return f"{sentence}; {' and '.join(besides)}"


def _one_from_each(people: tuple[Person, ...]) -> IntArray:
    """(C, T) slots of the largest and most moving person of each camera."""
    slots = np.full_like(people[0].slots, -1)
    for c in range(slots.shape[0]):
        conspicuous = [p for p in people if (p.slots[c] >= 0).any()]
        if conspicuous:
            best = max(conspicuous, key=lambda p: p.size_px * (0.05 + p.motion) * float((p.slots[c] >= 0).sum()))
            slots[c] = best.slots[c]
    return slots


# Tracks of one camera are split where they pause for more frames, or jump farther (body sizes) between frames.
_PAUSE, _JUMP = 10, 0.6


def _single_view_pieces(keypoints: Keypoints2D, tracked: list[IntArray]) -> list[IntArray]:
    """Slots (C, T) of detections that no tracked person has: pieces of one camera's tracks, without pause or jump."""
    points = keypoints.points_px.copy()
    for slots in tracked:
        cameras, frames = np.nonzero(slots >= 0)
        points[cameras, frames, slots[cameras, frames]] = np.nan
    size = extent(points)
    middle = np.stack([row_median(points[..., axis]) for axis in (0, 1)], -1)
    cameras, total, people = size.shape
    least = min(5, max(1, total // 4))
    result = []
    for c in range(cameras):
        for p in range(people):
            frames = np.flatnonzero(np.isfinite(size[c, :, p]))
            if not len(frames):
                continue
            moved = np.linalg.norm(np.diff(middle[c, frames, p], axis=0), axis=-1) / size[c, frames[1:], p]
            cut = (np.diff(frames) > _PAUSE) | (moved > _JUMP)
            for piece in np.split(frames, np.flatnonzero(cut) + 1):
                if len(piece) >= least:
                    slots = np.full((cameras, total), -1, dtype=np.int64)
                    slots[c, piece] = p
                    result.append(slots)
    return result


def _agreement(cameras: CameraGroup, keypoints: Keypoints2D, slots: IntArray) -> float:
    """0 to 1: one minus the median reprojection error in twelfths of the person's size."""
    points, variance, _ = take_slots(keypoints, slots)
    residual = triangulate(cameras, points, variance).residual_px
    off = row_median(residual, least=1) / extent(points)
    return float(np.clip(1 - 12 * np.nanmedian(off), 0.0, 1.0)) if np.isfinite(off).any() else 0.0


def _describe_person(
    cameras: CameraGroup,
    keypoints: Keypoints2D,
    slots: IntArray,
    agreement: float,
) -> Person:
    """A person with all quantities that decide who is of interest."""
    seen = slots >= 0
    names = tuple(name for name, s in zip(cameras.names, seen, strict=True) if s.any())
    views = seen.sum(axis=0)
    # Most detections that only one camera has are present for a small part of a long take.
    there = views > 0
    points = _select(keypoints.points_px[:, there], slots[:, there], np.nan)
    size_px = extent(points)
    motions = [_wander(p, s) for p, s in zip(points, size_px, strict=True) if np.isfinite(s).any()]
    motion = float(np.median(motions)) if motions else 0.0
    median_size = float(np.nanmedian(size_px)) if np.isfinite(size_px).any() else 0.0
    # Views beyond the first, because a single view gives no 3D position.
    support = float(np.maximum(views - 1, 0).mean())
    longer = max(max(camera.width, camera.height) for camera in cameras)
    rank = support * (median_size / longer) * (0.02 + motion) * (0.1 + agreement)
    return Person(slots, names, float((views >= 2).mean()), median_size, motion, agreement, rank)


def _wander(points: FloatArray, size_px: FloatArray) -> float:
    """Distance that landmarks (T, J, 2) of one camera travel, in body sizes, with their jitter averaged out."""
    frames = np.flatnonzero(np.isfinite(size_px))
    windows = np.array_split(frames, max(1, min(20, frames.size // 5)))
    means = np.stack([row_median(np.moveaxis(points[w], 0, -1), least=1) for w in windows])
    known = np.isfinite(means)
    low = np.where(known, means, np.inf).min(axis=0)
    high = np.where(known, means, -np.inf).max(axis=0)
    seen = known.any(axis=(0, 2))
    travelled = np.linalg.norm((high - low)[seen], axis=-1)
    return float(np.median(travelled) / np.nanmedian(size_px)) if travelled.size else 0.0
