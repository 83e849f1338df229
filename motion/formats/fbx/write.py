"""Writing FBX: a skeleton of limb nodes, its animation and a mesh of its bones."""

from itertools import count
from pathlib import Path

import numpy as np

from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.fbx.container import Node, Table
from muybridge.motion.formats.fbx.curves import object_name
from muybridge.motion.formats.fbx.document import write_document
from muybridge.motion.formats.fbx.limbs import FIRST_FREE, add_animation, add_joints, bind_matrices, model
from muybridge.motion.formats.fbx.meshes import Geometry, add_skin, geometry_node
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh

_TAKE = "Take 001"
_MESH, _GEOMETRY, _MATERIAL = 100004, 100005, 100008


def write_fbx(path: Path, motion: Motion) -> None:
    """Write a motion with its skeleton and a mesh of its bones as binary FBX 7.4.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up; at least one frame.

    Raises:
        OutputError: the file cannot be written.
    """
    if not len(motion):
        raise ValueError("a motion without frames cannot be written")
    objects, links, numbers = Node("Objects", (), []), Node("Connections", (), []), count(FIRST_FREE)
    add_joints(objects, links, motion.skeleton, [_MESH])
    _add_mesh(objects, links, motion.skeleton, numbers)
    last = add_animation(objects, links, motion, _TAKE, numbers)
    write_document(path, objects, links, [(_TAKE, last)], motion.fps)


def _add_mesh(objects: Node, links: Node, skeleton: Skeleton, numbers: "count[int]") -> None:
    mesh = bone_mesh(skeleton)
    triangles = np.arange(len(mesh.positions)).reshape(-1, 3)
    objects.append(geometry_node(_GEOMETRY, Geometry("bones", mesh.positions, triangles,
                                                     mesh.normals.reshape(-1, 3, 3))))  # fmt: skip
    objects.append(model(_MESH, "bones", "Mesh", np.zeros(3)))
    material = Table().line("DiffuseColor", "Color", "", "A", 0.8, 0.62, 0.36).node
    children = [Node("Version", (np.int32(102),)), Node("ShadingModel", ("lambert",)), material]
    objects.append(Node("Material", (_MATERIAL, object_name("bones", "Material"), ""), children))
    for child, parent in ((_MESH, 0), (_GEOMETRY, _MESH), (_MATERIAL, _MESH)):
        links.add("C", "OO", child, parent)
    weights = np.zeros((len(mesh.positions), len(skeleton)))
    weights[np.arange(len(weights)), mesh.joints] = 1.0
    add_skin(objects, links, _GEOMETRY, skeleton.names, bind_matrices(skeleton), weights, numbers)
