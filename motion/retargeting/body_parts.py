"""Trunk, head and thighs of a rig as round bodies about a line, whose radius differs along it and around it.

On a character it is measured on the mesh; a take has none, so that a usual body of its size stands in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from muybridge.arrays import FloatArray
from muybridge.motion.character.character import Character
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.retargeting.chains import chest_of, spine_of
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig

ADULT_LEG_M = 0.85
_ALONG, _AROUND = 8, 16  # cells of a part's radius
_SIDEWAYS_M, _AHEAD_M, _HEAD_M, _THIGH_M = 0.15, 0.11, 0.09, 0.075  # radii of an adult
_SKULL_M = 0.12  # from the joint of an adult's head to the middle of the skull's upper half
_MOST = 0.5  # of a vertex's weight: it belongs to a part from here on
_FEW = 40  # vertices that show a part's shape
_OUTER = 0.9  # quantile of the radii of a cell


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the body.

    Attributes:
        start, stop: joints whose middle is either end of its line.
        beyond: (3,) metres at rest from there to the line's end.
        frames: joints whose mean left is the part's left.
        radius: (8, 16) metres along the line and around it.
    """

    start: tuple[int, ...]
    stop: tuple[int, ...]
    beyond: FloatArray
    frames: tuple[int, ...]
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class Placed:
    """A part over time: where its line starts, and its frame.

    Attributes:
        start: (T, 3) metres.
        axes: (T, 3, 3) columns: left, ahead or back, along the line.
        length: (T,) metres.
    """

    start: FloatArray
    axes: FloatArray
    length: FloatArray


@dataclass(frozen=True, eq=False)
class Seen:
    """A point as a part sees it.

    Attributes:
        along: (T,) of the line, 0 to 1.
        way: (T, 3) unit, from there to the point, in the part's frame.
        far: (T,) metres from there.
    """

    along: FloatArray
    way: FloatArray
    far: FloatArray


def find_parts(rig: Rig, character: Character | None = None) -> dict[str, Part]:
    """Trunk, thighs and, where there is one, head.

    Args:
        rig: with core roles.
        character: whose meshes show the shapes; None for those of a usual body.
    """
    size, chest, hips = rig.leg_length() / ADULT_LEG_M, chest_of(rig), rig.roles["hips"]
    around = np.arange(_AROUND) * 2 * np.pi / _AROUND
    oval = 1 / np.hypot(np.cos(around) / _SIDEWAYS_M, np.sin(around) / _AHEAD_M)

    def tile(radii: FloatArray | float) -> FloatArray:
        return np.tile(np.broadcast_to(radii, _AROUND) * size, (_ALONG, 1))

    both = [tuple(rig.roles[f"{side}_{part}"] for side in SIDES) for part in ("thigh", "upper_arm")]
    out = {"trunk": Part(both[0], both[1], np.zeros(3), (hips, chest), tile(oval))}
    owners: dict[str, Sequence[int]] = {"trunk": [hips, *spine_of(rig)]}
    for side in SIDES:
        thigh, shin = rig.roles[f"{side}_thigh"], rig.roles[f"{side}_shin"]
        out[f"{side}_thigh"] = Part((thigh,), (shin,), np.zeros(3), (thigh,), tile(_THIGH_M))
        owners[f"{side}_thigh"] = [thigh, *rig.path(shin, thigh)[:-1]]
    if "head" in rig.roles:
        head = rig.roles["head"]
        out["head"] = Part((head,), (head,), np.array([0.0, 0.0, _SKULL_M * size]), (head,), tile(_HEAD_M))
        owners["head"] = [j for j in range(len(rig.parents)) if head in rig.above(j)]
    if character is None or not character.meshes:
        return out
    points, weights = _vertices(rig, character)
    return {name: _measured(rig, part, points[weights[:, list(owners[name])].sum(axis=1) > _MOST])
            for name, part in out.items()}  # fmt: skip


def place_part(part: Part, posed: Posed) -> Placed:
    """A part of a posed rig."""
    at, turns = posed.places, posed.turns
    start = at[:, list(part.start)].mean(axis=1)
    stop = at[:, list(part.stop)].mean(axis=1) + turns[:, part.frames[-1]] @ part.beyond
    line = stop - start
    length = np.linalg.norm(line, axis=1)
    along = line / np.maximum(length, 1e-9)[:, None]
    left = turns[:, list(part.frames)][..., 0].mean(axis=1)
    left = left - (left * along).sum(-1, keepdims=True) * along
    left = left / np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    return Placed(start, np.stack([left, np.cross(along, left), along], axis=-1), length)


