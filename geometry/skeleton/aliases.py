"""Names that other programs give the landmarks of BODY23 and the markers of SURFACE.

Recognised are the spellings of COCO, HALPE, OpenPose and Pose2Sim, MediaPipe, and names of joints in skeletons; names
of markers as in `muybridge.geometry.landmarks.marker_names`; each with or without a subject's name before a colon.

Sources: T.-Y. Lin and others, Microsoft COCO, 2014; H.-S. Fang and others, HALPE full-body, 2022; OpenPose's BODY_25
and BODY_25B.
"""

import difflib
import re
from collections.abc import Callable, Sequence

from muybridge.geometry.landmarks.marker_names import is_known, is_label, map_names, normal, surface_of
from muybridge.geometry.landmarks.marker_sets import SETS
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.profiles import roles_of

_PARTS = {
    "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist", "hip": "hip", "knee": "knee", "ankle": "ankle",
    "heel": "heel", "eye": "eye", "ear": "ear",
    "bigtoe": "big_toe", "toebig": "big_toe", "footindex": "big_toe", "greattoe": "big_toe", "hallux": "big_toe",
    "smalltoe": "small_toe", "littletoe": "small_toe", "toesmall": "small_toe", "pinkytoe": "small_toe",
}  # fmt: skip
_CENTRE = re.compile(r"([lr])([hkasew]jc)\d*$")
_JOINT_OF_CENTRE = {"hjc": "thigh", "kjc": "shin", "ajc": "foot", "sjc": "upper_arm", "ejc": "forearm", "wjc": "hand"}
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
# Landmarks that coincide with a skeleton's joint.
_LANDMARK_OF_ROLE = {
    "upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shin": "knee", "foot": "ankle",
}  # fmt: skip


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
    return map_names([name.rsplit(":", 1)[-1] for name in names])


def joint_centres_of(names: Sequence[str]) -> dict[str, int]:
    """Joint of `body.BODY` -> index in `names` of the joint centre that a gait model computed (`LKJC`: left shin)."""
    out: dict[str, int] = {}
    for i, name in enumerate(names):
        if (match := _CENTRE.match(normal(name))) and match[2] in _JOINT_OF_CENTRE:
            out.setdefault(f"{_SIDES[match[1]]}_{_JOINT_OF_CENTRE[match[2]]}", i)
    return out


def nearest_names(unknown: Sequence[str], most: int = 4) -> list[str]:
    """One sentence on unknown names and the known ones nearest to them; empty where there are none."""
    known = {normal(label): label for s in SETS.values() for label in s.labels}
    known |= {normal(name): name for name in BODY23.names}
    near = [(name, known[found[0]]) for name in unknown
            if (found := difflib.get_close_matches(normal(name), known, 1, 0.7))]  # fmt: skip
    if not near:
        return []
    return ["the nearest known names are " + ", ".join(f"{there} for {name}" for name, there in near[:most])]


def subject_of(name: str) -> str:
    """The subject of a label: its prefix before a colon or, where the rest is a label of a set, before an underscore;
    "" without a prefix."""
    name = name.strip()
    subject, _, label = name.rpartition(":")
    before, _, last = label.rpartition("_")
    if before and surface_of(label, True) is not None and not is_known(label) and is_label(last):
        return f"{subject}:{before}" if subject else before
    return subject


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
