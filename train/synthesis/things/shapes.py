"""A small modelling kit: boxes, tubes, surfaces of revolution and sheets with a surface each, to be joined.

Lengths are metres. Faces are counter-clockwise seen from outside.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from muybridge.arrays import FloatArray, IntArray

PLAIN, MOTTLED, WOOD, WOVEN, METAL, FUR = range(6)
X, Y, Z = np.eye(3)


class Surface(NamedTuple):
    """What a shape is made of: linear RGB, 0 to 1; pattern and gloss as of a `Thing`."""

    colour: tuple[float, float, float]
    pattern: int = PLAIN
    gloss: float = 0.15


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (V, 3), faces (F, 3), and of each face its colour (F, 3), pattern (F,) and gloss (F,)."""

    vertices: FloatArray
    faces: IntArray
    colour: FloatArray
    pattern: IntArray
    gloss: FloatArray

    def moved(self, by: ArrayLike) -> "Mesh":
        """The mesh moved by (3,)."""
        return replace(self, vertices=self.vertices + np.asarray(by, float))

    def turned(self, rotation: FloatArray, about: ArrayLike = (0.0, 0.0, 0.0)) -> "Mesh":
        """The mesh turned by (3, 3) about a point."""
        centre = np.asarray(about, float)
        return replace(self, vertices=(self.vertices - centre) @ rotation.T + centre)

    def mirrored(self) -> "Mesh":
        """The mirror image, left and right (x) exchanged."""
        return replace(self, vertices=self.vertices * [-1, 1, 1], faces=self.faces[:, ::-1])


def mesh(vertices: FloatArray, faces: IntArray, surface: Surface) -> Mesh:
    """A mesh of one surface."""
    count = len(faces)
    colour = np.clip(np.tile(np.asarray(surface.colour, float), (count, 1)), 0, 1)
    return Mesh(np.asarray(vertices, float), np.asarray(faces), colour, np.full(count, surface.pattern),
                np.full(count, surface.gloss))  # fmt: skip


def join(*meshes: Mesh) -> Mesh:
    """One mesh of several."""
    first = np.cumsum([0] + [len(m.vertices) for m in meshes])
    faces = [m.faces + n for m, n in zip(meshes, first[:-1], strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces),
                np.concatenate([m.colour for m in meshes]), np.concatenate([m.pattern for m in meshes]),
                np.concatenate([m.gloss for m in meshes]))  # fmt: skip


@functools.cache
def _bevelled_cube() -> tuple[FloatArray, FloatArray, IntArray]:
    """Signs (24, 3) of the corners, which coordinate (24, 3) is full, and faces."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1) for _ in range(3)], float)
    full = np.tile(np.eye(3), (8, 1))
    points = signs * np.where(full > 0, 1.0, 0.7)
    return signs, full, _outward(points, ConvexHull(points).simplices)


def _outward(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces of a convex body around the origin, turned counter-clockwise from outside."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    inside = (np.cross(b - a, c - a) * (a + b + c)).sum(1) < 0
    return np.where(inside[:, None], faces[:, ::-1], faces)


@functools.cache
def _cube() -> tuple[FloatArray, IntArray]:
    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    return points, _outward(points, ConvexHull(points).simplices)


def box(size: ArrayLike, at: ArrayLike, surface: Surface, bevel: float = 0.0) -> Mesh:
    """A box of `size` (3,) around the point `at`, its edges cut off by `bevel`."""
    half = np.asarray(size, float) / 2
    if bevel <= 0:
        corners, faces = _cube()
        return mesh(corners * half + np.asarray(at, float), faces, surface)
    signs, full, faces = _bevelled_cube()
    cut = np.minimum(bevel, 0.9 * half.min())
    return mesh(signs * (half - cut * (1 - full)) + np.asarray(at, float), faces, surface)


def _rings(rings: FloatArray, surface: Surface, closed: bool) -> Mesh:
    """The skin over rings (N, S, 3), each counter-clockwise seen from the last one; ends are closed by fans."""
    n, sides = rings.shape[:2]
    vertices = rings.reshape(-1, 3)
    i = np.arange(n if closed else n - 1)[:, None] * sides
    j = np.arange(sides)[None]
    k = (j + 1) % sides
    top = (i + sides) % (n * sides)
    faces = np.stack([np.stack([i + j, i + k, top + k], -1), np.stack([i + j, top + k, top + j], -1)]).reshape(-1, 3)
    if not closed:
        ends = np.stack([rings[0].mean(0), rings[-1].mean(0)])
        first, last, base = np.arange(sides), np.arange(sides) + (n - 1) * sides, n * sides
        around = (np.arange(sides) + 1) % sides
        bottom = np.stack([first[around], first, np.full(sides, base)], -1)
        lid = np.stack([last, last[around], np.full(sides, base + 1)], -1)
        vertices, faces = np.concatenate([vertices, ends]), np.concatenate([faces, bottom, lid])
    return mesh(vertices, faces, surface)


def tube(points: ArrayLike, radius: ArrayLike, surface: Surface, sides: int = 8, closed: bool = False,
         flat: float = 1.0) -> Mesh:  # fmt: skip
    """A round tube along points (N, 3).

    Args:
        points: the line in its middle.
        radius: one, or one a point.
        surface: of the tube.
        sides: of its cross-section.
        closed: whether the last point is joined to the first.
        flat: thickness across the first direction of the cross-section, relative to the other.
    """
    line = np.asarray(points, float)
    if closed:
        along = np.roll(line, -1, 0) - np.roll(line, 1, 0)
    else:
        along = np.gradient(line, axis=0)
    along = along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-12)
    start = Z if abs(along[0, 2]) < 0.9 else Y
    across = np.empty_like(line)
    for i, way in enumerate(along):
        # The cross-section is carried along without turning about the line.
        side = start - (start @ way) * way
        across[i] = start = side / (np.linalg.norm(side) + 1e-12)
    other = np.cross(along, across)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :, None]
    size = np.broadcast_to(np.asarray(radius, float), (len(line),))[:, None, None]
    circle = flat * np.cos(angle) * across[:, None] + np.sin(angle) * other[:, None]
    return _rings(line[:, None] + size * circle, surface, closed)


def rod(start: ArrayLike, end: ArrayLike, radius: float, surface: Surface, sides: int = 8) -> Mesh:
    """A cylinder from `start` to `end`."""
    return tube(np.stack([np.asarray(start, float), np.asarray(end, float)]), radius, surface, sides)


def capsule(start: ArrayLike, end: ArrayLike, radius: ArrayLike, surface: Surface, sides: int = 10) -> Mesh:
    """A cylinder or cone with round ends; `radius`: one, or one for each end."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    first, last = np.broadcast_to(np.asarray(radius, float), (2,)).tolist()
    way = (b - a) / (np.linalg.norm(b - a) + 1e-9)
    turn = np.radians([88, 55, 25])
    before = [(a - way * first * np.sin(t), first * np.cos(t)) for t in turn]
    after = [(b + way * last * np.sin(t), last * np.cos(t)) for t in turn[::-1]]
    line = [*before, (a, first), (b, last), *after]
    return tube([p for p, _ in line], [r for _, r in line], surface, sides)


