"""Bodies fitted to spoiled markers of synthetic people, with what the fits are off: the solver network's examples.

A person is calibrated once a clip, on a stretch of it, as `muybridge solve` does it; then stretches of the clip at
several frame rates are spoiled anew and fitted. A store is a folder of shards; shard `k` depends on the seed and `k`.
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
from muybridge.files import replacing
from muybridge.geometry.fitting.marker_fit import fit_markers
from muybridge.geometry.fitting.subject import MarkerFitOptions, Person, calibrate_person
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT
from muybridge.geometry.skeleton.statistical_body import marker_body
from muybridge.models.correction.features import carriers, solver_input, target_of
from muybridge.models.correction.network import SPANS
from muybridge.train.correction.clips import FRAMES, SolverClips, load_solver_clips, make_followed, make_solver_clips
from muybridge.train.correction.takes import Spoiling, marker_columns, placement_spread, spoil
from muybridge.train.synthesis.markers.trajectories import FPS

KEYS = ("markers", "known", "joints", "target", "rate")
# Frames a second over the clip's, one of each a clip; and the most frames that are fitted at once.
RATES = (1, 4)
STRETCH = 128
# So many frames of each are kept: neighbours tell the same.
KEPT = 24
# Frames that tell the person: as many more would tell the same and take as long again.
CALIBRATION = 56
_FEWEST = 14

Example = dict[str, NDArray[np.generic]]
_Rng = np.random.Generator


def drawn_markers(rng: _Rng) -> IndexArray:
    """Columns of SURFACE that a take has: Plug-in Gait's or CMU's, all or most of them, or the legs' alone."""
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


def drawn_spoiling(rng: _Rng) -> Spoiling:
    """What happens to a take: from a clean one to a quarter of the markers hidden and 15 % shifted."""
    shifted = rng.uniform(0, 0.15) if rng.random() < 0.75 else 0.0
    noise = float(np.exp(rng.uniform(np.log(0.0005), np.log(0.003))))
    return Spoiling(rng.uniform(0, 0.25), shifted, 0.05, noise, float(rng.choice([0.0, 0.0, 0.25])))


def _placed(clips: SolverClips, k: int, rng: _Rng) -> FloatArray:
    """(M, 3) metres in their joints' axes: how far along the skin this person's markers are from the table's places."""
    # Three people of ten have markers where the table has them, give or take what the body itself differs.
    spread = rng.uniform(0, 1.2) if rng.random() < 0.7 else 0.0
    placed = rng.normal(0, 1, (clips.points.shape[2], 3)) * placement_spread()[:, None] * spread
    out = np.einsum("tmji,tmj->mi", clips.turns[k][:, carriers()], clips.normals[k].astype(np.float32))
    out = out / (np.linalg.norm(out, axis=-1, keepdims=True) + 1e-9)
    return np.asarray(placed - 0.75 * (placed * out).sum(-1, keepdims=True) * out)


def examples(clips: SolverClips, k: int, rng: _Rng) -> Iterator[Example]:
    """Features and right answers of clip `k`, one take for each of RATES."""
    columns = drawn_markers(rng)
    turns, places = clips.turns[k].astype(np.float64), clips.places[k].astype(np.float64)
    points = (clips.points[k] + np.einsum("tmij,mj->tmi", turns[:, carriers()], _placed(clips, k, rng)))[:, columns]
    how, count = drawn_spoiling(rng), int(rng.integers(36, FRAMES + 1))
    first = int(rng.integers(0, FRAMES - count + 1))
    span = slice(first, first + count)
    seen, _ = spoil(points[span], FPS, how, rng)
    person = calibrate_person(seen, columns, FPS, MarkerFitOptions(calibration_frames=CALIBRATION))
    for rate in RATES:
        yield _take(person, columns, points[span], (turns[span], places[span]), rate, how, rng)


def _take(
    person: Person, columns: IndexArray, points: FloatArray, truth: tuple[FloatArray, ...], rate: int,
    how: Spoiling, rng: _Rng,
) -> Example:  # fmt: skip
    """A stretch at `rate` times the clip's frames a second, spoiled and fitted; the frames that the clip has."""
    count = min(len(points), STRETCH // rate)
    first = int(rng.integers(0, len(points) - count + 1))
    at = np.arange((count - 1) * rate + 1) / rate
    between = CubicSpline(np.arange(count), points[first : first + count], axis=0)(at)
    seen, _ = spoil(between, FPS * rate, how, rng)
    fit = fit_markers(seen, columns, FPS * rate, MarkerFitOptions(), person=person)
    given = solver_input(fit, seen, SPANS)
    kept = np.sort(rng.choice(count, min(KEPT, count), replace=False))
    parts = replace(given, turns=given.turns[kept * rate], places=given.places[kept * rate])
    target = target_of(parts, truth[0][first + kept], truth[1][first + kept])
    return {"markers": given.markers[kept * rate].astype(np.float16), "known": given.known[kept * rate] > 0,
            "joints": given.joints[kept * rate].astype(np.float16), "target": target,
            "rate": np.full(len(kept), FPS * rate, np.float32)}  # fmt: skip


def make_fits(clips: pathlib.Path, out: pathlib.Path, shards: range, seed: int = 0, followed: bool = False) -> None:
    """One file of examples a shard of clips, where there is none yet; `followed`: those of the people who follow."""
    if followed:
        out = out / "followed"
    out.mkdir(parents=True, exist_ok=True)
    for number in shards:
        path = out / f"{number:05}.npz"
        if path.exists():
            continue
        (make_followed if followed else make_solver_clips)(clips, range(number, number + 1), seed)
        shard = load_solver_clips(clips / "followed" if followed else clips, range(number, number + 1))
        rng = np.random.default_rng([seed, number, 1] if followed else [seed, number])
        made: list[Example] = []
        for k in range(len(shard.points)):
            try:
                made += examples(shard, k, rng)
            except (MuybridgeError, np.linalg.LinAlgError):
                continue  # a clip so spoiled that nothing can be fitted teaches nothing
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **{key: np.concatenate([m[key] for m in made]) for key in KEYS})  # type: ignore[arg-type]


def load_fits(folder: pathlib.Path, shards: range) -> tuple[Tensor, ...]:
    """What KEYS names, of those of `shards` that are there, with those who follow; markers and joints in half
    precision."""
    paths = [*sorted(folder.glob("*.npz")), *sorted((folder / "followed").glob("*.npz"))]
    found = [np.load(p) for p in paths if p.stem.isdecimal() and int(p.stem) in shards]
    return tuple(torch.from_numpy(np.concatenate([f[k] for f in found])) for k in KEYS) if found else ()
