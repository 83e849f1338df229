"""Rigs as artists make them, from characters with all of anny's joints: fewer joints, props, rigid parts.

Joints that a rig lacks give their weights to the nearest ancestor that it has. Rigid parts and props follow one joint
by rule.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IntArray
from muybridge.motion.character.surface import connected_parts, vertex_normals
from muybridge.train.characters.figures import Figure

_LEAST_POINTS, _MOST_POINTS = 250, 3500  # of a coarse mesh
_BLOCKS, _CUT, _SHARE_WITH_PROPS, _ARMOUR = 0.12, 0.1, 0.45, 0.3  # of the characters
_LEAST_REGION = 12  # vertices


def artists_rig(figure: Figure, rng: np.random.Generator) -> Figure:
    """A character with fewer joints, rigid parts, props and vertices, drawn at random."""
    figure = with_fewer_joints(figure, _kept(figure.names, rng))
    style = rng.random()
    if style < _BLOCKS:
        figure = _of_blocks(figure, rng)
    elif style < _BLOCKS + _CUT:
        figure = _cut(figure)
    else:
        figure = replace(figure, weights=_styled(figure.weights, rng))
        if rng.random() < _ARMOUR:
            figure = _with_armour(figure, rng)
    if rng.random() < _SHARE_WITH_PROPS:
        for _ in range(rng.integers(1, 5)):
            figure = with_prop(figure, rng)
    figure = decimated(figure, int(np.exp(rng.uniform(np.log(_LEAST_POINTS), np.log(_MOST_POINTS)))))
    figure = _with_idle_joints(figure, rng)
    return replace(figure, joints=figure.joints + rng.normal(0, 0.004 * figure.height, figure.joints.shape))


def _kept(names: tuple[str, ...], rng: np.random.Generator) -> BoolArray:
    """(J,) which joints a rig has: the same on both sides."""
    drop: list[Callable[[str], bool]] = []

    def maybe(chance: float, *starts: str) -> None:
        if rng.random() < chance:
            drop.append(lambda name: name.startswith(starts))

    maybe(0.9, "eye")
    maybe(0.85, "upperarm02", "lowerarm02", "upperleg02", "lowerleg02")
    maybe(0.85, "shoulder01")
    maybe(0.85, "pelvis")
    maybe(0.12, "clavicle", "shoulder01")
    maybe(0.8, "metacarpal")
    maybe(0.5, "finger", "metacarpal")
    maybe(0.2, "finger4", "finger5")
    maybe(0.4, "toe")
    maybe(0.95, *(f"toe{k}" for k in (1, 2, 4, 5)), "toe3-2", "toe3-3")
    maybe(0.6, "neck03")
    maybe(0.8, "neck02")
    spine = [f"spine0{k}" for k in range(1, 6)]
    maybe(0.95, *rng.permutation(spine)[: rng.integers(1, 5)])
    if rng.random() < 0.15:  # of a few parts
        maybe(0.7, "wrist", "finger", "metacarpal", "foot", "toe")
        maybe(0.6, "lowerarm", "lowerleg", "wrist", "finger", "metacarpal", "foot", "toe")
        maybe(0.8, "clavicle", "shoulder")
        maybe(0.5, "neck")
    return np.array([not any(test(name) for test in drop) for name in names])


def with_fewer_joints(figure: Figure, kept: BoolArray) -> Figure:
    """A character without some joints (J,), whose weights their nearest ancestors get."""
    count = len(figure.names)
    heir = np.arange(count)
    for j in range(count):  # ancestors come first
        if not kept[j] and figure.parents[j] >= 0:
            heir[j] = heir[figure.parents[j]]
    roots = np.unique(heir)
    number = np.full(count, -1)
    number[roots] = np.arange(len(roots))
    weights = np.zeros((len(figure.weights), len(roots)), np.float32)
    for j in range(count):
        weights[:, number[heir[j]]] += figure.weights[:, j]
    parents = np.array([number[heir[figure.parents[j]]] if figure.parents[j] >= 0 else -1 for j in roots])
    return replace(figure, names=tuple(figure.names[j] for j in roots), parents=parents,
                   joints=figure.joints[roots], weights=weights)  # fmt: skip


def _styled(weights: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Weights that are softer or sharper, of at most so many joints, and of one alone where a part is rigid."""
    out = weights ** np.exp(rng.normal(0.1, 0.25))
    most = int(rng.choice([2, 4, 4, 8]))
    if most < out.shape[1]:
        least = np.partition(out, -most, axis=1)[:, -most, None]
        out = np.where(out >= least, out, 0.0)
    out /= out.sum(axis=1, keepdims=True)
    if rng.random() < 0.2:
        rigid = rng.random(out.shape[1]) < 0.4
        first = out.argmax(axis=1)
        own = rigid[first]
        out[own] = np.eye(out.shape[1])[first[own]]
        out[np.ix_(~own, rigid)] *= 0.3
        out /= out.sum(axis=1, keepdims=True)
    return np.asarray(out, np.float32)


