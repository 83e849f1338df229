"""Vertices of everything that is drawn of a person: the body, its shells, the dome around the skull, accessories."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.clothing import garments
from muybridge.train.synthesis.clothing.garments import Accessory

I32 = NDArray[np.int32]


class Shells:
    """Faces of each part, and positions of all vertices for a posed body.

    Attributes:
        parts: triangles of body, trousers, shirt, shoes, skirt, long hair, hair, hat and the accessory slots.
        coarse_body: triangles of the body for shadows, with detail below a few millimetres removed.
        static: (count, 7) position at rest and traits (head, eye, arm, distance of loose cloth from the skin in
            metres).
        count: number of vertices.
        first: first vertex of the accessories.
        dot_places: vertices of the body that may carry a reflective dot.
    """

    def __init__(self, body: BodyModel) -> None:
        body_faces, tights, skirt, long_hair = body.parts
        v = len(body.rest)
        rings, spokes = garments.DOME
        self._dome = garments.dome_weights(body.rest[:BODY_VERTICES], body.is_head[:BODY_VERTICES] > 0.5)
        dome_rest = self._dome @ body.rest[:BODY_VERTICES]
        dome = garments.grid_faces(rings, spokes, closed=True)[:, ::-1] + v
        rows, columns = garments.GRID
        self.first = v + len(dome_rest)
        self._grid = garments.grid_faces(rows, columns, closed=False)
        slots = [self._grid + self.first + k * rows * columns for k in range(garments.SLOTS)]
        self.count = self.first + garments.SLOTS * rows * columns
        q = body.rest[tights]
        arm = body.arm_weight[tights].max(1) > 0.3
        trousers = tights[(q[..., 2].min(1) < 0.24) & ~arm]
        shirt = tights[(q[..., 2].max(1) > -0.13) | arm]
        shoes = tights[(q[..., 2].min(1) < -0.44) & ~arm]
        self.parts: list[I32] = [body_faces, trousers, shirt, shoes, skirt, long_hair, dome, dome, *slots]
        self.coarse_body = _coarse(body_faces, body.rest, body.arm_weight > 0.5)
        self.static = np.zeros((self.count, 7), np.float32)
        self.static[:v, :3] = body.rest
        self.static[:v, 3:6] = np.stack([body.is_head, body.is_eye, body.arm_weight], 1)
        self.static[v : self.first, :3] = dome_rest
        self.static[v : self.first, 3] = 1
        self._tights = int(tights.min()), int(tights.max()) + 1
        self._mean = garments.smoothing(tights, self._tights[0], self._tights[1] - self._tights[0])
        low, high = self._tights
        self.static[low:high, 6] = garments.drape(body.rest[low:high], body.arm_weight[low:high] > 0.5, self._mean)
        self._anchors = garments.Anchors(body.rest, body.arm_weight, BODY_VERTICES)
        self._faces = np.concatenate([*body.parts, dome])
        self._incidence = _incidence(self._faces, self.first)
        self._grid_incidence = _incidence(self._grid, rows * columns)
        skin = body.rest[:BODY_VERTICES]
        limbs = (body.is_head[:BODY_VERTICES] < 0.5) & (skin[:, 2] > -0.80) & (np.abs(skin[:, 0]) < 0.455)
        self.dot_places = np.nonzero(limbs)[0]

    def shape(self, vertices: Float32Array) -> tuple[Float32Array, Float32Array]:
        """The buffer (first, 9) of positions, normals and slack positions for a posed body (V, 3); and the normals."""
        points = np.concatenate([vertices, self._dome @ vertices[:BODY_VERTICES]])
        normals = _unit(self._incidence @ _face_normals(points, self._faces))
        table = np.concatenate([points, normals, points], 1).astype(np.float32)
        low, high = self._tights
        table[low:high, 6:] = garments.slack(vertices[low:high], self._mean)
        return table, normals

    def accessories(self, items: tuple[Accessory, ...], vertices: Float32Array) -> Float32Array:
        """(len(items) * rows * columns, 9): the same for accessories on a posed body."""
        tables = []
        for item in items:
            points = self._anchors.carry(item, vertices)
            normals = _unit(self._grid_incidence @ _face_normals(points, self._grid))
            tables.append(np.concatenate([points, normals, points], 1))
        return np.concatenate(tables).astype(np.float32) if tables else np.zeros((0, 9), np.float32)


def _coarse(faces: I32, rest: Float32Array, on_arm: BoolArray, cell: float = 0.008) -> I32:
    """`faces` with the vertices in each cube of `cell` metres at rest merged; arms separate from the trunk."""
    cube = np.concatenate([np.round(rest / cell).astype(int), on_arm[:, None]], 1)
    _, first, number = np.unique(cube, axis=0, return_index=True, return_inverse=True)
    merged = first[number.ravel()][faces]
    a, b, c = merged.T
    return np.asarray(merged[(a != b) & (b != c) & (a != c)], np.int32)


def _incidence(faces: I32, count: int) -> sp.csr_matrix:
    """(count, F) which faces a vertex belongs to."""
    entries = np.ones(faces.size, "f4"), (faces.reshape(-1), np.repeat(np.arange(len(faces)), 3))
    return sp.csr_matrix(entries, shape=(count, len(faces)))


def _face_normals(points: Float32Array, faces: I32) -> Float32Array:
    """(F, 3) normals whose length is twice the area."""
    a = points[faces[:, 0]]
    u, v = (points[faces[:, 1]] - a).T, (points[faces[:, 2]] - a).T
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], 1)


def _unit(normals: NDArray[np.floating]) -> Float32Array:
    size = np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
    return np.asarray(normals / (size + 1e-12), np.float32)
