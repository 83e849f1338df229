"""The nodes of a glTF file: their transforms, their tree, and which of them are joints."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.motion.formats.gltf.container import Document

_EVEN = 1e-3  # relative difference of a node's scales that counts as none

# Thumbs have the same three bones in VRM 0 and 1, under names that differ by one.
_THUMBS_OF_VRM_0 = {
    f"{side}Thumb{old}": f"{side}Thumb{new}"
    for side in ("left", "right") for old, new in (("Proximal", "Metacarpal"), ("Intermediate", "Proximal"))
}  # fmt: skip


@dataclass
class Node:
    """A node without animation.

    Attributes:
        name: as in the file, or made of its number.
        parent: its number, -1 at the top of a scene.
        translation: (3,) in the parent's axes and size.
        rotation: (3, 3) parent from node, without its scales.
        scales: (3,) along the node's own axes.
        linear: (3, 3) parent from node with its scales, and the shear that a matrix may have.
        tip: (3,) the end of the bone, which our own files state; None elsewhere.
        drawn: whether it has a mesh, a camera or a light.
    """

    name: str
    parent: int
    translation: FloatArray
    rotation: FloatArray
    scales: FloatArray
    linear: FloatArray
    tip: FloatArray | None
    drawn: bool


def read_nodes(document: Document) -> list[Node]:
    """All nodes of a file.

    Raises:
        FormatError: they are no forest, or a transform is not of finite numbers.
    """
    raw = document.json["nodes"]
    parents = [-1] * len(raw)
    for i, node in enumerate(raw):
        for child in node.get("children", []):
            if not isinstance(child, int) or not 0 <= child < len(raw) or parents[child] >= 0 or child == i:
                raise document.error(f"node {i} has a child {child!r} that does not exist or has another parent")
            parents[child] = i
    for i in range(len(raw)):
        above, steps = parents[i], 0
        while above >= 0:
            above, steps = parents[above], steps + 1
            if steps > len(raw):
                raise document.error(f"node {i} is its own ancestor")
    return [_node(document, i, node, parents[i]) for i, node in enumerate(raw)]


def _node(document: Document, i: int, raw: dict[str, Any], parent: int) -> Node:
    tip = raw["extras"].get("tip") if isinstance(raw.get("extras"), dict) else None
    name = str(raw.get("name") or f"node_{i}")
    if "matrix" in raw:
        matrix = _vector(document, raw["matrix"], 16, f"the matrix of node {i}").reshape(4, 4).T
        translation, linear = matrix[:3, 3], matrix[:3, :3]
        scales = np.linalg.norm(linear, axis=0)
        rotation = nearest_rotation(linear)
        if np.linalg.det(linear) < 0:
            scales = -scales
    else:
        translation = _vector(document, raw.get("translation", [0, 0, 0]), 3, f"the translation of node {i}")
        quat = _vector(document, raw.get("rotation", [0, 0, 0, 1]), 4, f"the rotation of node {i}")
        scales = _vector(document, raw.get("scale", [1, 1, 1]), 3, f"the scale of node {i}")
        if not np.linalg.norm(quat) > 1e-6:
            raise document.error(f"the rotation of node {i} is zero")
        rotation = matrix_from_quat(np.roll(quat, 1))
        linear = rotation * scales
    place = None if tip is None else _vector(document, tip, 3, f"the tip of node {i}")
    drawn = any(key in raw for key in ("mesh", "camera")) or "KHR_lights_punctual" in raw.get("extensions", {})
    return Node(name, parent, translation, rotation, scales, linear, place, drawn)


def _vector(document: Document, values: Any, count: int, what: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != (count,) or not (np.abs(array) < 1e12).all():
        raise document.error(f"{what} must be {count} finite numbers")
    return array


def even_scale(scales: FloatArray) -> bool:
    """Whether (..., 3) scales are positive and equal along the three axes, to a thousandth."""
    return bool((scales > 0).all() and (np.ptp(scales, axis=-1) <= _EVEN * scales.max(axis=-1)).all())


def nearest_rotation(linear: FloatArray) -> FloatArray:
    """(..., 3, 3) the rotation that is nearest to a linear map, by its polar decomposition.

    Of a map that mirrors, the rotation nearest to its negative: where a rotation turns the map, it turns this too.
    """
    u, _, vt = np.linalg.svd(linear)
    turn = u @ vt
    return np.asarray(turn * np.sign(np.linalg.det(turn))[..., None, None])


def path_to(nodes: list[Node], n: int) -> list[int]:
    """A node and those above it, the topmost first."""
    path: list[int] = []
    while n >= 0:
        path.append(n)
        n = nodes[n].parent
    return path[::-1]


@dataclass(frozen=True)
class JointChoice:
    """Which nodes of a file are read as joints.

    Attributes:
        order: their numbers, parents first.
        skins: the skins that bind them, in the file's order.
        notices: what was left out, one sentence each.
    """

    order: list[int]
    skins: list[dict[str, Any]]
    notices: list[str]


def choose_joints(document: Document, nodes: list[Node]) -> JointChoice:
    """The joints of a file: those of its skins, else of its VRM humanoid, else the animated nodes.

    Skins that share joints, or of which one is below the other, are of one skeleton; of several skeletons the one with
    most joints is read. Nodes between two joints are joints too; without a skin, so are nodes below a joint that have
    no mesh.

    Raises:
        FormatError: there is no skeleton, or a skin names nodes that do not exist.
    """
    skins = document.json.get("skins") or []
    if skins:
        return _of_skins(document, nodes, skins)
    chosen = set(humanoid_bones(document.json.get("extensions") or {}).values()) or _animated(
        document.json.get("animations") or []
    )
    chosen = {n for n in chosen if 0 <= n < len(nodes)}
    if not chosen:
        raise document.error("holds no skin, no VRM humanoid and no animated node, so no skeleton")
    for n, node in enumerate(nodes):
        if not node.drawn and any(above in chosen for above in path_to(nodes, n)):
            chosen.add(n)
    return JointChoice(_with_nodes_between(nodes, chosen), [], [])


def _of_skins(document: Document, nodes: list[Node], skins: list[dict[str, Any]]) -> JointChoice:
    groups: list[tuple[set[int], list[dict[str, Any]]]] = []
    for skin in skins:
        joints = skin["joints"]
        if not joints or any(not isinstance(n, int) or not 0 <= n < len(nodes) for n in joints):
            raise document.error("the skin's joints are not among the nodes")
        mine, of_mine = set(joints), [skin]
        apart = []
        for other, of_other in groups:
            lines = {n for j in mine for n in path_to(nodes, j)}, {n for j in other for n in path_to(nodes, j)}
            if mine & lines[1] or other & lines[0]:
                mine, of_mine = mine | other, [*of_other, *of_mine]
            else:
                apart.append((other, of_other))
        groups = [*apart, (mine, of_mine)]
    groups.sort(key=lambda g: (-len(g[0]), skins.index(g[1][0])))
    order = _with_nodes_between(nodes, groups[0][0])
    notices = []
    if len(groups) > 1:
        others = ", ".join(nodes[_with_nodes_between(nodes, g[0])[0]].name for g in groups[1:])
        notices.append(f"{document.path.name}: of {len(groups)} skeletons {nodes[order[0]].name!r} was read, "
                       f"{others} not")  # fmt: skip
    return JointChoice(order, groups[0][1], notices)


def _with_nodes_between(nodes: list[Node], chosen: set[int]) -> list[int]:
    wanted: set[int] = set()
    for n in chosen:
        path = path_to(nodes, n)
        wanted.update(path[next(k for k, m in enumerate(path) if m in chosen) :])
    return sorted(wanted, key=lambda n: (len(path_to(nodes, n)), n))


def humanoid_bones(extensions: dict[str, Any]) -> dict[str, int]:
    """Nodes of a VRM humanoid by the names of VRM 1.0's bones: VRM 1.0, its animations, or VRM 0.x."""
    for name in ("VRMC_vrm", "VRMC_vrm_animation", "VRM"):
        bones = (extensions.get(name) or {}).get("humanoid", {}).get("humanBones", {})
        if isinstance(bones, dict):
            found = {str(bone): entry.get("node") for bone, entry in bones.items()}
        else:
            found = {_THUMBS_OF_VRM_0.get(str(entry.get("bone")), str(entry.get("bone"))): entry.get("node")
                     for entry in bones}  # fmt: skip
        found = {bone: n for bone, n in found.items() if isinstance(n, int)}
        if found:
            return found
    return {}


def _animated(animations: list[dict[str, Any]]) -> set[int]:
    """Nodes that any animation turns, moves or scales."""
    targets = [channel["target"] for animation in animations for channel in animation["channels"]]
    return {
        t["node"]
        for t in targets
        if isinstance(t.get("node"), int) and t["path"] in ("translation", "rotation", "scale")
    }
