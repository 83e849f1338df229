"""The joints of a glTF file in the scene: without animation, over time, and as the file's skins are bound.

A node's place in the scene is the product of all transforms above it. Its orientation is that product's nearest
rotation, so that nodes which stretch or mirror what is below them leave every position exact.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.motion.formats.clip_choice import Clip, choose_clip, first_clip_notice
from muybridge.motion.formats.gltf.clips import Tracks, clip_names_of, even_times, read_tracks, sample
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.nodes import (
    JointChoice,
    Node,
    choose_joints,
    even_scale,
    humanoid_bones,
    nearest_rotation,
    path_to,
    read_nodes,
)

_SMALLEST = 1e-9  # determinant of a scale below which a map has no orientation


@dataclass
class Frame:
    """A node in the scene at T times (or 1, where nothing moves it).

    Attributes:
        turn: (T, 3, 3) scene from node, a rotation.
        linear: (T, 3, 3) the same with all scales.
        place: (T, 3) in the scene.
        even: whether `linear` is `turn` times a positive number.
    """

    turn: FloatArray
    linear: FloatArray
    place: FloatArray
    even: bool

    @property
    def matrix(self) -> FloatArray:
        """(T, 4, 4) scene from node."""
        out = np.zeros((len(self.place), 4, 4))
        out[:, :3, :3], out[:, :3, 3], out[:, 3, 3] = self.linear, self.place, 1.0
        return out


@dataclass
class Rig:
    """The joints of a file.

    Attributes:
        document: the file.
        nodes: all its nodes.
        choice: which nodes are joints.
        still: the joints and the nodes above them without animation, by number, parents first.
        meshes_bound: of each skin of `choice`, (4, 4) the scene from its meshes in the pose they are bound in.
        bound: (4, 4) the scene from each joint in that pose, by number; without joints that no skin binds.
    """

    document: Document
    nodes: list[Node]
    choice: JointChoice
    still: dict[int, Frame]
    meshes_bound: list[FloatArray]
    bound: dict[int, FloatArray]

    @property
    def parents(self) -> list[int]:
        """(J,) the parent of each joint among the joints, -1 for a root."""
        place = {n: i for i, n in enumerate(self.choice.order)}
        return [place.get(self.nodes[n].parent, -1) for n in self.choice.order]

    def uneven(self, frames: dict[int, Frame]) -> list[str]:
        """A notice of the topmost nodes that stretch or mirror the joints below them."""
        above = {self.nodes[n].parent for n in frames}
        odd = [n for n in frames if n in above and not frames[n].even
               and (self.nodes[n].parent < 0 or frames[self.nodes[n].parent].even)]  # fmt: skip
        names = ", ".join(f"node {n} ({self.nodes[n].name})" for n in odd)
        return [f"{self.document.path.name}: {names} stretches or mirrors what is below it; positions are kept, "
                "orientations of bones are the nearest rotations"] if odd else []  # fmt: skip


def read_rig(document: Document) -> Rig:
    """The joints of a file, without animation and as bound.

    Raises:
        FormatError: the nodes are no forest, or there is no skeleton.
    """
    nodes = read_nodes(document)
    choice = choose_joints(document, nodes)
    needed = sorted({n for j in choice.order for n in path_to(nodes, j)}, key=lambda n: len(path_to(nodes, n)))
    rig = Rig(document, nodes, choice, forward(nodes, needed, {}, np.zeros(1)), [], {})
    for skin in choice.skins:
        _bind(rig, skin)
    return rig


def humanoid_joints(rig: Rig) -> dict[str, int]:
    """The joints of a VRM humanoid by the names of VRM 1.0's bones; empty where the file states none."""
    number = {n: i for i, n in enumerate(rig.choice.order)}
    bones = humanoid_bones(rig.document.json.get("extensions") or {})
    return {bone: number[n] for bone, n in bones.items() if n in number}


def read_clip(rig: Rig, clip: Clip) -> tuple[dict[int, Frame], float, list[str]]:
    """The rig's nodes over the even frames of one of the file's animations, its rate, and notices.

    Raises:
        FormatError: no such clip, or its keys do not fit together.
    """
    document = rig.document
    names = clip_names_of(document)
    number = choose_clip(names, clip, document.error)
    tracks = read_tracks(document, number, set(rig.still))
    fps, times = even_times(document, tracks, number)
    notices = []
    if clip is None and len(names) > 1:
        notices.append(first_clip_notice(document.path, names))
    return forward(rig.nodes, list(rig.still), tracks, times), fps, notices


