"""How well and how fast recordings are labelled, and what each part brings.

    python -m scripts.benchmarks.markers.labelling LABELLED.c3d ... [--model labels.onnx] [--set pig39] [--seed 0]

Strips the names of recordings that are labelled, shuffles their points (anew in every frame, or whole trajectories),
hides and adds points, and compares what comes out with the names they had. One row a protocol, one column a variant.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.markers.tracking import TrackOptions
from muybridge.infer.labelling.label import LabelOptions, label_points
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

# Protocol: shuffled in every frame, most hidden a frame, ghosts a frame, broken trajectories.
PROTOCOLS = {
    "per frame": (True, 0, 0, 0), "per frame, 5 hidden, 3 ghosts": (True, 5, 3, 0), "whole": (False, 0, 0, 0),
    "whole, 5 hidden, 3 ghosts": (False, 5, 3, 0), "50 breaks, 5 hidden, 3 ghosts": (False, 5, 3, 50),
}  # fmt: skip
ALONE = LabelOptions(window=False, votes=False, distances=False, track=TrackOptions(shuffled=2.0))
VARIANTS = {
    "frame alone": ALONE, "+ distances": replace(ALONE, distances=True),
    "+ tracking, window": LabelOptions(votes=False, distances=False),
    "+ votes": LabelOptions(distances=False), "+ votes, distances": LabelOptions(),
}  # fmt: skip


def trial(
    truth: FloatArray, every: bool, hidden: int, ghosts: int, breaks: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """A shuffled cloud (T, K, 3) and what is still to be seen of the truth (T, M, 3)."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--set", default="pig39")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--protocols", nargs="*", default=list(PROTOCOLS))
    parser.add_argument("--variants", nargs="*", default=list(VARIANTS))
    a = parser.parse_args()
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


if __name__ == "__main__":
    main()