def _cut(figure: Figure) -> Figure:
    """Cut between the joints into rigid parts, each a little larger than it was."""
    first = figure.weights.argmax(axis=1)
    part = first[figure.triangles[:, 0]]
    keys = figure.triangles * figure.weights.shape[1] + part[:, None]
    used, corner = np.unique(keys, return_inverse=True)
    source, owner = used // figure.weights.shape[1], used % figure.weights.shape[1]
    vertices = figure.vertices[source]
    for j in np.unique(owner):
        own = owner == j
        middle = vertices[own].mean(axis=0)
        vertices[own] = middle + 1.02 * (vertices[own] - middle)
    return replace(figure, vertices=vertices, triangles=corner.reshape(-1, 3).astype(np.int64),
                   weights=np.eye(figure.weights.shape[1], dtype=np.float32)[owner])  # fmt: skip


def _of_blocks(figure: Figure, rng: np.random.Generator) -> Figure:
    """A toy: each joint that moves enough of the body has one solid, as large as what it moves."""
    count = figure.weights.shape[1]
    first = figure.weights.argmax(axis=1)
    kind = rng.integers(0, 3)
    vertices, triangles, owner, start = [], [], [], 0
    for j in range(count):
        own = figure.vertices[first == j]
        if len(own) < _LEAST_REGION or np.ptp(own, axis=0).max() < 0.02 * figure.height:
            continue
        points, faces = _solid(rng, int(kind if rng.random() < 0.8 else rng.integers(0, 3)))
        middle = own.mean(axis=0)
        axes = np.linalg.svd(own - middle, full_matrices=False)[2] if rng.random() < 0.6 else np.eye(3)
        low, high = ((own - middle) @ axes.T).min(axis=0), ((own - middle) @ axes.T).max(axis=0)
        half = 0.5 * (high - low) * rng.uniform(0.8, 1.1)
        points = (0.5 * (low + high) + points * half) @ axes + middle
        if np.linalg.det(axes) < 0:
            faces = faces[:, ::-1]
        vertices.append(points)
        triangles.append(faces + start)
        owner.append(np.full(len(points), j))
        start += len(points)
    whole = np.concatenate(vertices)
    return replace(figure, vertices=whole, triangles=np.concatenate(triangles),
                   weights=np.eye(count, dtype=np.float32)[np.concatenate(owner)])  # fmt: skip


