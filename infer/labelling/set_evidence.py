"""Evidence for the point of the body on which a marker of an unknown set stands: its name, and where it is."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_names import normal, side_of_label, words_of
from muybridge.geometry.landmarks.marker_sets import SURFACE

# Part of the body -> stems of SURFACE's points on it, and the words that name it. Letters of short labels (RTH1) too.
_PARTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "head": (("crown", "head"), ("head", "temple", "forehead", "hd", "hed", "occ", "ear", "nas", "skull", "vertex")),
    "trunk": (("c7", "t10", "sternal", "xiphoid", "scapula", "acromion"),
              ("sternum", "stern", "chest", "thorax", "trunk", "back", "spine", "clav", "scap", "scapula", "rib", "bak",
               "c7", "acr", "shoulder", "sho", "trx", "thx", "xiph", "strn", "jug", "t")),
    "pelvis": (("asis", "psis", "sacrum", "iliac", "trochanter"),
               ("pelvis", "pelv", "hip", "asis", "psis", "asi", "psi", "sacrum", "sacr", "sacral", "iliac", "crest",
                "ic", "waist", "wt", "troch", "gt", "l")),
    "upper arm": (("acromion", "upper_arm", "elbow"), ("arm", "upperarm", "upa", "ua", "bicep", "biceps", "tricep",
                                                       "humerus", "hum", "delt", "deltoid")),
    "elbow": (("elbow",), ("elbow", "elb", "el", "epicondyle")),
    "forearm": (("forearm", "radial", "ulnar", "elbow"), ("forearm", "frm", "fa", "radius", "ulna", "rad", "uln",
                                                          "lowerarm")),
    "wrist": (("radial", "ulnar"), ("wrist", "wr", "wri")),
    "hand": (("metacarpal",), ("hand", "finger", "fin", "metacarpal", "mc", "knuckle", "han")),
    "thigh": (("thigh", "trochanter"), ("thigh", "thi", "th", "femur", "fem", "quad")),
    "knee": (("knee", "patella"), ("knee", "kne", "kn", "condyle")),
    "shank": (("shank", "tibial"), ("shank", "shn", "sh", "shin", "tibia", "tib", "tb", "tub", "calf", "fib",
                                    "fibula", "hfb", "leg", "sk")),
    "ankle": (("malleolus",), ("ankle", "ank", "malleolus", "mal")),
    "foot": (("heel", "metatarsal", "toe", "hallux", "malleolus"),
             ("foot", "ft", "midfoot", "toe", "heel", "hee", "calc", "cal", "calcaneus", "met", "meta", "mt",
              "metatarsal", "hallux", "hlx", "nav", "navicular", "instep", "cpg", "stl", "lca")),
}  # fmt: skip
_NEIGHBOURS = {"thigh": ("knee",), "knee": ("thigh", "shank"), "shank": ("knee", "ankle"), "foot": ("ankle",),
               "ankle": ("shank", "foot"), "forearm": ("wrist",), "wrist": ("forearm", "hand"), "hand": ("wrist",),
               "elbow": ("upper arm", "forearm"), "upper arm": ("elbow",)}  # fmt: skip
_SIDE, _MIDDLE, _ELSEWHERE, _NEXT = -20.0, -20.0, -20.0, -2.0
# Standard deviations of a distance: what every marker's place is off, metres; no distance counts for more than so many.
_PLACE_M, _MOST_SIGMAS = 0.02, 5.0
_CLOSEST = 8


def parts_of(name: str) -> tuple[str, ...]:
    """The parts of the body that a name's words mention, by whole words, or by the letters of a short label."""
    side, words = words_of(name)
    if not side and side_of_label(name) and words:
        words = [words[0][1:], *words[1:]]
    plain = [re.sub(r"\d+$", "", w) for w in words]
    found = tuple(part for part, (_, known) in _PARTS.items() if any(w in known for w in plain))
    if found or not plain:
        return found
    # Codes such as LHFTFL say nothing; LTHIA begins with a part of three letters.
    return tuple(part for part, (_, known) in _PARTS.items()
                 if any(len(k) >= 3 and plain[0].startswith(k) for k in known))  # fmt: skip


