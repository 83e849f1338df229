"""A marker set learned from one trial whose markers are labelled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from muybridge.errors import FormatError
from muybridge.geometry.landmarks import SURFACE, MarkerSet
from muybridge.geometry.marker_sets import SETS, MarkerPlan, plan_of
from muybridge.geometry.marker_tracking import Tracks
from muybridge.infer.label_network import LabelNetwork
from muybridge.infer.labelling import metres_of, upright
from muybridge.models.registry import shipped_model
from muybridge.motion.formats.marker_cloud import read_marker_cloud

_FRAMES = 200
# A trajectory that is less than this share of its votes a marker of the body is something else (a racket, a cluster).
_LEAST = 0.2


def learn_marker_set(trial: Path, model: Path | None) -> tuple[MarkerPlan, list[str]]:
    """The points of the body that a trial's markers stand on, and what the user should know.

    Names that well-known sets use keep their meaning; the others are found by the network, among the points left.

    Raises:
        FormatError: the trial cannot be read, or its trajectories have no names of their own.
    """
    cloud = read_marker_cloud(trial)
    labels = [name.split(":")[-1] for name in cloud.names]
    if len(set(labels)) < len(labels):
        twice = next(n for n in labels if labels.count(n) > 1)
        raise FormatError(f"{trial}: {twice!r} names more than one trajectory; give a trial with every marker labelled")
    known = {label: name for s in reversed(SETS.values()) for label, name in zip(s.labels, s.names, strict=True)}
    said, notes = _network_says(cloud.points, cloud.fps, LabelNetwork(model or shipped_model("labels")))
    chosen: dict[str, str] = {label: known[label] for label in labels if label in known}
    free = [i for i, name in enumerate(SURFACE.names) if name not in chosen.values()]
    rest = [i for i, label in enumerate(labels) if label not in chosen]
    if rest and free:
        rows, cols = linear_sum_assignment(said[np.ix_(rest, free)], maximize=True)
        for row, col in zip(rows, cols, strict=True):
            if said[rest[row], free[col]] > _LEAST:
                chosen[labels[rest[row]]] = SURFACE.names[free[col]]
                sure = said[rest[row], free[col]]
                notes.append(f"{labels[rest[row]]} stands on {SURFACE.names[free[col]]} ({sure:.0%} certain)")
            else:
                notes.append(f"{labels[rest[row]]} is on no point of the body that is known: left out")
    kept = [label for label in labels if label in chosen]
    if len(kept) < 6:
        raise FormatError(f"{trial}: only {len(kept)} of its {len(labels)} trajectories are markers of a body; "
                          "at least 6 are needed")  # fmt: skip
    names = tuple(chosen[label] for label in kept)
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    return plan_of(MarkerSet(trial.stem, names, edges, tuple(kept))), notes


def _network_says(points: np.ndarray, fps: float, network: LabelNetwork) -> tuple[np.ndarray, list[str]]:  # type: ignore[type-arg]
    """(K, L) mean probability of a file's trajectories for every point of the body, and notes."""
    notes: list[str] = []
    scaled = points * metres_of(points, notes)
    seen = np.isfinite(points[..., 0])
    column = np.where(seen, np.arange(points.shape[1]), -1)
    tracks = Tracks(scaled, column, column, False)
    everything = np.arange(len(SURFACE))
    turn = upright(tracks, fps, everything, network)
    frames = np.linspace(0, len(points) - 1, min(_FRAMES, len(points))).astype(int)
    scores = network.scores(tracks, fps, everything, frames, turn)
    with np.errstate(all="ignore"):
        mean = np.nanmean(np.exp(scores[..., :-1]), 0)
    return np.nan_to_num(mean), notes
