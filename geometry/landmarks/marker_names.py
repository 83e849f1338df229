"""Names of markers in the sets of many laboratories and programs, and the points of the body that they mean.

One normalisation serves all: `R.ASIS`, `R_ASIS`, `r asis`, `Right ASIS`, `ASIS_R`, `RASIS` and `Bob:RASIS` are one
name, and a number at the end that no set knows (`RASI1`) is dropped.

Sources: Vicon, Plug-in Gait reference guide; the CMU motion capture database; the marker sets of OpenSim's models:
gait2354 and gait2392 (S. L. Delp and others, IEEE Transactions on Biomedical Engineering 54, 2007), A. Rajagopal and
others, IEEE Transactions on Biomedical Engineering 63, 2016, and A. K. M. Lai, A. S. Arnold, J. M. Wakeling, Annals of
Biomedical Engineering 45, 2017, as OpenCap uses it (S. D. Uhlrich and others, PLOS Computational Biology 19, 2023);
S. van Sint Jan, Color Atlas of Skeletal Landmark Definitions, 2007, as used by A. Leardini and others, Gait & Posture
26, 2007; A. Leardini and others, Gait & Posture 25, 2007 (foot).
"""

import functools
import itertools
import re
from collections.abc import Sequence

from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SETS, SURFACE

_LATERAL, _MEDIAL = ("lateral", "lat", "outer", "outside"), ("medial", "med", "inner", "inside")
_OUTSIDE_OF = {
    "knee": ("knee", "femoral epicondyle", "femur epicondyle", "femoral condyle"),
    "elbow": ("elbow", "humeral epicondyle", "humerus epicondyle"), "malleolus": ("ankle", "malleolus", "mal"),
}  # fmt: skip
# Point of SURFACE, without its side -> names for it. Words of a name may be in any order, with any separator.
_SIDED = {
    "asis": ("asis", "asi", "ias", "anterior superior iliac spine"),
    "psis": ("psis", "psi", "ips", "posterior superior iliac spine"),
    "iliac_crest": ("iliac crest", "icr", "ilcr", "crest"),
    "trochanter": ("trochanter", "greater trochanter", "troch", "gtro", "gtr", "ftc"),
    "acromion": ("acromion", "acromium", "acr", "sae", "caj", "acromio clavicular joint"),
    "scapula": ("bak", "bac"),
    "front_head": ("fhd", "front head", "temple"), "back_head": ("bhd", "back head", "rear head"),
    "upper_arm_proximal": ("upper arm proximal",), "upper_arm_distal": ("bicep", "biceps", "upper arm distal"),
    "elbow_lateral": ("elb", "lel", "hle", "l elbow"), "elbow_medial": ("elm", "mel", "hme", "melb", "m elbow"),
    "forearm_proximal": ("fa superior", "forearm proximal"), "forearm_distal": ("forearm distal",),
    "radial_styloid": ("radial styloid", "styloid radius", "fa radius", "rsp", "wra", "wrist lateral", "wrist lat",
                       "l wrist", "wrist radial", "wrist thumb"),
    "ulnar_styloid": ("ulnar styloid", "styloid ulna", "fa ulna", "usp", "wrb", "wrist medial", "wrist med", "m wrist",
                      "wrist ulnar"),
    "metacarpal_2": ("fin", "hm2", "2nd metacarpal", "metacarpal 2", "mc2"),
    "metacarpal_5": ("hm5", "5th metacarpal", "metacarpal 5", "mc5"),
    "thigh_proximal": ("thigh upper", "thigh superior", "thigh proximal"),
    "thigh_distal": ("thigh rear", "thigh inferior", "thigh distal"),
    "knee_lateral": ("kne", "lfc", "fle", "l knee"), "knee_medial": ("knm", "mkne", "mfc", "fme", "m knee"),
    "patella": ("patella", "pat"),
    "tibial_tuberosity": ("tibial tuberosity", "tuberosity", "ttc", "tub", "tibtub", "shank front"),
    "shank_proximal": ("shank rear", "shank proximal", "shank superior"),
    "shank_distal": ("shank distal", "shank inferior"),
    "malleolus_lateral": ("ank", "lmal", "fal", "l ankle"),
    "malleolus_medial": ("anm", "mank", "mmal", "tam", "m ankle"),
    "heel": ("hee", "calcaneus", "calc", "cal", "fcc"),
    "toe": ("toe", "fm2", "mt2", "2nd metatarsal", "metatarsal 2", "second metatarsal"),
    "metatarsal_1": ("mt1", "fm1", "d1m", "1meta", "toe medial", "toe med", "1st metatarsal", "metatarsal 1",
                     "first metatarsal"),
    "metatarsal_5": ("mt5", "fm5", "d5m", "5meta", "toe lateral", "toe lat", "5th metatarsal", "metatarsal 5",
                     "fifth metatarsal"),
    "hallux": ("hallux", "hal", "hlx", "toe tip"),
}  # fmt: skip
_MIDDLE = {
    "crown": ("top head", "head top", "crown", "vertex", "htop"), "c7": ("c7", "cv7"), "t10": ("t10", "tv10"),
    "sternal_notch": ("clav", "jug", "ij", "sjn", "sternal notch", "jugular notch", "suprasternal notch"),
    "xiphoid": ("strn", "sxs", "xiphoid", "xiph", "xiphoid process", "px"),
    "sacrum": ("sacrum", "sacr", "sacral", "v sacral", "vsacral"),
}  # fmt: skip
# Also names of joints or of a landmark of the face: markers only among others that are.
_AMBIGUOUS = {
    "shoulder": "acromion", "elbow": "elbow_lateral", "knee": "knee_lateral", "ankle": "malleolus_lateral",
    "heel": "heel", "bigtoe": "hallux",
}  # fmt: skip
_AMBIGUOUS_MIDDLE = {"sternum": "xiphoid"}
# With so many names of markers, a file is one of markers.
SURE = 4
_SUFFIX = re.compile(r"(?i)[ _.-](?:study|augmenter)$")
_SIDES = {"l": "left", "left": "left", "lt": "left", "r": "right", "right": "right", "rt": "right"}


