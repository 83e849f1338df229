"""The meshes and materials of an FBX file, as parts of a character."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.character import Material, Mesh, Morph
from muybridge.motion.formats.fbx.container import Node
from muybridge.motion.formats.fbx.read import FbxRig
from muybridge.motion.formats.fbx.scene import Scene, properties

_SAME = 1e-6  # corners of one point whose normals and coordinates differ by less are one vertex


@dataclass
class Binding:
    """What moves a mesh: world from mesh as bound, (J, 4, 4) joints from it, (V, K) joints and weights of points."""

    world_from_mesh: FloatArray
    bind: FloatArray
    joints: IntArray
    weights: FloatArray
    rigid: bool


def read_meshes(
    rig: FbxRig, linear: FloatArray, places: FloatArray, still: dict[int, FloatArray]
) -> tuple[list[Mesh], list[int], int]:
    """The meshes that follow a rig's joints, the numbers of their materials, and how many meshes follow none.

    Args:
        rig: of the file.
        linear: (J, 3, 3) world from joint at rest, with the size of the joints, in metres per unit of the file.
        places: (J, 3) metres, the joints in the world at rest.
        still: (4, 4) world from the models without animation.
    """
    scene, out, materials, left = rig.scene, [], [], 0
    for model in scene.models:
        for geometry in scene.below(model, "Geometry"):
            points = points_of(scene, geometry)
            if points is None:
                continue
            binding = _skinned(rig, geometry, len(points), linear) or _hung(
                rig, model, len(points), linear, places, still
            )
            if binding is None:
                left += 1
                continue
            mine = scene.below(model, "Material")
            materials += [m for m in mine if m not in materials]
            numbers = [materials.index(m) for m in mine]
            out += mesh_parts(scene, geometry, scene.models[model].name, points, binding, numbers)
    return out, materials, left


def points_of(scene: Scene, geometry: int) -> FloatArray | None:
    """(N, 3) the points of a geometry in the file's unit; None where it is no mesh."""
    node = scene.objects[geometry]
    if not node.all("Vertices") or not node.all("PolygonVertexIndex"):
        return None
    return _array(node, "Vertices").reshape(-1, 3)


def standing_models(scene: Scene) -> dict[int, FloatArray]:
    """(4, 4) world from every model of a scene without animation, in metres."""
    world = np.eye(4)
    world[:3, :3] = scene.metres * scene.axes
    out: dict[int, FloatArray] = {0: np.eye(4)}

    def matrix(n: int) -> FloatArray:
        if n not in out:
            step, model = np.eye(4), scene.models[n]
            turn = model.turns(model.vectors["Lcl Rotation"][None])[0]
            step[:3, :3] = turn * model.vectors["Lcl Scaling"]
            v = model.vectors
            pivot = v["ScalingOffset"] + v["ScalingPivot"] - v["RotationPivot"] - v["Lcl Scaling"] * v["ScalingPivot"]
            step[:3, 3] = v["Lcl Translation"] + v["RotationOffset"] + v["RotationPivot"] + turn @ pivot
            out[n] = matrix(model.parent) @ step
        return out[n]

    return {n: world @ matrix(n) for n in scene.models}


def _array(node: Node, name: str) -> FloatArray:
    values = node.all(name)[0].properties[0]
    if not isinstance(values, np.ndarray):
        raise ValueError(f"the {name} of a mesh are not a list of numbers")
    return np.asarray(values, float)


def _skinned(rig: FbxRig, geometry: int, count: int, linear: FloatArray) -> Binding | None:
    scene, place = rig.scene, {n: k for k, n in enumerate(rig.joints)}
    place |= {end: place[n] for n, end in rig.tips.items()}
    clusters: list[tuple[int, Node]] = []
    for skin in scene.below(geometry, "Deformer"):
        for number in scene.below(skin, "Deformer"):
            bones = [m for m in scene.below(number, "Model") if m in place]
            if bones and scene.objects[number].all("TransformLink"):
                clusters.append((place[bones[0]], scene.objects[number]))
    if not clusters:
        return None
    world = np.diag([scene.metres] * 3 + [1.0])
    world[:3, :3] = scene.metres * scene.axes
    _, first = clusters[0]
    world_from_mesh = world @ _matrix(first, "TransformLink") @ _matrix(first, "Transform")
    back = np.linalg.inv(world_from_mesh)
    bind = np.tile(np.eye(4), (len(rig.joints), 1, 1))
    pairs: list[tuple[IntArray, IntArray, FloatArray]] = []
    for j, cluster in clusters:
        step = np.eye(4)
        step[:3, :3] = linear[j]
        bind[j] = step @ _matrix(cluster, "Transform") @ back
        if cluster.all("Indexes"):
            at, weights = _array(cluster, "Indexes").astype(np.int64), _array(cluster, "Weights")
            if at.max(initial=0) >= count or at.min(initial=0) < 0 or len(at) != len(weights):
                raise ValueError("a skin's points and weights do not fit its mesh")
            pairs.append((at, np.full(len(at), j), weights))
    joints, weights = _gathered(pairs, count)
    return Binding(world_from_mesh, bind, joints, weights, False)


