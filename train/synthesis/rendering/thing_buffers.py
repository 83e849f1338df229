"""Meshes of things, and the programs that draw them."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import Float32Array
from muybridge.train.synthesis.rendering.renderer import SHADERS, Program, Renderer
from muybridge.train.synthesis.things.scene import Thing

# Faces that meet at a larger angle have an edge between them; others are shaded smoothly. Degrees.
CREASE = 38.0
_FIELDS = "3f 3f 3f 2f"
_NAMES = ("position", "normal", "colour", "surface")
_FLOATS = 11


class ThingBuffers:
    """Draws things with a renderer's lights and shadow maps.

    Args:
        renderer: whose context and textures are used.
    """

    def __init__(self, renderer: Renderer) -> None:
        self._ctx = ctx = renderer.ctx
        vertex = (SHADERS / "thing.vert").read_text()
        mask = "#version 330\nout vec4 colour;\nvoid main() { colour = vec4(1); }"
        sources = {
            "colour": ("clip", (SHADERS / "thing.frag").read_text()), "mask": ("clip", mask),
            "depth": ("light_clip", "#version 330\nvoid main() {}"),
        }  # fmt: skip
        self._programs = {
            name: Program(ctx, vertex.replace("PROJECTION", projection + "_from_world"), fragment)
            for name, (projection, fragment) in sources.items()
        }
        self._buffer = ctx.buffer(reserve=1 << 16, dynamic=True)
        self._count = 0

    def load(self, things: Sequence[Thing]) -> None:
        """Draw `things` from now on."""
        table = np.concatenate([corners(t) for t in things]) if things else np.zeros((0, _FLOATS), np.float32)
        self._count = len(table)
        if table.nbytes > self._buffer.size:
            self._buffer.orphan(table.nbytes)
        if self._count:
            self._buffer.write(table.tobytes())
        self._arrays = {name: self._array(program) for name, program in self._programs.items()}

    def _array(self, program: Program) -> object:
        fields = zip(_NAMES, _FIELDS.split(), strict=True)
        used = [n for n in _NAMES if n in program.program]
        layout = " ".join(size if n in used else f"{4 * int(size[0])}x" for n, size in fields)
        return self._ctx.vertex_array(program.program, [(self._buffer, layout, *used)])

    def draw(self, name: str, values: dict[str, object]) -> None:
        """Draw everything into the current target: `colour`, `mask` or `depth`."""
        if self._count:
            self._programs[name].set(values)
            self._arrays[name].render(vertices=self._count)  # type: ignore[attr-defined]


def corners(thing: Thing) -> Float32Array:
    """(3 F, 11) position, normal, colour, pattern and gloss of the corners of the faces."""
    points = np.asarray(thing.vertices_world, np.float32)
    faces = np.asarray(thing.faces)
    normals = _corner_normals(points, faces)
    per_face = np.concatenate(
        [np.asarray(thing.colour, np.float32), np.stack([thing.pattern, thing.gloss], -1).astype(np.float32)], 1
    )
    return np.concatenate([points[faces.reshape(-1)], normals, np.repeat(per_face, 3, 0)], 1).astype(np.float32)


def _corner_normals(points: Float32Array, faces: np.ndarray) -> Float32Array:
    """(3 F, 3): the mean normal of those faces around a corner's vertex that meet its own at less than `CREASE`."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    unit = weighted / (np.linalg.norm(weighted, axis=1, keepdims=True) + 1e-12)
    vertex = faces.reshape(-1)
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex, minlength=len(points))
    first = np.concatenate([[0], np.cumsum(count)])[:-1]
    # Every corner is paired with every corner at the same vertex.
    many = count[vertex]
    own = np.repeat(np.arange(len(vertex)), many)
    step = np.arange(len(own)) - np.repeat(np.cumsum(many) - many, many)
    other = order[first[vertex[own]] + step]
    near = np.einsum("ij,ij->i", unit[own // 3], unit[other // 3]) > np.cos(np.radians(CREASE))
    total = np.stack([np.bincount(own[near], weighted[other[near] // 3, k], len(vertex)) for k in range(3)], -1)
    return np.asarray(total / (np.linalg.norm(total, axis=1, keepdims=True) + 1e-12), np.float32)
