"""Reading a skeleton and its animation out of a glTF 2.0 file, whoever made it.

Other programs' joints have axes of their own at rest, stand under nodes that turn and scale everything, and move at
any times. What comes out has the world's axes at rest and even frames.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.gltf.container import JSON_ERRORS, Document
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.world_axes import frame_times, motion_in_world_axes

_DEFAULT_FPS = 30.0


@dataclass
class _Node:
    name: str
    parent: int
    translation: FloatArray
    rotation: FloatArray  # (3, 3)
    scale: float
    tip: FloatArray | None


def read_gltf(path: Path, animation: int = 0) -> Motion:
    """Read the first skin's skeleton and one of the file's animations into metres, Z up.

    Args:
        path: a `.glb` or `.gltf` file.
        animation: which one; without any, the motion is one frame at rest.

    Returns:
        A Motion at the frame rate of the keys (30 where there are fewer than two). Its rest pose is the skin's.

    Raises:
        FormatError: malformed, no skeleton, or bones that are stretched or slide.
    """
    document = Document(Path(path))
    try:
        return _read(document, animation)
    except (RecursionError, *JSON_ERRORS) as error:
        raise document.error(f"is not as glTF 2.0 must be ({type(error).__name__}: {error})") from error


def _read(document: Document, animation: int) -> Motion:
    nodes = _nodes(document)
    order = _joints(document, nodes)
    tracks = _tracks(document, animation)
    fps, times = _even_times(document, tracks, animation)
    turns, places, scales = _forward(document, nodes, order, tracks, times)
    rest = _rest_turns(document, nodes, order)
    parents = [order.index(nodes[n].parent) if i else -1 for i, n in enumerate(order)]
    tips = np.full((len(order), 3), np.nan)
    for i, n in enumerate(order):
        tip = nodes[n].tip
        if tip is not None and i not in parents:
            tips[i] = tip * scales[n]
    return motion_in_world_axes(
        [nodes[n].name for n in order], parents,
        BVH_FROM_WORLD.T @ np.stack([turns[n] for n in order], axis=1),
        np.stack([places[n] for n in order], axis=1) @ BVH_FROM_WORLD,
        BVH_FROM_WORLD.T @ np.stack(rest), tips, fps, document.error,
    )  # fmt: skip


def _nodes(document: Document) -> list[_Node]:
    raw = document.json["nodes"]
    parents = [-1] * len(raw)
    for i, node in enumerate(raw):
        for child in node.get("children", []):
            if not isinstance(child, int) or not 0 <= child < len(raw) or parents[child] >= 0 or child == i:
                raise document.error(f"node {i} has a child {child!r} that is none or has another parent")
            parents[child] = i
    for i in range(len(raw)):
        above, steps = parents[i], 0
        while above >= 0:
            above, steps = parents[above], steps + 1
            if steps > len(raw):
                raise document.error(f"node {i} is its own ancestor")
    return [_node(document, i, node, parents[i]) for i, node in enumerate(raw)]


def _node(document: Document, i: int, raw: dict[str, Any], parent: int) -> _Node:
    tip = raw["extras"].get("tip") if isinstance(raw.get("extras"), dict) else None
    name = str(raw.get("name") or f"node_{i}")
    if "matrix" in raw:
        matrix = _vector(document, raw["matrix"], 16, f"the matrix of node {i}").reshape(4, 4).T
        translation, axes = matrix[:3, 3], matrix[:3, :3]
        scale = float(np.cbrt(np.linalg.det(axes)))
        scales = np.linalg.norm(axes, axis=0)
        rotation = axes / (scale or 1.0)
        straight = np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-3)
    else:
        translation = _vector(document, raw.get("translation", [0, 0, 0]), 3, f"the translation of node {i}")
        quat = _vector(document, raw.get("rotation", [0, 0, 0, 1]), 4, f"the rotation of node {i}")
        scales = _vector(document, raw.get("scale", [1, 1, 1]), 3, f"the scale of node {i}")
        if not np.linalg.norm(quat) > 1e-6:
            raise document.error(f"the rotation of node {i} is zero")
        rotation, scale, straight = matrix_from_quat(np.roll(quat, 1)), float(scales[0]), True
    if not straight or scale <= 0 or np.ptp(scales) > 1e-3 * scale:
        raise document.error(f"node {i} ({name}) stretches what is below it ({scales}); apply its scale")
    place = None if tip is None else _vector(document, tip, 3, f"the tip of node {i}")
    return _Node(name, parent, translation, rotation, scale, place)


def _vector(document: Document, values: Any, count: int, what: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != (count,) or not (np.abs(array) < 1e12).all():
        raise document.error(f"{what} must be {count} finite numbers")
    return array


def _joints(document: Document, nodes: list[_Node]) -> list[int]:
    """The first skin's joints and the nodes between them, parents first."""
    if not document.json.get("skins"):
        raise document.error("holds no skin, so no skeleton")
    joints = document.json["skins"][0]["joints"]
    if not joints or any(not isinstance(n, int) or not 0 <= n < len(nodes) for n in joints):
        raise document.error("the skin's joints are not among the nodes")

    def above(n: int) -> list[int]:
        path = []
        while n >= 0:
            path.append(n)
            n = nodes[n].parent
        return path[::-1]

    paths = [above(n) for n in joints]
    common = 0
    while all(len(p) > common and p[common] == paths[0][common] for p in paths):
        common += 1
    if not common:
        raise document.error("the skin's joints have no common root")
    wanted = {n for path in paths for n in path[common - 1 :]}
    return sorted(wanted, key=lambda n: (len(above(n)), n))


