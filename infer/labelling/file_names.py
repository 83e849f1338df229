"""The names that a file gives its trajectories: they hold unless the evidence against them is beyond doubt.

A laboratory knows where it put its markers: a marker named LTHI on the kneecap is LTHI, though another one stands where
LTHI usually is. Names that a person exchanged by mistake make distances impossible, and those are corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_names import map_names
from muybridge.geometry.landmarks.marker_sets import MarkerSet
from muybridge.geometry.markers.tracking import Tracks
from muybridge.geometry.markers.voting import join_pieces
from muybridge.geometry.markers.whole import Bodies, Judge, WholeOptions, find_columns
from muybridge.infer.labelling.certainty import MOST

# Fewer names than this, or than this share of the labels found, are no labelling.
_FEWEST, _SHARE = 6, 0.5
# The quality by the file's names relative to the best one, below which they are no labelling of this person.
_WORTH = 0.4
# What a name of the file is worth in the quality of the whole, and what a name for a trajectory that the file calls
# otherwise costs.
_OWN, _FOREIGN = 6.0, 25.0
# Wrong names beyond this number are no further mistakes.
_ALONE = 4
# Smallest share of a trajectory that counts as another marker, and how certain that must be.
_PART, _CERTAIN = 0.02, 0.9
# What a name of the file adds to the logarithm of the odds that it is right, and what a contradiction takes away.
SUPPORT, CONTRADICTION = 3.0, 2.0


def columns_of(names: Sequence[str], markers: MarkerSet) -> IndexArray:
    """(A,) the column of the file that has the name of each label, or another known name for it; -1 for none.

    Args:
        names: (K,) of the file, prefixes of subjects included.
        markers: the set.
    """
    plain = [name.rsplit(":", 1)[-1].strip().upper() for name in names]
    out = np.full(len(markers), -1, np.intp)
    for a, label in enumerate(markers.labels):
        if plain.count(label.upper()) == 1:
            out[a] = plain.index(label.upper())
    known = map_names(list(names))
    for a, point in enumerate(markers.names):
        k = known.get(point, -1)
        # A number that is dropped to find a name (LTHI2) may as well mean another marker; so may a name given twice.
        if out[a] < 0 and k >= 0 and k not in out and plain.count(plain[k]) == 1 and not plain[k][-1:].isdigit():
            out[a] = k
    return out


def believe_names(label: IndexArray, confidence: FloatArray, hint: IndexArray, foreign: BoolArray, scores: FloatArray,
                  tracks: Tracks, bodies: Bodies, options: WholeOptions) -> tuple[IndexArray, BoolArray]:  # fmt: skip
    """The labelling with the file's names where nothing speaks against them beyond doubt.

    Args:
        label: (T, S) what was found without the names, -1 for none.
        confidence: (T, A) of it.
        hint: (A,) columns of the file by its names, see `columns_of`.
        foreign: (K,) columns to which the file gives a name that is no label of the set.
        scores: (T, S, A + 1) log probabilities; NaN where there is no point.
        tracks: trajectories.
        bodies: distances of the set.
        options: see `WholeOptions`.

    Returns:
        (T, S) labels, and (A,) the labels whose columns are those of the file's names.
    """
    size = len(hint)
    nothing = np.zeros(size, bool)
    if tracks.tracked or (hint >= 0).sum() < max(_FEWEST, _SHARE * len(np.unique(label[label >= 0]))):
        return label, nothing
    usual = _usual_columns(label, tracks.column, size)
    by_name = _relabelled(label, confidence, tracks.column, hint, usual)
    whole = join_pieces(tracks.track, tracks.column, tracks.tracked)
    columns = find_columns(tracks.points, whole, by_name, scores, options)
    judge = Judge(columns, bodies, options)
    # The column of the file that each candidate is.
    own = np.concatenate(
        [np.where(hint >= 0, hint, _usual_columns(by_name, tracks.column, size)), columns.piece[size:]]
    )
    place = {int(c): k for k, c in enumerate(own) if c >= 0}
    named = judge.start
    found = np.array([place.get(int(c), -1) for c in usual], np.intp)
    if judge.quality(named) < _WORTH * judge.quality(found):
        return label, nothing
    prior = np.zeros_like(columns.gain)
    said = np.nonzero((hint >= 0) & (named >= 0))[0]
    prior[named[said], said] = _OWN
    prior[[k for k in range(size, len(own)) if foreign[own[k]]]] = -_FOREIGN
    judge = Judge(replace(columns, gain=columns.gain + prior / options.network), bodies, options)
    mostly = np.where((found >= size) & foreign[own[np.maximum(found, 0)]], named, found)
    mostly[(mostly >= 0) & (np.bincount(mostly[mostly >= 0], minlength=len(own))[mostly] > 1)] = -1
    chosen = max((judge.improve(named), judge.improve(found), mostly),
                 key=lambda c: judge.quality(c) + _together(int((c != named)[said].sum())))  # fmt: skip
    lost = (chosen < 0) & (named >= 0) & ~np.isin(named, chosen)
    chosen[lost] = named[lost]
    kept = np.where(chosen >= 0, own[np.maximum(chosen, 0)], -1)
    out = _relabelled(label, confidence, tracks.column, kept, usual)
    return out, (kept == hint) & (hint >= 0)


def _together(differ: int) -> float:
    """What names that differ together cost less than each by itself: who mistakes a leg mistakes all its names."""
    return (_OWN - 1.0) * max(differ - _ALONE, 0)


def _usual_columns(label: IndexArray, column: IndexArray, size: int) -> IndexArray:
    """(A,) the column that each label has in most frames, -1 for none."""
    out = np.full(size, -1, np.intp)
    for a in range(size):
        at = column[label == a]
        if len(at):
            out[a] = int(np.bincount(at).argmax())
    return out


def _relabelled(label: IndexArray, confidence: FloatArray, column: IndexArray, wanted: IndexArray,
                usual: IndexArray) -> IndexArray:  # fmt: skip
    """Labels (T, S) in which every column of `wanted` (A,) has its label, but for parts that are certainly another
    marker's than the rest of the column is."""
    out = label.copy()
    rest = {int(c): a for a, c in enumerate(usual) if c >= 0}
    for a, c in enumerate(wanted):
        if c < 0:
            continue
        own = column == c
        for b in np.unique(label[own & (label >= 0)]):
            t, s = np.nonzero(own & (label == b))
            apart = b not in (a, rest.get(int(c), -1)) and len(t) >= _PART * own.sum()
            if not (apart and confidence[t, b].mean() > _CERTAIN):
                out[t, s] = a
        out[own & (label < 0)] = a
    # A label is one point of a frame: the column of the file's name has it.
    for a, c in enumerate(wanted):
        if c >= 0:
            mine = (out == a) & (column == c)
            out[(out == a) & (column != c) & mine.any(1)[:, None]] = -1
    return out


def with_names(certainty: FloatArray, column: IndexArray, hint: IndexArray, kept: BoolArray) -> FloatArray:
    """Certainty (T, A) that knows of the file's names: what they support is surer, what they contradict less.

    Args:
        certainty: (T, A) without them.
        column: (T, A) column of the file that each label has, -1 for none.
        hint: (A,) columns by the file's names, -1 for none.
        kept: (A,) whether the file's names were believed.
    """
    supported = kept & (column == hint)
    against = (hint >= 0) & kept.any() & (column >= 0) & ~supported
    p = np.clip(certainty, 1e-6, 1 - 1e-6)
    odds = np.log(p / (1 - p)) + SUPPORT * supported - CONTRADICTION * against
    return np.where(supported | against, np.minimum(1 / (1 + np.exp(-odds)), MOST), certainty)
