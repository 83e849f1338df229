"""One more animation in a glTF file, of which nothing else changes.

The JSON is changed as text: what was there keeps its spelling and its order. Of a GLB the binary chunk grows at its
end; elsewhere the new numbers are in a buffer of their own.
"""

import base64
import struct
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.motion.formats.gltf.container import BINARY_CHUNK, GLB_HEAD, JSON_CHUNK, Buffer, Document
from muybridge.motion.formats.gltf.json_text import JsonText
from muybridge.motion.formats.gltf.nodes import nearest_rotation
from muybridge.motion.formats.gltf.rig import Rig

_HELD = 1e-6  # metres from its node's own place by which a joint still counts as there
_SHEAR = 1e-5


def node_tracks(
    rig: Rig, linear: FloatArray, turns: FloatArray, places: FloatArray
) -> dict[tuple[int, str], FloatArray]:
    """What to write for each joint's node so that the joints get the frames that a motion gives them.

    Args:
        rig: of the file.
        linear: (J, 3, 3) scene from joint at rest, with the scales of the nodes.
        turns: (T, J, 3, 3) rotations of the joints from rest, in the scene's axes.
        places: (T, J, 3) in the scene.

    Returns:
        (T, 4) rotations xyzw of all joints and (T, 3) translations of the roots and of joints that are not where their
        nodes are, by node and property. Below a node that stretches, places are exact and rotations the nearest.
    """
    count = len(places)
    out: dict[tuple[int, str], FloatArray] = {}
    frames = {n: (f.linear, f.place) for n, f in rig.still.items()}
    for i, n in enumerate(rig.choice.order):
        node = rig.nodes[n]
        up_linear, up_place = frames.get(node.parent, (np.eye(3)[None], np.zeros((1, 3))))
        back = np.linalg.inv(up_linear)
        shift = (back @ (places[:, i] - up_place)[..., None])[..., 0]
        scales = np.where(np.abs(node.scales) < 1e-12, 1.0, node.scales)
        turn = nearest_rotation(back @ turns[:, i] @ linear[i] / scales)
        size = np.abs(np.linalg.det(up_linear[0])) ** (1 / 3)
        if i == 0 or np.abs(shift - node.translation).max() * size > _HELD:
            out[n, "translation"] = np.broadcast_to(shift, (count, 3))
        else:
            shift = np.broadcast_to(node.translation, shift.shape)
        out[n, "rotation"] = np.roll(continuous_quat(quat_from_matrix(turn)[:, None])[:, 0], -1, axis=-1)
        frames[n] = up_linear @ (turn * node.scales), up_place + (up_linear @ shift[..., None])[..., 0]
    return out