def forward(nodes: list[Node], needed: list[int], tracks: Tracks, times: FloatArray) -> dict[int, Frame]:
    """Nodes in the scene, by number; `needed` has parents first, `tracks` may be empty."""
    out: dict[int, Frame] = {}
    top = Frame(np.eye(3)[None], np.eye(3)[None], np.zeros((1, 3)), True)
    for n in needed:
        node = nodes[n]
        turn, place, scales, linear = node.rotation[None], node.translation[None], node.scales[None], node.linear[None]
        if (n, "rotation") in tracks:
            turn = matrix_from_quat(np.roll(sample(tracks[n, "rotation"], times, True), 1, axis=-1))
        if (n, "translation") in tracks:
            place = sample(tracks[n, "translation"], times, False)
        if (n, "scale") in tracks:
            scales = sample(tracks[n, "scale"], times, False)
        if (n, "rotation") in tracks or (n, "scale") in tracks:
            linear = turn * scales[:, None, :]
        up = out.get(node.parent, top)
        linear_here = up.linear @ linear
        even = up.even and even_scale(np.linalg.norm(linear, axis=1)) and bool((np.linalg.det(linear) > 0).all())
        turn_here = up.turn @ turn
        if not even:
            flat = np.abs(np.linalg.det(linear_here)) < _SMALLEST * np.linalg.norm(linear_here, axis=(1, 2)) ** 3
            turn_here = np.where(flat[:, None, None], turn_here, nearest_rotation(linear_here))
        out[n] = Frame(turn_here, linear_here, up.place + (up.linear @ place[..., None])[..., 0], even)
    return out


def _bind(rig: Rig, skin: dict[str, Any]) -> None:
    """Add where a skin's meshes and joints are in the pose that they are bound in.

    Its first joint in the tree is where it was in an earlier skin, else where its node is without animation.
    """
    joints = [n for n in rig.choice.order if n in skin["joints"]]
    matrices = inverse_binds(rig.document, skin)
    usable = {n: m for n, m in matrices.items() if abs(np.linalg.det(m[:3, :3])) > _SMALLEST**2}
    anchor = next((n for n in joints if n in usable), None)
    if anchor is None or "inverseBindMatrices" not in skin:
        rig.meshes_bound.append(rig.still[joints[0]].matrix[0])
        return
    scene_from_mesh = rig.bound.get(anchor, rig.still[anchor].matrix[0]) @ usable[anchor]
    rig.meshes_bound.append(scene_from_mesh)
    for n in joints:
        if n in usable and n not in rig.bound:
            rig.bound[n] = scene_from_mesh @ np.linalg.inv(usable[n])


def inverse_binds(document: Document, skin: dict[str, Any]) -> dict[int, FloatArray]:
    """(4, 4) joint from mesh as bound, by the joint's node; the identity where the file states none."""
    if "inverseBindMatrices" not in skin:
        return {n: np.eye(4) for n in skin["joints"]}
    columns = document.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
    if len(columns) < len(skin["joints"]):
        raise document.error(f"a skin has {len(skin['joints'])} joints and {len(columns)} inverse bind matrices")
    return {n: m.T for n, m in zip(skin["joints"], columns, strict=False)}


def rest_turns(rig: Rig) -> FloatArray:
    """(J, 3, 3) scene from joint at rest: as bound where a skin says so, else as its node is below its parent."""
    rest: dict[int, FloatArray] = {}
    for n in rig.choice.order:
        up = rig.nodes[n].parent
        if n in rig.bound and abs(np.linalg.det(rig.bound[n][:3, :3])) > 0:
            rest[n] = nearest_rotation(rig.bound[n][:3, :3])
        elif up in rest:
            rest[n] = rest[up] @ rig.still[up].turn[0].T @ rig.still[n].turn[0]
        else:
            rest[n] = rig.still[n].turn[0]
    return np.stack([rest[n] for n in rig.choice.order])
