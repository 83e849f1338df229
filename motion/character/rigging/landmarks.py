"""Where the limbs of a standing body leave its trunk: armpits, crotch, neck, ankles, measured in its volume."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.motion.character.rigging.paths import Branch, Graph, build_graph, find_branches, section
from muybridge.motion.character.rigging.volume import Volume

_LEAST_BRANCH = 0.05  # of the height
_SAMPLES = 60  # cross-sections along an arm
_SPLIT = 0.42  # of the height: below it the two legs are kept apart
_STUB = 0.5  # of the other side's free length, below which a way is no arm
_THINNED = 2  # layers of cells that are taken off to part an arm from the body
_GROWN = 1.6  # by which the section of a body that two legs enter exceeds theirs, if a skirt hides them


class NoBody(ValueError):
    """A volume without the limbs that a template needs; the message says which, `four_legs` whether it is an animal."""

    def __init__(self, message: str, four_legs: bool = False) -> None:
        super().__init__(message)
        self.four_legs = four_legs


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm, from its end to the trunk.

    Attributes:
        way: from the tip of the hand to the middle of the body.
        armpit: metres from the tip to where the arm meets the trunk.
        direction: (3,) unit vector of the upper arm, towards the trunk.
        sections: (N, 2) metres from the tip, and square metres of the cross-section there.
    """

    way: Branch
    armpit: float
    direction: FloatArray
    sections: FloatArray


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg.

    Attributes:
        way: from the tip of the toes to the middle of the body.
        slices: (N, 4) metres, the middles of its horizontal cross-sections from the floor to above the hip, which end
            at the plane of symmetry, and their areas in square metres.
        heel: metres, y of the rearmost cell of the foot.
        toes: metres, y of the foremost.
        middle: metres, x of the middle of the foot.
    """

    way: Branch
    slices: FloatArray
    heel: float
    toes: float
    middle: float

    def at_height(self, z: float) -> FloatArray:
        """(3,) the middle of the leg at a height."""
        s = self.slices
        return np.array([np.interp(z, s[:, 2], s[:, 0]), np.interp(z, s[:, 2], s[:, 1]), z])


@dataclass(frozen=True, eq=False)
class Landmarks:
    """What is measured on a body that stands on z = 0, faces -Y and is symmetric about x = 0; metres.

    Attributes:
        height: of its highest cell.
        arms: left and right.
        legs: left and right.
        crotch: height at which the legs meet.
        hidden: whether that is the hem of clothes.
        trunk: (N, 4) height, x and y of the middle and area of the trunk's cross-section, without the arms.
        shoulders: height at which the trunk narrows above the chest.
        neck: height of its narrowest slice above the shoulders.
        branches: all ways.
    """

    height: float
    arms: tuple[Arm, Arm]
    legs: tuple[Leg, Leg]
    crotch: float
    hidden: bool
    trunk: FloatArray
    shoulders: float
    neck: float
    branches: tuple[Branch, ...]


def find_landmarks(volume: Volume) -> Landmarks:
    """Measure a body in its own frame.

    Raises:
        NoBody: no two legs or no two arms.
    """
    branches, height = branches_of(volume)
    if feet_of_animal(branches, height):
        raise NoBody("it stands on four legs", four_legs=True)
    legs = []
    for sign in (1.0, -1.0):
        low = [b for b in branches if b.points[0, 2] < 0.15 * height and b.points[0, 0] * sign > 0]
        if not low:
            raise NoBody(f"no {'left' if sign > 0 else 'right'} leg was found")
        legs.append(max(low, key=lambda b: b.reach))
    both = _arms(volume, legs, branches, height)
    trunk = _without_arms(volume, both)
    crotch, hidden = _crotch(volume, trunk, legs, height)
    feet = [_leg(volume, trunk, leg, height) for leg in legs]
    table = _trunk(volume, trunk)
    return Landmarks(height, both, (feet[0], feet[1]), crotch, hidden, table, *_neck(table, both, height), branches)


def branches_of(volume: Volume) -> tuple[tuple[Branch, ...], float]:
    """The ways from the ends of a body in its own frame to its middle, and its height in metres."""
    graph = build_graph(_split(volume))
    height = float(volume.centres(graph.cells)[:, 2].max())
    return tuple(find_branches(graph, middle_of(graph, height), _LEAST_BRANCH * height)), height


def _arms(volume: Volume, legs: list[Branch], branches: Sequence[Branch], height: float) -> tuple[Arm, Arm]:
    """Left and right arm; one that clings to the body is looked for in its core, or mirrored from the other side."""
    ways: list[Branch | None] = [None, None]
    for tried in range(_THINNED + 1):
        if tried:
            thin = ndimage.binary_erosion(volume.inside, iterations=tried)
            graph = build_graph(_split(replace(volume, inside=thin)))
            branches = find_branches(graph, middle_of(graph, height), _LEAST_BRANCH * height)
        for k, sign in enumerate((1.0, -1.0)):
            found = [b for b in branches if all(b is not leg for leg in legs) and _is_arm(b, sign, height)]
            if ways[k] is None and found:
                ways[k] = max(found, key=lambda b: b.free + 0.5 * abs(float(b.points[0, 0])))
        left, right = ways
        if left is not None and right is not None and min(left.free, right.free) < _STUB * max(left.free, right.free):
            ways[0 if left.free < right.free else 1] = None  # a shoulder, or a strand of hair
        if all(way is not None for way in ways):
            break
    arms = [None if way is None else _arm(volume, way, height) for way in ways]
    if arms[0] is None and arms[1] is None:
        raise NoBody("no arms were found")
    return arms[0] or _mirrored(arms[1]), arms[1] or _mirrored(arms[0])


def _mirrored(arm: Arm | None) -> Arm:
    assert arm is not None
    flip = np.array([-1.0, 1.0, 1.0])
    way = replace(arm.way, points=arm.way.points * flip)
    return replace(arm, way=way, direction=arm.direction * flip)


def feet_of_animal(branches: Sequence[Branch], height: float) -> tuple[Branch, ...]:
    """The legs of an animal, front left, front right, back left and back right; empty where there are no four."""
    out = []
    for sign in (1.0, -1.0):
        low = [b for b in branches if b.points[0, 2] < 0.12 * height and b.points[0, 0] * sign > 0
               and b.free > 0.15 * height]  # fmt: skip
        front, back = (pick(low, key=lambda b: float(b.points[0, 1]), default=None) for pick in (min, max))
        if front is None or back is None or back.points[0, 1] - front.points[0, 1] < 0.3 * height:
            return ()
        out.append((front, back))
    return (out[0][0], out[1][0], out[0][1], out[1][1])


def _split(volume: Volume) -> Volume:
    """The volume with a gap between the legs, which clothes or thick thighs may join."""
    inside = volume.inside.copy()
    x = int(np.round(-volume.origin[0] / volume.cell))
    inside[x, :, : int(_SPLIT * volume.inside.shape[2])] = False
    return replace(volume, inside=inside, radius=ndimage.distance_transform_edt(inside) * volume.cell)


def _without_arms(volume: Volume, arms: tuple[Arm, Arm]) -> BoolArray:
    """The cells of trunk, head and legs."""
    out = volume.inside.copy()
    for arm in arms:
        along = arm.way.along
        for k in np.flatnonzero(along < arm.armpit):
            c = volume.cell_of(arm.way.points[k])
            size = 1.35 * volume.radius[tuple(c)] / volume.cell + 1.5
            n = int(size) + 1
            low, high = np.maximum(c - n, 0), np.minimum(c + n + 1, out.shape)
            box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
            out[box] &= sum((g - m) ** 2 for g, m in zip(np.ogrid[box], c, strict=True)) > size**2
    return out


def middle_of(graph: Graph, height: float) -> int:
    """The node in the thickest place of the trunk."""
    places = graph.volume.centres(graph.cells)
    radius = graph.volume.radius[tuple(graph.cells.T)]
    z = places[:, 2] / height
    return int(np.argmax(np.where((np.abs(places[:, 0]) < 0.05 * height) & (z > _SPLIT) & (z < 0.62), radius, -1.0)))


def _is_arm(branch: Branch, sign: float, height: float) -> bool:
    tip = branch.points[0]
    lateral = float((branch.points[:, 0] * sign).max())
    long = branch.free > 0.12 * height and lateral > 0.12 * height
    return bool(long and tip[0] * sign > max(0.08 * height, 0.5 * lateral) and tip[2] > 0.15 * height)


def _arm(volume: Volume, way: Branch, height: float) -> Arm:
    along = way.along
    inside = np.flatnonzero(np.abs(way.points[:, 0]) < 0.03 * height)
    whole = float(along[inside[0]]) if len(inside) else float(along[-1])
    step = whole / _SAMPLES
    sections = []
    for s in np.arange(0.04, 0.97, 1 / _SAMPLES) * whole:
        tangent = way.at(s + 3 * step) - way.at(s - 3 * step)
        area = section(volume, way.at(s), tangent / max(float(np.linalg.norm(tangent)), 1e-9), 0.2 * height)[0]
        sections.append((s, max(area, volume.cell**2)))
    table = np.array(sections)
    growth = np.log(table[2:, 1] / table[:-2, 1])
    middle = table[1:-1, 0] / whole
    growth[(middle < 0.45) | (middle > 0.92)] = -np.inf
    armpit = float(table[1 + int(np.argmax(growth)), 0])
    near, far = way.at(armpit - 0.02 * height), way.at(armpit - 0.35 * armpit)
    direction = (near - far) / max(float(np.linalg.norm(near - far)), 1e-9)
    return Arm(way, armpit, direction, table)


def _crotch(volume: Volume, inside: BoolArray, ways: list[Branch], height: float) -> tuple[float, bool]:
    """Metres, the height at which the legs meet, and whether that is the hem of clothes."""
    eight, below = np.ones((3, 3)), []
    for k in range(int((0.5 * height - volume.origin[2]) / volume.cell), 0, -1):
        z = float(volume.origin[2] + k * volume.cell)
        label = ndimage.label(inside[:, :, k], eight)[0]
        own = [_label_at(volume, label, way, z) for way in ways]
        below.append(sum(int((label == n).sum()) for n in set(own)))
        if own[0] != own[1]:
            above = below[-3] if len(below) > 2 else below[0]
            return z, above >= _GROWN * below[-1]
    return 0.0, True


def _label_at(volume: Volume, label: IntArray, way: Branch, z: float) -> int:
    """The part of a slice that a way passes."""
    k = int(np.argmin(np.abs(way.points[:, 2] - z)))
    x, y, _ = volume.cell_of(way.points[k])
    if label[x, y]:
        return int(label[x, y])
    if not label.any():
        return 0
    near = ndimage.distance_transform_edt(label == 0, return_distances=False, return_indices=True)[:, x, y]
    return int(label[tuple(near)])


def _leg(volume: Volume, inside: BoolArray, way: Branch, height: float) -> Leg:
    """The middles of a leg's slices, and its foot."""
    sign = np.sign(way.points[0, 0])
    x = volume.origin[0] + np.arange(inside.shape[0]) * volume.cell
    half = inside & (x * sign > 0)[:, None, None]
    slices = []
    for k in range(int((0.62 * height - volume.origin[2]) / volume.cell)):
        z = float(volume.origin[2] + k * volume.cell)
        label = ndimage.label(half[:, :, k], np.ones((3, 3)))[0]
        own = _label_at(volume, label, way, z)
        if own:
            cells = np.argwhere(label == own)
            slices.append([*(volume.origin[:2] + cells.mean(axis=0) * volume.cell), z, len(cells) * volume.cell**2])
    table = np.array(slices)
    low = half[:, :, : int((0.04 * height - volume.origin[2]) / volume.cell) + 1]
    label = ndimage.label(low, np.ones((3, 3, 3)))[0]
    tip = volume.cell_of(way.points[0])
    foot = label[tuple(np.minimum(tip, np.array(low.shape) - 1))]
    cells = np.argwhere(label == foot) if foot else np.argwhere(low)
    if not len(cells):
        raise NoBody(f"no {'left' if sign > 0 else 'right'} foot was found")
    places = volume.centres(cells)
    return Leg(way, table, float(places[:, 1].max()), float(places[:, 1].min()), float(np.median(places[:, 0])))


