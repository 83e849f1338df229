"""Writing FBX: a skeleton of limb nodes, its animation and a mesh of its bones.

Centimetres, Y up, facing +Z at rest, as exporters for game engines write it; Unreal, Unity and Maya import it without
settings. Joints have their own axes, and the bind pose holds their rest orientation. Every frame is a key, of rotations
and, for roots and joints that slide, of translations; angles are unwrapped, so that a value between two keys lies
between them. Several roots are children of one null node.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge import __version__
from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.local_frames import motion_frames, own_axes, rest_frames
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.fbx.container import CREATION_TIME, FILE_ID, VERSION, Node, Table, write_fbx_nodes
from muybridge.motion.formats.fbx.curves import add_curves, add_stack, object_name, take, ticks
from muybridge.motion.formats.fbx.scene import CUSTOM_RATE, RATES
from muybridge.motion.formats.skeletal.bone_meshes import BoneMesh, bone_mesh
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.euler import smooth_euler

CM = 100.0
_RATE_NUMBERS = {rate: number for number, rate in reversed(RATES.items()) if rate.is_integer()}
_TAKE = "Take 001"
_DOCUMENT, _STACK, _LAYER, _MESH, _GEOMETRY, _SKIN, _POSE, _MATERIAL, _HOLDER = range(100001, 100010)
# Numbers of a joint's objects, joint j having base + j; of its curves three each.
_JOINT, _ATTRIBUTE, _CLUSTER, _END, _END_ATTRIBUTE = (200000, 300000, 400000, 500000, 600000)
_NODE_OF = {"T": 700000, "R": 800000}
_CURVE_OF = {"T": 1000000, "R": 2000000}


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
    skeleton = motion.skeleton
    objects, links = Node("Objects", (), []), Node("Connections", (), [])
    ends = [j for j, tip in enumerate(skeleton.tips) if j not in skeleton.parents and np.isfinite(tip).all()]
    _add_joints(objects, links, skeleton, ends)
    _add_mesh(objects, links, skeleton)
    _add_animation(objects, links, motion)
    write_fbx_nodes(path, [*_head(motion), _definitions(objects), objects, links, _takes(motion)])


def _head(motion: Motion) -> list[Node]:
    header = Node("FBXHeaderExtension", (), [])
    header.add("FBXHeaderVersion", np.int32(1003))
    header.add("FBXVersion", np.int32(VERSION))
    header.add("EncryptionType", np.int32(0))
    stamp = header.add("CreationTimeStamp", children=[])
    moment = (
        ("Year", 1970),
        ("Month", 1),
        ("Day", 1),
        ("Hour", 10),
        ("Minute", 0),
        ("Second", 0),
        ("Millisecond", 0),
    )
    for key, value in (("Version", 1000), *moment):
        stamp.add(key, np.int32(value))
    header.add("Creator", f"muybridge {__version__}")
    table = Table()
    for axis, way in (("Up", 1), ("Front", 2), ("Coord", 0)):
        table.integer(f"{axis}Axis", way).integer(f"{axis}AxisSign", 1)
    table.integer("OriginalUpAxis", -1).integer("OriginalUpAxisSign", 1)
    table.number("UnitScaleFactor", 1.0).number("OriginalUnitScaleFactor", 1.0)
    table.integer("TimeMode", _RATE_NUMBERS.get(motion.fps, CUSTOM_RATE), "enum").number("CustomFrameRate", motion.fps)
    table.line("TimeSpanStart", "KTime", "Time", "", 0)
    table.line("TimeSpanStop", "KTime", "Time", "", ticks(len(motion) - 1, motion.fps))
    settings = Node("GlobalSettings", (), [Node("Version", (np.int32(1000),)), table.node])
    documents = Node("Documents", (), [Node("Count", (np.int32(1),))])
    scene = documents.add("Document", _DOCUMENT, "Scene", "Scene", children=[])
    scene.children = [Table().line("ActiveAnimStackName", "KString", "", "", _TAKE).node, Node("RootNode", (0,))]
    return [
        header, Node("FileId", (FILE_ID,)), Node("CreationTime", (CREATION_TIME,)),
        Node("Creator", (f"muybridge {__version__}",)), settings, documents, Node("References", (), []),
    ]  # fmt: skip


def _definitions(objects: Node) -> Node:
    """How many objects there are of each kind."""
    kinds = ["GlobalSettings", *(node.name for node in objects.children or [])]
    out = Node("Definitions", (), [Node("Version", (np.int32(100),)), Node("Count", (np.int32(len(kinds)),))])
    for kind in dict.fromkeys(kinds):
        out.add("ObjectType", kind, children=[Node("Count", (np.int32(kinds.count(kind)),))])
    return out


def _takes(motion: Motion) -> Node:
    out = Node("Takes", (), [Node("Current", (_TAKE,))])
    out.append(take(_TAKE, ticks(len(motion) - 1, motion.fps)))
    return out


def _model(number: int, name: str, kind: str, place: FloatArray, turn: FloatArray | None = None) -> Node:
    """A model at `place` (3,) with the rotation `turn` (3, 3) in its parent's axes; None: without rotation."""
    angles = np.zeros(3)
    if turn is not None:
        angles = np.degrees(smooth_euler(Rotation.from_matrix(turn).as_quat()[None, None], "xyz")[0, 0])
    table = Table().integer("InheritType", 1, "enum")
    table.line("Lcl Translation", "Lcl Translation", "", "A", *map(float, place))
    table.line("Lcl Rotation", "Lcl Rotation", "", "A", *map(float, angles))
    table.line("Lcl Scaling", "Lcl Scaling", "", "A", 1.0, 1.0, 1.0)
    seen = [Node("Shading", (True,)), Node("Culling", ("CullingOff",))]
    children = [Node("Version", (np.int32(232),)), table.node, *seen]
    return Node("Model", (number, object_name(name, "Model"), kind), children)