@dataclass
class _Track:
    times: FloatArray
    values: FloatArray  # (N, K), or (N, 3, K) for cubic splines: tangent in, value, tangent out
    kind: str


def _tracks(document: Document, animation: int) -> dict[tuple[int, str], _Track]:
    animations = document.json.get("animations") or []
    if not animations:
        return {}
    if not 0 <= animation < len(animations):
        raise document.error(f"has {len(animations)} animations, so none of number {animation}")
    chosen = animations[animation]
    out = {}
    for channel in chosen["channels"]:
        node, what = channel["target"].get("node"), channel["target"]["path"]
        if node is None or what not in ("translation", "rotation", "scale"):
            continue
        sampler = chosen["samplers"][channel["sampler"]]
        kind = sampler.get("interpolation", "LINEAR")
        times, values = document.accessor(sampler["input"])[:, 0], document.accessor(sampler["output"])
        width = 4 if what == "rotation" else 3
        keys = len(times) * (3 if kind == "CUBICSPLINE" else 1)
        if not len(times) or values.shape != (keys, width) or (np.diff(times) <= 0).any():
            raise document.error(f"the animation of node {node}'s {what} has keys that do not fit together")
        out[node, what] = _Track(times, values.reshape(len(times), -1, width), kind)
    return out


def _even_times(document: Document, tracks: dict[tuple[int, str], _Track], animation: int) -> tuple[float, FloatArray]:
    if not tracks:
        return _DEFAULT_FPS, np.zeros(1)
    first = min(t.times[0] for t in tracks.values())
    last = max(t.times[-1] for t in tracks.values())
    finest = max((t.times for t in tracks.values()), key=len)
    extras = document.json["animations"][animation].get("extras")
    stated = extras.get("fps") if isinstance(extras, dict) else None
    if isinstance(stated, int | float) and 0 < stated < 1e6:
        fps = float(stated)
    else:
        # Keys may lie on part of the frames only: the step that most of them have.
        fps = float(1.0 / np.median(np.diff(finest))) if len(finest) > 1 else _DEFAULT_FPS
        fps = float(round(fps)) if abs(fps - round(fps)) < 1e-2 else fps
    return fps, frame_times(first, last, fps, sum(len(t.times) for t in tracks.values()), document.error)


