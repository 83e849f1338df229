"""Accuracy and speed of marker labelling.

Usage: python -m scripts.benchmarks.markers.labelling parts LABELLED.c3d ... [--model labels.onnx] [--set pig39]
       python -m scripts.benchmarks.markers.labelling variations LABELLED.c3d [--model labels.onnx] [--only WORDS ...]

parts: what each part of the method contributes. The names of labelled recordings are removed, their points shuffled
(in every frame, or as whole trajectories), points hidden and added, and the result is compared with the original names.
One row per protocol, one column per variant.

variations: one recording of Plug-in Gait labelled in many ways: without some markers, at other frame rates, in other
axes and units, from other starts, with points that belong to nobody. Each variation is labelled as whole trajectories;
with 50 of them broken, 5 occlusions and 3 ghosts per frame (`hard`); and shuffled in every frame, without and with
occlusions and ghosts. Cells are the shares of visible markers with the correct name.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.markers.tracking import TrackOptions
from muybridge.infer.labelling.label import LabelOptions, label_points
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

# Protocol: shuffled in every frame, most hidden points per frame, ghosts per frame, broken trajectories.
PROTOCOLS = {
    "per frame": (True, 0, 0, 0), "per frame, 5 hidden, 3 ghosts": (True, 5, 3, 0), "whole": (False, 0, 0, 0),
    "whole, 5 hidden, 3 ghosts": (False, 5, 3, 0), "50 breaks, 5 hidden, 3 ghosts": (False, 5, 3, 50),
}  # fmt: skip
ALONE = LabelOptions(window=False, votes=False, distances=False, track=TrackOptions(shuffled=2.0))
VARIANTS = {
    "single frame": ALONE, "+ distances": replace(ALONE, distances=True),
    "+ tracking, window": LabelOptions(votes=False, distances=False),
    "+ votes": LabelOptions(distances=False), "+ votes, distances": LabelOptions(),
}  # fmt: skip


def trial(
    truth: FloatArray, every: bool, hidden: int, ghosts: int, breaks: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """A shuffled cloud (T, K, 3) and the visible part of the truth (T, M, 3)."""
    rng = np.random.default_rng(seed)
    truth = truth.copy()
    count, size = truth.shape[:2]
    gone = 0
    for t in range(count if hidden and every else 0):
        truth[t, rng.permutation(size)[: rng.integers(0, hidden + 1)]] = np.nan
    while not every and gone < count * hidden / 2:
        length = int(min(count - 1, max(1, rng.lognormal(1.8, 1.6))))
        start = rng.integers(0, count - length)
        truth[start : start + length, rng.integers(size)] = np.nan
        gone += length
    columns = [truth[:, m].copy() for m in range(size)]
    for _ in range(breaks):
        i, cut = int(rng.integers(len(columns))), int(rng.integers(1, count - 1))
        columns.append(np.where(np.arange(count)[:, None] < cut, np.nan, columns[i]))
        columns[i] = np.where(np.arange(count)[:, None] < cut, columns[i], np.nan)
    spread = np.nanstd(truth, (0, 1)) + 0.1
    for _ in range(ghosts):
        ghost = np.nanmedian(truth, 1) + rng.normal(0, 0.5, (count, 3)) * spread
        columns.append(np.where(rng.random((count, 1)) < 0.5, ghost, np.nan))
    cloud = np.stack(columns, 1)
    for t in range(count if every else 0):
        cloud[t] = cloud[t, rng.permutation(cloud.shape[1])]
    return (cloud if every else cloud[:, rng.permutation(cloud.shape[1])]), truth


def compare_parts(a: argparse.Namespace) -> None:
    """Print the shares of correct labels, one row per protocol, one column per variant."""
    network = LabelNetwork(a.model or shipped_model("labels"))
    for file in a.files:
        cloud = read_marker_cloud(file)
        names = [n.split(":")[-1] for n in cloud.names]
        plan = find_marker_set(a.set)
        shared = [label for label in plan.markers.labels if label in names]
        truth = cloud.points[:, [names.index(label) for label in shared]]
        print(f"{file.name}: {len(truth)} frames, {len(shared)} markers of {a.set}")
        print("| protocol | " + " | ".join(a.variants) + " | frames/s |\n| --- |" + " --- |" * (len(a.variants) + 1))
        for name in a.protocols:
            points, seen = trial(truth, *PROTOCOLS[name], a.seed)
            cells = []
            for variant in a.variants:
                start = time.process_time()
                done = label_points(points, cloud.fps, plan.markers, network, VARIANTS[variant])
                rate = len(points) / (time.process_time() - start)
                found = done.points[:, [plan.markers.labels.index(label) for label in shared]]
                right = np.linalg.norm(found - seen, axis=-1) < 1e-3
                cells.append(f"{right.sum() / np.isfinite(seen[..., 0]).sum():.2%}")
            print(f"| {name} | " + " | ".join(cells) + f" | {rate:.0f} |", flush=True)


VARIATION_PROTOCOLS = {"whole": (False, 0, 0, 0), "hard": (False, 5, 3, 50), "shuffled": (True, 0, 0, 0),
             "shuffled, 5 hidden, 3 ghosts": (True, 5, 3, 0)}  # fmt: skip
LEFT_OUT = {
    "without upper arms and forearms": "LUPA RUPA LFRM RFRM", "without RBAK": "RBAK",
    "without the head": "LFHD RFHD LBHD RBHD", "without FIN, THI, TIB": "LFIN RFIN LTHI RTHI LTIB RTIB",
}  # fmt: skip
Y_UP = np.eye(3)[[1, 2, 0]]


@dataclass(frozen=True)
class Recording:
    """Markers (T, M, 3) in metres with their labels, the requested marker set, and points (T, K, 3) that belong to
    nobody."""

    points: FloatArray
    labels: tuple[str, ...]
    fps: float
    asked: str = "pig39"
    turn: FloatArray | None = None
    unit: float = 1.0
    beside: FloatArray | None = None


def variations(whole: Recording) -> Iterator[tuple[str, Recording]]:
    """Names and recordings."""
    at, labels = whole.points, whole.labels
    yield "unchanged", whole
    for name, out in LEFT_OUT.items():
        kept = [i for i, label in enumerate(labels) if label not in out.split()]
        less = replace(whole, points=at[:, kept], labels=tuple(labels[i] for i in kept))
        yield name, less
        if "arms" in name:
            yield f"{name}, requested as pig35", replace(less, asked="pig35")
    for step in (2, 4):
        yield f"{whole.fps / step:g} frames/s", replace(whole, points=at[::step], fps=whole.fps / step)
    yield "backwards in time", replace(whole, points=at[::-1])
    yield "Y up, millimetres declared as metres", replace(whole, turn=Y_UP, unit=1000.0)
    low = int(np.nanargmin(at[:, labels.index("C7"), 2]))
    yield "starting in the deepest crouch", replace(whole, points=at[low : low + 400])
    yield "two seconds", replace(whole, points=at[: round(2 * whole.fps)])
    yield "30 markers of a second person, 0.8 m away", replace(whole, beside=at[::-1, :30] + [0.8, 0.3, 0])
    yield "30 markers of a second person, 3 m away", replace(whole, beside=at[::-1, :30] + [3.0, 0.3, 0])
    along = at[:, labels.index("RFIN")] - at[:, labels.index("RELB")]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    racket = [at[:, labels.index("RFIN")] + along * x for x in (0.2, 0.45, 0.6)]
    floor = [np.tile(np.append(at[0].mean(0)[:2] + shift, 0.0), (len(at), 1)) for shift in ([0.8, 0.5], [1.2, 0.5])]
    yield "a racket and markers on the floor", replace(whole, beside=np.stack([*racket, *floor], 1))


def share(recording: Recording, protocol: tuple[bool, int, int, int], network: LabelNetwork) -> float:
    """Share of visible markers that get the correct name."""
    cloud, seen = trial(recording.points, *protocol, 0)
    if recording.beside is not None:
        cloud = np.concatenate([cloud, recording.beside], 1)
    turn = np.eye(3) if recording.turn is None else recording.turn
    plan = find_marker_set(recording.asked)
    done = label_points(cloud @ turn.T * recording.unit, recording.fps, plan.markers, network)
    found = done.points[:, [plan.markers.labels.index(label) for label in recording.labels]] @ turn
    return float((np.linalg.norm(found - seen, axis=-1) < 1e-3).sum() / np.isfinite(seen[..., 0]).sum())


def compare_variations(a: argparse.Namespace) -> None:
    """Print the shares of one recording's variations."""
    network, cloud = LabelNetwork(a.model or shipped_model("labels")), read_marker_cloud(a.file)
    names, labels = [n.split(":")[-1] for n in cloud.names], find_marker_set("pig39").markers.labels
    points = cloud.points[:, [names.index(label) for label in labels]]
    print("| variation | " + " | ".join(VARIATION_PROTOCOLS) + " |\n| --- |" + " --- |" * len(VARIATION_PROTOCOLS))
    for name, recording in variations(Recording(points, labels, cloud.fps)):
        if not a.only or any(word in name for word in a.only):
            cells = [f"{share(recording, protocol, network):.2%}" if not (protocol[0] and recording.beside is not None)
                     else "–" for protocol in VARIATION_PROTOCOLS.values()]  # fmt: skip
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    parts = commands.add_parser("parts")
    parts.add_argument("files", nargs="+", type=Path)
    parts.add_argument("--model", type=Path)
    parts.add_argument("--set", default="pig39")
    parts.add_argument("--seed", type=int, default=0)
    parts.add_argument("--protocols", nargs="*", default=list(PROTOCOLS))
    parts.add_argument("--variants", nargs="*", default=list(VARIANTS))
    parts.set_defaults(run=compare_parts)
    variants = commands.add_parser("variations")
    variants.add_argument("file", type=Path)
    variants.add_argument("--model", type=Path)
    variants.add_argument("--only", nargs="*", default=[], help="words, of which a variation's name must have one")
    variants.set_defaults(run=compare_variations)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