def _variants(phrase: str) -> set[str]:
    """A phrase's words joined in every order; long phrases only as they stand."""
    words = phrase.split()
    return {"".join(p) for p in itertools.permutations(words)} if len(words) < 4 else {"".join(words)}


@functools.cache
def _stems() -> dict[str, str]:
    out = {v: point for point, phrases in _SIDED.items() for phrase in phrases for v in _variants(phrase)}
    for place, words in _OUTSIDE_OF.items():
        for face, faces in (("lateral", _LATERAL), ("medial", _MEDIAL)):
            for word, which in itertools.product(words, faces):
                out |= dict.fromkeys(_variants(f"{word} {which}"), f"{place}_{face}")
    return out


@functools.cache
def _middles() -> dict[str, str]:
    return {v: point for point, phrases in _MIDDLE.items() for phrase in phrases for v in _variants(phrase)}


@functools.cache
def _labels() -> dict[str, str]:
    """Normalised labels of the sets whose left and right differ, SURFACE's own names, and labels with one meaning that
    the rules would read differently."""
    out = {normal(name): name for name in SURFACE.names}
    for s in (SETS["lower22"], CMU, PLUG_IN_GAIT):
        out |= {normal(label): name for label, name in zip(s.labels, s.names, strict=True)}
    return out | {"lmed": "left_malleolus_medial", "rmed": "right_malleolus_medial"}


def plain_name(name: str) -> str:
    """A name without the subject before its last colon and without a program's suffix (`_study`)."""
    return _SUFFIX.sub("", name.rsplit(":", 1)[-1].strip())


