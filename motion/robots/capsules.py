"""Capsules that stand for a robot's links, and which of them can meet.

Simple solids of the file become capsules; a link that has none (its shape is a mesh, or not given) gets one along its
bone, as thick as its mass says.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.motion.robots._pair_kernel import segment_distance, surface_distances
from muybridge.motion.robots.robot import Robot, Shape

_DENSITY = 1200.0  # kilograms per cubic metre of a link: motors, frame and air
_LEAST_BONE_M = 0.04  # a shorter link is inside its neighbours
_THIN, _THICK = 0.12, 0.5  # radius of an estimated capsule as a share of its bone
_POINT_M = 0.011  # solids of at most this radius are points that touch the floor, not the link's shape
_CLEAR_M = 0.015  # between links at rest; an estimated capsule is made thinner for it
_THINNEST = 0.4  # of what the mass says
_MOST_ROWS = 3  # of capsules that a flat box becomes


@dataclass(frozen=True, eq=False)
class Capsules:
    """Segments with a radius, on links.

    Attributes:
        link: (C,) index of the link.
        start, stop: (C, 3) metres in the link's frame.
        radius: (C,) metres.
        estimated: (C,) whether it is not from a shape of the file.
        pairs: (K, 2) capsules that can meet: not of one link or of neighbours, and apart at rest.
    """

    link: IndexArray
    start: FloatArray
    stop: FloatArray
    radius: FloatArray
    estimated: BoolArray
    pairs: IndexArray

    def __len__(self) -> int:
        return len(self.link)

    def distances(self, turns: FloatArray, places: FloatArray) -> FloatArray:
        """(T, K) metres between the surfaces of the pairs; negative where they are inside each other.

        Args:
            turns: (T, L, 3, 3) world from link.
            places: (T, L, 3) metres.
        """
        return surface_distances(*self.ends(turns, places), self.radius, self.pairs)

    def ends(self, turns: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(T, C, 3) metres of the two ends in the world."""
        out = []
        for ends in (self.start, self.stop):
            out.append(places[:, self.link] + (turns[:, self.link] @ ends[..., None])[..., 0])
        return np.ascontiguousarray(out[0]), np.ascontiguousarray(out[1])


def find_capsules(robot: Robot) -> Capsules:
    """The capsules of a robot."""
    rows: list[tuple[int, FloatArray, FloatArray, float, bool]] = []
    for link in range(len(robot)):
        solids = [s for s in robot.shapes if s.link == link and s.solid]
        bulky = [s for s in solids if _radius(s) > _POINT_M]
        if bulky:
            rows.extend((link, *each, False) for s in bulky for each in _of_shape(s))
        elif len(solids) >= 3:
            rows.append((link, *_of_points(solids), False))
        elif (bone := _bone(robot, link)) is not None:
            rows.append((link, *bone, True))
    link_of = np.array([row[0] for row in rows], np.int64)
    start, stop = (np.array([row[k] for row in rows]).reshape(-1, 3) for k in (1, 2))
    radius = np.array([row[3] for row in rows])
    estimated = np.array([row[4] for row in rows], np.bool_)
    bare = Capsules(link_of, start, stop, radius, estimated, np.zeros((0, 2), np.int64))
    return _with_pairs(robot, bare)


def _radius(shape: Shape) -> float:
    return float(np.sort(shape.size)[-1]) if shape.kind in ("box", "ellipsoid") else float(shape.size[0])


def _of_shape(shape: Shape) -> list[tuple[FloatArray, FloatArray, float]]:
    """Segments and radii for a shape; a flat box becomes several side by side."""
    if shape.kind == "sphere":
        return [(shape.place, shape.place, float(shape.size[0]))]
    if shape.kind in ("capsule", "cylinder"):
        half = float(shape.size[1]) - (float(shape.size[0]) if shape.kind == "cylinder" else 0.0)
        along = shape.turn[:, 2] * max(half, 0.0)
        return [(shape.place - along, shape.place + along, float(shape.size[0]))]
    order = np.argsort(shape.size)[::-1]
    long, wide, flat = shape.size[order]
    count = min(max(round(float(wide / max(flat, 1e-3))), 1), _MOST_ROWS)
    radius = float(flat if count > 1 else (wide + flat) / 2)
    along = shape.turn[:, order[0]] * max(long - radius, 0.0)
    across = shape.turn[:, order[1]] * max(wide - radius, 0.0)
    shifts = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    return [(shape.place + s * across - along, shape.place + s * across + along, radius) for s in shifts]


