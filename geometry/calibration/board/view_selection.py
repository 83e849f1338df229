"""Selection of the times of a recording that show the board in new positions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.board.intrinsics import View

_FIELDS = (8, 6)
_ENOUGH_SHARED = 12
_TILTS = 6


def choose_times(
    views: Mapping[str, Mapping[int, View]],
    sizes: Mapping[str, tuple[int, int]],
    most: int,
    kept: int | None = None,
) -> list[int]:
    """Select times that together show the board all over every image, at many tilts, and to every pair of cameras.

    Args:
        views: views by camera and by time.
        sizes: (width, height) px by camera.
        most: maximum number of times.
        kept: time that is selected in any case, if it has views.

    Returns:
        Times in order: greedily those that add most, where every field of an image, tilt of the board and pair of
        cameras has less value the more often it was selected.
    """
    times = sorted(set().union(*(v.keys() for v in views.values())))
    if len(times) <= most:
        return times
    traits = {t: _traits(t, views, sizes) for t in times}
    had: dict[tuple[object, ...], int] = {}
    chosen: list[int] = []
    left = set(times)
    while left and len(chosen) < most:
        best = max(sorted(left), key=lambda t: sum(w / (1 + had.get(k, 0)) for k, w in traits[t].items()))
        best = kept if kept in left else best
        chosen.append(best)
        left.discard(best)
        for k in traits[best]:
            had[k] = had.get(k, 0) + 1
    return sorted(chosen)


def _traits(
    t: int, views: Mapping[str, Mapping[int, View]], sizes: Mapping[str, tuple[int, int]]
) -> dict[tuple[object, ...], float]:
    """Properties that a time shows, with their values."""
    names = [n for n in views if t in views[n]]
    out: dict[tuple[object, ...], float] = {}
    for n in names:
        px = views[n][t][1]
        field = np.clip((px + 0.5) / sizes[n] * _FIELDS, 0, np.subtract(_FIELDS, 1)).astype(int)
        cells = {tuple(f) for f in field.tolist()}
        out |= {(n, *cell): 1.0 / len(cells) ** 0.5 for cell in cells}
        out[n, "tilt", *_tilt(px)] = 2.0
    for a in names:
        out |= {(a, b): 3.0 for b in names if b > a}
    return out


def _tilt(px: FloatArray) -> tuple[int, int]:
    """Coarse shape of the visible board: foreshortening and its direction."""
    centered = px - px.mean(axis=0)
    values, vectors = np.linalg.eigh(centered.T @ centered)
    flat = int(np.sqrt(max(values[0], 0.0) / max(values[1], 1e-9)) * 4)
    angle = int(np.arctan2(vectors[1, 1], vectors[0, 1]) % np.pi / np.pi * _TILTS) % _TILTS
    return flat, angle
