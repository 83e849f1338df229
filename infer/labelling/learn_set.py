"""A marker set learned from one trial whose markers are labelled."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.marker_names import map_names, surface_of
from muybridge.geometry.landmarks.marker_sets import ANYWHERE, SETS, SURFACE, MarkerPlan, MarkerSet, plan_of
from muybridge.geometry.landmarks.real_markers import find_markers
from muybridge.geometry.markers.known_distances import measure_distances
from muybridge.geometry.markers.tracking import Tracks
from muybridge.infer.labelling.label import metres_of
from muybridge.infer.labelling.set_evidence import median_distances, name_evidence, partners_by_name, place_evidence
from muybridge.infer.labelling.settle import upright_by_network
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

_FRAMES = 200
_FEWEST = 6
# With this many markers known by their names, the others are found by their distances to them.
_ANCHORS = 6
# Root mean square of the differences from a person's usual distances, metres: up to the first a marker is on a body
# point, up to the second it is near one (and recognised by it), beyond it is on something else.
_ON_M, _NEAR_M = 0.04, 0.10
# The same on segments without landmarks, where markers are put anywhere.
_ON_SEGMENT_M, _NEAR_SEGMENT_M = 0.09, 0.25
_SEGMENT = (*ANYWHERE, "trochanter", "patella", "knee", "tibial")
# A network's probability counts for no less; so much worse than the best marker for a point is left out.
_LEAST_LOG, _LEFT_OUT = -3.0, -30.0
_SURE = 0.5
# Weight of a name that a set has for a marker anywhere on a segment.
_MEANT = 3.0


def learn_marker_set(trial: Path, model: Path | None) -> tuple[MarkerPlan, list[str]]:
    """The body points on which a trial's markers sit, the distances between the markers, and notes for the user.

    Names that marker sets know keep their meaning. For the others, sides and parts of the body that their names state,
    their distances to the known markers, and the network's probabilities are weighed together; every marker gets a
    point of its own.

    Raises:
        FormatError: the trial cannot be read, or its trajectories have no names of their own.
    """
    cloud = read_marker_cloud(trial)
    kinds = find_markers(cloud.names)
    named = np.nonzero(kinds.marker & ~kinds.unnamed)[0]
    labels = [plain_label(cloud.names[i]) for i in named]
    if len(set(labels)) < len(labels):
        twice = next(n for n in labels if labels.count(n) > 1)
        raise FormatError(f"{trial}: {twice!r} names more than one trajectory; give a trial with every marker labelled")
    if len(labels) < _FEWEST:
        raise FormatError(f"{trial}: {len(labels)} of its {len(cloud.names)} trajectories have names of markers; "
                          f"at least {_FEWEST} are needed")  # fmt: skip
    network = LabelNetwork(model or shipped_model("labels"))
    view = _View(cloud.points[:, named], cloud.fps, network)
    chosen, off = _assign(labels, view)
    kept = sorted(chosen)
    if len(kept) < _FEWEST:
        raise FormatError(f"{trial}: only {len(kept)} of its {len(labels)} trajectories are markers of a body; "
                          f"at least {_FEWEST} are needed")  # fmt: skip
    near = tuple(labels[k] for k in kept if _beside(chosen[k], off[k]))
    names = tuple(SURFACE.names[chosen[k]] for k in kept)
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    plan = plan_of(MarkerSet(trial.stem, names, edges, tuple(labels[k] for k in kept), near))
    partner, position = partners_by_name(labels), {k: i for i, k in enumerate(kept)}
    twins = tuple(position[partner[k]] if partner[k] != k and partner[k] in position else plan.twins[i]
                  for i, k in enumerate(kept))  # fmt: skip
    plan = replace(plan, twins=_mutual(twins), distances=measure_distances(view.tracks.points[:, kept]))
    return plan, [*view.notes, *_notes(labels, chosen, off, view)] + ([cloud.why] if cloud.why else [])


def plain_label(name: str) -> str:
    """A trajectory's name without its subject, as one word: a set's file has one marker per line, words apart."""
    return re.sub(r"[\s#]+", "_", name.rsplit(":", 1)[-1].strip())


def _beside(point: int, off: float) -> bool:
    """Whether a marker is beside its point rather than on it."""
    return off > (_ON_SEGMENT_M if any(part in SURFACE.names[point] for part in ANYWHERE) else _ON_M)


def _mutual(twins: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(twin if twins[twin] == i else i for i, twin in enumerate(twins))


def _notes(labels: list[str], chosen: dict[int, int], off: dict[int, float], view: _View) -> list[str]:
    notes = []
    for k in sorted(k for k in chosen if k not in view.known or surface_of(labels[k]) is None):
        where = SURFACE.names[chosen[k]]
        if _beside(chosen[k], off[k]):
            notes.append(f"{labels[k]} is on no body point that is known; it is recognised near {where}")
        else:
            notes.append(f"{labels[k]} stands on {where}")
    left = [labels[k] for k in range(len(labels)) if k not in chosen]
    if left:
        shown = ", ".join(left[:12]) + (f" and {len(left) - 12} more" if len(left) > 12 else "")
        notes.append(f"left out, for want of a body point of their own: {shown}")
    return notes


def _assign(labels: list[str], view: _View) -> tuple[dict[int, int], dict[int, float]]:
    """Trajectory -> point of SURFACE, and metres that each is off its usual place."""
    meant = {k: SURFACE.index(name) for name, k in map_names(labels).items()}
    words = name_evidence(labels)
    # Sets differ in how high markers are on a segment; a name says little more than the segment then.
    chosen = {k: p for k, p in meant.items() if not any(part in SURFACE.names[p] for part in ANYWHERE)}
    for k, p in meant.items():
        words[k, p] += _MEANT if k not in chosen else 0.0
    view.known = set(chosen)
    if len(chosen) < _ANCHORS:
        chosen |= _by_network(chosen, words, view)
    apart = median_distances(view.tracks.points[view.frames])
    if not chosen:
        return {}, {}
    card = view.network.card
    off: dict[int, float] = {}
    for _ in range(2):  # the second time, what the first found serves as known too
        place, rms = place_evidence(apart, chosen, (card.distance_m, card.motion_m, card.bodies_m))
        fixed = {k: p for k, p in chosen.items() if k in view.known}
        rest = np.array([k for k in range(len(labels)) if k not in fixed], np.intp)
        free = np.array([p for p in range(len(SURFACE)) if p not in fixed.values()], np.intp)
        score = words + place + np.maximum(np.log(view.probabilities(list(SURFACE.names)) + 1e-9), _LEAST_LOG)
        score = _symmetric(score, partners_by_name(labels), fixed)
        found = _matched(score, rms, rest, free)
        chosen = fixed | found
        off = {k: float(rms[k, p]) if k not in view.known else 0.0 for k, p in chosen.items()}
    return chosen, off


def _symmetric(score: FloatArray, partner: list[int], fixed: dict[int, int]) -> FloatArray:
    """Scores in which markers that differ in their side only agree on their points' mirror images."""
    mirror = np.array(SURFACE.mirror)
    out = score.copy()
    for k, other in enumerate(partner):
        if other != k and k not in fixed and other not in fixed:
            out[k] = (score[k] + score[other][mirror]) / 2
    return out


