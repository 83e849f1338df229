"""Videos that are mirrored, as programs for webcams record them.

A mirrored image shows its subject's left where the right is, and a network names the limbs by what it sees. With the
image turned back and the names with it, the views of a good calibration agree; without, they do not, even where all of
them are mirrored: each is reflected in a plane of its own. Cameras that stand symmetrically are the exception: their
mirrored views are those of a mirrored person in the cameras of the other side, so that exchanged videos explain them
as well (`exchanged_instead`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D

# Frames that are compared, landmarks that must be seen by two cameras or more.
_FRAMES, _LEAST = 60, 100
# Mirrored views must agree so many times better once turned back, and so many times better than with any other views
# turned back. Of the image's diagonal, they must then be so close, and have been so far apart.
_BETTER, _CLEARER = 3.0, 2.0
_CLOSE, _APART = 0.008, 0.004
# Of more cameras, only single pairs are exchanged on trial.
_FEW = 6


def find_mirrored(cameras: CameraGroup, keypoints: Keypoints2D) -> tuple[int, ...]:
    """The cameras whose videos are mirrored: one, all, or none where that is not certain.

    Args:
        cameras: C cameras.
        keypoints: people's landmarks; in every frame of a camera the most certain person is used.

    Returns:
        Indices of cameras, ascending; empty if none is mirrored, or the views agree in no way.
    """
    points = _compared(keypoints)
    if (np.isfinite(points[..., 0]).sum(0) >= 2).sum() < _LEAST:
        return ()
    turned = _turned_back(cameras, points, keypoints.landmarks.mirror)
    every = tuple(range(len(cameras)))
    choices = [(), every, *(combinations(every, 1) if len(every) > 2 else ())]
    errors = np.array([_disagreement(cameras, points, turned, choice) for choice in choices])
    best = int(np.argmin(errors))
    others = np.delete(errors, best)
    much_better = errors[0] > max(_BETTER * errors[best], _APART) and others.min() > _CLEARER * errors[best]
    return choices[best] if much_better and errors[best] < _CLOSE else ()


def exchanged_instead(cameras: CameraGroup, keypoints: Keypoints2D) -> tuple[tuple[int, int], ...]:
    """Videos that may have been exchanged with each other, where all seem to be mirrored.

    Args:
        cameras: C cameras.
        keypoints: people's landmarks, of which `find_mirrored` finds all videos mirrored.

    Returns:
        Pairs of camera indices whose exchange lets the views agree about as well as mirroring does; empty if none does.
    """
    points, count = _compared(keypoints), len(cameras)
    every = tuple(range(count))
    turned = _turned_back(cameras, points, keypoints.landmarks.mirror)
    mirrored = _disagreement(cameras, points, turned, every)
    found: tuple[tuple[int, int], ...] = ()
    least = _CLEARER * mirrored
    for pairs in _exchanges(every, count // 2 if count <= _FEW else 1):
        order = list(every)
        for a, b in pairs:
            order[a], order[b] = b, a
        error = _disagreement(cameras, points[order], turned, ())
        if error <= least:
            found, least = pairs, error
    return found


def _exchanges(cameras: tuple[int, ...], most: int) -> Iterator[tuple[tuple[int, int], ...]]:
    """All ways to exchange one to `most` disjoint pairs."""
    for k, pair in enumerate(combinations(cameras, 2)):
        yield (pair,)
        if most > 1:
            later = list(combinations(cameras, 2))[k + 1 :]
            rest = tuple(c for c in cameras if c not in pair)
            yield from ((pair, *more) for more in _exchanges(rest, most - 1) if more[0] in later)


def _compared(keypoints: Keypoints2D) -> FloatArray:
    """(C, F, J, 2) px of one person in frames where two cameras see something, spread over the take."""
    points = _one_person(keypoints)
    usable = np.flatnonzero((np.isfinite(points[..., 0]).sum(0) >= 2).any(-1))
    frames = usable[np.unique(np.linspace(0, len(usable) - 1, _FRAMES).astype(int))] if len(usable) else usable
    return points[:, frames]


def _one_person(keypoints: Keypoints2D) -> FloatArray:
    """(C, T, J, 2) px of the most certain person in every frame of a camera."""
    best = keypoints.score.mean(-1).argmax(-1)
    return np.take_along_axis(keypoints.points_px, best[:, :, None, None, None], axis=2)[:, :, 0]


def _turned_back(cameras: CameraGroup, points_px: FloatArray, mirror: Sequence[int]) -> FloatArray:
    """(C, T, J, 2) landmarks of mirrored videos as the cameras saw them."""
    back = points_px[:, :, list(mirror)].copy()
    back[..., 0] = np.array([camera.width - 1 for camera in cameras])[:, None, None] - back[..., 0]
    return back


def _disagreement(cameras: CameraGroup, points: FloatArray, turned: FloatArray, choice: Sequence[int]) -> float:
    """Median distance of landmarks from their triangulated points with the chosen cameras turned back, in diagonals of
    the image."""
    px = points.copy()
    px[list(choice)] = turned[list(choice)]
    rays = np.stack([camera.rays(px[c]) for c, camera in enumerate(cameras)])  # (C, T, J, 3)
    seen = np.isfinite(rays).all(-1) & (np.isfinite(px).all(-1).sum(0) >= 2)
    across = (np.eye(3) - rays[..., :, None] * rays[..., None, :]) * seen[..., None, None]
    across = np.where(seen[..., None, None], across, 0.0)
    sums = across.sum(0) + 1e-9 * np.eye(3)
    targets = np.einsum("ctjxy,cy->tjx", across, cameras.centers_world)
    world = np.linalg.solve(sums, targets[..., None])[..., 0]
    diagonals = np.array([np.hypot(camera.width, camera.height) for camera in cameras])
    away = np.linalg.norm(cameras.project(world) - px, axis=-1) / diagonals[:, None, None]
    away = np.where(np.isfinite(away), away, 1.0)  # behind a camera
    return float(np.median(away[seen])) if seen.any() else np.inf
