"""Joints as nodes of an FBX file: limbs, the pose that meshes are bound in, and their animation.

Joints have their own axes, and the bind pose holds their rest orientation. Every frame is a key, of rotations and, for
roots and joints that slide, of translations; angles are unwrapped, so that a value between two keys lies between them.
Several roots are children of one null node.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.local_frames import motion_frames, own_axes, rest_frames
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.fbx.container import Node, Table
from muybridge.motion.formats.fbx.curves import add_curves, add_stack, object_name, ticks
from muybridge.motion.formats.fbx.document import CM
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.euler import smooth_euler

_POSE, _HOLDER = 100007, 100009
# Numbers of a joint's objects, joint j having base + j.
JOINT = 200000
_ATTRIBUTE, _END, _END_ATTRIBUTE = 300000, 500000, 600000
FIRST_FREE = 700000  # what is no joint may have any number from here on


def model(number: int, name: str, kind: str, place: FloatArray, turn: FloatArray | None = None) -> Node:
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


def _limb(objects: Node, links: Node, numbers: tuple[int, int, int], name: str, length: float, limb: Node) -> None:
    """A joint's model and what makes it a limb; `numbers` are the model's, the attribute's and the parent's."""
    number, attribute, parent = numbers
    size = Table().number("Size", length).node
    attributes = [Node("TypeFlags", ("Skeleton",)), size]
    objects.append(Node("NodeAttribute", (attribute, object_name(name, "NodeAttribute"), "LimbNode"), attributes))
    objects.append(limb)
    links.add("C", "OO", number, parent)
    links.add("C", "OO", attribute, number)


def add_joints(
    objects: Node, links: Node, skeleton: Skeleton, meshes: Sequence[int], root: FloatArray | None = None
) -> None:
    """The joints at rest, with an end where a last one's bone ends; and the pose that meshes are bound in.

    Args:
        objects, links: nodes to add to.
        skeleton: at rest; joint j becomes the model `JOINT` + j.
        meshes: numbers of the models that are bound, which stand without rotation at the origin.
        root: (3,) metres, where the first root is; None: at the origin.
    """
    axes = own_axes(skeleton, BVH_FROM_WORLD.T)
    turns, places = rest_frames(skeleton, BVH_FROM_WORLD.T)
    at_root = np.zeros(3) if root is None else BVH_FROM_WORLD @ root
    lengths, top = CM * skeleton.bone_lengths, 0
    if len(skeleton.roots) > 1:
        top = _HOLDER
        objects.append(model(top, "skeleton", "Null", np.zeros(3)))
        links.add("C", "OO", top, 0)
    for j, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        numbers = (JOINT + j, _ATTRIBUTE + j, JOINT + parent if parent >= 0 else top)
        turn = None if skeleton.axes is None else turns[j]
        place = places[j] + at_root if parent < 0 else places[j]
        _limb(objects, links, numbers, name, float(lengths[j]), model(JOINT + j, name, "LimbNode", CM * place, turn))
    for j in _ends(skeleton):
        tip = CM * axes[j].T @ skeleton.tips[j]
        numbers, name = (_END + j, _END_ATTRIBUTE + j, JOINT + j), f"{skeleton.names[j]}_End"
        _limb(objects, links, numbers, name, float(np.linalg.norm(tip)), model(_END + j, name, "LimbNode", tip))
    pose = Node("Pose", (_POSE, object_name("BindPose", "Pose"), "BindPose"), [])
    pose.add("Type", "BindPose")
    pose.add("Version", np.int32(100))
    pose.add("NbPoseNodes", np.int32(len(skeleton) + len(meshes)))
    bind = enumerate(bind_matrices(skeleton, root))
    entries = [*((number, np.eye(4)) for number in meshes), *((JOINT + j, matrix) for j, matrix in bind)]
    for number, matrix in entries:
        pose.add("PoseNode", children=[Node("Node", (number,)), Node("Matrix", (columns(matrix),))])
    objects.append(pose)


def _ends(skeleton: Skeleton) -> Iterable[int]:
    return [j for j, tip in enumerate(skeleton.tips) if j not in skeleton.parents and np.isfinite(tip).all()]


def bind_matrices(skeleton: Skeleton, root: FloatArray | None = None) -> FloatArray:
    """(J, 4, 4) the file's axes from each joint at rest, centimetres; `root` as in `add_joints`."""
    out = np.tile(np.eye(4), (len(skeleton), 1, 1))
    places = skeleton.rest_positions + (0.0 if root is None else root)
    out[:, :3, 3] = CM * places @ BVH_FROM_WORLD.T
    if skeleton.axes is not None:
        out[:, :3, :3] = BVH_FROM_WORLD @ skeleton.axes
    return out


def columns(matrix: FloatArray) -> FloatArray:
    """A matrix as FBX stores it: (16,), column after column."""
    return matrix.T.ravel()


def add_animation(objects: Node, links: Node, motion: Motion, name: str, numbers: Iterator[int]) -> int:
    """A stack with the angles of every joint, and the translations of roots and of joints that slide.

    Args:
        objects, links: nodes to add to.
        motion: metres, Z up; at least one frame.
        name: of the stack.
        numbers: that no object has.

    Returns:
        The time of the last key.
    """
    last, layer = ticks(len(motion) - 1, motion.fps), next(numbers)
    add_stack(objects, links, (next(numbers), layer), name, last)
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
        moved = [("Lcl Rotation", angles[:, j])]
        if j == 0 or j in skeleton.sliding:
            moved.append(("Lcl Translation", CM * places[:, j] if j else root))
        for what, values in moved:
            node, first, _, _ = (next(numbers) for _ in range(4))
            add_curves(objects, links, (node, first), layer, JOINT + j, what, times, values)
    return last
