"""Which joint has which role, how that was found, and maps that a user writes."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from muybridge.errors import FormatError, MuybridgeError, parsing
from muybridge.geometry.skeleton.profiles import ROLES
from muybridge.geometry.skeleton.skeleton import Skeleton

Kind = Literal["human", "quadruped", "one piece", "other"]
LIMBS = ("thigh", "shin", "foot", "upper_arm", "forearm", "hand")
CORE_ROLES = ("hips", *(f"{side}_{part}" for side in ("left", "right") for part in LIMBS))
_MOST_NAMES = 12  # joints that a message lists
_KINDS = {
    "quadruped": "is that of an animal on four legs",
    "one piece": "is that of a figure whose limbs are of one piece each, without joints for knees, ankles, elbows and "
    "wrists, which a take needs",
    "other": "has no two legs, trunk and two arms that could be recognised",
}


@dataclass(frozen=True)
class RoleMap:
    """The joints of a skeleton that have a role in a human body.

    Attributes:
        roles: role (`muybridge.geometry.skeleton.profiles.ROLES`) -> index of the joint.
        how: `map`, `vrm`, `names:<profile>`, `geometry` or `none`.
        kind: what the skeleton is of, as far as it was recognised.
        notes: what was assumed, one sentence each.
    """

    roles: dict[str, int]
    how: str
    kind: Kind
    notes: tuple[str, ...] = ()

    @property
    def source(self) -> str:
        """How the roles were found, to be put behind "by"."""
        if self.how.startswith("names:"):
            profile = self.how.removeprefix("names:")
            return "the words in the names" if profile == "words" else f"names, which are those of {profile}"
        return {"map": "the map", "vrm": "the file's own table"}.get(self.how, self.how)

    @property
    def body(self) -> str:
        """What the skeleton is of where it is of no human body, to be put behind "the skeleton"; else empty."""
        return "" if self.kind == "human" else _KINDS[self.kind]

    @property
    def missing(self) -> tuple[str, ...]:
        """The core roles that no joint has."""
        return tuple(role for role in CORE_ROLES if role not in self.roles)

    def require(self, what: str, needed: tuple[str, ...] = CORE_ROLES, remedy: str = "role_map") -> None:
        """Check that roles are there.

        Args:
            what: whose skeleton it is, which a message begins with.
            needed: roles.
            remedy: key of `muybridge.remedies` for roles that a user's map can give.

        Raises:
            MuybridgeError: some are missing.
        """
        missing = [role for role in needed if role not in self.roles]
        if not missing:
            return
        if self.kind == "one piece" and self.how != "map":
            of_parts = f" ({'; '.join(self.notes)})" if self.notes else ""
            raise MuybridgeError(f"{what}: the skeleton {self.body}{of_parts}")
        if self.kind == "quadruped" and self.how != "map":
            raise MuybridgeError(f"{what}: the skeleton {self.body}", remedy="no_human_body")
        if self.kind != "human" and self.how != "map":
            raise MuybridgeError(f"{what}: the skeleton {self.body}", remedy=remedy)
        raise MuybridgeError(f"{what}: no joint was found for {', '.join(missing)}", remedy=remedy)


def load_role_map(path: Path) -> dict[str, str]:
    """Read a TOML file of lines `role = "joint"`; a joint's name may be empty, for a role that none has.

    Raises:
        FormatError: it is no such file, a role is unknown, or a joint has two roles.
    """
    with parsing(path, FormatError, "a map of roles"):
        values = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    values = values.get("roles", values)
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values.values()):
        raise FormatError(f'{path}: a map of roles has lines role = "joint"')
    try:
        check_map(values)
    except ValueError as error:
        raise FormatError(f"{path}: {error}") from None
    return {role: name for role, name in values.items() if name}


def check_map(values: Mapping[str, str]) -> None:
    """ValueError where a role is unknown or a joint has two roles."""
    if unknown := [role for role in values if role not in ROLES]:
        raise ValueError(f"unknown role {unknown[0]!r}: choose among {', '.join(ROLES)}")
    taken: dict[str, str] = {}
    for role, name in values.items():
        if name and name in taken:
            raise ValueError(f"{taken[name]} and {role} are both given to the joint {name!r}; a joint has one role")
        taken[name] = role


def joints_of_map(skeleton: Skeleton, values: Mapping[str, str]) -> dict[str, int]:
    """Role -> index of a map of names.

    Raises:
        MuybridgeError: the skeleton has no joint of that name, a role is unknown, or a joint has two roles.
    """
    try:
        check_map(values)
    except ValueError as error:
        raise MuybridgeError(f"the map of roles: {error}") from None
    known = {name: j for j, name in enumerate(skeleton.names)}
    for role, name in values.items():
        if name and name not in known:
            names = ", ".join(skeleton.names[:_MOST_NAMES]) + (", ..." if len(skeleton) > _MOST_NAMES else "")
            raise MuybridgeError(f"the map of roles gives {role} to {name!r}, and the skeleton has no such joint, but "
                                 f"{names}")  # fmt: skip
    return {role: known[name] for role, name in values.items() if name}


def in_order(skeleton: Skeleton, roles: Mapping[str, int]) -> bool:
    """Whether roles fit the tree: limbs from the hips outwards, the two sides apart, no joint twice."""
    if len(set(roles.values())) < len(roles):
        return False
    above = skeleton.is_ancestor
    for side, other in (("left", "right"), ("right", "left")):
        for limb in (LIMBS[:3], LIMBS[3:]):
            chain = [roles[f"{side}_{part}"] for part in limb if f"{side}_{part}" in roles]
            # A foot may hang from a control bone of its own, so its place in the tree says nothing.
            inner = chain[:2] if limb[0] == "thigh" else chain
            if any(not above[a, b] for a, b in zip(inner, inner[1:], strict=False)):
                return False
            if f"{other}_{limb[0]}" in roles and any(above[roles[f"{other}_{limb[0]}"], j] for j in chain):
                return False
    arms = [roles[f"{side}_upper_arm"] for side in ("left", "right") if f"{side}_upper_arm" in roles]
    legs = [roles[f"{side}_thigh"] for side in ("left", "right") if f"{side}_thigh" in roles]
    if "hips" in roles and not all(above[roles["hips"], leg] for leg in legs):
        return False
    return not any(above[leg, arm] or above[arm, leg] for leg in legs for arm in arms)
