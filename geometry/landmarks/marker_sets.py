"""Marker sets: the markers that laboratories use, and their positions on the body."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.sets import LandmarkSet, both

# Landmarks of the skin, defined on the body model's mesh by the synthesis of markers; each once for all sets.
SURFACE = LandmarkSet(
    name="surface",
    names=(
        "crown", "left_front_head", "right_front_head", "left_back_head", "right_back_head", "c7", "t10",
        "sternal_notch", "xiphoid", "left_scapula", "right_scapula", "left_asis", "right_asis", "left_psis",
        "right_psis", "sacrum", "left_iliac_crest", "right_iliac_crest", "left_trochanter", "right_trochanter",
        "left_acromion", "right_acromion", "left_upper_arm_proximal", "right_upper_arm_proximal",
        "left_upper_arm_distal", "right_upper_arm_distal", "left_elbow_lateral", "right_elbow_lateral",
        "left_elbow_medial", "right_elbow_medial", "left_forearm_proximal", "right_forearm_proximal",
        "left_forearm_distal", "right_forearm_distal", "left_radial_styloid", "right_radial_styloid",
        "left_ulnar_styloid", "right_ulnar_styloid", "left_metacarpal_2", "right_metacarpal_2", "left_metacarpal_5",
        "right_metacarpal_5", "left_thigh_proximal", "right_thigh_proximal", "left_thigh_distal",
        "right_thigh_distal", "left_knee_lateral", "right_knee_lateral", "left_knee_medial", "right_knee_medial",
        "left_patella", "right_patella", "left_tibial_tuberosity", "right_tibial_tuberosity", "left_shank_proximal",
        "right_shank_proximal", "left_shank_distal", "right_shank_distal", "left_malleolus_lateral",
        "right_malleolus_lateral", "left_malleolus_medial", "right_malleolus_medial", "left_heel", "right_heel",
        "left_metatarsal_1", "right_metatarsal_1", "left_toe", "right_toe", "left_metatarsal_5",
        "right_metatarsal_5", "left_hallux", "right_hallux",
    ),
    edges=(
        ("c7", "t10"), ("sternal_notch", "xiphoid"), ("left_asis", "right_asis"), ("left_psis", "right_psis"),
        ("left_front_head", "right_front_head"), ("left_back_head", "right_back_head"),
        *both("front_head", "back_head"), *both("acromion", "upper_arm_proximal"),
        *both("upper_arm_proximal", "upper_arm_distal"), *both("upper_arm_distal", "elbow_lateral"),
        *both("elbow_lateral", "elbow_medial"), *both("elbow_lateral", "forearm_proximal"),
        *both("forearm_proximal", "forearm_distal"), *both("forearm_distal", "radial_styloid"),
        *both("radial_styloid", "ulnar_styloid"), *both("radial_styloid", "metacarpal_2"),
        *both("ulnar_styloid", "metacarpal_5"), *both("metacarpal_2", "metacarpal_5"),
        *both("asis", "iliac_crest"), *both("iliac_crest", "psis"), *both("trochanter", "thigh_proximal"),
        *both("thigh_proximal", "thigh_distal"), *both("thigh_distal", "knee_lateral"),
        *both("knee_lateral", "patella"), *both("patella", "knee_medial"), *both("patella", "tibial_tuberosity"),
        *both("knee_lateral", "shank_proximal"), *both("shank_proximal", "shank_distal"),
        *both("shank_distal", "malleolus_lateral"), *both("knee_medial", "malleolus_medial"),
        *both("malleolus_lateral", "heel"), *both("malleolus_medial", "heel"), *both("toe", "hallux"),
        *both("metatarsal_1", "toe"), *both("toe", "metatarsal_5"), *both("heel", "metatarsal_1"),
        *both("heel", "metatarsal_5"),
    ),
)  # fmt: skip
MarkerChoice = Literal["none", "plug-in-gait", "cmu", "all"]
# Points on segments, not on bones: where exactly a set has them is a matter of taste.
ANYWHERE = ("upper_arm", "forearm", "thigh", "shank", "scapula")
JITTER_MM, _LOOSE_MM, _NEAR_MM = 15.0, 40.0, 60.0
_MEDIAL = {"LKNM": "left_knee_medial", "RKNM": "right_knee_medial", "LANM": "left_malleolus_medial",
           "RANM": "right_malleolus_medial"}  # fmt: skip


@dataclass(frozen=True)
class MarkerSet(LandmarkSet):
    """A laboratory's marker set: `names` are those of `SURFACE`, `labels` the laboratory's own (``LASI``).

    Left and right markers of a limb may be at different heights on purpose; left-right pairs are defined by the labels.

    Attributes:
        labels: of the markers.
        near: labels of markers that stand near their point, not on it: enough to recognise them by, not to fit a body.
    """

    labels: tuple[str, ...]
    near: tuple[str, ...] = ()

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each marker the index of its counterpart on the other side, by label (itself where there is none)."""
        flip = {"L": "R", "R": "L", "l": "r", "r": "l"}
        twins = [flip.get(label[0], label[0]) + label[1:] for label in self.labels]
        return tuple(self.labels.index(t) if t in self.labels else i for i, t in enumerate(twins))

    @property
    def surface_indices(self) -> tuple[int, ...]:
        """Index of each marker in `SURFACE`: ``points[:, PLUG_IN_GAIT.surface_indices]`` are the points of the set."""
        return tuple(SURFACE.index(n) for n in self.names)


