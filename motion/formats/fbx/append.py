"""One more animation stack in a binary FBX file, of which nothing else changes.

Nodes are copied byte for byte; only the positions that the format stores in each node's head move where something was
added before them, and the counts of the definitions grow.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.motion.formats.fbx.container import (
    FOOT_END,
    FOOT_ID,
    MAGIC,
    Node,
    append_node,
    end_mark,
    head_of,
)
from muybridge.motion.formats.fbx.curves import add_curves, add_stack, take, ticks
from muybridge.motion.formats.fbx.read import FbxRig, shift_of_pivots
from muybridge.motion.formats.skeletal.euler import smooth_euler

_HELD = 1e-6  # metres from its model's own place by which a joint still counts as there
_KINDS = ("AnimationStack", "AnimationLayer", "AnimationCurveNode", "AnimationCurve")
_MOST = 2**62  # of a number of an object


def model_tracks(
    rig: FbxRig, still: tuple[dict[int, FloatArray], dict[int, FloatArray], dict[int, float]], turns: FloatArray,
    places: FloatArray,
) -> dict[tuple[int, str], FloatArray]:  # fmt: skip
    """What to write for each joint's model so that the joints get the frames that a motion gives them.

    Args:
        rig: of the file.
        still: orientations, places and sizes of all models without animation, as `forward` gives them.
        turns: (T, J, 3, 3) scene from joint, in the joint's own axes.
        places: (T, J, 3) in the scene, in the file's unit.

    Returns:
        (T, 3) angles in degrees of all joints, and translations of the roots and of joints that are not where their
        models are, by model and property.
    """
    scene, count = rig.scene, len(places)
    out: dict[tuple[int, str], FloatArray] = {}
    moving = np.empty_like(turns)
    number = {n: k for k, n in enumerate(rig.joints)}
    for k, n in enumerate(rig.joints):
        model = scene.models[n]
        up = model.parent
        size = still[2][up]
        up_turn, up_place = still[0][up], still[1][up]
        if up in number:
            up_turn, up_place = turns[:, number[up]], places[:, number[up]]
        back = np.swapaxes(up_turn, 1, 2)
        local = back @ turns[:, k]
        before, after = model.around()
        moving[:, k] = before.T @ local @ after
        shift = (back @ (places[:, k] - up_place)[..., None])[..., 0] / size
        shift = shift - shift_of_pivots(model, local, still[2][n] / size)
        if k == 0 or np.abs(shift - model.vectors["Lcl Translation"]).max() * size * scene.metres > _HELD:
            out[n, "Lcl Translation"] = np.broadcast_to(shift, (count, 3))
    quat = np.roll(continuous_quat(quat_from_matrix(moving)), -1, axis=-1)
    for order in sorted({scene.models[n].order for n in rig.joints}):
        mine = [k for k, n in enumerate(rig.joints) if scene.models[n].order == order]
        # In the order of the angles' own axes, whichever is turned about first.
        angles = np.degrees(smooth_euler(quat[:, mine], order.lower()))[..., np.argsort([*order])]
        out |= {(rig.joints[k], "Lcl Rotation"): angles[:, i] for i, k in enumerate(mine)}
    return out


def write_fbx_clip(
    rig: FbxRig, data: bytes, tracks: dict[tuple[int, str], FloatArray], fps: float, path: Path, name: str
) -> None:
    """Write the file of a rig again with one more animation stack.

    Args:
        rig: of the file.
        data: the file's bytes.
        tracks: (T, 3) of each, by model and property.
        fps: frames per second.
        path: the file to write.
        name: of the stack.

    Raises:
        OutputError: the file cannot be written.
    """
    objects, links = Node("Objects", (), []), Node("Connections", (), [])
    numbers = _free_numbers(rig)
    stack, layer = next(numbers), next(numbers)
    count = len(next(iter(tracks.values())))
    add_stack(objects, links, (stack, layer), name, ticks(count - 1, fps))
    times = np.array([ticks(t, fps) for t in range(count)], np.int64)
    for (model, what), values in tracks.items():
        curve_node, first, _, _ = (next(numbers) for _ in range(4))
        add_curves(objects, links, (curve_node, first), layer, model, what, times, values)
    takes = [take(name, ticks(count - 1, fps))]
    added = {"Objects": objects.children or [], "Connections": links.children or [], "Takes": takes}
    with replacing(path) as temporary:
        temporary.write_bytes(_spliced(data, added))


def _free_numbers(rig: FbxRig) -> Iterator[int]:
    """Numbers that no object of the file has, one after the other."""
    used = {n for n in rig.scene.objects if isinstance(n, int)}
    number = max((n for n in used if n < _MOST), default=0)
    while True:
        number += 1
        if number not in used:
            yield number


@dataclass
class _Raw:
    """Where a node is in a file: its start, its name, where what is within begins, and the nodes within."""

    start: int
    name: str
    within: int
    end: int
    children: list["_Raw"] = field(default_factory=list)


class _Copy:
    """A file that is copied node by node, with others added."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        (self.version,) = struct.unpack_from("<I", data, len(MAGIC))
        self.layout = head_of(self.version)
        self.head = struct.calcsize(self.layout)
        self.out = bytearray(data[: len(MAGIC) + 4])

    def node(self, at: int) -> _Raw | None:
        end, _, size = struct.unpack_from(self.layout, self.data, at)
        if end == 0:
            return None
        length = self.data[at + self.head]
        name = self.data[at + self.head + 1 : at + self.head + 1 + length].decode("ascii")
        raw = _Raw(at, name, at + self.head + 1 + length + size, end)
        inner = raw.within
        while inner < end:
            child = self.node(inner)
            if child is None:
                break
            raw.children.append(child)
            inner = child.end
        return raw

    def copy(self, raw: _Raw, added: list[Node] | None = None) -> None:
        """A node as it was, with nodes added at the end of those within."""
        start = len(self.out)
        self.out += self.data[raw.start : raw.within]
        for child in raw.children:
            self.copy(child)
        last = raw.children[-1].end if raw.children else raw.within
        for node in added or []:
            append_node(self.out, node, self.version)
        self.out += self.data[last : raw.end] or (end_mark(self.version) if added else b"")
        struct.pack_into(self.layout[:2], self.out, start, len(self.out))

    def whole(self, raw: _Raw) -> int:
        """The one 32-bit number that a node holds."""
        (value,) = struct.unpack_from("<i", self.data, raw.within - 4)
        return int(value)

    def definitions(self, raw: _Raw, counts: dict[str, int]) -> None:
        """The list of the kinds of objects, with as many more as are added."""
        start = len(self.out)
        self.out += self.data[raw.start : raw.within]
        missing = dict(counts)
        for child in raw.children:
            at = len(self.out)
            self.copy(child)
            kind = self.data[child.start : child.within].rpartition(b"\0")[2].decode("ascii", "replace")
            if child.name == "Count":
                struct.pack_into("<i", self.out, at + child.within - child.start - 4,
                                 self.whole(child) + sum(counts.values()))  # fmt: skip
            elif child.name == "ObjectType" and kind in missing:
                more, place = missing.pop(kind), at + child.within - child.start
                for inner in child.children:
                    if inner.name == "Count":
                        offset = place + inner.within - child.within - 4
                        struct.pack_into("<i", self.out, offset, self.whole(inner) + more)
        for kind, more in missing.items():
            node = Node("ObjectType", (kind,), [Node("Count", (np.int32(more),))])
            append_node(self.out, node, self.version)
        last = raw.children[-1].end if raw.children else raw.within
        self.out += self.data[last : raw.end] or end_mark(self.version)
        struct.pack_into(self.layout[:2], self.out, start, len(self.out))


def _spliced(data: bytes, added: dict[str, list[Node]]) -> bytes:
    """The bytes of a file with nodes added within those of these names at the top."""
    copy = _Copy(data)
    at, left = len(copy.out), dict(added)
    counts = {kind: sum(node.name == kind for node in added["Objects"]) for kind in _KINDS}
    while (raw := copy.node(at)) is not None:
        if raw.name == "Definitions":
            copy.definitions(raw, counts)
        else:
            copy.copy(raw, left.pop(raw.name, None))
        at = raw.end
    left.pop("Takes", None)  # a list that older programs need
    for name, nodes in left.items():
        append_node(copy.out, Node(name, (), nodes), copy.version)
    # The foot: a mark of the file, padding to sixteen bytes, the version again, and a constant.
    mark = data[at + len(end_mark(copy.version)) :][: len(FOOT_ID)]
    out = copy.out + end_mark(copy.version) + (mark if len(mark) == len(FOOT_ID) else FOOT_ID) + bytes(4)
    return bytes(out + bytes(16 - len(out) % 16) + struct.pack("<I", copy.version) + bytes(120) + FOOT_END)
