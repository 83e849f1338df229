"""Roles by names: the tables of `muybridge.geometry.skeleton.profiles`, then words that mean one part only."""

import re
from collections.abc import Sequence

from muybridge.geometry.roles.role_map import CORE_ROLES, in_order
from muybridge.geometry.skeleton.profiles import EXTRAS, PROFILES, roles_of
from muybridge.geometry.skeleton.skeleton import Skeleton

Side = str  # "left", "right" or ""

_LEFT, _RIGHT = {"left", "l", "lt", "lf"}, {"right", "r", "rt", "rg"}
_FIXES = {"j", "bip", "def", "org", "mixamorig", "bip01", "bip001", "valve", "biped", "cc", "base", "b", "jnt", "joint",
          "bone", "bn", "sk", "rig", "m", "c"}  # fmt: skip
# Words of one part, without side and numbers; those that mean different parts in different programs are not here.
_WORDS: dict[str, tuple[str, ...]] = {
    "hips": ("hips", "pelvis", "hip", "cog"),
    "head": ("head", "skull"),
    "neck": ("neck",),
    "thigh": ("thigh", "upleg", "upperleg", "legupper", "femur", "thighbone", "hipjoint"),
    "shin": ("shin", "calf", "lowerleg", "leglower", "lowleg", "knee", "tibia"),
    "foot": ("foot", "ankle"),
    "toe": ("toe", "toes", "ball", "toebase"),
    "clavicle": ("clavicle", "collar", "collarbone"),
    "upper_arm": ("upperarm", "armupper", "uparm", "humerus"),
    "forearm": ("forearm", "lowerarm", "armlower", "lowarm", "elbow", "radius"),
    "hand": ("hand", "wrist", "palm", "fist"),
}


def roles_by_profile(skeleton: Skeleton) -> tuple[str, dict[str, int]]:
    """The profile that gives most of the core roles in an order that fits the tree, and its roles; "" if none does."""
    best: tuple[tuple[int, int, int], str, dict[str, int]] = ((0, 0, 0), "", {})
    for profile in PROFILES:
        roles = roles_of(skeleton.names, profile)
        if not {"hips", "left_thigh", "right_thigh"} <= set(roles):
            continue
        core = sum(role in roles for role in CORE_ROLES)
        extras = sum(name in EXTRAS.get(profile, {}) for name in skeleton.names)
        if (rank := (core, len(roles), extras)) > best[0] and in_order(skeleton, roles):
            best = rank, profile, roles
    return best[1], best[2]


def roles_by_words(skeleton: Skeleton) -> dict[str, int]:
    """Roles by what the names say in plain words; empty where they do not fit the tree.

    Of several joints with one role the first from the body outwards counts (`thigh`, `thigh_twist`).
    """
    meanings = {word: part for part, words in _WORDS.items() for word in words}
    roles: dict[str, int] = {}
    for j, name in enumerate(skeleton.names):
        side, words = side_and_words(name)
        part = meanings.get("".join(words))
        if part is None or (part in ("hips", "head", "neck")) == bool(side):
            continue
        roles.setdefault(f"{side}_{part}" if side else part, j)
    return roles if in_order(skeleton, roles) else {}


def side_and_words(name: str) -> tuple[Side, list[str]]:
    """The side that a name states, and its words in small letters without prefixes, side and numbers."""
    name = name.rsplit(":", 1)[-1].rsplit("|", 1)[-1]
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    words = [w.lower() for w in re.split(r"[^A-Za-z]+", name) if w]
    if words and len(words) > 1 and words[0] in _FIXES - _LEFT - _RIGHT:
        while len(words) > 1 and words[0] in _FIXES:
            words = words[1:]
    side = ""
    for k, word in enumerate(words):
        if word in _LEFT | _RIGHT:
            side = "left" if word in _LEFT else "right"
            return side, words[:k] + words[k + 1 :]
        for whole, found in (("left", "left"), ("right", "right")):
            if word.startswith(whole) or word.endswith(whole):
                return found, [*words[:k], word.replace(whole, "", 1), *words[k + 1 :]]
    return side, words


def sides_by_names(names: Sequence[str], first: Sequence[int], second: Sequence[int]) -> bool | None:
    """Whether the first of two mirrored chains is the left one, as the names state; None where they do not agree."""
    votes = [(side_and_words(names[a])[0], side_and_words(names[b])[0]) for a, b in zip(first, second, strict=True)]
    told = {vote for vote in votes if vote != ("", "")}
    if told == {("left", "right")}:
        return True
    return False if told == {("right", "left")} else None