def _trunk(volume: Volume, inside: BoolArray) -> FloatArray:
    """(N, 4) height, middle and area of the slices of what is left without the arms."""
    out = []
    for k in range(inside.shape[2]):
        cells = np.argwhere(inside[:, :, k])
        if len(cells):
            middle = volume.origin[:2] + cells.mean(axis=0) * volume.cell
            out.append([volume.origin[2] + k * volume.cell, *middle, len(cells) * volume.cell**2])
    return np.array(out)


def _neck(trunk: FloatArray, arms: tuple[Arm, Arm], height: float) -> tuple[float, float]:
    """Heights of the shoulders and of the neck's narrowest slice."""
    z, area = trunk[:, 0], ndimage.gaussian_filter1d(trunk[:, 3], 1.0)
    armpit = float(np.mean([arm.way.at(arm.armpit)[2] for arm in arms]))
    chest = np.median(area[(z > armpit - 0.12 * height) & (z < armpit + 0.02 * height)])
    narrow = z[(z > armpit) & (area < 0.5 * chest)]
    shoulders = float(narrow.min()) if len(narrow) else armpit + 0.05 * height
    above = np.flatnonzero((z >= shoulders - 0.02 * height) & (z <= shoulders + 0.45 * (height - shoulders)))
    return shoulders, float(z[above[np.argmin(area[above])]]) if len(above) else shoulders
