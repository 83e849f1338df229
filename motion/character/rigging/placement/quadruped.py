"""Where the joints of an animal on four legs are: legs at shares of the height of its belly, trunk between them."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import NoBody, branches_of, feet_of_animal
from muybridge.motion.character.rigging.paths import Branch
from muybridge.motion.character.rigging.volume import Volume

# Joints of the legs: shares of the belly's height; above one, what is more is a share of the trunk's thickness.
_FRONT = {"front_upper": 1.28, "front_lower": 0.70, "front_foot": 0.20}
_BACK = {"back_thigh": 1.45, "back_shin": 1.0, "back_ankle": 0.50, "back_foot": 0.17}
_SCAPULA, _SPINE = 0.75, 0.66  # of the trunk's thickness, from the belly
_HEAD, _NECK = 0.55, 0.35  # of the way from the nose to the withers, and from the withers to the head


def place_quadruped(volume: Volume) -> dict[str, FloatArray]:
    """Role -> (3,) metres in the animal's own frame, of the template quadruped.

    Raises:
        NoBody: no four legs.
    """
    branches, height = branches_of(volume)
    ways = feet_of_animal(branches, height)
    if not ways:
        raise NoBody("it does not stand on four legs")
    places = volume.centres(np.argwhere(volume.inside))
    middle = places[np.abs(places[:, 0]) < 2.5 * volume.cell]
    front, back = (float(np.mean([w.points[0, 1] for w in ways[k : k + 2]])) for k in (0, 2))
    belly, thick = _trunk_at(middle, front + 0.6 * (back - front), volume.cell)
    out: dict[str, FloatArray] = {}
    for side, first, last in (("left", ways[0], ways[2]), ("right", ways[1], ways[3])):
        for table, way in ((_FRONT, first), (_BACK, last)):
            for role, share in table.items():
                out[f"{side}_{role}"] = _on_leg(way, share, belly, thick)
        upper = out[f"{side}_front_upper"]
        out[f"{side}_front_scapula"] = np.array([0.6 * upper[0], upper[1], belly + _SCAPULA * thick])
    shoulder = float(np.mean([out[f"{s}_front_upper"][1] for s in ("left", "right")]))
    hip = float(np.mean([out[f"{s}_back_thigh"][1] for s in ("left", "right")]))
    for role, share in (("hips", 1.0), ("spine", 0.6), ("chest", 0.15)):
        y = shoulder + share * (hip - shoulder)
        low, deep = _trunk_at(middle, y, volume.cell)
        out[role] = np.array([0.0, y, max(low, belly) + _SPINE * min(deep, 1.3 * thick)])
    return out | _head(middle, out["chest"], belly + thick) | _tail(branches, out["hips"], ways, height)


def _trunk_at(middle: FloatArray, y: float, cell: float) -> tuple[float, float]:
    """Metres: height of the trunk's underside at a place along it, and its thickness."""
    here = middle[np.abs(middle[:, 1] - y) < 1.5 * cell]
    if not len(here):
        raise NoBody("its legs hang on no trunk")
    return float(here[:, 2].min()), float(np.ptp(here[:, 2]))


def _on_leg(way: Branch, share: float, belly: float, thick: float) -> FloatArray:
    """(3,) a joint of a leg: on its way below the belly, straight above it in the trunk."""
    z = share * belly if share <= 1.0 else belly + (share - 1.0) * thick
    rises = np.maximum.accumulate(way.points[:, 2])
    k = int(np.searchsorted(rises, min(z, belly)))
    x, y, _ = way.points[min(k, len(way.points) - 1)]
    column = way.points[int(np.searchsorted(rises, 0.6 * belly)) % len(way.points), 0]
    return np.array([column if share >= 1.0 else x, y, z])


def _head(middle: FloatArray, chest: FloatArray, back: float) -> dict[str, FloatArray]:
    nose = middle[np.argmin(middle[:, 1])]
    withers = np.array([0.0, chest[1], max(back, float(chest[2]))])
    head = nose + _HEAD * (withers - nose)
    neck = withers + _NECK * (head - withers)
    return {"neck": neck * [0, 1, 1], "head": head * [0, 1, 1]}


def _tail(
    branches: tuple[Branch, ...], hips: FloatArray, ways: tuple[Branch, ...], height: float
) -> dict[str, FloatArray]:
    """Three joints along the tail; without one, close together behind the hips."""
    behind = [b for b in branches if all(b is not w for w in ways) and b.points[0, 1] > hips[1] + 0.12 * height
              and abs(float(b.points[0, 0])) < 0.15 * height]  # fmt: skip
    if not behind:
        return {f"tail_{k}": hips + np.array([0.0, 0.02 * k * height, 0.0]) for k in (1, 2, 3)}
    tail = max(behind, key=lambda b: float(b.points[0, 1]))
    base = int(np.argmax(tail.points[:, 1] < hips[1] + 0.05 * height))
    length = float(tail.along[base]) if base else tail.free
    return {f"tail_{k}": tail.at(length * share) * [0, 1, 1] for k, share in ((1, 1.0), (2, 0.67), (3, 0.33))}