def _limb(objects: Node, links: Node, numbers: tuple[int, int, int], name: str, length: float, model: Node) -> None:
    """A joint's model and what makes it a limb; `numbers` are the model's, the attribute's and the parent's."""
    number, attribute, parent = numbers
    size = Table().number("Size", length).node
    attributes = [Node("TypeFlags", ("Skeleton",)), size]
    objects.append(Node("NodeAttribute", (attribute, object_name(name, "NodeAttribute"), "LimbNode"), attributes))
    objects.append(model)
    links.add("C", "OO", number, parent)
    links.add("C", "OO", attribute, number)


def _add_joints(objects: Node, links: Node, skeleton: Skeleton, ends: Iterable[int]) -> None:
    """The joints at rest, with an end where a last one's bone ends; and the pose that the mesh is bound in."""
    axes = own_axes(skeleton, BVH_FROM_WORLD.T)
    turns, places = rest_frames(skeleton, BVH_FROM_WORLD.T)
    lengths, top = CM * skeleton.bone_lengths, 0
    if len(skeleton.roots) > 1:
        top = _HOLDER
        objects.append(_model(top, "skeleton", "Null", np.zeros(3)))
        links.add("C", "OO", top, 0)
    for j, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        numbers = (_JOINT + j, _ATTRIBUTE + j, _JOINT + parent if parent >= 0 else top)
        turn = None if skeleton.axes is None else turns[j]
        model = _model(_JOINT + j, name, "LimbNode", CM * places[j], turn)
        _limb(objects, links, numbers, name, float(lengths[j]), model)
    for j in ends:
        tip = CM * axes[j].T @ skeleton.tips[j]
        numbers, name = (_END + j, _END_ATTRIBUTE + j, _JOINT + j), f"{skeleton.names[j]}_End"
        _limb(objects, links, numbers, name, float(np.linalg.norm(tip)), _model(_END + j, name, "LimbNode", tip))
    pose = Node("Pose", (_POSE, object_name("BindPose", "Pose"), "BindPose"), [])
    pose.add("Type", "BindPose")
    pose.add("Version", np.int32(100))
    pose.add("NbPoseNodes", np.int32(len(skeleton) + 1))
    entries = [(_MESH, np.eye(4)), *((_JOINT + j, matrix) for j, matrix in enumerate(_bind(skeleton)))]
    for number, matrix in entries:
        pose.add("PoseNode", children=[Node("Node", (number,)), Node("Matrix", (_columns(matrix),))])
    objects.append(pose)


def _bind(skeleton: Skeleton) -> FloatArray:
    """(J, 4, 4) the file's axes from each joint at rest, centimetres."""
    out = np.tile(np.eye(4), (len(skeleton), 1, 1))
    out[:, :3, 3] = CM * skeleton.rest_positions @ BVH_FROM_WORLD.T
    if skeleton.axes is not None:
        out[:, :3, :3] = BVH_FROM_WORLD @ skeleton.axes
    return out


def _columns(matrix: FloatArray) -> FloatArray:
    """A matrix as FBX stores it: (16,), column after column."""
    return matrix.T.ravel()


