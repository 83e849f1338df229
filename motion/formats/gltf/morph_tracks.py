"""Morph targets and their weights over time, added to a GLB file that has the takes already.

Source: Khronos Group, glTF 2.0 Specification, sections 3.7.2.2 (morph targets) and 3.11 (animations).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from muybridge.arrays import Float32Array
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.motion.formats.gltf.container import ARRAY_BUFFER, FLOAT, Buffer, Document, pack_glb


class MorphTracks(NamedTuple):
    """Weights of morph targets in a clip.

    Attributes:
        weights: of each primitive (T, M), a frame each.
        fps: frames per second.
    """

    weights: Sequence[Float32Array]
    fps: float


def add_morph_tracks(path: Path, targets: Sequence[Float32Array], clips: Mapping[str, MorphTracks]) -> None:
    """Add morph targets to the primitives of a GLB, and tracks of their weights to its clips; in place.

    Primitives of one mesh have all targets of that mesh, as the format demands: those of another primitive are zero.

    Args:
        path: a GLB with one buffer; replaced once it is complete.
        targets: of each primitive, over all nodes that draw a mesh, (M, V, 3) offsets at rest in the file's axes.
        clips: of every clip of the file.

    Raises:
        FormatError: the file draws other primitives.
        OutputError: the file cannot be written.
    """
    document = Document(path)
    root: dict[str, Any] = document.json
    buffer = Buffer()
    buffer.data += document.binary or b""
    buffer.views, buffer.accessors = root["bufferViews"], root["accessors"]
    drawn = [n for n, node in enumerate(root["nodes"]) if "mesh" in node]
    parts = [(n, root["meshes"][root["nodes"][n]["mesh"]]) for n in drawn]
    sizes = [root["accessors"][p["attributes"]["POSITION"]]["count"] for _, mesh in parts for p in mesh["primitives"]]
    if sizes != [t.shape[1] for t in targets]:
        raise FormatError(f"{path}: draws other meshes than those that were baked")
    first = 0
    for node, mesh in parts:
        own = slice(first, first + len(mesh["primitives"]))
        first = own.stop
        before = len(mesh["primitives"][0].get("targets", ()))
        _add_targets(buffer, mesh, targets[own])
        for clip in root["animations"]:
            tracks = clips[clip["name"]]
            series = np.concatenate(tracks.weights[own], axis=1)
            _add_track(buffer, clip, node, np.pad(series, ((0, 0), (before, 0))), tracks.fps)
    root["buffers"] = [{"byteLength": len(buffer.data)}]
    with replacing(path) as temporary:
        temporary.write_bytes(pack_glb(root, bytes(buffer.data)))


def _add_targets(buffer: Buffer, mesh: dict[str, Any], targets: Sequence[Float32Array]) -> None:
    """The targets of a mesh's primitives, each (M, V, 3), to all of them."""
    total = sum(map(len, targets))
    begin = 0
    for primitive, own in zip(mesh["primitives"], targets, strict=True):
        entries = primitive.setdefault("targets", [])
        for k in range(total):
            if begin <= k < begin + len(own):
                entries.append({"POSITION": buffer.add(own[k - begin], "VEC3", target=ARRAY_BUFFER, bounds=True)})
            else:
                entries.append({"POSITION": _zeros(buffer, own.shape[1])})
        begin += len(own)
    if total:
        names = mesh.setdefault("extras", {}).setdefault("targetNames", [])
        names += [f"corrective {k + 1}" for k in range(total)]
        mesh["weights"] = [*mesh.get("weights", []), *[0.0] * total]


def _zeros(buffer: Buffer, count: int) -> int:
    """An accessor of zero offsets, which takes no room: one without a view."""
    zero = [0.0, 0.0, 0.0]
    buffer.accessors.append({"componentType": FLOAT, "count": count, "type": "VEC3", "min": zero, "max": zero})
    return len(buffer.accessors) - 1


def _add_track(buffer: Buffer, clip: dict[str, Any], node: int, weights: Float32Array, fps: float) -> None:
    """The weights (T, M) of a node's mesh in a clip."""
    if not weights.shape[1]:
        return
    times = buffer.add(np.arange(len(weights)) / fps, "SCALAR", bounds=True)
    clip["samplers"].append({"input": times, "output": buffer.add(weights.reshape(-1), "SCALAR")})
    clip["channels"].append({"sampler": len(clip["samplers"]) - 1, "target": {"node": node, "path": "weights"}})