def _forward(
    document: Document, nodes: list[_Node], order: list[int], tracks: dict[tuple[int, str], _Track], times: FloatArray
) -> tuple[dict[int, FloatArray], dict[int, FloatArray], dict[int, float]]:
    """Orientation (T, 3, 3), place (T, 3) and scale in the scene of joints and of what stands above them."""
    turns: dict[int, FloatArray] = {}
    places: dict[int, FloatArray] = {}
    scales: dict[int, float] = {}
    above: list[int] = []
    n = nodes[order[0]].parent
    while n >= 0:
        above.insert(0, n)
        n = nodes[n].parent
    for n in [*above, *order]:
        node = nodes[n]
        turn = np.broadcast_to(node.rotation, (len(times), 3, 3))
        if (n, "rotation") in tracks:
            turn = matrix_from_quat(np.roll(_sample(tracks[n, "rotation"], times, True), 1, axis=-1))
        place = np.broadcast_to(node.translation, (len(times), 3))
        if (n, "translation") in tracks:
            place = _sample(tracks[n, "translation"], times, False)
        scale = node.scale
        if (n, "scale") in tracks:
            animated = tracks[n, "scale"].values[:, -2 if tracks[n, "scale"].kind == "CUBICSPLINE" else 0]
            if np.ptp(animated) > 1e-3 * abs(animated[0, 0]) or animated[0, 0] <= 0:
                raise document.error(f"node {n} ({node.name}) changes its size; bones must be constant")
            scale = float(animated[0, 0])
        if node.parent < 0:
            turns[n], places[n], scales[n] = turn, place, scale
        else:
            p = node.parent
            turns[n] = turns[p] @ turn
            places[n] = places[p] + scales[p] * (turns[p] @ place[..., None])[..., 0]
            scales[n] = scales[p] * scale
    return turns, places, scales


def _sample(track: _Track, times: FloatArray, rotation: bool) -> FloatArray:
    keys = track.times
    at = np.clip(times, keys[0], keys[-1])
    if track.kind == "CUBICSPLINE":
        out = _cubic(track, at)
    elif len(keys) == 1 or track.kind == "STEP":
        # Times are single precision in the file: a key counts from a little before it.
        k = np.searchsorted(keys, at + 1e-6 * max(1.0, abs(keys[-1])), side="right") - 1
        out = track.values[np.maximum(k, 0), 0]
    elif rotation:
        return np.asarray(Slerp(keys, Rotation.from_quat(track.values[:, 0]))(at).as_quat())
    else:
        out = np.stack([np.interp(at, keys, track.values[:, 0, c]) for c in range(track.values.shape[-1])], axis=-1)
    if rotation:
        out = out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
    return np.asarray(out)


def _cubic(track: _Track, at: FloatArray) -> FloatArray:
    """Hermite splines, as the specification's appendix C has them."""
    keys = track.times
    if len(keys) == 1:
        return np.repeat(track.values[:, 1], len(at), axis=0)
    k = np.clip(np.searchsorted(keys, at, side="right") - 1, 0, len(keys) - 2)
    step = (keys[k + 1] - keys[k])[:, None]
    s = (at - keys[k])[:, None] / step
    start, end = track.values[k], track.values[k + 1]
    return np.asarray(
        (2 * s**3 - 3 * s**2 + 1) * start[:, 1]
        + step * (s**3 - 2 * s**2 + s) * start[:, 2]
        + (3 * s**2 - 2 * s**3) * end[:, 1]
        + step * (s**3 - s**2) * end[:, 0]
    )


def _rest_turns(document: Document, nodes: list[_Node], order: list[int]) -> list[FloatArray]:
    """World from joint at rest, (3, 3) each: by the skin's bind pose where it is given, turned so that the root
    stands as its node does."""
    of_node: dict[int, FloatArray] = {}

    def standing(n: int) -> FloatArray:
        if n not in of_node:
            above = np.eye(3) if nodes[n].parent < 0 else standing(nodes[n].parent)
            of_node[n] = above @ nodes[n].rotation
        return of_node[n]

    skin = document.json["skins"][0]
    bound: dict[int, FloatArray] = {}
    if "inverseBindMatrices" in skin:
        matrices = document.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
        for n, columns in zip(skin["joints"], matrices, strict=False):
            u, size, vt = np.linalg.svd(columns[:3, :3])  # stored column by column: this is the transpose
            if size.min() > 1e-9 and np.linalg.det(u @ vt) > 0:
                bound[n] = u @ vt
    root = order[0]
    if root not in bound:
        bound = {}
    turn = standing(root) @ bound[root].T if bound else np.eye(3)
    rest: dict[int, FloatArray] = {}
    for n in order:
        if n in bound:
            rest[n] = turn @ bound[n]
        else:
            rest[n] = standing(n) if n == root else rest[nodes[n].parent] @ nodes[n].rotation
    return [rest[n] for n in order]