def _matched(score: FloatArray, rms: FloatArray, rest: IndexArray, free: IndexArray) -> dict[int, int]:
    """The best assignment of trajectories to points, one each; those too far from any are left out."""
    if not len(rest) or not len(free):
        return {}
    reach = np.array([_NEAR_SEGMENT_M if any(part in SURFACE.names[p] for part in _SEGMENT) else _NEAR_M for p in free])
    part = np.where(rms[np.ix_(rest, free)] <= reach, score[np.ix_(rest, free)], -1e3)
    # A column of its own for every trajectory, so that leaving it out is a choice too.
    padded = np.concatenate([part, np.full((len(rest), len(rest)), _LEFT_OUT)], 1)
    rows, columns = linear_sum_assignment(padded, maximize=True)
    return {int(rest[r]): int(free[c]) for r, c in zip(rows, columns, strict=True) if c < len(free)}


def _by_network(chosen: dict[int, int], words: FloatArray, view: _View) -> dict[int, int]:
    """Markers that the network is sure of, among the points of the well-known set of which it finds most."""
    asked = list(max(SETS.values(), key=lambda s: float(view.probabilities(list(s.names)).max(1).sum())).names)
    points = np.array([SURFACE.index(name) for name in asked])
    likely = view.probabilities(asked)
    rows, columns = linear_sum_assignment(np.log(likely + 1e-9) + words[:, points], maximize=True)
    return {int(r): int(points[c]) for r, c in zip(rows, columns, strict=True)
            if likely[r, c] > _SURE and r not in chosen and points[c] not in chosen.values()}  # fmt: skip


class _View:
    """A trial prepared for the network.

    Attributes:
        notes: for the user.
        known: trajectories whose names are known.
    """

    def __init__(self, points: FloatArray, fps: float, network: LabelNetwork) -> None:
        self.notes: list[str] = []
        self.known: set[int] = set()
        column = np.where(np.isfinite(points[..., 0]), np.arange(points.shape[1]), -1)
        self.tracks = Tracks(points * metres_of(points, self.notes), column, column, False)
        self.fps, self.network = fps, network
        self.turn = upright_by_network(self.tracks, fps, np.arange(len(SURFACE)), network)
        self.frames = np.linspace(0, len(points) - 1, min(_FRAMES, len(points))).astype(int)
        self._found: dict[tuple[str, ...], FloatArray] = {}

    def probabilities(self, names: list[str]) -> FloatArray:
        """(K, N) mean probability of the trajectories for some points of the body."""
        key = tuple(names)
        if key not in self._found:
            asked = np.array([SURFACE.index(name) for name in names])
            scores = self.network.scores(self.tracks, self.fps, asked, self.frames, self.turn)
            seen = np.isfinite(scores[..., :1])
            total = np.where(seen, np.exp(np.nan_to_num(scores[..., :-1])), 0).sum(0)
            self._found[key] = np.asarray(total / np.maximum(seen.sum(0), 1), np.float64)
        return self._found[key]