@dataclass(frozen=True, eq=False)
class MarkerDistances:
    """Distances between a person's M markers, measured in a labelled recording.

    Attributes:
        mean_m: (M, M) metres, NaN where a pair was not measured.
        sigma_m: (M, M) their standard deviation while the person moved.
    """

    mean_m: FloatArray
    sigma_m: FloatArray


@dataclass(frozen=True)
class MarkerPlan:
    """A marker set and how it is placed on people.

    Attributes:
        markers: labels, and the points of `SURFACE` at which the markers are placed.
        jitter_m: (M,) standard deviation of each marker's placement, metres.
        optional: (M,) whether recordings may lack the marker.
        twins: (M,) index of the marker's counterpart on the other side, its own where there is none.
        distances: between the markers of one person, where the set was learned from one.
    """

    markers: MarkerSet
    jitter_m: FloatArray
    optional: BoolArray
    twins: tuple[int, ...]
    distances: MarkerDistances | None = None


def _set(name: str, by_label: dict[str, str]) -> MarkerSet:
    chosen = set(by_label.values())
    edges = tuple((a, b) for a, b in SURFACE.edges if a in chosen and b in chosen)
    return MarkerSet(name, tuple(by_label.values()), edges, tuple(by_label))


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


def plan_of(markers: MarkerSet) -> MarkerPlan:
    """A set with the usual jitter, in which only the markers that separate the parts of the body are required."""
    near = np.array([label in markers.near for label in markers.labels])
    loose = np.array([any(stem in name for stem in ANYWHERE) for name in markers.names]) | near
    jitter = np.where(near, _NEAR_MM, np.where(loose, _LOOSE_MM, JITTER_MM)) / 1000
    return MarkerPlan(markers, jitter, loose, twins_of(markers))


def twins_of(markers: MarkerSet) -> tuple[int, ...]:
    """Counterparts by body point, or by label where the body point has none in the set (heights may differ)."""
    names, by_label = list(markers.names), markers.mirror
    twins = []
    for i, name in enumerate(names):
        other = SURFACE.names[SURFACE.mirror[SURFACE.index(name)]]
        twins.append(names.index(other) if other in names and other != name else by_label[i])
    return tuple(twins)


