"""Reading a skeleton and its animation from a glTF 2.0 file, whichever program wrote it.

Other programs' joints have axes of their own at rest, are below nodes that rotate and scale everything, slide against
their parents, and have keys at any times. The result has even frames; the joints' own axes are in `Skeleton.axes`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.clip_choice import Clip, choose_clip
from muybridge.motion.formats.gltf.clips import Tracks, clip_names_of, even_times, read_tracks, sample
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.nodes import JointChoice, Node, choose_joints, even_scale, path_to, read_nodes
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.joint_frames import motion_from_frames
from muybridge.motion.take import Take


def read_gltf(path: Path, clip: Clip = None) -> Motion:
    """Read a file's skeleton and one of its animations into metres, Z up.

    Args:
        path: a `.glb` or `.gltf` file, or a `.vrm` or `.vrma`, which are glTF.
        clip: name or number (from 0) of the animation; None is the first. Without any animation the motion is one
            frame of the nodes without animation.

    Returns:
        A Motion at the frame rate of the keys (30 where there are fewer than two). Its rest pose is the skin's.

    Raises:
        FormatError: malformed, no skeleton, no such clip (the message lists those there are), or joints below a node
            that stretches or mirrors.
    """
    motion = read_gltf_take(path, clip).motion
    assert motion is not None
    return motion


def read_gltf_take(path: Path, clip: Clip = None) -> Take:
    """As `read_gltf`, with notices of what was chosen and left out."""
    with parsing(path, FormatError, "a glTF 2.0 file", "export_gltf"):
        return _read(Document(Path(path)), clip)


def clip_names(path: Path) -> tuple[str, ...]:
    """The names of a file's animations, in its order.

    Raises:
        FormatError: malformed.
    """
    with parsing(path, FormatError, "a glTF 2.0 file", "export_gltf"):
        return clip_names_of(Document(Path(path)))


def _read(document: Document, clip: Clip) -> Take:
    nodes = read_nodes(document)
    choice = choose_joints(document, nodes)
    names = clip_names_of(document)
    number = choose_clip(names, clip, document.error)
    needed = sorted({n for j in choice.order for n in path_to(nodes, j)}, key=lambda n: len(path_to(nodes, n)))
    tracks = read_tracks(document, number, set(needed))
    fps, times = even_times(document, tracks, number)
    frames = _forward(document, nodes, needed, tracks, times)
    notices = list(choice.notices)
    if clip is None and len(names) > 1:
        notices.append(f"{document.path.name}: the first of its {len(names)} clips was read, {names[0]!r}")
    return Take(motion=_motion(document, nodes, choice, frames, fps), notices=tuple(notices))


@dataclass
class _Frame:
    """A node in the scene over time (T or 1 frames)."""

    turn: FloatArray  # (T, 3, 3) scene from node, a rotation
    linear: FloatArray  # (T, 3, 3) the same with all scales
    place: FloatArray  # (T, 3)
    size: float  # product of the scales at rest


def _forward(
    document: Document, nodes: list[Node], needed: list[int], tracks: Tracks, times: FloatArray
) -> dict[int, _Frame]:
    """The joints and the nodes above them, by number; `needed` has parents first."""
    out: dict[int, _Frame] = {}
    above = {nodes[n].parent for n in needed}
    for n in needed:
        node = nodes[n]
        turn, place, scales = node.rotation[None], node.translation[None], node.scales[None]
        if (n, "rotation") in tracks:
            turn = matrix_from_quat(np.roll(sample(tracks[n, "rotation"], times, True), 1, axis=-1))
        if (n, "translation") in tracks:
            place = sample(tracks[n, "translation"], times, False)
        if (n, "scale") in tracks:
            scales = sample(tracks[n, "scale"], times, False)
        if n in above and not even_scale(scales):
            worst = scales[int(np.argmax(np.ptp(scales, axis=1)))]
            raise document.error(f"node {n} ({node.name}) stretches or mirrors what is below it ({worst}); its scale "
                                 "must be applied")  # fmt: skip
        size = float(scales[0].mean())
        if node.parent < 0:
            out[n] = _Frame(turn, turn * scales[:, None, :], place, size)
        else:
            up = out[node.parent]
            at = up.place + (up.linear @ place[..., None])[..., 0]
            out[n] = _Frame(up.turn @ turn, up.linear @ (turn * scales[:, None, :]), at, up.size * size)
    return out


def _motion(
    document: Document, nodes: list[Node], choice: JointChoice, frames: dict[int, _Frame], fps: float
) -> Motion:
    order = choice.order
    parents = [order.index(nodes[n].parent) if nodes[n].parent in order else -1 for n in order]
    rest = _rest_turns(document, nodes, choice)
    tips, shifts = np.full((len(order), 3), np.nan), np.full((len(order), 3), np.nan)
    standing = {n: _standing(nodes, n) for n in order}
    for i, n in enumerate(order):
        tip = nodes[n].tip
        if tip is not None and i not in parents:
            tips[i] = tip * frames[n].size
        up = nodes[n].parent
        shifts[i] = nodes[n].translation * frames[up].size if parents[i] >= 0 else standing[n] @ BVH_FROM_WORLD
    count = max(len(f.place) for f in frames.values())
    return motion_from_frames(
        [nodes[n].name for n in order], parents,
        BVH_FROM_WORLD.T @ np.stack([np.broadcast_to(frames[n].turn, (count, 3, 3)) for n in order], axis=1),
        np.stack([np.broadcast_to(frames[n].place, (count, 3)) for n in order], axis=1) @ BVH_FROM_WORLD,
        BVH_FROM_WORLD.T @ rest, tips, fps, BVH_FROM_WORLD.T, shifts,
    )  # fmt: skip


def _standing(nodes: list[Node], n: int) -> FloatArray:
    """(3,) position of a node in the scene without animation."""
    linear, place = np.eye(3), np.zeros(3)
    for m in path_to(nodes, n):
        place = place + linear @ nodes[m].translation
        linear = linear @ (nodes[m].rotation * nodes[m].scales)
    return place


def _rest_turns(document: Document, nodes: list[Node], choice: JointChoice) -> FloatArray:
    """(J, 3, 3) scene from joint at rest: by the skins' bind pose where it is given, rotated so that the first root
    has the orientation of its node."""
    of_node: dict[int, FloatArray] = {}

    def standing(n: int) -> FloatArray:
        if n not in of_node:
            above = np.eye(3) if nodes[n].parent < 0 else standing(nodes[n].parent)
            of_node[n] = above @ nodes[n].rotation
        return of_node[n]

    bound: dict[int, FloatArray] = {}
    for skin in choice.skins:
        if "inverseBindMatrices" not in skin:
            continue
        matrices = document.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
        for n, columns in zip(skin["joints"], matrices, strict=False):
            u, size, vt = np.linalg.svd(columns[:3, :3])  # stored column by column: this is the transpose
            if n not in bound and size.min() > 1e-9 and np.linalg.det(u @ vt) > 0:
                bound[n] = u @ vt
    root = choice.order[0]
    if root not in bound:
        bound = {}
    turn = standing(root) @ bound[root].T if bound else np.eye(3)
    rest: dict[int, FloatArray] = {}
    for n in choice.order:
        up = nodes[n].parent
        if n in bound:
            rest[n] = turn @ bound[n]
        else:
            rest[n] = rest[up] @ nodes[n].rotation if up in rest else standing(n)
    return np.stack([rest[n] for n in choice.order])