def lathe(profile: ArrayLike, at: ArrayLike, surface: Surface, sides: int = 16, axis: ArrayLike = (0, 0, 1)) -> Mesh:
    """A surface of revolution: `profile` (N, 2) radius and height, upward; `axis` where up is."""
    points = np.asarray(profile, float)
    up = np.asarray(axis, float) / np.linalg.norm(axis)
    side = np.cross(Y if abs(up[1]) < 0.9 else X, up)
    side /= np.linalg.norm(side)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :, None]
    circle = np.cos(angle) * side + np.sin(angle) * np.cross(up, side)
    rings = points[:, 0, None, None].clip(1e-4) * circle + points[:, 1, None, None] * up
    return _rings(rings + np.asarray(at, float), surface, False)


def disc(radius: float, thickness: float, at: ArrayLike, surface: Surface, sides: int = 20,
         axis: ArrayLike = (0, 0, 1)) -> Mesh:  # fmt: skip
    """A round plate around the point `at`."""
    half, edge = thickness / 2, min(0.3 * thickness, 0.1 * radius)
    profile = [(radius - edge, -half), (radius, edge - half), (radius, half - edge), (radius - edge, half)]
    return lathe(profile, at, surface, sides, axis)


def ellipsoid(radii: ArrayLike, at: ArrayLike, surface: Surface, sides: int = 14) -> Mesh:
    """An ellipsoid with its axes along x, y, z."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, max(5, sides // 2 + 1))
    ball = lathe(np.stack([np.cos(turn), np.sin(turn)], -1), (0, 0, 0), surface, sides)
    return replace(ball, vertices=ball.vertices * np.asarray(radii, float) + np.asarray(at, float))


def sheet(grid: FloatArray, thickness: float, surface: Surface) -> Mesh:
    """A bent plate: its middle surface (N, M, 3), the outside where rows cross columns."""
    across, along = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normal = np.cross(across, along)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-12
    # Each row is a flat ring: over the plate's outside and back along its inside.
    over, under = grid + normal * thickness / 2, grid - normal * thickness / 2
    return _rings(np.concatenate([under, over[:, ::-1]], 1), surface, False)


def prism(outline: ArrayLike, thickness: float, surface: Surface, plane: str = "xy") -> Mesh:
    """A plate with an outline (N, 2), counter-clockwise, whose every point is seen from its middle; around the plane of
    the two axes named by `plane`."""
    flat = np.asarray(outline, float)
    first, second = ("xyz".index(c) for c in plane)
    third = 3 - first - second
    rings = np.zeros((2, len(flat), 3))
    rings[:, :, first], rings[:, :, second] = flat[:, 0], flat[:, 1]
    up = 1.0 if (second - first) % 3 == 1 else -1.0
    rings[0, :, third], rings[1, :, third] = -up * thickness / 2, up * thickness / 2
    return _rings(rings, surface, False)


def strut(start: Sequence[float], end: Sequence[float], width: float, depth: float, surface: Surface) -> Mesh:
    """A beam with a square cross-section from `start` to `end`; upright ones have their width along x."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    way = (b - a) / (np.linalg.norm(b - a) + 1e-12)
    across = np.cross(Y if abs(way[1]) < 0.9 else Z, way)
    across /= np.linalg.norm(across)
    other = np.cross(way, across)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * [width, depth]
    ring = corners[:, :1] * across + corners[:, 1:] * other
    return _rings(np.stack([a + ring, b + ring]), surface, False)
