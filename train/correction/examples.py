"""Bodies fitted to corrupted markers of synthetic people, with the errors of the fits: examples for the correction
network.

A person is calibrated once per clip, on a stretch of it, as in `muybridge solve`; then stretches of the clip at several
frame rates get new faults and are fitted. A store is a folder of shards; shard `k` depends only on the seed and `k`.
"""

import pathlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from torch import Tensor

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting.marker_fit import fit_markers
from muybridge.geometry.fitting.subject import MarkerFitOptions, Person, calibrate_person
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT
from muybridge.geometry.skeleton.statistical_body import marker_body
from muybridge.models.correction.features import carriers, solver_input, target_of
from muybridge.models.correction.network import SPANS
from muybridge.train.correction.clips import FRAMES, SolverClips, load_solver_clips, make_followed, make_solver_clips
from muybridge.train.correction.takes import MarkerFaults, add_faults, marker_columns, placement_spread
from muybridge.train.engine.shards import missing_shards, read_shards, save_shard
from muybridge.train.synthesis.markers.trajectories import FPS

KEYS = ("markers", "known", "joints", "target", "rate")
# Frame rates relative to the clip's, one example of each per clip; and the most frames fitted at once.
RATES = (1, 4)
STRETCH = 128
# Frames kept of each example: neighbouring ones are nearly equal.
KEPT = 24
# Frames for the calibration of a person: more take longer and add little.
CALIBRATION = 56
_FEWEST = 14

Example = dict[str, NDArray[np.generic]]
_Rng = np.random.Generator


def sample_marker_columns(rng: _Rng) -> IndexArray:
    """Columns of SURFACE that a take has: those of Plug-in Gait or CMU, all or most of them, or only the legs'."""
    columns = marker_columns((PLUG_IN_GAIT, CMU)[int(rng.integers(2))])
    kind = rng.random()
    if kind < 0.7:
        return columns
    if kind < 0.8:
        table = marker_body()
        legs = ("hips", "thigh", "shin", "foot", "toe")
        return columns[[table.names[table.carrier[c]].endswith(legs) for c in columns]]
    more = np.union1d(columns, rng.choice(len(marker_body().carrier), 12, replace=False))
    return np.asarray(np.sort(rng.choice(more, max(_FEWEST, len(more) - int(rng.integers(4, 14))), replace=False)))


def sample_faults(rng: _Rng) -> MarkerFaults:
    """Faults of a take: from none to a quarter of the markers hidden and 15 % displaced."""
    shifted = rng.uniform(0, 0.15) if rng.random() < 0.75 else 0.0
    noise = float(np.exp(rng.uniform(np.log(0.0005), np.log(0.003))))
    return MarkerFaults(rng.uniform(0, 0.25), shifted, 0.05, noise, float(rng.choice([0.0, 0.0, 0.25])))


def _placement_offsets(clips: SolverClips, k: int, rng: _Rng) -> FloatArray:
    """(M, 3) metres in their joints' axes: displacement of this person's markers along the skin from the table's
    positions."""
    # Three people of ten have markers at the positions of the table, except for differences between bodies.
    spread = rng.uniform(0, 1.2) if rng.random() < 0.7 else 0.0
    placed = rng.normal(0, 1, (clips.points.shape[2], 3)) * placement_spread()[:, None] * spread
    out = np.einsum("tmji,tmj->mi", clips.turns[k][:, carriers()], clips.normals[k].astype(np.float32))
    out = out / (np.linalg.norm(out, axis=-1, keepdims=True) + 1e-9)
    return np.asarray(placed - 0.75 * (placed * out).sum(-1, keepdims=True) * out)


def examples(clips: SolverClips, k: int, rng: _Rng) -> Iterator[Example]:
    """Features and targets of clip `k`, one take for each of RATES."""
    columns = sample_marker_columns(rng)
    turns, places = clips.turns[k].astype(np.float64), clips.places[k].astype(np.float64)
    points = (clips.points[k] + np.einsum("tmij,mj->tmi", turns[:, carriers()], _placement_offsets(clips, k, rng)))[
        :, columns
    ]
    how, count = sample_faults(rng), int(rng.integers(36, FRAMES + 1))
    first = int(rng.integers(0, FRAMES - count + 1))
    span = slice(first, first + count)
    measured, _ = add_faults(points[span], FPS, how, rng)
    person = calibrate_person(measured, columns, FPS, MarkerFitOptions(calibration_frames=CALIBRATION))
    for rate in RATES:
        yield _example(person, columns, points[span], (turns[span], places[span]), rate, how, rng)


def _example(
    person: Person, columns: IndexArray, points: FloatArray, truth: tuple[FloatArray, ...], rate: int,
    how: MarkerFaults, rng: _Rng,
) -> Example:  # fmt: skip
    """A stretch at `rate` times the clip's frame rate, with faults and fitted; only frames that the clip has are
    kept."""
    count = min(len(points), STRETCH // rate)
    first = int(rng.integers(0, len(points) - count + 1))
    at = np.arange((count - 1) * rate + 1) / rate
    between = CubicSpline(np.arange(count), points[first : first + count], axis=0)(at)
    measured, _ = add_faults(between, FPS * rate, how, rng)
    fit = fit_markers(measured, columns, FPS * rate, MarkerFitOptions(), person=person)
    given = solver_input(fit, measured, SPANS)
    kept = np.sort(rng.choice(count, min(KEPT, count), replace=False))
    parts = replace(given, turns=given.turns[kept * rate], places=given.places[kept * rate])
    target = target_of(parts, truth[0][first + kept], truth[1][first + kept])
    return {"markers": given.markers[kept * rate].astype(np.float16), "known": given.known[kept * rate] > 0,
            "joints": given.joints[kept * rate].astype(np.float16), "target": target,
            "rate": np.full(len(kept), FPS * rate, np.float32)}  # fmt: skip


def make_fits(clips: pathlib.Path, out: pathlib.Path, shards: range, seed: int = 0, followed: bool = False) -> None:
    """Write one file of examples per shard of clips, if there is none.

    Args:
        clips: store of clips.
        out: store of examples.
        shards: numbers of the shards.
        seed: of both stores.
        followed: use the people who follow the motions of others.
    """
    if followed:
        out = out / "followed"
    for number in missing_shards(out, shards):
        (make_followed if followed else make_solver_clips)(clips, range(number, number + 1), seed)
        shard = load_solver_clips(clips / "followed" if followed else clips, range(number, number + 1))
        rng = np.random.default_rng([seed, number, 1] if followed else [seed, number])
        made: list[Example] = []
        for k in range(len(shard.points)):
            try:
                made += examples(shard, k, rng)
            except (MuybridgeError, np.linalg.LinAlgError):
                continue  # the markers of this clip are too corrupted to be fitted
        save_shard(out, number, {key: np.concatenate([m[key] for m in made]) for key in KEYS})


def load_fits(folder: pathlib.Path, shards: range) -> tuple[Tensor, ...]:
    """The arrays named in KEYS, of the existing ones of `shards`, including people who follow others; empty if there
    are none. Markers and joints are in half precision."""
    found = [part for store in (folder, folder / "followed") for part in read_shards(store, shards, KEYS)]
    return tuple(torch.from_numpy(np.concatenate([f[k] for f in found])) for k in KEYS) if found else ()