def normal(name: str) -> str:
    """A name without subject, separators and case."""
    return re.sub(r"[^a-z0-9*]", "", plain_name(name).lower())


def words_of(name: str) -> tuple[str, list[str]]:
    """The side that a name states ("left", "right" or "") and its other words in small letters.

    A side is a word of its own at either end (`R.Heel`, `heel_left`), or the first letter of capitals (`RHEE`); the
    latter only as far as the rest is a name too, which `surface_of` and `side_of_label` check.
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain_name(name))
    spaced = re.sub(r"(?<=\b[LR])(?=[A-Z][a-z])", " ", spaced)
    words = [w for w in re.split(r"[^a-z0-9]+", spaced.lower()) if w]
    for at in (0, -1):
        if len(words) > 1 and words[at] in _SIDES:
            return _SIDES[words.pop(at)], words
    if len(words) > 1 and (match := re.match(r"(left|right)(?=.)", words[0])):
        words[0] = words[0][match.end() :]
        return match[1], words
    if words and (match := re.match(r"(left|right)(.+)", words[0])):
        return match[1], [match[2], *words[1:]]
    return "", words


def side_of_label(name: str) -> str:
    """The side that a label states, "" for none or the middle: a word at either end, or the first capital letter of a
    label of a set's kind (`LTHI`)."""
    side, words = words_of(name)
    if side:
        return side
    point = surface_of(name, among_markers=True)
    if point is not None:
        return point.split("_")[0] if point.startswith(("left_", "right_")) else ""
    plain = plain_name(name)
    return {"L": "left", "R": "right"}.get(plain[0], "") if re.match(r"[LR][A-Z]{1,}", plain) and words else ""


def surface_of(name: str, among_markers: bool = False, numbered: bool = True) -> str | None:
    """The point of SURFACE that a marker's name means; None for any other name.

    Args:
        name: as a file has it.
        among_markers: other names of the file are certainly of markers, so that `R.Elbow` is the marker beside the
            joint, not the joint; true of the suffix `_study`, too.
        numbered: whether a number at the end may be dropped.
    """
    loose = among_markers or _SUFFIX.search(name.strip()) is not None
    found = _find(name, loose)
    if found is None and "_" in plain_name(name):  # a subject before an underscore
        found = _labels().get(normal(name.rsplit("_", 1)[-1]))
    if found is None and numbered and (match := re.match(r"(.*[A-Za-z])[ _.-]?\d{1,2}$", plain_name(name))):
        found = _find(match[1], loose)
    return found


def is_known(name: str) -> bool:
    """Whether a whole name, without a subject before an underscore, is a marker's."""
    return _find(name, True) is not None


def is_label(name: str) -> bool:
    """Whether a name is a label of a built-in set or a point of SURFACE."""
    return normal(name) in _labels()


def map_names(names: Sequence[str]) -> dict[str, int]:
    """Point of SURFACE -> index in `names`; of several names for one point the first that needs no number dropped.

    Names that are also a joint's (`R.Elbow`) count where at least `SURE` others are a marker's.
    """
    sure = sum(surface_of(name) is not None for name in names) >= SURE
    out: dict[str, int] = {}
    for numbered in (False, True):
        for i, name in enumerate(names):
            point = surface_of(name, sure, numbered)
            if point is not None and i not in out.values():
                out.setdefault(point, i)
    return out


def _find(name: str, loose: bool) -> str | None:
    key = normal(name)
    for table in (_labels(), _middles(), _AMBIGUOUS_MIDDLE if loose else {}):
        if key in table:
            return table[key]
    stems = _stems() | (_AMBIGUOUS if loose else {})
    side, words = words_of(name)
    if side:
        choices = [(side, "".join(words))]
    else:
        choices = [(_SIDES.get(key[:1], ""), key[1:]), (_SIDES.get(key[-1:], ""), key[:-1])]
    return next((f"{which}_{stems[stem]}" for which, stem in choices if which and stem in stems), None)
