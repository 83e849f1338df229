"""What surrounds the objects of a written FBX file: header, settings, counts and the list of takes.

Centimetres, Y up, facing +Z at rest, as exporters for game engines write it; Unreal, Unity and Maya import it without
settings.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from muybridge import __version__
from muybridge.motion.formats.fbx.container import CREATION_TIME, FILE_ID, VERSION, Node, Table, write_fbx_nodes
from muybridge.motion.formats.fbx.curves import take
from muybridge.motion.formats.fbx.scene import CUSTOM_RATE, RATES

CM = 100.0
DEFAULT_FPS = 30.0
_RATE_NUMBERS = {rate: number for number, rate in reversed(RATES.items()) if rate.is_integer()}
_DOCUMENT = 100001
_MOMENT = {"Year": 1970, "Month": 1, "Day": 1, "Hour": 10, "Minute": 0, "Second": 0, "Millisecond": 0}


def write_document(path: Path, objects: Node, links: Node, stacks: Sequence[tuple[str, int]], fps: float) -> None:
    """Write a binary FBX 7.4.

    Args:
        path: the file to write; replaced only once it is complete.
        objects: the node `Objects`; no object has the number 100001.
        links: the node `Connections`.
        stacks: name of each animation stack and the time of its last key; the first one is active.
        fps: frames per second of the scene.

    Raises:
        OutputError: the file cannot be written.
    """
    active, last = stacks[0] if stacks else ("", 0)
    listed = Node("Takes", (), [Node("Current", (active,)), *(take(name, end) for name, end in stacks)])
    write_fbx_nodes(path, [*_head(active, last, fps), _definitions(objects), objects, links, listed])


def _head(active: str, last: int, fps: float) -> list[Node]:
    header = Node("FBXHeaderExtension", (), [])
    header.add("FBXHeaderVersion", np.int32(1003))
    header.add("FBXVersion", np.int32(VERSION))
    header.add("EncryptionType", np.int32(0))
    stamp = header.add("CreationTimeStamp", children=[])
    for key, value in {"Version": 1000, **_MOMENT}.items():
        stamp.add(key, np.int32(value))
    header.add("Creator", f"muybridge {__version__}")
    table = Table()
    for axis, way in (("Up", 1), ("Front", 2), ("Coord", 0)):
        table.integer(f"{axis}Axis", way).integer(f"{axis}AxisSign", 1)
    table.integer("OriginalUpAxis", -1).integer("OriginalUpAxisSign", 1)
    table.number("UnitScaleFactor", 1.0).number("OriginalUnitScaleFactor", 1.0)
    table.integer("TimeMode", _RATE_NUMBERS.get(fps, CUSTOM_RATE), "enum").number("CustomFrameRate", fps)
    table.line("TimeSpanStart", "KTime", "Time", "", 0)
    table.line("TimeSpanStop", "KTime", "Time", "", last)
    settings = Node("GlobalSettings", (), [Node("Version", (np.int32(1000),)), table.node])
    documents = Node("Documents", (), [Node("Count", (np.int32(1),))])
    scene = documents.add("Document", _DOCUMENT, "Scene", "Scene", children=[])
    scene.children = [Table().line("ActiveAnimStackName", "KString", "", "", active).node, Node("RootNode", (0,))]
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
