"""Shells that people wear, made from the body at rest: the faces of each garment; a dome around the skull for hair,
hats and hoods; and accessories: brims, buns, ponytails, glasses, bags, objects in hands.

Garments that follow the skin are skinned shells (MakeHuman's helper tights and skirt, or the dome, whose vertices are
combinations of the scalp's). Accessories are grids, moved by the similarity transform that carries a patch of the body
at rest to its posed position.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray

I32 = NDArray[np.int32]

SKULL = np.array([0.0, -0.03, 0.745])  # centre of the head at rest
DOME = (30, 48)  # rings and spokes of the dome
GRID = (12, 20)  # rows and columns of an accessory
SLOTS = 6  # accessories of a person at most
# Patches of the body at rest that carry accessories: centre and radius, metres; those of hands contain only vertices of
# arms.
ANCHORS: dict[str, tuple[tuple[float, float, float], float]] = {
    "head": ((0.0, -0.03, 0.76), 0.125), "face": ((0.0, -0.13, 0.73), 0.07), "back": ((0.0, 0.06, 0.38), 0.14),
    "left_hip": ((0.15, 0.0, 0.08), 0.08), "right_hip": ((-0.15, 0.0, 0.08), 0.08),
    "left_hand": ((0.445, -0.235, 0.19), 0.06), "right_hand": ((-0.445, -0.235, 0.19), 0.06),
}  # fmt: skip


@dataclass(frozen=True)
class Accessory:
    """An object attached to the body.

    Attributes:
        anchor: name of a patch of `ANCHORS`.
        points: (rows, columns, 3) metres on the body at rest.
        colour: linear RGB.
        hair: whether it is shaded as hair.
        frozen: share of the tilt of its anchor that it does not follow, 0 to 1, since gravity keeps it upright.
    """

    anchor: str
    points: FloatArray
    colour: tuple[float, float, float]
    hair: bool = False
    frozen: float = 0.0


def grid_faces(rows: int, columns: int, closed: bool) -> I32:
    """(F, 3) triangles of a grid of vertices; `closed` joins the last column to the first."""
    r, c = np.meshgrid(np.arange(rows - 1), np.arange(columns if closed else columns - 1), indexing="ij")
    a, b = r * columns + c, r * columns + (c + 1) % columns
    quads = np.stack([a, b, a + columns, b, b + columns, a + columns], -1)
    return np.asarray(quads.reshape(-1, 3), np.int32)


def dome_directions() -> FloatArray:
    """(rings * spokes, 3) unit directions from the centre of the skull, from the crown down to the nape."""
    rings, spokes = DOME
    polar = np.radians(np.linspace(0.5, 150, rings))[:, None]
    turn = np.linspace(0, 2 * np.pi, spokes, endpoint=False)[None]
    ones = np.ones((rings, spokes))
    table = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) * ones], -1)
    return np.asarray(table.reshape(-1, 3))


def dome_weights(rest: Float32Array, on_head: BoolArray) -> sp.csr_matrix:
    """(rings * spokes, V): each vertex of the dome as a weighted mean of vertices of the head's outer skin.

    Ears are excluded, so that hair covers them; so are surfaces inside the head.
    """
    q = rest.astype(np.float64)
    ear = (np.abs(q[:, 0]) > 0.072) & (q[:, 2] > 0.655) & (q[:, 2] < 0.765)
    neck = (q[:, 2] > 0.555) & (q[:, 2] < 0.64) & (np.abs(q[:, 0]) < 0.09)
    chosen = np.nonzero((on_head | neck) & ~ear)[0]
    offset = q[chosen] - SKULL
    radius = np.linalg.norm(offset, axis=1)
    unit = offset / radius[:, None]
    near = unit @ unit.T > np.cos(np.radians(7))
    outer = radius > 0.93 * np.where(near, radius, 0).max(1)
    chosen, unit = chosen[outer], unit[outer]
    cosine = (dome_directions() @ unit.T).clip(-1, 1)
    angle = np.degrees(np.arccos(cosine))
    spread = np.maximum(angle.min(1, keepdims=True), 3.0)
    weights = np.exp(-0.5 * (angle / spread) ** 2)
    weights[weights < 0.02] = 0
    weights /= weights.sum(1, keepdims=True)
    table = sp.lil_matrix((len(weights), len(rest)), dtype=np.float32)
    table[:, chosen] = weights.astype(np.float32)
    return table.tocsr()


def smoothing(faces: I32, first: int, count: int) -> sp.csr_matrix:
    """(count, count) matrix of the mean over the neighbours of each vertex of a shell whose vertices start at `first`;
    vertices without faces stay in place."""
    f = faces - first
    i = np.concatenate([f[:, 0], f[:, 1], f[:, 2]])
    j = np.concatenate([f[:, 1], f[:, 2], f[:, 0]])
    link = sp.csr_matrix((np.ones(len(i), np.float32), (i, j)), shape=(count, count))
    link = ((link + link.T) > 0).astype(np.float32)
    degree = np.asarray(link.sum(1)).ravel()
    return sp.csr_matrix(sp.diags((1 / np.maximum(degree, 1)).astype("f4")) @ link + sp.diags((degree == 0) * 1.0),
                         dtype=np.float32)  # fmt: skip


def slack(points: Float32Array, mean: sp.csr_matrix, rounds: int = 6) -> Float32Array:
    """A loosely hanging shell: smoothed without shrinking (Taubin 1995), (count, 3)."""
    for _ in range(rounds):
        points = points + 0.6 * (mean @ points - points)
        points = points - 0.62 * (mean @ points - points)
    return points


SHOULDER, ELBOW, WRIST = np.array([[0.167, -0.015, 0.525], [0.313, -0.013, 0.35], [0.43, -0.175, 0.245]])
HIP, KNEE, ANKLE = np.array([[0.11, -0.013, 0.05], [0.158, -0.032, -0.37], [0.22, 0.0, -0.745]])
FALL, WINDOW = (
    0.12,
    np.cos(np.radians(25)),
)  # slope at which cloth falls inwards; angle within which it hangs from what protrudes


def drape(rest: Float32Array, on_arm: BoolArray, mean: sp.csr_matrix) -> Float32Array:
    """(count,) distance in metres of cloth from each vertex of the tights' shell at rest, if it hangs from what
    protrudes above: shoulder blades, bust, seat and calves."""
    q = rest.astype(np.float64)
    side = np.where(q[:, 0] < 0, -1, 1)
    folded = q * np.stack([side, np.ones_like(side), np.ones_like(side)], 1)
    fall, out = np.zeros(len(q)), np.zeros((len(q), 3))
    for group, chain in (("arm", (SHOULDER, ELBOW, WRIST)), ("leg", (HIP, KNEE, ANKLE))):
        member = on_arm if group == "arm" else ~on_arm & (q[:, 2] < -0.03)
        points = folded[member]
        bend = ((points - chain[1]) @ (chain[2] - chain[1])) > 0
        start = np.where(bend[:, None], chain[1], chain[0])
        axis = np.where(bend[:, None], chain[2] - chain[1], chain[1] - chain[0])
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        along = ((points - start) * axis).sum(1)
        fall[member] = along + bend * np.linalg.norm(chain[1] - chain[0])
        out[member] = points - start - along[:, None] * axis
    trunk = ~on_arm & (q[:, 2] >= -0.03)
    fall[trunk], out[trunk] = -q[trunk, 2], q[trunk] * [1, 1, 0] + [0, 0.02, 0]
    part = np.where(trunk, 0, np.where(on_arm, 1, 2) * side)
    radius = np.linalg.norm(out, axis=1)
    unit = out / (radius[:, None] + 1e-9)
    lower = fall[:, None] - fall[None]
    above = (part[:, None] == part[None]) & (lower > 0) & (unit @ unit.T > WINDOW) & (lower < 0.6)
    above &= (fall > -0.44)[None] | (part != 0)[None]  # not from the neck
    hang = np.where(above, radius[None] - FALL * lower, 0).max(1)
    off = np.clip(hang - radius, 0, 0.07)
    for _ in range(3):
        off = 0.5 * off + 0.5 * (mean @ off)
    return np.asarray(off, np.float32)


class Anchors:
    """Similarity transforms that carry patches of the body at rest to a posed body."""

    def __init__(self, rest: Float32Array, arm_weight: Float32Array, body_vertices: int) -> None:
        self.patches: dict[str, IndexArray] = {}
        self._rest = rest
        q, arm = rest[:body_vertices], arm_weight[:body_vertices] > 0.5
        for name, (center, reach) in ANCHORS.items():
            near = np.linalg.norm(q - np.array(center, np.float32), axis=1) < reach
            self.patches[name] = np.nonzero(near & (arm == name.endswith("hand")))[0]

    def carry(self, item: Accessory, vertices: Float32Array) -> Float32Array:
        """(rows * columns, 3) points of `item` on the posed `vertices` (V, 3)."""
        patch = self.patches[item.anchor]
        a, b = self._rest[patch].astype(np.float64), vertices[patch].astype(np.float64)
        ca, cb = a.mean(0), b.mean(0)
        u, s, vt = np.linalg.svd((b - cb).T @ (a - ca))
        flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        rotation = u @ flip @ vt
        scale = float(np.trace(np.diag(s) @ flip) / ((a - ca) ** 2).sum())
        points = (item.points.reshape(-1, 3) - ca) @ rotation.T * scale + cb
        if item.frozen:  # about its first row
            pivot = points[: item.points.shape[1]].mean(0)
            points = (points - pivot) @ _upright(rotation, item.frozen).T + pivot
        return np.asarray(points, np.float32)


def _upright(rotation: FloatArray, share: float) -> FloatArray:
    """The rotation that removes `share` of the tilt of the z axis under `rotation`."""
    up = rotation @ np.array([0.0, 0.0, 1.0])
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-6:
        return np.eye(3)
    angle = np.arctan2(sine, up[2]) * share
    k = np.cross(np.eye(3), axis / sine)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


# -- accessories at rest -------------------------------------------------------------------------------------


def _rows_columns() -> tuple[FloatArray, FloatArray]:
    """Rows (rows, 1) in 0..1 and angles (1, columns) in 0..2 pi, the last column coinciding with the first."""
    rows, columns = GRID
    return np.linspace(0, 1, rows)[:, None], np.linspace(0, 2 * np.pi, columns)[None]


def blob(center: tuple[float, float, float], half: tuple[float, float, float], square: float = 1.0) -> FloatArray:
    """An ellipsoid, or with `square` below 1 a box with rounded edges."""
    v, turn = _rows_columns()
    polar = np.pi * v

    def power(values: FloatArray) -> FloatArray:
        return np.asarray(np.sign(values) * np.abs(values) ** square)

    x = power(np.sin(polar)) * power(np.cos(turn)) * half[0]
    y = power(np.sin(polar)) * power(np.sin(turn)) * half[1]
    z = power(np.cos(polar)) * half[2] * np.ones_like(turn)
    return np.asarray(np.stack([x, y, z], -1) + np.array(center))


def tube(points: FloatArray, radii: FloatArray, flatten: float = 1.0) -> FloatArray:
    """A tube along a polyline (n, 3) with radii (n,), resampled to the rows of the grid; its ends are closed."""
    v, turn = _rows_columns()
    t = np.linspace(0, 1, len(points))
    at = np.stack([np.interp(v[:, 0], t, points[:, k]) for k in range(3)], -1)
    radius = np.interp(v[:, 0], t, radii)
    radius[[0, -1]] = 0
    along = np.gradient(at, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    side = np.cross(along, [0.0, 1.0, 0.01])
    side /= np.linalg.norm(side, axis=1, keepdims=True) + 1e-9
    other = np.cross(along, side) * flatten
    ring = np.cos(turn)[..., None] * side[:, None] + np.sin(turn)[..., None] * other[:, None]
    return np.asarray(at[:, None] + ring * radius[:, None, None])


def brim(height: float, width: float, back: float, droop: float, slope: float) -> FloatArray:
    """The brim of a hat at `height`: `width` metres at the front, `back` times that at the back."""
    v, turn = _rows_columns()
    front = np.clip(-np.sin(turn), 0, 1) ** 0.6 * (1 - back) + back
    reach = v * width * front
    x = np.cos(turn) * (0.080 + reach)
    y = np.sin(turn) * (0.100 + reach) + SKULL[1]
    z = height - slope * (y + 0.02) - droop * v**2 * width * np.ones_like(turn)
    return np.asarray(np.stack(np.broadcast_arrays(x, y, z), -1))


def glasses(height: float, wide: float = 0.82) -> FloatArray:
    """A strip in front of the eyes that bends around to the temples; `height` metres high."""
    rows, columns = GRID
    turn = np.linspace(-wide * np.pi / 2, wide * np.pi / 2, columns)[None]
    v = np.linspace(-0.5, 0.5, rows)[:, None]
    x = np.sin(turn) * 0.074
    y = -(np.cos(turn) ** 0.45) * 0.105 - 0.055
    nose = 0.35 * np.exp(-((turn / 0.12) ** 2))
    temple = 0.3 + 0.7 * (np.abs(turn) < 0.62 * wide * np.pi / 2)
    z = 0.7275 + v * height * (temple - nose) + nose * 0.2 * height
    return np.asarray(np.stack(np.broadcast_arrays(x, y, z), -1))