# Vicon's Plug-in Gait, whole body, 39 markers.
PLUG_IN_GAIT = _set(
    "plug_in_gait",
    {
        "LFHD": "left_front_head", "RFHD": "right_front_head", "LBHD": "left_back_head", "RBHD": "right_back_head",
        "C7": "c7", "T10": "t10", "CLAV": "sternal_notch", "STRN": "xiphoid", "RBAK": "right_scapula",
        "LSHO": "left_acromion", "LUPA": "left_upper_arm_proximal", "LELB": "left_elbow_lateral",
        "LFRM": "left_forearm_distal", "LWRA": "left_radial_styloid", "LWRB": "left_ulnar_styloid",
        "LFIN": "left_metacarpal_2", "RSHO": "right_acromion", "RUPA": "right_upper_arm_distal",
        "RELB": "right_elbow_lateral", "RFRM": "right_forearm_proximal", "RWRA": "right_radial_styloid",
        "RWRB": "right_ulnar_styloid", "RFIN": "right_metacarpal_2", "LASI": "left_asis", "RASI": "right_asis",
        "LPSI": "left_psis", "RPSI": "right_psis", "LTHI": "left_thigh_distal", "LKNE": "left_knee_lateral",
        "LTIB": "left_shank_distal", "LANK": "left_malleolus_lateral", "LHEE": "left_heel", "LTOE": "left_toe",
        "RTHI": "right_thigh_proximal", "RKNE": "right_knee_lateral", "RTIB": "right_shank_proximal",
        "RANK": "right_malleolus_lateral", "RHEE": "right_heel", "RTOE": "right_toe",
    },
)  # fmt: skip


# The 41 markers of the Carnegie Mellon motion capture database.
CMU = _set(
    "cmu",
    {
        "LFHD": "left_front_head", "RFHD": "right_front_head", "LBHD": "left_back_head", "RBHD": "right_back_head",
        "C7": "c7", "T10": "t10", "CLAV": "sternal_notch", "STRN": "xiphoid", "RBAC": "right_scapula",
        "LSHO": "left_acromion", "LUPA": "left_upper_arm_proximal", "LELB": "left_elbow_lateral",
        "LFRM": "left_forearm_distal", "LWRA": "left_radial_styloid", "LWRB": "left_ulnar_styloid",
        "LFIN": "left_metacarpal_2", "RSHO": "right_acromion", "RUPA": "right_upper_arm_distal",
        "RELB": "right_elbow_lateral", "RFRM": "right_forearm_proximal", "RWRA": "right_radial_styloid",
        "RWRB": "right_ulnar_styloid", "RFIN": "right_metacarpal_2", "LFWT": "left_asis", "RFWT": "right_asis",
        "LBWT": "left_psis", "RBWT": "right_psis", "LTHI": "left_thigh_distal", "LKNE": "left_knee_lateral",
        "LSHN": "left_shank_distal", "LANK": "left_malleolus_lateral", "LHEE": "left_heel", "LTOE": "left_toe",
        "LMT5": "left_metatarsal_5", "RTHI": "right_thigh_proximal", "RKNE": "right_knee_lateral",
        "RSHN": "right_shank_proximal", "RANK": "right_malleolus_lateral", "RHEE": "right_heel", "RTOE": "right_toe",
        "RMT5": "right_metatarsal_5",
    },
)  # fmt: skip


_LEGS = _subset(PLUG_IN_GAIT, "lower16", only=("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE"))


def _sided(name: str, letters: tuple[str, str], sided: dict[str, str], middle: dict[str, str],
           near: tuple[str, ...] = (), suffix: str = "") -> MarkerSet:  # fmt: skip
    """A set whose two sides are alike: labels without their side -> points of `SURFACE` without theirs."""
    by_label = {label + suffix: point for label, point in middle.items()}
    for letter, side in zip(letters, ("right", "left"), strict=True):
        by_label |= {f"{letter}{label}{suffix}": f"{side}_{point}" for label, point in sided.items()}
    there = tuple(f"{letter}{label}{suffix}" for letter in letters for label in near)
    return replace(_set(name, by_label), near=there)


