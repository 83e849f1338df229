"""Separation of two people's marker trajectories by their position."""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.markers.tracking import Tracks

# A second person is searched for if there are at least this many points per marker of the set; each person must have
# this share of the set.
CROWDED = 1.35
LEAST_SHARE = 0.5
_FRAMES = 150
_FAR = 5.0


def split_people(tracks: Tracks, size: int) -> list[Tracks]:
    """Split trajectories by person.

    Args:
        tracks: trajectories, metres.
        size: number of markers of the set that the people wear.

    Returns:
        One `Tracks` per person, the one with most points first; a single one where there is one person.
    """
    crowd = float(np.median((tracks.track >= 0).sum(1)))
    if crowd < CROWDED * size:
        return [tracks]
    frames = np.linspace(0, len(tracks.points) - 1, min(_FRAMES, len(tracks.points))).astype(int)
    number, place = _long_tracks(tracks, frames)
    if len(number) < size:
        return [tracks]
    group = scipy.cluster.hierarchy.fcluster(
        scipy.cluster.hierarchy.linkage(scipy.spatial.distance.squareform(_distances(place), checks=False), "average"),
        2,
        "maxclust",
    )
    if min((group == g).sum() for g in (1, 2)) < LEAST_SHARE * size:
        return [tracks]
    owner = _owners(tracks, number, group)
    people = []
    for g in (1, 2):
        own = owner == g
        points = np.where(own[..., None], tracks.points, np.nan)
        track, column = (np.where(own, a, -1) for a in (tracks.track, tracks.column))
        people.append(replace(tracks, points=points, track=track, column=column))
    return sorted(people, key=lambda p: -int((p.track >= 0).sum()))


def _long_tracks(tracks: Tracks, frames: IndexArray) -> tuple[IndexArray, FloatArray]:
    """Numbers (P,) of the longest trajectories, and their positions (P, F, 3) in a sample of frames."""
    track = tracks.track[frames]
    number, count = np.unique(track[track >= 0], return_counts=True)
    number = number[np.argsort(-count, kind="stable")[:400]]
    number = number[np.isin(number, number[count[np.argsort(-count, kind="stable")[:400]] >= 3])]
    place = np.full((len(number), len(frames), 3), np.nan)
    row = {int(n): i for i, n in enumerate(number)}
    for f, t in enumerate(frames):
        for s in np.nonzero(track[f] >= 0)[0]:
            i = row.get(int(track[f, s]))
            if i is not None:
                place[i, f] = tracks.points[t, s]
    return number, place


def _distances(place: FloatArray) -> FloatArray:
    """(P, P) mean distance in common frames; without any, that of the trajectories' medians over the frames."""
    out = np.empty((len(place), len(place)))
    for i, one in enumerate(place):
        away = np.linalg.norm(place - one, axis=-1)
        known = np.isfinite(away)
        out[i] = np.where(known.any(1), np.nansum(away, 1) / np.maximum(known.sum(1), 1), np.nan)
    missing = ~np.isfinite(out)
    # Trajectories without a common frame get their distance via the trajectories that both overlap with.
    filled = np.where(missing, 0.0, out)
    common = (~missing).astype(float)
    between = (filled @ common + common @ filled) / np.maximum(2 * (common @ common), 1)
    out = np.where(missing, np.where(common @ common > 0, between, _FAR), out)
    out = (out + out.T) / 2
    np.fill_diagonal(out, 0)
    return out


def _owners(tracks: Tracks, number: IndexArray, group: NDArray[np.int32]) -> IndexArray:
    """(T, S) person of every point, 0 where there is none; short trajectories belong to the nearest person."""
    of_track = np.zeros(tracks.count + 1, np.intp)
    of_track[number] = group
    owner = np.where(tracks.track >= 0, of_track[tracks.track], 0)
    middle = {g: _middle(tracks.points, owner == g) for g in (1, 2)}
    away = np.stack([np.linalg.norm(tracks.points - middle[g][:, None], axis=-1) for g in (1, 2)], -1)
    nearest = np.nan_to_num(away, nan=1e9).argmin(-1) + 1
    return np.where((tracks.track >= 0) & (owner == 0), nearest, owner)


def _middle(points: FloatArray, own: BoolArray) -> FloatArray:
    """(T, 3) median of a person's points; in frames without any, that of the whole recording."""
    seen = np.where(own[..., None], points, np.nan)
    empty = ~own.any(1)
    seen[empty, 0] = np.nanmedian(seen[~empty].reshape(-1, 3), 0) if (~empty).any() else 0.0
    return np.asarray(np.nanmedian(seen, 1))