def see(placed: Placed, points: FloatArray) -> Seen:
    """Points (T, 3) in the world as a part sees them."""
    local = (np.swapaxes(placed.axes, -1, -2) @ (points - placed.start)[..., None])[..., 0]
    along = np.clip(local[:, 2] / np.maximum(placed.length, 1e-9), 0.0, 1.0)
    local[:, 2] -= along * placed.length
    far = np.linalg.norm(local, axis=1)
    return Seen(along, local / np.maximum(far, 1e-9)[:, None], far)


def radius_at(part: Part, seen: Seen) -> FloatArray:
    """(T,) metres of a part's radius towards points."""
    angle = np.arctan2(seen.way[:, 1], seen.way[:, 0]) % (2 * np.pi)
    ring = np.concatenate([part.radius, part.radius[:, :1]], axis=1)
    places = np.stack([seen.along * (_ALONG - 1), angle * _AROUND / (2 * np.pi)])
    return np.asarray(map_coordinates(ring, places, order=1, mode="nearest"))


def from_part(placed: Placed, seen: Seen, far: FloatArray) -> FloatArray:
    """(T, 3) metres in the world of points that another body's part sees so, `far` (T,) metres from the line."""
    local = seen.way * far[:, None]
    local[:, 2] += seen.along * placed.length
    return np.asarray(placed.start + (placed.axes @ local[..., None])[..., 0])


def rest_of(rig: Rig) -> Posed:
    """One frame of the rig at rest."""
    return Posed(np.tile(np.eye(3), (1, len(rig.parents), 1, 1)), rig.places[None])


def _vertices(rig: Rig, character: Character) -> tuple[FloatArray, FloatArray]:
    """(V, 3) metres at rest in the rig's axes, and (V, K) weights of its joints."""
    index = np.full(len(character.skeleton), len(rig.joints))
    index[list(rig.joints)] = np.arange(len(rig.joints))
    points, weights = [], []
    for mesh, posed in zip(character.meshes, pose_meshes(character, character.rest_motion()), strict=True):
        own = np.zeros((len(mesh.positions), len(rig.joints) + 1))
        for k in range(mesh.joints.shape[1]):
            np.add.at(own, (np.arange(len(own)), index[mesh.joints[:, k]]), mesh.weights[:, k])
        points.append((posed[0] - rig.mover_at_rest) @ rig.turn.T)
        weights.append(own[:, :-1])
    return np.concatenate(points), np.concatenate(weights)


def _measured(rig: Rig, part: Part, points: FloatArray) -> Part:
    """A part with the radius of its vertices; as it was where there are few."""
    if len(points) < _FEW:
        return part
    placed = place_part(part, rest_of(rig))
    local = (points - placed.start[0]) @ placed.axes[0]
    along = local[:, 2] / max(float(placed.length[0]), 1e-9)
    within = (along > -0.1) & (along < 1.1)
    radii, angle = np.hypot(local[:, 0], local[:, 1]), np.arctan2(local[:, 1], local[:, 0]) % (2 * np.pi)
    row = np.clip(np.round(along * (_ALONG - 1)).astype(int), 0, _ALONG - 1)
    column = np.round(angle * _AROUND / (2 * np.pi)).astype(int) % _AROUND
    found = np.full(part.radius.shape, np.nan)
    for k in np.unique(row[within] * _AROUND + column[within]):
        mine = within & (row == k // _AROUND) & (column == k % _AROUND)
        found[k // _AROUND, k % _AROUND] = np.quantile(radii[mine], _OUTER)
    known = np.isfinite(found)
    if not known.any():
        return part
    # Cells without vertices are as their neighbours.
    mode = ("nearest", "wrap")
    share = gaussian_filter(known.astype(np.float64), 1.5, mode=mode)
    filled = gaussian_filter(np.where(known, found, 0.0), 1.5, mode=mode) / np.maximum(share, 1e-6)
    usual = float(np.median(found[known]))
    found = np.where(known, found, np.where(share > 1e-3, filled, usual))
    return Part(part.start, part.stop, part.beyond, part.frames, found)