def _of_points(points: list[Shape]) -> tuple[FloatArray, FloatArray, float]:
    """A capsule over points that touch the floor, as long and as wide as they are apart, and resting on them."""
    places = np.array([s.place for s in points])
    middle = places.mean(axis=0)
    _, size, axes = np.linalg.svd(places - middle, full_matrices=False)
    reach = np.abs((places - middle) @ axes.T).max(axis=0) + float(points[0].size[0])
    radius = float(max(reach[1], _POINT_M))
    along = axes[0] * max(reach[0] - radius, 0.0)
    inward = -middle / max(np.linalg.norm(middle), 1e-9) * max(radius - float(points[0].size[0]), 0.0)
    up = axes[2] * np.sign(axes[2] @ inward or 1.0) * np.linalg.norm(inward)
    return middle + up - along, middle + up + along, radius


def _bone(robot: Robot, link: int) -> tuple[FloatArray, FloatArray, float] | None:
    """A link's capsule from its joint to those below it, or to where its mass says that it ends."""
    mass, centre = robot.masses[link], robot.centres[link]
    moved = [joint.anchor for joint in robot.joints if joint.link == link]
    if not moved and link != 0:  # fixed to another link: a ball of its mass
        radius = float(np.cbrt(0.75 * mass / (np.pi * _DENSITY)))
        return (centre, centre, radius) if np.isfinite(centre).all() and radius > _POINT_M else None
    own = moved[0] if moved else np.zeros(3)
    below = bone_ends(robot, link)
    stop = below.mean(axis=0) if len(below) else centre * 2 - own
    if len(below) == 2 and np.linalg.norm(stop - own) < _LEAST_BONE_M:  # hips, from one side to the other
        own, stop = below
    length = float(np.linalg.norm(stop - own))
    if not length >= _LEAST_BONE_M:
        return None
    radius = np.sqrt(mass / (_DENSITY * np.pi * length)) if mass > 0 else 0.15 * length
    radius = float(np.clip(radius, _THIN * length, _THICK * length))
    along = (stop - own) / length * min(radius, length / 2)
    return own + along / 2, stop - along / 2, radius


def bone_ends(robot: Robot, link: int) -> FloatArray:
    """(N, 3) metres in the link's frame: the joints below it, or the links that are fixed to it where none moves."""
    moved = {joint.link: joint.anchor for joint in reversed(robot.joints)}
    moving, fixed = [], []
    stack = [(child, np.zeros(3), np.eye(3)) for child in _children(robot, link)]
    while stack:
        child, place, turn = stack.pop()
        here, there = place + turn @ robot.places[child], turn @ robot.turns[child]
        if child in moved:
            moving.append(here + there @ moved[child])
        else:
            fixed.append(here)
            stack.extend((each, here, there) for each in _children(robot, child))
    if not moving and fixed:
        moving = [max(fixed, key=lambda place: float(np.linalg.norm(place)))]
    return np.array(moving).reshape(-1, 3)


def _children(robot: Robot, link: int) -> list[int]:
    return [k for k, parent in enumerate(robot.parents) if parent == link]


def _with_pairs(robot: Robot, capsules: Capsules) -> Capsules:
    turns, places = robot.at_rest()
    a, b = (each[0] for each in capsules.ends(turns[None], places[None]))
    carried = _carriers(robot, set(capsules.link.tolist()))
    radius, pairs = capsules.radius.copy(), []
    least = radius * _THINNEST
    count = len(capsules)
    wanted = [
        (i, j) for i in range(count) for j in range(i) if not _neighbours(capsules.link[i], capsules.link[j], carried)
    ]
    for i, j in wanted:
        gap = segment_distance(a[i], b[i], a[j], b[j])
        for k in sorted((i, j), key=lambda k: -radius[k]):
            short = _CLEAR_M - (gap - radius[i] - radius[j])
            if short > 0 and capsules.estimated[k]:
                radius[k] = max(radius[k] - short, least[k])
    for i, j in wanted:
        if segment_distance(a[i], b[i], a[j], b[j]) - radius[i] - radius[j] > 0.3 * _CLEAR_M:
            pairs.append((i, j))
    found = np.array(pairs, np.int64).reshape(-1, 2)
    return Capsules(capsules.link, capsules.start, capsules.stop, radius, capsules.estimated, found)


def _carriers(robot: Robot, links: set[int]) -> dict[int, int]:
    """Of each link with capsules: the next one above that has some; -1 for none."""
    out = {}
    for link in links:
        above = robot.parents[link]
        while above >= 0 and above not in links:
            above = robot.parents[above]
        out[link] = above
    return out


def _neighbours(one: int, other: int, carried: dict[int, int]) -> bool:
    return one == other or carried[one] == other or carried[other] == one