def _gathered(pairs: Sequence[tuple[IntArray, IntArray, FloatArray]], count: int) -> tuple[IntArray, FloatArray]:
    """(V, K) joints and weights of points, from lists of points, joints and weights."""
    at, joint, weight = (np.concatenate([p[k] for p in pairs]) if pairs else np.zeros(0) for k in range(3))
    used = weight > 0
    at, joint, weight = at[used].astype(np.int64), joint[used].astype(np.int64), weight[used]
    order = np.lexsort((-weight, at))
    at, joint, weight = at[order], joint[order], weight[order]
    slot = np.arange(len(at)) - np.searchsorted(at, at)
    joints = np.zeros((count, max(int(slot.max(initial=0)) + 1, 1)), np.int64)
    weights = np.zeros(joints.shape)
    joints[at, slot], weights[at, slot] = joint, weight
    total = weights.sum(axis=1, keepdims=True)
    return joints, np.where(total > 0, weights / np.where(total > 0, total, 1), np.eye(joints.shape[1])[0])


def _hung(
    rig: FbxRig, model: int, count: int, linear: FloatArray, places: FloatArray, still: dict[int, FloatArray]
) -> Binding | None:
    scene, holder = rig.scene, model
    while holder and holder not in rig.joints:
        holder = scene.models[holder].parent
    if not holder:
        return None
    j = rig.joints.index(holder)
    at_rest, bind = np.eye(4), np.tile(np.eye(4), (len(rig.joints), 1, 1))
    at_rest[:3, :3], at_rest[:3, 3], bind[j, :3, 3] = linear[j], places[j], -places[j]
    world_from_mesh = at_rest @ np.linalg.inv(still[holder]) @ still[model] @ geometric(scene, model)
    return Binding(world_from_mesh, bind, np.full((count, 1), j), np.ones((count, 1)), True)


def geometric(scene: Scene, model: int) -> FloatArray:
    """(4, 4) a model from its mesh, which the mesh alone is moved by."""
    own, out = properties(scene.objects[model]), np.eye(4)
    vectors = [np.array(own.get(f"Geometric{what}", (usual,) * 3)[:3], float)
               for what, usual in (("Translation", 0.0), ("Rotation", 0.0), ("Scaling", 1.0))]  # fmt: skip
    out[:3, :3] = Rotation.from_euler("xyz", np.radians(vectors[1])).as_matrix() * vectors[2]
    out[:3, 3] = vectors[0]
    return out


def _matrix(cluster: Node, name: str) -> FloatArray:
    return _array(cluster, name).reshape(4, 4).T


def mesh_parts(
    scene: Scene, geometry: int, name: str, points: FloatArray, binding: Binding, materials: list[int]
) -> list[Mesh]:
    """A mesh for each of the materials of a geometry, whose points are (N, 3); `materials` are those of its model."""
    node = scene.objects[geometry]
    corners = _array(node, "PolygonVertexIndex").astype(np.int64)
    last = corners < 0
    corners = np.where(last, ~corners, corners)
    if not last.any() or corners.max(initial=0) >= len(points):
        raise ValueError(f"the polygons of the mesh {name!r} do not fit its points")
    polygon = np.concatenate([[0], np.cumsum(last)[:-1]])
    uv, normal = (_layer(node, kind, key, width, corners, polygon)
                  for kind, key, width in (("UV", "UV", 2), ("Normal", "Normals", 3)))  # fmt: skip
    detail = [v for v in (uv, normal) if v is not None]
    rows = np.concatenate([corners[:, None], *[np.round(v / _SAME) for v in detail]], axis=1)
    _, first, vertex = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    vertex, point = vertex.reshape(-1), corners[first]
    ends = np.flatnonzero(last)
    starts = np.concatenate([[0], ends[:-1] + 1])
    sizes = ends - starts + 1
    count = np.maximum(sizes - 2, 0)  # triangles of each polygon, as a fan about its first corner
    start = np.repeat(starts, count)
    step = np.arange(len(start)) - np.repeat(np.cumsum(count) - count, count) + 1
    triangles = np.stack([vertex[start], vertex[start + step], vertex[start + step + 1]], axis=1)
    of_polygon = _material_of(node, len(ends))[polygon[start]]
    turn, shift = binding.world_from_mesh[:3, :3], binding.world_from_mesh[:3, 3]
    if np.linalg.det(turn) < 0:
        triangles = triangles[:, ::-1]
    positions = points[point] @ turn.T + shift
    normals = None if normal is None else normal[first] @ np.linalg.inv(turn)
    if normals is not None:
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    uvs = None if uv is None else uv[first] * [1, -1] + [0, 1]
    morphs, weights = _morphs(scene, geometry, len(points), point, turn)
    out = []
    for k in np.unique(of_polygon):
        used, corner = np.unique(triangles[of_polygon == k], return_inverse=True)
        out.append(Mesh(
            name, positions[used], corner.reshape(-1, 3), binding.joints[point[used]], binding.weights[point[used]],
            binding.bind, None if normals is None else normals[used], None if uvs is None else uvs[used],
            tuple(Morph(m.name, m.offsets[used]) for m in morphs), weights,
            materials[k] if 0 <= k < len(materials) else None, binding.rigid,
        ))  # fmt: skip
    return out


