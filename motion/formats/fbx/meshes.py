"""Meshes as nodes of an FBX file: geometry with layers, skins, and shapes to blend towards."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.formats.fbx.container import Node, Property, Table
from muybridge.motion.formats.fbx.curves import object_name
from muybridge.motion.formats.fbx.document import CM
from muybridge.motion.formats.fbx.limbs import JOINT, columns
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD


@dataclass(frozen=True, eq=False)
class Geometry:
    """Triangles whose corners share points.

    Attributes:
        name: of the mesh.
        points: (P, 3) metres, in the world.
        triangles: (F, 3) points, counter-clockwise seen from outside.
        normals: (F, 3, 3) unit vectors in the world, of each corner; None for none.
        uvs: (F, 3, 2) of each set of texture coordinates, (0, 0) being the bottom left corner.
        colours: (F, 3, 4) red, green, blue and alpha; None for none.
        materials: (F,) each triangle's number among the model's materials; None where all have the first.
    """

    name: str
    points: FloatArray
    triangles: IntArray
    normals: FloatArray | None = None
    uvs: Sequence[FloatArray] = ()
    colours: FloatArray | None = None
    materials: IntArray | None = None


def geometry_node(number: int, mesh: Geometry) -> Node:
    """The geometry; its object's number is `number`."""
    out = Node("Geometry", (number, object_name(mesh.name, "Geometry"), "Mesh"), [])
    corners = mesh.triangles.astype(np.int32).copy()
    corners[:, 2] = ~corners[:, 2]  # the last of a face is negative
    out.add("GeometryVersion", np.int32(124))
    out.add("Vertices", (CM * mesh.points @ BVH_FROM_WORLD.T).ravel())
    out.add("PolygonVertexIndex", corners.ravel())
    layers: list[tuple[str, int, str]] = []

    def layer(kind: str, number: int, mapping: str, values: dict[str, Property], direct: bool = True) -> None:
        element = out.add(f"LayerElement{kind}", np.int32(number), children=[])
        element.add("Version", np.int32(101))
        element.add("Name", f"UVMap{f'_{number}' if number else ''}" if kind == "UV" else "")
        element.add("MappingInformationType", mapping)
        element.add("ReferenceInformationType", "Direct" if direct else "IndexToDirect")
        for key, value in values.items():
            element.add(key, value)
        layers.append((kind, number, mapping))

    if mesh.normals is not None:
        layer("Normal", 0, "ByPolygonVertex", {"Normals": (mesh.normals @ BVH_FROM_WORLD.T).ravel()})
    for k, uv in enumerate(mesh.uvs):
        different, index = np.unique(uv.reshape(-1, 2), axis=0, return_inverse=True)
        layer("UV", k, "ByPolygonVertex", {"UV": different.ravel(), "UVIndex": index.ravel().astype(np.int32)}, False)
    if mesh.colours is not None:
        layer("Color", 0, "ByPolygonVertex", {"Colors": mesh.colours.ravel()})
    own = np.zeros(1, np.int32) if mesh.materials is None else mesh.materials.astype(np.int32)
    layer("Material", 0, "AllSame" if mesh.materials is None else "ByPolygon", {"Materials": own}, False)
    for number in sorted({k for _, k, _ in layers}):
        head = out.add("Layer", np.int32(number), children=[Node("Version", (np.int32(100),))])
        for kind in (kind for kind, k, _ in layers if k == number):
            one = head.add("LayerElement", children=[])
            one.add("Type", f"LayerElement{kind}")
            one.add("TypedIndex", np.int32(number))
    return out


def add_skin(
    objects: Node, links: Node, geometry: int, names: Sequence[str], bind: FloatArray, weights: FloatArray,
    numbers: Iterator[int],
) -> None:  # fmt: skip
    """Bind a geometry to joints.

    Args:
        objects, links: nodes to add to.
        geometry: its object's number.
        names: of the J joints, whose models `limbs.add_joints` made.
        bind: (J, 4, 4) of `limbs.bind_matrices`.
        weights: (P, J) of the geometry's points.
        numbers: that no object has.
    """
    skin = next(numbers)
    head = [Node("Version", (np.int32(101),)), Node("Link_DeformAcuracy", (50.0,))]
    objects.append(Node("Deformer", (skin, object_name("skin", "Deformer"), "Skin"), head))
    links.add("C", "OO", skin, geometry)
    for j, name in enumerate(names):
        moved = np.flatnonzero(weights[:, j] > 0).astype(np.int32)
        number = next(numbers)
        cluster = Node("Deformer", (number, object_name(name, "SubDeformer"), "Cluster"), [])
        cluster.add("Version", np.int32(100))
        cluster.add("UserData", "", "")
        if len(moved):
            cluster.add("Indexes", moved)
            cluster.add("Weights", np.ascontiguousarray(weights[moved, j], np.float64))
        cluster.add("Transform", columns(_inverse(bind[j])))  # the mesh as the joint sees it
        cluster.add("TransformLink", columns(bind[j]))
        objects.append(cluster)
        links.add("C", "OO", number, skin)
        links.add("C", "OO", JOINT + j, number)


def _inverse(matrix: FloatArray) -> FloatArray:
    """The inverse of a rotation and a shift (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = matrix[:3, :3].T
    out[:3, 3] = -out[:3, :3] @ matrix[:3, 3]
    return out


def add_shapes(
    objects: Node, links: Node, geometry: int, shapes: Sequence[tuple[str, FloatArray]], numbers: Iterator[int]
) -> list[int]:
    """Shapes that a geometry can be blended towards; all weights are zero.

    Args:
        objects, links: nodes to add to.
        geometry: its object's number.
        shapes: name, and (P, 3) metres, offsets of the geometry's points in the world's axes.
        numbers: that no object has.

    Returns:
        The number of each shape's channel, whose `DeformPercent` is its weight.
    """
    if not shapes:
        return []
    blend, channels = next(numbers), []
    objects.append(Node("Deformer", (blend, object_name("shapes", "Deformer"), "BlendShape"),
                        [Node("Version", (np.int32(100),))]))  # fmt: skip
    links.add("C", "OO", blend, geometry)
    for name, offsets in shapes:
        channel, shape = next(numbers), next(numbers)
        node = Node("Deformer", (channel, object_name(name, "SubDeformer"), "BlendShapeChannel"), [])
        node.add("Version", np.int32(100))
        node.add("DeformPercent", 0.0)
        node.add("FullWeights", np.array([100.0]))
        node.append(Table().line("DeformPercent", "Number", "", "A", 0.0).node)
        objects.append(node)
        moved = np.flatnonzero((offsets != 0).any(axis=1)).astype(np.int32)
        own = Node("Geometry", (shape, object_name(name, "Geometry"), "Shape"), [Node("Version", (np.int32(100),))])
        own.add("Indexes", moved)
        own.add("Vertices", (CM * offsets[moved] @ BVH_FROM_WORLD.T).ravel())
        own.add("Normals", np.zeros(3 * len(moved)))
        objects.append(own)
        links.add("C", "OO", channel, blend)
        links.add("C", "OO", shape, channel)
        channels.append(channel)
    return channels
