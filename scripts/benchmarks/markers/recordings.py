"""Labelling one recording in many ways: markers left out, other frame rates, axes, units, starts, points that are none.

    python -m scripts.benchmarks.markers.recordings LABELLED.c3d [--model labels.onnx] [--only WORDS ...]

The recording wears Plug-in Gait. Each variation is labelled as whole trajectories, with 50 of them broken under 5
occlusions and 3 ghosts a frame (`hard`), and shuffled anew in every frame without and with occlusions and ghosts.
Cells are the shares of the visible markers that got their name.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.infer.labelling.label import label_points
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from scripts.benchmarks.markers.labelling import trial

PROTOCOLS = {"whole": (False, 0, 0, 0), "hard": (False, 5, 3, 50), "shuffled": (True, 0, 0, 0),
             "shuffled, 5 hidden, 3 ghosts": (True, 5, 3, 0)}  # fmt: skip
LEFT_OUT = {
    "without upper arms and forearms": "LUPA RUPA LFRM RFRM", "without RBAK": "RBAK",
    "without the head": "LFHD RFHD LBHD RBHD", "without FIN, THI, TIB": "LFIN RFIN LTHI RTHI LTIB RTIB",
}  # fmt: skip
Y_UP = np.eye(3)[[1, 2, 0]]


@dataclass(frozen=True)
class Recording:
    """Markers (T, M, 3) in metres with their labels, what is asked for, and points (T, K, 3) that are none of them."""

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
    yield "as it is", whole
    for name, out in LEFT_OUT.items():
        kept = [i for i, label in enumerate(labels) if label not in out.split()]
        less = replace(whole, points=at[:, kept], labels=tuple(labels[i] for i in kept))
        yield name, less
        if "arms" in name:
            yield f"{name}, asked for as pig35", replace(less, asked="pig35")
    for step in (2, 4):
        yield f"{whole.fps / step:g} frames/s", replace(whole, points=at[::step], fps=whole.fps / step)
    yield "backwards in time", replace(whole, points=at[::-1])
    yield "Y up, millimetres that say metres", replace(whole, turn=Y_UP, unit=1000.0)
    low = int(np.nanargmin(at[:, labels.index("C7"), 2]))
    yield "beginning at the deepest crouch", replace(whole, points=at[low : low + 400])
    yield "two seconds", replace(whole, points=at[: round(2 * whole.fps)])
    yield "30 markers of a second person, 0.8 m away", replace(whole, beside=at[::-1, :30] + [0.8, 0.3, 0])
    yield "30 markers of a second person, 3 m away", replace(whole, beside=at[::-1, :30] + [3.0, 0.3, 0])
    along = at[:, labels.index("RFIN")] - at[:, labels.index("RELB")]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    racket = [at[:, labels.index("RFIN")] + along * x for x in (0.2, 0.45, 0.6)]
    floor = [np.tile(np.append(at[0].mean(0)[:2] + shift, 0.0), (len(at), 1)) for shift in ([0.8, 0.5], [1.2, 0.5])]
    yield "a racket and markers on the floor", replace(whole, beside=np.stack([*racket, *floor], 1))


def share(recording: Recording, protocol: tuple[bool, int, int, int], network: LabelNetwork) -> float:
    """Share of the visible markers that get their name."""
    cloud, seen = trial(recording.points, *protocol, 0)
    if recording.beside is not None:
        cloud = np.concatenate([cloud, recording.beside], 1)
    turn = np.eye(3) if recording.turn is None else recording.turn
    plan = find_marker_set(recording.asked)
    done = label_points(cloud @ turn.T * recording.unit, recording.fps, plan.markers, network)
    found = done.points[:, [plan.markers.labels.index(label) for label in recording.labels]] @ turn
    return float((np.linalg.norm(found - seen, axis=-1) < 1e-3).sum() / np.isfinite(seen[..., 0]).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="words that a variation's name must have one of")
    a = parser.parse_args()
    network, cloud = LabelNetwork(a.model or shipped_model("labels")), read_marker_cloud(a.file)
    names, labels = [n.split(":")[-1] for n in cloud.names], find_marker_set("pig39").markers.labels
    points = cloud.points[:, [names.index(label) for label in labels]]
    print("| variation | " + " | ".join(PROTOCOLS) + " |\n| --- |" + " --- |" * len(PROTOCOLS))
    for name, recording in variations(Recording(points, labels, cloud.fps)):
        if not a.only or any(word in name for word in a.only):
            cells = [f"{share(recording, protocol, network):.2%}" if not (protocol[0] and recording.beside is not None)
                     else "–" for protocol in PROTOCOLS.values()]  # fmt: skip
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