def write_gltf_clip(
    rig: Rig, tracks: dict[tuple[int, str], FloatArray], fps: float, path: Path, name: str, alone: bool = False
) -> tuple[str, ...]:
    """Write the file of a rig again with one more animation.

    Args:
        rig: of the file.
        tracks: (T, 3) translations and (T, 4) rotations xyzw, by node and property.
        fps: frames per second.
        path: the file to write; other files that a `.gltf` names are copied beside it.
        name: of the animation.
        alone: whether it takes the place of the animations that are there; their numbers stay in the buffer.

    Returns:
        What else had to change, one sentence each.

    Raises:
        FormatError: a joint's node has a sheared matrix, which no animation can replace.
        OutputError: the file cannot be written.
    """
    document, buffer = rig.document, Buffer()
    accessors, views = (len(document.json.get(key) or []) for key in ("accessors", "bufferViews"))
    count = len(next(iter(tracks.values())))
    time = buffer.add(np.arange(count) / fps, "SCALAR", bounds=True)
    outputs = [buffer.add(values, "VEC4" if what == "rotation" else "VEC3") for (_, what), values in tracks.items()]
    animation = {
        "name": name,
        "extras": {"fps": float(fps)},
        "samplers": [{"input": accessors + time, "interpolation": "LINEAR", "output": accessors + output}
                     for output in outputs],
        "channels": [{"sampler": k, "target": {"node": n, "path": what}} for k, (n, what) in enumerate(tracks)],
    }  # fmt: skip
    text = JsonText(document.text)
    notices = _without_matrices(rig, text, {n for n, _ in tracks})
    binary = document.binary
    if binary is not None and "uri" not in document.json["buffers"][0]:
        # The chunk may be padded beyond the length that the buffer states: what is added begins after that.
        base, number = len(binary) + -len(binary) % 4, 0
        binary = binary.ljust(base, b"\0") + bytes(buffer.data) + bytes(-len(buffer.data) % 4)
        text.replace(base + len(buffer.data), "buffers", 0, "byteLength")
    else:
        base, number = 0, len(document.json.get("buffers") or [])
        uri = "data:application/octet-stream;base64," + base64.b64encode(buffer.data).decode("ascii")
        text.append("buffers", [{"byteLength": len(buffer.data), "uri": uri}])
    text.append("accessors", [a | {"bufferView": views + a["bufferView"]} for a in buffer.accessors])
    text.append("bufferViews", [v | {"buffer": number, "byteOffset": base + v["byteOffset"]} for v in buffer.views])
    if alone and document.json.get("animations"):
        text.replace([animation], "animations")
    else:
        text.append("animations", [animation])
    data = _packed(document, text.changed(), binary)
    _copy_files(document, path)
    with replacing(path) as temporary:
        temporary.write_bytes(data)
    return notices


def _without_matrices(rig: Rig, text: JsonText, moved: set[int]) -> tuple[str, ...]:
    """Replace the matrices of nodes that the animation moves, as the format asks for."""
    names = []
    for n in sorted(moved):
        node = rig.nodes[n]
        if not text.has("nodes", n, "matrix"):
            continue
        if np.abs(node.rotation * node.scales - node.linear).max() > _SHEAR * np.abs(node.linear).max():
            raise rig.document.error(f"node {n} ({node.name}) has a sheared matrix, which no animation can replace")
        parts = {
            "translation": node.translation.tolist(),
            "rotation": np.roll(quat_from_matrix(node.rotation), -1).tolist(),
            "scale": node.scales.tolist(),
        }
        text.replace_member(parts, "nodes", n, "matrix")
        names.append(node.name)
    if not names:
        return ()
    return (f"the matrix of {', '.join(names)} is written as translation, rotation and scale, which animation needs",)


def _packed(document: Document, text: str, binary: bytes | None) -> bytes:
    """The bytes of the file: as GLB where it was one, with its other chunks as they were."""
    packed = text.encode("utf-8")
    if not document.chunks:
        return packed
    out, done = b"", False
    packed = packed.rstrip(b" ")
    for kind, chunk in document.chunks:
        if kind == JSON_CHUNK and not done:
            chunk, done = packed + b" " * (-len(packed) % 4), True
        elif kind == BINARY_CHUNK and binary is not None:
            chunk, binary = binary, None
        out += struct.pack("<II", len(chunk), kind) + chunk
    return struct.pack("<III", GLB_HEAD, 2, 12 + len(out)) + out


def _copy_files(document: Document, path: Path) -> None:
    """Copy the files that the JSON names beside the new file, where they are not there already."""
    for raw in [*(document.json.get("buffers") or []), *(document.json.get("images") or [])]:
        uri = str(raw.get("uri", "data:"))
        if uri.startswith("data:") or "://" in uri:
            continue
        beside = Path(unquote(uri))
        if beside.is_absolute() or ".." in beside.parts:  # nothing is written outside the folder
            continue
        source, target = document.path.parent / beside, path.parent / beside
        if source.is_file() and not target.exists():
            with replacing(target) as temporary:
                temporary.write_bytes(source.read_bytes())
