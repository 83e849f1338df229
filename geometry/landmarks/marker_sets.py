"""Marker sets by name: what laboratories put where."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.landmarks.arrays import CMU, PLUG_IN_GAIT, SURFACE, MarkerSet

JITTER_MM = 15.0


@dataclass(frozen=True)
class MarkerPlan:
    """A marker set and how it is put on.

    Attributes:
        markers: labels and the points of `SURFACE` they stand on.
        jitter_m: (M,) how loosely each is placed, 1 sigma, metres.
        optional: (M,) whether recordings may lack it.
        twins: (M,) index of the marker on the other side, its own where there is none.
    """

    markers: MarkerSet
    jitter_m: NDArray[np.float64]
    optional: NDArray[np.bool_]
    twins: tuple[int, ...]


def _subset(markers: MarkerSet, name: str, without: tuple[str, ...] = (), only: tuple[str, ...] = ()) -> MarkerSet:
    keep = [i for i, label in enumerate(markers.labels)
            if (not only or label.lstrip("LR") in only) and label.lstrip("LR") not in without]  # fmt: skip
    names = tuple(markers.names[i] for i in keep)
    edges = tuple(e for e in markers.edges if e[0] in names and e[1] in names)
    return MarkerSet(name, names, edges, tuple(markers.labels[i] for i in keep))


def _more(markers: MarkerSet, name: str, more: dict[str, str]) -> MarkerSet:
    names = (*markers.names, *more.values())
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    return MarkerSet(name, names, edges, (*markers.labels, *more))


_LEGS = _subset(PLUG_IN_GAIT, "lower16", only=("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE"))
_MEDIAL = {"LKNM": "left_knee_medial", "RKNM": "right_knee_medial", "LANM": "left_malleolus_medial",
           "RANM": "right_malleolus_medial"}  # fmt: skip
SETS: dict[str, MarkerSet] = {
    "pig39": PLUG_IN_GAIT,
    "pig37": _subset(PLUG_IN_GAIT, "pig37", without=("FIN",)),
    "pig35": _subset(PLUG_IN_GAIT, "pig35", without=("UPA", "FRM")),
    "pig43": _more(PLUG_IN_GAIT, "pig43", _MEDIAL),
    "cmu41": CMU,
    "lower16": _LEGS,
    "lower22": _more(_LEGS, "lower22", _MEDIAL | {"LMT5": "left_metatarsal_5", "RMT5": "right_metatarsal_5"}),
}


def plan_of(markers: MarkerSet) -> MarkerPlan:
    """A set as it stands: usual jitter, everything optional but what tells the body apart."""
    anywhere = ("upper_arm", "forearm", "thigh", "shank", "scapula")
    loose = np.array([any(stem in name for stem in anywhere) for name in markers.names])
    return MarkerPlan(markers, np.where(loose, 0.04, JITTER_MM / 1000), loose, twins_of(markers))


def twins_of(markers: MarkerSet) -> tuple[int, ...]:
    """By body point, or by label where the body point has no twin in the set (heights may differ on purpose)."""
    names, by_label = list(markers.names), markers.mirror
    twins = []
    for i, name in enumerate(names):
        other = SURFACE.names[SURFACE.mirror[SURFACE.index(name)]]
        twins.append(names.index(other) if other in names and other != name else by_label[i])
    return tuple(twins)
