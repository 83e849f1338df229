"""A marker set learned from one trial whose markers are labelled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE, MarkerPlan, MarkerSet, plan_of
from muybridge.geometry.markers.tracking import Tracks
from muybridge.infer.labelling.label import metres_of, upright
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

_FRAMES = 200
# With this many labels of well-known sets, the set's other points are likely theirs or their mirror images.
_FEW = 6
# A trajectory whose probability for every body point is lower belongs to something else (a racket, a cluster).
_LEAST = 0.2


def learn_marker_set(trial: Path, model: Path | None) -> tuple[MarkerPlan, list[str]]:
    """The body points on which a trial's markers sit, and notes for the user.

    Labels of well-known sets keep their meaning; the network assigns the others to the remaining points.

    Raises:
        FormatError: the trial cannot be read, or its trajectories have no names of their own.
    """
    cloud = read_marker_cloud(trial)
    labels = [name.split(":")[-1] for name in cloud.names]
    if len(set(labels)) < len(labels):
        twice = next(n for n in labels if labels.count(n) > 1)
        raise FormatError(f"{trial}: {twice!r} names more than one trajectory; give a trial with every marker labelled")
    known = {label: name for s in reversed(SETS.values()) for label, name in zip(s.labels, s.names, strict=True)}
    chosen: dict[str, str] = {label: known[label] for label in labels if label in known}
    view = _View(cloud.points, cloud.fps, LabelNetwork(model or shipped_model("labels")))
    notes = view.notes
    # First among the points of this kind of set, where the network is most accurate; then among all.
    for asked, least in ((_likely(chosen, view), 0.5), (list(SURFACE.names), _LEAST)):
        rest = [i for i, label in enumerate(labels) if label not in chosen]
        free = [i for i, name in enumerate(asked) if name not in chosen.values()]
        if rest and free:
            likelihood = view.probabilities(asked)[np.ix_(rest, free)]
            for row, col in zip(*linear_sum_assignment(likelihood, maximize=True), strict=True):
                if likelihood[row, col] > least:
                    chosen[labels[rest[row]]] = asked[free[col]]
                    notes.append(
                        f"{labels[rest[row]]} stands on {asked[free[col]]} ({likelihood[row, col]:.0%} certain)"
                    )
    notes += [f"{label} is on no point of the body that is known: left out" for label in labels if label not in chosen]
    kept = [label for label in labels if label in chosen]
    if len(kept) < 6:
        raise FormatError(f"{trial}: only {len(kept)} of its {len(labels)} trajectories are markers of a body; "
                          "at least 6 are needed")  # fmt: skip
    names = tuple(chosen[label] for label in kept)
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    return plan_of(MarkerSet(trial.stem, names, edges, tuple(kept))), notes


def _likely(chosen: dict[str, str], view: _View) -> list[str]:
    """Points that a set like this has: the known ones and their mirror images, or those of the well-known set of which
    the network finds most."""
    if len(chosen) >= _FEW:
        twins = {SURFACE.names[SURFACE.mirror[SURFACE.index(name)]] for name in chosen.values()}
        return list(dict.fromkeys([*chosen.values(), *sorted(twins)]))
    return list(max(SETS.values(), key=lambda s: float(view.probabilities(list(s.names)).max(1).sum())).names)


class _View:
    """A trial prepared for the network.

    Attributes:
        notes: for the user.
    """

    def __init__(self, points: FloatArray, fps: float, network: LabelNetwork) -> None:
        self.notes: list[str] = []
        column = np.where(np.isfinite(points[..., 0]), np.arange(points.shape[1]), -1)
        self.tracks = Tracks(points * metres_of(points, self.notes), column, column, False)
        self.fps, self.network = fps, network
        self.turn = upright(self.tracks, fps, np.arange(len(SURFACE)), network)
        self.frames = np.linspace(0, len(points) - 1, min(_FRAMES, len(points))).astype(int)

    def probabilities(self, names: list[str]) -> FloatArray:
        """(K, N) mean probability of the trajectories for some points of the body."""
        asked = np.array([SURFACE.index(name) for name in names])
        scores = self.network.scores(self.tracks, self.fps, asked, self.frames, self.turn)
        seen = np.isfinite(scores[..., :1])
        total = np.where(seen, np.exp(np.nan_to_num(scores[..., :-1])), 0).sum(0)
        return np.asarray(total / np.maximum(seen.sum(0), 1), np.float64)