def _layer(node: Node, kind: str, key: str, width: int, corners: IntArray, polygon: IntArray) -> FloatArray | None:
    """(N, K) values of a layer of a mesh at each corner of its polygons; None where there is none."""
    found = [n for n in node.all(f"LayerElement{kind}") if n.all(key)]
    if not found:
        return None
    values = _array(found[0], key).reshape(-1, width)
    mapping = _word(found[0], "MappingInformationType")
    at = {"ByPolygonVertex": np.arange(len(corners)), "ByVertice": corners, "ByVertex": corners, "ByPolygon": polygon,
          "AllSame": np.zeros(len(corners), np.int64)}.get(mapping)  # fmt: skip
    if at is None:
        return None
    for name in (f"{kind}Index", f"{key}Index"):
        if "IndexToDirect" in _word(found[0], "ReferenceInformationType") and found[0].all(name):
            at = _array(found[0], name).astype(np.int64)[at]
            break
    return values[at] if at.max(initial=-1) < len(values) else None


def _word(node: Node, name: str) -> str:
    return next((str(n.properties[0]) for n in node.all(name) if n.properties), "")


def _material_of(node: Node, polygons: int) -> IntArray:
    """(P,) the number of each polygon's material among the model's."""
    for layer in node.all("LayerElementMaterial"):
        numbers = _array(layer, "Materials").astype(np.int64)
        if _word(layer, "MappingInformationType") == "ByPolygon" and len(numbers) == polygons:
            return numbers
        return np.full(polygons, numbers[0] if len(numbers) else 0)
    return np.zeros(polygons, np.int64)


def _morphs(
    scene: Scene, geometry: int, count: int, point: IntArray, turn: FloatArray
) -> tuple[list[Morph], FloatArray]:
    """The shapes of a geometry at its vertices, and their weights without animation."""
    out, weights = [], []
    for deformer in scene.below(geometry, "Deformer"):
        for channel in scene.below(deformer, "Deformer"):
            for shape in scene.below(channel, "Geometry")[-1:]:
                node, offsets = scene.objects[shape], np.zeros((count, 3))
                if node.all("Indexes") and node.all("Vertices"):
                    offsets[_array(node, "Indexes").astype(np.int64)] = _array(node, "Vertices").reshape(-1, 3)
                name = str(scene.objects[channel].properties[1]).split("\x00")[0]
                out.append(Morph(name, offsets[point] @ turn.T))
                percent: Any = properties(scene.objects[channel]).get("DeformPercent", (0.0,))[0]
                weights.append(float(percent) / 100)
    return out, np.array(weights)


def read_material(scene: Scene, number: int, folder: Path) -> Material:
    """A material with the image of its colour, where the file holds it or it lies in the folder."""
    node = scene.objects[number]
    own = properties(node)
    colour: Any = own.get("DiffuseColor", own.get("Diffuse", (0.8, 0.8, 0.8)))[:3]
    opacity: Any = own.get("Opacity", (1.0,))[0]
    name = str(node.properties[1]).split("\x00")[0]
    for texture in scene.below(number, "Texture", "DiffuseColor"):
        for video in [*scene.below(texture, "Video"), texture]:
            source = scene.objects[video]
            content = next((n.properties[0] for n in source.all("Content") if n.properties), b"")
            file = _word(source, "RelativeFilename") or _word(source, "FileName")
            beside = folder / file.replace("\\", "/")
            if not content and file and beside.is_file():
                content = beside.read_bytes()
            if isinstance(content, bytes) and content:
                kind = "image/png" if content[:4] == b"\x89PNG" else "image/jpeg" if content[:2] == b"\xff\xd8" else ""
                return Material(name, np.array([1.0, 1.0, 1.0, float(opacity)]), content, kind)
    return Material(name, np.array([*map(float, colour), float(opacity)]))