# The markers that OpenSim's models carry. gait2354 and gait2392: the trial's 41 markers. Of clusters, as many as the
# body has points for.
_GAIT2354 = _sided(
    "gait2354", ("R.", "L."),
    {"ASIS": "asis", "Thigh.Upper": "thigh_proximal", "Thigh.Front": "patella", "Thigh.Rear": "thigh_distal",
     "Shank.Upper": "knee_lateral", "Shank.Front": "tibial_tuberosity", "Shank.Rear": "shank_proximal", "Heel": "heel",
     "Midfoot.Sup": "toe", "Midfoot.Lat": "malleolus_lateral", "Toe.Tip": "hallux", "Toe.Lat": "metatarsal_5",
     "Toe.Med": "metatarsal_1", "Acromium": "acromion", "Bicep": "upper_arm_distal", "Elbow": "elbow_lateral",
     "Wrist.Med": "ulnar_styloid", "Wrist.Lat": "radial_styloid", "Temple": "front_head"},
    {"V.Sacral": "sacrum", "Sternum": "xiphoid", "Top.Head": "crown"},
    near=("Thigh.Front", "Shank.Upper", "Midfoot.Sup", "Midfoot.Lat"),
)  # fmt: skip
_RAJAGOPAL = _sided(
    "rajagopal", ("R", "L"),
    {"ACR": "acromion", "ASI": "asis", "PSI": "psis", "LFC": "knee_lateral", "MFC": "knee_medial",
     "LMAL": "malleolus_lateral", "MMAL": "malleolus_medial", "CAL": "heel", "TOE": "toe", "MT5": "metatarsal_5",
     "TH1": "thigh_proximal", "TH2": "thigh_distal", "TB1": "shank_proximal", "TB2": "shank_distal",
     "LEL": "elbow_lateral", "MEL": "elbow_medial", "FAradius": "radial_styloid", "FAulna": "ulnar_styloid",
     "UA1": "upper_arm_proximal", "UA2": "upper_arm_distal", "FAsuperior": "forearm_proximal"},
    {"CLAV": "sternal_notch", "C7": "c7"}, near=("TH1", "TH2", "TB1", "TB2", "UA1", "UA2"),
)  # fmt: skip
_OPENCAP = _sided(
    "opencap", ("r", "L"),
    {"_shoulder": "acromion", ".ASIS": "asis", ".PSIS": "psis", "_knee": "knee_lateral", "_mknee": "knee_medial",
     "_ankle": "malleolus_lateral", "_mankle": "malleolus_medial", "_calc": "heel", "_toe": "toe",
     "_5meta": "metatarsal_5", "_thigh1": "thigh_proximal", "_thigh2": "thigh_distal", "_sh1": "shank_proximal",
     "_sh2": "shank_distal", "_lelbow": "elbow_lateral", "_melbow": "elbow_medial", "_lwrist": "radial_styloid",
     "_mwrist": "ulnar_styloid"},
    {"C7": "c7"}, near=("_thigh1", "_thigh2", "_sh1", "_sh2"), suffix="_study",
)  # fmt: skip


SETS: dict[str, MarkerSet] = {
    "pig39": PLUG_IN_GAIT,
    "pig37": _subset(PLUG_IN_GAIT, "pig37", without=("FIN",)),
    "pig35": _subset(PLUG_IN_GAIT, "pig35", without=("UPA", "FRM")),
    "pig43": _more(PLUG_IN_GAIT, "pig43", _MEDIAL),
    "cmu41": CMU,
    "lower16": _LEGS,
    "lower22": _more(_LEGS, "lower22", _MEDIAL | {"LMT5": "left_metatarsal_5", "RMT5": "right_metatarsal_5"}),
    "gait2354": _GAIT2354,
    "rajagopal": _RAJAGOPAL,
    "opencap": _OPENCAP,
}
