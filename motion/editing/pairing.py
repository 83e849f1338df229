"""Which joints or points are each other's counterparts on the two sides of a body.

First by the roles of joints, then by names in which left and right are exchanged, then by where joints are in the rest
pose: a joint that has a counterpart where its mirror image is.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.skeleton import Skeleton

_SNAP = np.cos(np.radians(10))
_NEAR = 0.04  # of the skeleton's size at rest
_WORDS = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
_BOTH = _WORDS | {right: left for left, right in _WORDS.items()}
# A whole word in any spelling; one letter between separators, in front of a name, or behind small letters or digits.
_PATTERNS = (
    re.compile(r"left|right|Left|Right|LEFT|RIGHT"),
    re.compile(r"(?:(?<=[^A-Za-z])|^)[lrLR](?=[^A-Za-z]|$)"),
    re.compile(r"(?:(?<=[:|])|^(?!.*[:|]))[lrLR](?=[A-Za-z])"),
    re.compile(r"(?<=[a-z0-9])[LR](?=$|[^a-z])"),
)


@dataclass(frozen=True, eq=False)
class Sides:
    """Counterparts of joints, and the plane between the sides of the rest pose.

    Attributes:
        partner: (J,) index of each joint's counterpart, its own where it has none.
        normal: (3,) unit length, across the plane at rest, from right to left where the names say which is which.
        how: number of pairs by "roles", "names" and "places".
        alone: joints off the plane that have no counterpart.
    """

    partner: tuple[int, ...]
    normal: FloatArray
    how: dict[str, int]
    alone: tuple[int, ...]


def pair_names(names: Sequence[str]) -> dict[int, int]:
    """Index of a name for the left side -> index of its counterpart; by left and right, l and r in any usual place."""
    at = {name: i for i, name in enumerate(names)}
    out: dict[int, int] = {}
    for pattern in _PATTERNS:
        for i, name in enumerate(names):
            found = pattern.findall(name)
            if not found or found[0] not in _WORDS or i in out:
                continue
            other = at.get(pattern.sub(lambda m: _BOTH[m[0]], name))
            if other is not None and other != i and other not in out.values() and other not in out:
                out[i] = other
    return out


def find_sides(skeleton: Skeleton, roles: Mapping[str, int] | None = None) -> Sides:
    """Pair the joints of a skeleton.

    Args:
        skeleton: any.
        roles: role -> joint, of a human body; None finds them.

    Raises:
        MuybridgeError: the skeleton has no two sides.
    """
    roles = find_roles(skeleton).roles if roles is None else roles
    partner = list(range(len(skeleton)))
    how = {"roles": 0, "names": 0, "places": 0}
    lefts: list[int] = []

    def add(a: int, b: int, source: str) -> None:
        if a != b and partner[a] == a and partner[b] == b:
            partner[a], partner[b] = b, a
            how[source] += 1
            lefts.append(a)

    for role, j in roles.items():
        if role.startswith("left_") and "right_" + role[5:] in roles:
            add(j, roles["right_" + role[5:]], "roles")
    for a, b in pair_names(skeleton.names).items():
        add(a, b, "names")
    normal = _normal_of_pairs(skeleton, lefts, partner) if lefts else _normal_of_places(skeleton)
    for a, b in _pairs_by_places(skeleton, normal, partner):
        add(a, b, "places")
    if not any(how.values()):
        raise MuybridgeError("no joint has a counterpart on another side, by its name or by where it is at rest; "
                             f"the joints are {', '.join(skeleton.names[:12])}")  # fmt: skip
    distance = _distances(skeleton, normal, partner)
    alone = [j for j, p in enumerate(partner) if p == j and abs(distance[j]) > _NEAR * _size(skeleton)]
    return Sides(tuple(partner), normal, how, tuple(alone))


def snapped(direction: FloatArray) -> FloatArray:
    """A unit vector; the world's axis where it is within ten degrees of one."""
    unit = direction / np.linalg.norm(direction)
    k = int(np.argmax(np.abs(unit)))
    return np.eye(3)[k] * np.sign(unit[k]) if abs(unit[k]) > _SNAP else unit


def _normal_of_pairs(skeleton: Skeleton, lefts: list[int], partner: list[int]) -> FloatArray:
    rest = skeleton.rest_positions
    across = np.stack([rest[j] - rest[partner[j]] for j in lefts])
    total = across.sum(axis=0)
    if np.linalg.norm(total) < 1e-6 * max(_size(skeleton), 1e-12):
        return _normal_of_places(skeleton)
    return snapped(total)


def _normal_of_places(skeleton: Skeleton) -> FloatArray:
    """The world's axis across which the rest pose is most nearly its own mirror image."""
    rest = skeleton.rest_positions
    axes = [axis for axis in np.eye(3) if np.ptp(rest @ axis) > _NEAR * _size(skeleton)]
    if not axes:
        return np.array([1.0, 0.0, 0.0])

    def mismatch(axis: FloatArray) -> float:
        image = rest - 2 * np.outer((rest - rest[0]) @ axis, axis)
        away = np.linalg.norm(image[:, None] - rest[None], axis=-1).min(axis=1).mean()
        return float(away / np.ptp(rest @ axis))  # a flat pose is nearly its own image from front to back

    return min(axes, key=mismatch)


def _size(skeleton: Skeleton) -> float:
    return float(np.ptp(skeleton.rest_positions, axis=0).max())


def _distances(skeleton: Skeleton, normal: FloatArray, partner: Sequence[int]) -> FloatArray:
    """(J,) metres of each joint from the plane between the sides at rest."""
    rest = skeleton.rest_positions
    pairs = [j for j, p in enumerate(partner) if p != j]
    middle = rest[pairs].mean(axis=0) if pairs else rest[0]
    return np.asarray((rest - middle) @ normal)


def _pairs_by_places(skeleton: Skeleton, normal: FloatArray, partner: list[int]) -> list[tuple[int, int]]:
    """Pairs of joints without a counterpart, from the roots down: of the children of two counterparts, or of one joint
    in the middle, those that are each other's mirror images as seen from there."""
    known, out = list(partner), []
    above, rest = skeleton.is_ancestor.astype(np.float64), skeleton.rest_positions
    below = above.sum(axis=1)
    starts = np.stack([rest[p] if p >= 0 else rest[0] for p in skeleton.parents])
    # Where a joint is, and the middle of all that hangs on it: bones without length say nothing by themselves.
    places = np.stack([rest - starts, above @ rest / below[:, None] - starts], axis=1)
    images = places - 2 * (places @ normal)[..., None] * normal
    tolerance = _NEAR * _size(skeleton)
    for j in range(-1, len(skeleton)):
        other = known[j] if j >= 0 else -1
        if other < j:
            continue
        mine, theirs = ([k for k, p in enumerate(skeleton.parents) if p == side and k > 0 and known[k] == k]
                        for side in (j, other))  # fmt: skip
        gaps = sorted(
            (float(np.linalg.norm(images[a] - places[b], axis=-1).sum()), a, b)
            for a in mine for b in theirs if below[a] == below[b] and (j != other or a <= b)
        )  # fmt: skip
        taken: set[int] = set()
        for gap, a, b in gaps:
            if {a, b} & taken or gap > max(tolerance, 0.3 * float(np.linalg.norm(places[a], axis=-1).sum())):
                continue
            taken |= {a, b}
            if a != b:
                known[a], known[b] = b, a
                out.append((a, b) if places[a].sum(axis=0) @ normal >= 0 else (b, a))
    return out
