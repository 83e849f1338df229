"""Markers of videos in 3D: blobs in every camera, matched and tracked, then triangulated by label.

Blobs are located with sub-pixel accuracy and matched between cameras by epipolar geometry, without labels. Trajectories
of ghosts and lamps are dropped. Once the labelling network has labelled the trajectories, every marker is triangulated
again from all cameras that see it.
"""

from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray, IntArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import ray_directions
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.markers.cleaning import CleanOptions
from muybridge.geometry.markers.matching import MatchOptions, find_real_markers, follow_points, intersect_rays
from muybridge.geometry.markers.tracking import TrackOptions, track_points
from muybridge.infer.detection.blobs import BlobOptions, find_blobs, find_threshold
from muybridge.infer.labelling.label import LabelOptions
from muybridge.infer.runtime.stages import Arrays, Facts
from muybridge.infer.session.damage import DamageWatch
from muybridge.infer.session.probe import VideoInfo
from muybridge.infer.session.video import read_chunks


@dataclass(frozen=True)
class MarkerVideoOptions:
    """How markers are detected in videos.

    Attributes:
        markerset: the marker set: `pig39`, `cmu41`, ... or a text file of your own.
        shortest_s: least duration of a marker's trajectory, seconds.
        blobs: markers in an image.
        match: 2D points to 3D points.
        track: trajectories.
        label: labels.
        clean: spikes and gaps.
        fit: the skeleton.
        correct: correct the fitted joints with the shipped solver network.
    """

    markerset: str = "pig39"
    shortest_s: float = 0.05
    blobs: BlobOptions = field(default_factory=BlobOptions)
    match: MatchOptions = field(default_factory=MatchOptions)
    track: TrackOptions = field(default_factory=TrackOptions)
    label: LabelOptions = field(default_factory=LabelOptions)
    clean: CleanOptions = field(default_factory=CleanOptions)
    fit: MarkerFitOptions = field(default_factory=MarkerFitOptions)
    correct: bool = True


@dataclass(frozen=True, eq=False)
class FoundMarkers:
    """Unlabelled markers of a take.

    Attributes:
        points: (T, S, 3) metres in slots, NaN where empty: trajectories without ghosts.
        seen: for each frame and camera (K, 3): x, y in pixels and area.
        dropped: number of trajectories that were ghosts or lamps.
    """

    points: FloatArray
    seen: list[list[FloatArray]]
    dropped: int


def blobs_of(
    video: VideoInfo, indices: IntArray, options: BlobOptions, watch: DamageWatch
) -> tuple[list[FloatArray], float]:
    """Blobs (K, 3) of every frame of a video, none in damaged ones, and the threshold that was used."""
    threshold = options.threshold
    found: list[FloatArray] = []
    for chunk in read_chunks(video, indices, watch=watch):
        # Markers are lit in one colour, which may be any channel.
        grey = chunk.max(axis=-1)
        if threshold is None:
            threshold = find_threshold([grey[k] for k in np.linspace(0, len(grey) - 1, min(9, len(grey))).astype(int)])
        found += [find_blobs(image, threshold, options) for image in grey]
    damaged = watch.damaged()[indices]
    found = [np.empty((0, 3)) if bad else blobs for blobs, bad in zip(found, damaged, strict=False)]
    return found, float(threshold or 0.0)


def pack_blobs(blobs: list[FloatArray], threshold: float) -> tuple[Arrays, Facts]:
    """The result of `blobs_of` as arrays and facts."""
    counts = np.array([len(each) for each in blobs], dtype=np.int64)
    return {"blobs": np.concatenate([np.empty((0, 3)), *blobs]), "counts": counts}, {"threshold": threshold}


def unpack_blobs(arrays: Arrays) -> list[FloatArray]:
    """Blobs (K, 3) of every frame."""
    return np.split(arrays["blobs"], np.cumsum(arrays["counts"])[:-1])


def find_markers(
    cameras: CameraGroup, seen: list[list[FloatArray]], fps: float, options: MarkerVideoOptions
) -> FoundMarkers:
    """Unlabelled trajectories from blobs.

    Args:
        cameras: C cameras.
        seen: for each of T frames C arrays (K, 3).
        fps: frames per second.
        options: of every step.
    """
    points, _ = follow_points(cameras, seen, fps, options.match)
    tracks = track_points(points, fps, options.track)
    good = find_real_markers(tracks.points, tracks.track, max(3, round(options.shortest_s * fps)), fps)
    kept = np.where(good[..., None], tracks.points, np.nan)
    dropped = len(np.unique(tracks.track[(tracks.track >= 0) & ~good]))
    used = good.any(0)
    return FoundMarkers(kept[:, used], seen, dropped)