def _add_mesh(objects: Node, links: Node, skeleton: Skeleton) -> None:
    mesh = bone_mesh(skeleton)
    objects.append(_geometry(mesh))
    objects.append(_model(_MESH, "bones", "Mesh", np.zeros(3)))
    material = Table().line("DiffuseColor", "Color", "", "A", 0.8, 0.62, 0.36).node
    children = [Node("Version", (np.int32(102),)), Node("ShadingModel", ("lambert",)), material]
    objects.append(Node("Material", (_MATERIAL, object_name("bones", "Material"), ""), children))
    skin = [Node("Version", (np.int32(101),)), Node("Link_DeformAcuracy", (50.0,))]
    objects.append(Node("Deformer", (_SKIN, object_name("bones", "Deformer"), "Skin"), skin))
    for child, parent in ((_MESH, 0), (_GEOMETRY, _MESH), (_MATERIAL, _MESH), (_SKIN, _GEOMETRY)):
        links.add("C", "OO", child, parent)
    bind = _bind(skeleton)
    for j, name in enumerate(skeleton.names):
        moved = np.flatnonzero(mesh.joints == j).astype(np.int32)
        cluster = Node("Deformer", (_CLUSTER + j, object_name(name, "SubDeformer"), "Cluster"), [])
        cluster.add("Version", np.int32(100))
        cluster.add("UserData", "", "")
        if len(moved):
            cluster.add("Indexes", moved)
            cluster.add("Weights", np.ones(len(moved)))
        cluster.add("Transform", _columns(_inverse(bind[j])))  # the mesh as the joint sees it
        cluster.add("TransformLink", _columns(bind[j]))
        objects.append(cluster)
        links.add("C", "OO", _CLUSTER + j, _SKIN)
        links.add("C", "OO", _JOINT + j, _CLUSTER + j)


def _inverse(matrix: FloatArray) -> FloatArray:
    """The inverse of a rotation and a shift (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = matrix[:3, :3].T
    out[:3, 3] = -out[:3, :3] @ matrix[:3, 3]
    return out


def _geometry(mesh: BoneMesh) -> Node:
    out = Node("Geometry", (_GEOMETRY, object_name("bones", "Geometry"), "Mesh"), [])
    corners = np.arange(len(mesh.positions), dtype=np.int32)
    corners[2::3] = ~corners[2::3]  # the last of a face is negative
    out.add("GeometryVersion", np.int32(124))
    out.add("Vertices", (CM * mesh.positions @ BVH_FROM_WORLD.T).ravel())
    out.add("PolygonVertexIndex", corners)
    layers = {"Normal": ("ByPolygonVertex", "Normals", (mesh.normals @ BVH_FROM_WORLD.T).ravel()),
              "Material": ("AllSame", "Materials", np.zeros(1, np.int32))}  # fmt: skip
    layer = Node("Layer", (np.int32(0),), [Node("Version", (np.int32(100),))])
    for kind, (mapping, key, values) in layers.items():
        element = out.add(f"LayerElement{kind}", np.int32(0), children=[])
        element.add("Version", np.int32(101))
        element.add("Name", "")
        element.add("MappingInformationType", mapping)
        element.add("ReferenceInformationType", "Direct" if kind == "Normal" else "IndexToDirect")
        element.add(key, values)
        one = layer.add("LayerElement", children=[])
        one.add("Type", f"LayerElement{kind}")
        one.add("TypedIndex", np.int32(0))
    out.append(layer)
    return out


def _add_animation(objects: Node, links: Node, motion: Motion) -> None:
    """Every joint's angles, and the translations of roots and of joints that slide: one key per frame."""
    add_stack(objects, links, (_STACK, _LAYER), _TAKE, ticks(len(motion) - 1, motion.fps))
    times = np.array([ticks(t, motion.fps) for t in range(len(motion))], np.int64)
    skeleton = motion.skeleton
    turns, places = motion_frames(motion, BVH_FROM_WORLD.T)
    if skeleton.axes is None:  # without a detour over matrices, which rounds
        quat = continuous_quat(motion.quat_wxyz)
        xyzw = np.concatenate([quat[..., 1:] @ BVH_FROM_WORLD.T, quat[..., :1]], axis=-1)
    else:
        xyzw = np.roll(continuous_quat(quat_from_matrix(turns)), -1, axis=-1)
    angles = np.degrees(smooth_euler(xyzw, "xyz"))  # FBX's order: about X first
    root = CM * motion.root_positions_world @ BVH_FROM_WORLD.T
    for j in range(len(skeleton)):
        moved = [("R", "Lcl Rotation", angles[:, j])]
        if j == 0 or j in skeleton.sliding:
            moved.append(("T", "Lcl Translation", CM * places[:, j] if j else root))
        for kind, what, values in moved:
            numbers = (_NODE_OF[kind] + j, _CURVE_OF[kind] + 3 * j)
            add_curves(objects, links, numbers, _LAYER, _JOINT + j, what, times, values)