def name_evidence(labels: Sequence[str]) -> FloatArray:
    """(K, 72) logarithm, up to a constant, of how well names agree with points of SURFACE: sides, parts of the body."""
    sides = [side_of_label(label) for label in labels]
    has_sides = np.mean([bool(side) for side in sides]) > 0.5
    out = np.zeros((len(labels), len(SURFACE)))
    stems = [re.sub(r"^(left|right)_", "", name) for name in SURFACE.names]
    of_point = ["left" if n.startswith("left_") else "right" if n.startswith("right_") else "" for n in SURFACE.names]
    for k, (label, side) in enumerate(zip(labels, sides, strict=True)):
        parts = parts_of(label)
        close = {n for part in parts for n in _NEIGHBOURS.get(part, ())}
        for p, (stem, where) in enumerate(zip(stems, of_point, strict=True)):
            if side:
                out[k, p] += 0.0 if where == side else _SIDE if where else _MIDDLE
            elif has_sides and where:
                out[k, p] += _MIDDLE
            if parts and not any(stem.startswith(s) or s in stem for part in parts for s in _PARTS[part][0]):
                near = any(s in stem for part in close for s in _PARTS[part][0])
                out[k, p] += _NEXT if near else _ELSEWHERE
            for word, face in (("med", "medial"), ("lat", "lateral")):
                if re.search(rf"(?i){word}(?:ial|eral)?$", label) and stem.endswith(("medial", "lateral")):
                    out[k, p] += 1.0 if stem.endswith(face) else -1.0
    return out


def partners_by_name(labels: Sequence[str]) -> list[int]:
    """Index of each label's counterpart on the other side, by names that differ in their side only; else its own."""
    keys = []
    for label in labels:
        side, words = words_of(label)
        stated = side_of_label(label)
        rest = "".join(words) if side else normal(label)[1:] if stated else normal(label)
        keys.append((stated, rest))
    other = {"left": "right", "right": "left"}
    at = {key: i for i, key in enumerate(keys)}
    return [at.get((other.get(side, "-"), rest), i) for i, (side, rest) in enumerate(keys)]


def median_distances(points: FloatArray) -> FloatArray:
    """(K, K) median distances, metres, between trajectories (T, K, 3); NaN where two are never seen together."""
    out = np.full((points.shape[1],) * 2, np.nan)
    for k in range(points.shape[1]):
        apart = np.linalg.norm(points - points[:, k, None], axis=-1)
        seen = np.isfinite(apart).any(0)
        out[k, seen] = np.nanmedian(apart[:, seen], 0)
    return out


def place_evidence(
    apart_m: FloatArray, anchors: dict[int, int], table: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """How well trajectories are where points of the body should be, by their distances to markers that are known.

    Args:
        apart_m: (K, K) distances between trajectories, metres.
        anchors: trajectory -> point of SURFACE, of those that are known.
        table: (72, 72) each, metres: mean distances between points of SURFACE, their standard deviations by motion and
            between bodies.

    Returns:
        (K, 72) logarithm of the likelihood up to a constant, and (K, 72) root mean square of the differences, metres.
    """
    mean, motion, bodies = table
    known = np.array(list(anchors), np.intp)
    at: IndexArray = np.array([anchors[k] for k in known], np.intp)
    size = _size(apart_m, known, at, mean)
    sigma = np.sqrt(motion[:, at] ** 2 + (0.5 * bodies[:, at]) ** 2 + _PLACE_M**2)
    off = apart_m[:, known][:, None] - size * mean[:, at]
    itself = np.arange(len(apart_m))[:, None] == known
    off[np.broadcast_to(itself[:, None], off.shape)] = np.nan
    # A marker is tied to those of its own part of the body more than to others: the closest for every point count.
    rank = np.argsort(np.argsort(np.where(np.isfinite(off), sigma, np.inf), 2), 2)
    there = np.isfinite(off) & (rank < _CLOSEST)
    count = np.maximum(there.sum(2), 1)
    z = np.where(there, np.minimum(np.abs(off) / sigma, _MOST_SIGMAS), 0.0)
    rms = np.sqrt(np.where(there, off**2, 0).sum(2) / count)
    # Distances are not independent: all together count as two of three.
    return -0.5 * (z**2).sum(2) / count * 3.0, np.where(there.any(2), rms, np.inf)


def _size(apart_m: FloatArray, known: IndexArray, at: IndexArray, mean: FloatArray) -> float:
    """The person's size relative to the table's."""
    measured, usual = apart_m[np.ix_(known, known)], mean[np.ix_(at, at)]
    pairs = np.isfinite(measured) & (usual > 0.1)
    return float(np.clip(np.median(measured[pairs] / usual[pairs]), 0.4, 1.4)) if pairs.any() else 1.0