def triangulate_again(cameras: CameraGroup, seen: list[list[FloatArray]], points: FloatArray, reach_px: float = 2.0,
                      longest: int = 12) -> tuple[FloatArray, IndexArray]:  # fmt: skip
    """Labelled markers triangulated from all cameras that see them, and in short gaps where two cameras have a blob
    close to the interpolated path.

    Args:
        cameras: C cameras.
        seen: blobs (K, 3) of every frame and camera.
        points: (T, M, 3) metres.
        reach_px: how far a blob may be from the projection.
        longest: frames of the longest gap.

    Returns:
        (T, M, 3) metres and (T, M) number of cameras.
    """
    expected, gap = _interpolate(points, longest)
    out, views = np.full_like(points, np.nan), np.zeros(points.shape[:2], np.intp)
    centres, count = cameras.centers_world, len(cameras)
    for t, frame in enumerate(seen):
        known = np.nonzero(np.isfinite(expected[t, :, 0]))[0]
        if not len(known):
            continue
        width = max((len(s) for s in frame), default=0)
        if width == 0:
            continue
        px = np.full((count, width, 2), np.nan)
        for c, blobs in enumerate(frame):
            px[c, : len(blobs)] = blobs[:, :2]
        at = cameras.project(expected[t, known])
        far = np.linalg.norm(at[:, :, None] - px[:, None], axis=-1)  # (C, N, K)
        far = np.where(np.isfinite(far), far, np.inf)
        best = far.argmin(2)
        near = np.take_along_axis(far, best[..., None], 2)[..., 0] < np.where(gap[t, known], 3 * reach_px, reach_px)
        # A blob belongs to the marker whose projection is nearest.
        nearest = far.argmin(1)
        owner = np.take_along_axis(nearest, best, 1) == np.arange(len(known))
        near &= owner
        rays = ray_directions(cameras, np.take_along_axis(px, best[..., None], 1))
        new = intersect_rays(centres, np.nan_to_num(np.moveaxis(rays, 0, 1)), near.T)
        error = np.linalg.norm(cameras.project(new) - np.take_along_axis(px, best[..., None], 1), axis=-1)
        good = near & (error < reach_px)
        enough = (good.sum(0) >= 2) & (good.sum(0) == near.sum(0))
        again = intersect_rays(centres, np.nan_to_num(np.moveaxis(rays, 0, 1)), good.T)
        kept = (good.sum(0) >= 2) & (np.linalg.norm(again - expected[t, known], axis=-1) < 0.015)
        kept &= enough | (good.sum(0) >= 3)
        out[t, known[kept]], views[t, known[kept]] = again[kept], good.sum(0)[kept]
    # The earlier point stays where two cameras no longer agree.
    lost = np.isnan(out[..., 0]) & np.isfinite(points[..., 0])
    out[lost] = points[lost]
    return out, views


def nearest_blobs(
    cameras: CameraGroup, seen: list[list[FloatArray]], points: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:
    """Each marker's blob in each camera.

    Args:
        cameras: C cameras.
        seen: blobs (K, 3) of every frame and camera.
        points: (T, M, 3) metres.
        reach_px: how far a blob may be from the projection.

    Returns:
        (C, T, M, 2) px and (C, T, M) distance to the projection, px; NaN where there is no blob within reach.
    """
    projected = cameras.project(points)
    px, away = np.full(projected.shape, np.nan), np.full(projected.shape[:-1], np.nan)
    for t, frame in enumerate(seen):
        for c, blobs in enumerate(frame):
            if not len(blobs):
                continue
            far = np.linalg.norm(projected[c, t, :, None] - blobs[None, :, :2], axis=-1)
            far = np.where(np.isfinite(far), far, np.inf)
            best = far.argmin(1)
            least = far[np.arange(len(best)), best]
            near = least < reach_px
            px[c, t, near], away[c, t, near] = blobs[best[near], :2], least[near]
    return px, away


def _interpolate(points: FloatArray, longest: int) -> tuple[FloatArray, BoolArray]:
    """Points interpolated linearly over short gaps, and (T, M) where."""
    out, gap = points.copy(), np.zeros(points.shape[:2], bool)
    time = np.arange(len(points))
    for m in range(points.shape[1]):
        known = np.nonzero(np.isfinite(points[:, m, 0]))[0]
        for a, b in zip(known, known[1:], strict=False):
            if 1 < b - a <= longest:
                between = time[a + 1 : b]
                share = ((between - a) / (b - a))[:, None]
                out[between, m] = points[a, m] * (1 - share) + points[b, m] * share
                gap[between, m] = True
    return out, gap
