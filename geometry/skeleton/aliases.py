"""Names that other programs give the landmarks of BODY23 and the markers of SURFACE.

Recognised are the spellings of COCO, HALPE, OpenPose and Pose2Sim, MediaPipe, and names of joints in skeletons;
labels of Plug-in Gait and the CMU marker set; each with or without a subject's name before a colon.

Sources: T.-Y. Lin and others, Microsoft COCO, 2014; H.-S. Fang and others, HALPE full-body, 2022; OpenPose's BODY_25
and BODY_25B; Vicon, Plug-in Gait reference guide.
"""

import re
from collections.abc import Callable, Sequence

from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.profiles import roles_of

_PARTS = {
    "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist", "hip": "hip", "knee": "knee", "ankle": "ankle",
    "heel": "heel", "eye": "eye", "ear": "ear",
    "bigtoe": "big_toe", "toebig": "big_toe", "footindex": "big_toe", "greattoe": "big_toe", "hallux": "big_toe",
    "smalltoe": "small_toe", "littletoe": "small_toe", "toesmall": "small_toe", "pinkytoe": "small_toe",
}  # fmt: skip
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
# Landmarks that coincide with a skeleton's joint.
_LANDMARK_OF_ROLE = {
    "upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shin": "knee", "foot": "ankle",
}  # fmt: skip
# Labels that mean the same marker in sets of other laboratories.
_OTHER_LABELS = {
    "SACR": "sacrum", "LMT1": "left_metatarsal_1", "RMT1": "right_metatarsal_1", "LMT5": "left_metatarsal_5",
    "RMT5": "right_metatarsal_5", "LHAL": "left_hallux", "RHAL": "right_hallux", "LKNM": "left_knee_medial",
    "RKNM": "right_knee_medial", "LMED": "left_malleolus_medial", "RMED": "right_malleolus_medial",
    "LELM": "left_elbow_medial", "RELM": "right_elbow_medial", "LANM": "left_malleolus_medial",
    "RANM": "right_malleolus_medial", "LMKNE": "left_knee_medial", "RMKNE": "right_knee_medial",
    "LMELB": "left_elbow_medial", "RMELB": "right_elbow_medial", "LMANK": "left_malleolus_medial",
    "RMANK": "right_malleolus_medial",
}  # fmt: skip

_MARKER_OF_LABEL = {
    **{label.upper(): name for s in (PLUG_IN_GAIT, CMU) for label, name in zip(s.labels, s.names, strict=True)},
    **_OTHER_LABELS,
    **{name.upper(): name for name in SURFACE.names},
}


def body_landmark(name: str) -> str | None:
    """The landmark of BODY23 that a name means; None for any other."""
    plain = name.rsplit(":", 1)[-1].strip()
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", plain)
    spaced = re.sub(r"(?<=\b[LR])(?=[A-Z][a-z])", " ", spaced)  # LBigToe
    words = [w for w in re.split(r"[^a-z0-9]+", spaced.lower()) if w]
    if words == ["nose"]:
        return "nose"
    sides = [w for w in words if w in _SIDES]
    part = "".join(w for w in words if w not in _SIDES)
    if not sides and part[:1] in ("l", "r") and part[1:] in _PARTS:
        sides, part = [part[0]], part[1:]
    if len(sides) != 1 or part not in _PARTS:
        return None
    return f"{_SIDES[sides[0]]}_{_PARTS[part]}"


def map_body(names: Sequence[str]) -> dict[str, int]:
    """Landmark of BODY23 -> index in `names`, by the meaning of the names; the first of several counts.

    Names of a skeleton's joints are recognised too: a shoulder is where the upper arm begins. Of several subjects
    the one with most landmarks is taken.
    """
    return of_one_subject(names, _map_body)


def _map_body(names: Sequence[str]) -> dict[str, int]:
    out: dict[str, int] = {}
    for i, name in enumerate(names):
        landmark = body_landmark(name)
        if landmark is not None:
            out.setdefault(landmark, i)
    # A skeleton's `LeftShoulder` may be a collar bone, and its hand begin beyond the wrist; roles decide.
    for role, i in roles_of(names).items():
        side, _, part = role.partition("_")
        landmark = f"{side}_{_LANDMARK_OF_ROLE.get(part, '')}"
        if part in _LANDMARK_OF_ROLE and (part == "upper_arm" or landmark not in out):
            out[landmark] = i
    return {name: out[name] for name in BODY23.names if name in out}


def map_surface(names: Sequence[str]) -> dict[str, int]:
    """Marker of SURFACE -> index in `names`, by the labels of known marker sets or SURFACE's own names; of several
    subjects of the one with most markers."""
    return of_one_subject(names, _map_surface)


def _map_surface(names: Sequence[str]) -> dict[str, int]:
    out: dict[str, int] = {}
    for i, name in enumerate(names):
        label = _label(name)
        if label in _MARKER_OF_LABEL:
            out.setdefault(_MARKER_OF_LABEL[label], i)
    return out


def _label(name: str) -> str:
    """A marker's label in capitals, without a prefix that ends in a colon or, if the whole is no label,
    in an underscore."""
    plain = name.rsplit(":", 1)[-1].strip().upper()
    return plain if plain in _MARKER_OF_LABEL else plain.rsplit("_", 1)[-1]


def subject_of(name: str) -> str:
    """The subject of a label: its prefix before a colon or before a known marker's label; "" without a prefix."""
    label, colon = _label(name), name.rfind(":") + 1
    name = name.rstrip()
    return (name[: -len(label)] if label in _MARKER_OF_LABEL else name[:colon]).strip().rstrip(":_")


def of_one_subject(names: Sequence[str], find: Callable[[Sequence[str]], dict[str, int]]) -> dict[str, int]:
    """The result of `find` for the subject of which it finds most, as indices in `names`."""
    best: dict[str, int] = {}
    for columns in _columns_of_subjects(names).values():
        found = {key: columns[i] for key, i in find([names[i] for i in columns]).items()}
        best = max(best, found, key=len)
    return best


def one_of_several(names: Sequence[str], used: Sequence[int]) -> str:
    """One sentence that names the subject whose labels are used, where there are several subjects; else empty."""
    known = {
        subject: max(len(_map_body(mine)), len(_map_surface(mine)))
        for subject, columns in _columns_of_subjects(names).items()
        if (mine := [names[i] for i in columns])
    }
    known = {subject: count for subject, count in known.items() if count}
    taken = {subject_of(names[i]) for i in used}
    if len(known) < 2 or len(taken) != 1:
        return ""
    people = ", ".join(f"{subject or 'without a name'} ({count})" for subject, count in known.items())
    return f"its labels are of several subjects: {people}; taken are those of {taken.pop() or 'the one without a name'}"


def _columns_of_subjects(names: Sequence[str]) -> dict[str, list[int]]:
    out: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        out.setdefault(subject_of(name), []).append(i)
    return out