def _solid(rng: np.random.Generator, kind: int) -> tuple[FloatArray, IntArray]:
    """A box, a ball or a cylinder between -1 and 1 on each axis."""
    rows, columns = int(rng.integers(4, 9)), int(rng.integers(6, 13))
    height, turn = np.linspace(-1, 1, rows), np.linspace(0, 2 * np.pi, columns, endpoint=False)
    radius = np.sin(np.linspace(0.03, np.pi - 0.03, rows)) if kind == 1 else np.ones(rows)
    if kind == 1:
        height = -np.cos(np.linspace(0.03, np.pi - 0.03, rows))
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if kind == 0:
        ring = np.sign(ring) * np.minimum(np.abs(ring) / np.abs(ring).max(axis=1, keepdims=True), 1.0)
    rings = [np.column_stack([r * ring, np.full(columns, h)]) for r, h in zip(radius, height, strict=True)]
    points = np.concatenate([*rings, [[0, 0, -1.0]], [[0, 0, 1.0]]])
    i, k = (a.ravel() for a in np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij"))
    a, b = i * columns + k, i * columns + (k + 1) % columns
    sides = np.concatenate([np.stack([a, b, a + columns], 1), np.stack([b, b + columns, a + columns], 1)])
    k = np.arange(columns)
    low = np.stack([np.full(columns, rows * columns), (k + 1) % columns, k], 1)
    top = (rows - 1) * columns
    high = np.stack([np.full(columns, rows * columns + 1), top + k, top + (k + 1) % columns], 1)
    order = rng.permutation(3)
    faces = np.concatenate([sides, low, high])
    odd = np.linalg.det(np.eye(3)[order]) < 0
    return points[:, order], faces[:, ::-1] if odd else faces


def with_prop(figure: Figure, rng: np.random.Generator) -> Figure:
    """With a hat, a sword, a pack or the like: an island that is rigid to the joint it is at."""
    first = figure.weights.argmax(axis=1)
    joint = int(rng.choice(np.unique(first)))
    at = int(rng.choice(np.nonzero(first == joint)[0]))
    points, triangles = _solid(rng, int(rng.integers(0, 3)))
    size = figure.height * np.exp(rng.uniform(np.log(0.01), np.log(0.2), 3))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
    if np.linalg.det(axes) < 0:
        triangles = triangles[:, ::-1]
    normal = vertex_normals(figure.vertices, figure.triangles)[at]
    points = (points * size) @ axes + figure.vertices[at] + normal * float(np.mean(size)) * rng.uniform(-0.5, 1.0)
    return _joined(figure, points, triangles, np.full(len(points), joint))


def _with_armour(figure: Figure, rng: np.random.Generator) -> Figure:
    """With plates over some joints' regions, rigid to them."""
    first = figure.weights.argmax(axis=1)
    normals = vertex_normals(figure.vertices, figure.triangles)
    for joint in rng.permutation(np.unique(first))[: rng.integers(1, 6)]:
        own = (figure.weights[:, joint] > rng.uniform(0.3, 0.8))[figure.triangles].all(axis=1)
        if own.sum() < _LEAST_REGION:
            continue
        used, corner = np.unique(figure.triangles[own], return_inverse=True)
        points = figure.vertices[used] + figure.height * rng.uniform(0.005, 0.03) * normals[used]
        figure = _joined(figure, points, corner.reshape(-1, 3), np.full(len(points), joint))
        normals = np.concatenate([normals, normals[used]])
    return figure


def _joined(figure: Figure, points: FloatArray, triangles: IntArray, joint: IntArray) -> Figure:
    weights = np.eye(figure.weights.shape[1], dtype=np.float32)[joint]
    return replace(figure, vertices=np.concatenate([figure.vertices, points]),
                   triangles=np.concatenate([figure.triangles, triangles + len(figure.vertices)]),
                   weights=np.concatenate([figure.weights, weights]))  # fmt: skip


def decimated(figure: Figure, most: int) -> Figure:
    """With at most about so many vertices: those of one cell of a grid become one, islands and both sides of a sheet
    apart."""
    island = connected_parts(figure.triangles, len(figure.vertices))
    sides = 8 * island + (vertex_normals(figure.vertices, figure.triangles) > 0) @ np.array([1, 2, 4])
    low = figure.vertices.min(axis=0)
    cell = float(np.linalg.norm(np.ptp(figure.vertices, axis=0))) / np.sqrt(4 * most)
    while True:
        cells = np.floor((figure.vertices - low) / cell).astype(np.int64)
        keys = ((sides * 1024 + cells[:, 0]) * 1024 + cells[:, 1]) * 1024 + cells[:, 2]
        _, first, place = np.unique(keys, return_index=True, return_inverse=True)
        if len(first) <= most or cell > 0.08 * figure.height:
            break
        cell *= 1.15
    place = place.ravel()
    number = np.bincount(place).astype(np.float64)
    vertices = np.stack([np.bincount(place, figure.vertices[:, k]) for k in range(3)], axis=1) / number[:, None]
    weights = np.zeros((len(first), figure.weights.shape[1]), np.float32)
    np.add.at(weights, place, figure.weights)
    triangles = place[figure.triangles]
    a, b, c = triangles.T
    triangles = np.unique(triangles[(a != b) & (b != c) & (c != a)], axis=0)
    used, corner = np.unique(triangles, return_inverse=True)
    mean = (weights[used] / number[used, None]).astype(np.float32)
    return replace(figure, vertices=vertices[used], triangles=corner.reshape(-1, 3).astype(np.int64),
                   weights=mean)  # fmt: skip


def _with_idle_joints(figure: Figure, rng: np.random.Generator) -> Figure:
    """With joints that move nothing: ends of chains, and a root on the floor."""
    joints, parents, names = list(figure.joints), list(figure.parents), list(figure.names)
    if rng.random() < 0.4:
        first = figure.weights.argmax(axis=1)
        for j in sorted(set(range(len(names))) - set(parents)):
            own = figure.vertices[first == j]
            if len(own):
                tip = own[np.linalg.norm(own - figure.joints[j], axis=1).argmax()]
                joints.append(figure.joints[j] + rng.uniform(0.6, 1.0) * (tip - figure.joints[j]))
                parents.append(j)
                names.append(f"{names[j]}_end")
    if rng.random() < 0.3:
        parents[parents.index(-1)] = len(names)
        joints.append(np.array([0.0, 0.0, 0.0]))
        parents.append(-1)
        names.append("floor")
    weights: Float32Array = np.zeros((len(figure.weights), len(names)), np.float32)
    weights[:, : figure.weights.shape[1]] = figure.weights
    return replace(figure, joints=np.stack(joints), parents=np.array(parents), names=tuple(names), weights=weights)
