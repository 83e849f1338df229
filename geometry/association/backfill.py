"""Completion of tracked bodies after the last frame: backwards to where they first appeared, and over short gaps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.association.matching import DetectionMatcher, FrameDetections
from muybridge.geometry.association.tracks import BodyTrack


def track_backwards(
    bodies: list[BodyTrack],
    matcher: DetectionMatcher,
    frame: Callable[[int], FrameDetections],
    taken: BoolArray,
    patience: float,
) -> None:
    """Extend bodies to the frames before they were started, as long as free detections fit them.

    Args:
        bodies: bodies, changed in place.
        matcher: assigns detections to bodies.
        frame: returns the detections of a frame.
        taken: (C, T, P) detections that are assigned already, changed in place.
        patience: number of frames without two views after which the extension ends.
    """
    # Mark the detections of all bodies before any is extended, so that the order of the bodies does not matter.
    for body in bodies:
        seen = np.nonzero(body.slots >= 0)
        taken[(*seen, body.slots[seen])] = True
    for body in bodies:
        _extend_backwards(body, matcher, frame, taken, patience)


def _extend_backwards(
    body: BodyTrack,
    matcher: DetectionMatcher,
    frame: Callable[[int], FrameDetections],
    taken: BoolArray,
    patience: float,
) -> None:
    if not body.track:
        return
    frames = sorted(body.track)
    probe = BodyTrack(body.track[frames[0]], body.slots, True, body.first)
    probe.points = np.where(np.isfinite(probe.points), probe.points, np.nanmedian(probe.points, axis=0))
    later = [f for f in frames if f <= frames[0] + 5]
    if len(later) > 1:
        velocity = np.nanmedian(body.track[later[-1]] - body.track[later[0]], axis=0) / (later[-1] - later[0])
        probe.velocity = -np.nan_to_num(velocity)
    t = frames[0] - 1
    while t >= 0 and probe.unmet <= patience and probe.unseen < 3:
        detections = frame(t)
        free = detections.valid & ~taken[:, t]
        probe.points = probe.points + probe.velocity
        before = probe.met
        matcher.follow([probe], detections, free)
        if probe.met > before:
            body.track[t] = probe.track[t]
        seen = body.slots[:, t] >= 0
        taken[seen, t, body.slots[seen, t]] = True
        t -= 1


def bridge_gaps(bodies: list[BodyTrack], points_px: FloatArray, most: float) -> None:
    """Assign detections between two frames of the same camera track that the body left out and no other body has.

    Whether such a detection is good is decided later, by the triangulation.

    Args:
        bodies: bodies, changed in place.
        points_px: (C, T, P, J, 2) all detections.
        most: largest distance of the two frames.
    """
    there = np.asarray(np.isfinite(points_px).all(-1).any(-1))
    taken = np.zeros_like(there)
    for body in bodies:
        camera, frame = np.nonzero(body.slots >= 0)
        taken[camera, frame, body.slots[camera, frame]] = True
    for body in bodies:
        for c, row in enumerate(body.slots):
            frames = np.flatnonzero(row >= 0)
            for a, b in zip(frames[:-1], frames[1:], strict=True):
                if 1 < b - a <= most and row[a] == row[b]:
                    gap = np.arange(a + 1, b)
                    free = there[c, gap, row[a]] & ~taken[c, gap, row[a]]
                    row[gap[free]] = row[a]
                    taken[c, gap[free], row[a]] = True
