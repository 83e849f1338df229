"""FBX's binary container: a tree of nodes with typed properties; written as version 7400, read as 7000 to 7700.

The format has no public specification; this is what its files have in common (A. Barton, "FBX binary file format
specification", code.blender.org, 2013), and Blender's two readers and Assimp's read what is written here.
"""

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError, parsing
from muybridge.files import replacing

VERSION = 7400
MAGIC = b"Kaydara FBX Binary  \x00\x1a\x00"
# Readers compare these with the file's time of creation, so all three are constants.
CREATION_TIME = "1970-01-01 10:00:00:000"
FILE_ID = bytes.fromhex("28b32aebb624ccc2bfc8b02aa92bfcf1")
FOOT_ID = bytes.fromhex("fabcab09d0c8d466b176fb831cf7267e")
FOOT_END = bytes.fromhex("f85a8c6adef5d97eece90ce3758f290b")
# Of version 7.5 on, positions have 64 bits.
WIDE = 7500
_ARRAYS = {"f": np.float32, "d": np.float64, "i": np.int32, "q": np.int64}
_LETTERS = {"f": b"f", "d": b"d", "i": b"i", "q": b"l"}
_COMPRESSED_FROM = 128  # bytes
_NUMBERS = {"Y": "<h", "C": "<?", "I": "<i", "L": "<q", "F": "<f", "D": "<d"}
_STORED = {"f": "<f4", "d": "<f8", "i": "<i4", "l": "<i8", "b": "<u1", "c": "<u1"}
_DEEPEST = 64
# Bytes that an array may unpack to: any number up to the first, beyond it so many times the size of the file.
_ANY_SIZE, _RATIO = 2**26, 100

Property = bool | int | float | str | bytes | NDArray[np.generic] | np.int32


@dataclass
class Node:
    """A node: a name, properties and nodes within.

    Attributes:
        name: of its kind.
        properties: an int is written as 64 bits, a `numpy.int32` as 32; arrays as what they are.
        children: within; a list, even an empty one, ends with the mark that readers look for.
    """

    name: str
    properties: tuple[Property, ...] = ()
    children: list["Node"] | None = None

    def add(self, name: str, *properties: Property, children: list["Node"] | None = None) -> "Node":
        """A new node within this one."""
        return self.append(Node(name, properties, children))

    def all(self, name: str) -> list["Node"]:
        """The nodes within that have this name."""
        return [child for child in self.children or [] if child.name == name]

    def append(self, node: "Node") -> "Node":
        """That node within this one."""
        if self.children is None:
            self.children = []
        self.children.append(node)
        return node


@dataclass
class Table:
    """The `Properties70` of an object, line by line."""

    node: Node = field(default_factory=lambda: Node("Properties70", (), []))

    def line(self, name: str, kind: str, label: str, flags: str, *values: Property) -> "Table":
        """One property: its name, type, second name of the type, flags, and values."""
        self.node.add("P", name, kind, label, flags, *values)
        return self

    def number(self, name: str, value: float, flags: str = "") -> "Table":
        """A number."""
        return self.line(name, "double", "Number", flags, float(value))

    def integer(self, name: str, value: int, kind: str = "int") -> "Table":
        """A number without fraction, or one of a list of choices (`enum`)."""
        return self.line(name, kind, "Integer" if kind == "int" else "", "", np.int32(value))


def write_fbx_nodes(path: Path, nodes: list[Node]) -> None:
    """Write a file of these nodes; OutputError where it cannot be written."""
    body = bytearray(MAGIC + struct.pack("<I", VERSION))
    for node in nodes:
        append_node(body, node)
    body += end_mark(VERSION) + FOOT_ID + bytes(4)
    body += bytes(16 - len(body) % 16) + struct.pack("<I", VERSION) + bytes(120) + FOOT_END
    with replacing(path) as temporary:
        temporary.write_bytes(bytes(body))


def head_of(version: int) -> str:
    """The layout of where a node ends, how many properties it has and how many bytes they take."""
    return "<QQQ" if version >= WIDE else "<III"


def end_mark(version: int) -> bytes:
    """What ends a list of nodes."""
    return bytes(struct.calcsize(head_of(version)) + 1)


def append_node(body: bytearray, node: Node, version: int = VERSION) -> None:
    """Add a node at the end of a file of some version."""
    start, name, layout = len(body), node.name.encode("ascii"), head_of(version)
    properties = b"".join(_encoded(p) for p in node.properties)
    body += bytes(struct.calcsize(layout)) + struct.pack("<B", len(name)) + name + properties
    for child in node.children or []:
        append_node(body, child, version)
    if node.children is not None:
        body += end_mark(version)
    if layout == "<III" and len(body) > 0xFFFFFFFF:
        raise FormatError("the take is too long for FBX, whose files end at 4 GB; write shorter pieces")
    struct.pack_into(layout, body, start, len(body), len(node.properties), len(properties))


def _encoded(value: Property) -> bytes:
    if isinstance(value, bool):
        return b"C" + struct.pack("<B", value)
    if isinstance(value, np.int32):
        return b"I" + struct.pack("<i", value)
    if isinstance(value, int):
        return b"L" + struct.pack("<q", value)
    if isinstance(value, float):
        return b"D" + struct.pack("<d", value)
    if isinstance(value, str | bytes):
        data = value.encode() if isinstance(value, str) else value
        return (b"S" if isinstance(value, str) else b"R") + struct.pack("<I", len(data)) + data
    array = np.ascontiguousarray(value)
    letter = array.dtype.char if array.dtype.char in _ARRAYS else "q"
    data = array.astype(_ARRAYS[letter]).tobytes()
    packed = zlib.compress(data) if len(data) > _COMPRESSED_FROM else data
    head = struct.pack("<III", array.size, int(len(data) > _COMPRESSED_FROM), len(packed))
    return _LETTERS[letter] + head + packed


def read_fbx_nodes(path: Path) -> Node:
    """A file's nodes, within one without a name; numbers as Python's, arrays as numpy's.

    Raises:
        FormatError: no such file, text instead of binary, of a version before 2011, damaged.
    """
    with parsing(path, FormatError, "a binary FBX", "resave_fbx"):
        return _read_nodes(path, Path(path).read_bytes())


def _read_nodes(path: Path, data: bytes) -> Node:
    if not data.startswith(MAGIC[:20]):
        raise FormatError(f"{path}: no FBX file; export it as binary FBX")
    (version,) = struct.unpack_from("<I", data.ljust(len(MAGIC) + 4, b"\0"), len(MAGIC))
    check_version(path, version)
    out, at = Node("", (), []), len(MAGIC) + 4
    reader = _Reader(data, head_of(version))
    while True:
        node, at = reader.node(at, len(data))
        if node is None:
            return out
        out.append(node)


def check_version(path: Path, version: int) -> None:
    """FormatError where a file is older than FBX 2011."""
    if not 7000 <= version < 8000:
        raise FormatError(f"{path}: FBX of version {version / 1000:g}; FBX 2011 or newer (7.0 to 7.7) is read",
                          remedy="resave_fbx")  # fmt: skip


class _Reader:
    def __init__(self, data: bytes, head: str) -> None:
        self.data, self.head = data, head
        self.head_size = struct.calcsize(head)

    def node(self, at: int, limit: int, depth: int = 0) -> tuple[Node | None, int]:
        """The node at `at` and where the next begins; None for the mark that ends a list."""
        end, count, size = struct.unpack_from(self.head, self.data, at)
        (length,) = struct.unpack_from("<B", self.data, at + self.head_size)
        start = at + self.head_size + 1
        if end == 0:
            return None, start
        name, at = self.data[start : start + length].decode("ascii"), start + length
        if not at + size <= end <= limit or depth > _DEEPEST:
            raise ValueError(f"the node {name!r} ends at byte {end} of {limit}")
        within = at + size
        properties = []
        for _ in range(count):
            value, at = self.value(at, within)
            properties.append(value)
        node, at = Node(name, tuple(properties)), within
        while at < end:
            child, at = self.node(at, end, depth + 1)
            if child is None:
                break
            node.append(child)
        return node, end

    def value(self, at: int, limit: int) -> tuple[Property, int]:
        letter, at = chr(self.data[at]) if at < limit else "", at + 1
        if letter in _NUMBERS:
            (number,) = struct.unpack_from(_NUMBERS[letter], self.data, at)
            value, at = number, at + struct.calcsize(_NUMBERS[letter])
        elif letter in ("S", "R"):
            (size,) = struct.unpack_from("<I", self.data, at)
            raw, at = self.data[at + 4 : at + 4 + size], at + 4 + size
            value = raw.decode("utf-8", "replace") if letter == "S" else raw
        else:
            value, at = self.array(_STORED[letter], at, limit)
        if at > limit:
            raise ValueError("a value runs beyond its node")
        return value, at

    def array(self, kind: str, at: int, limit: int) -> tuple[NDArray[np.generic], int]:
        count, packed, stored = struct.unpack_from("<III", self.data, at)
        raw, at = self.data[at + 12 : at + 12 + stored], at + 12 + stored
        size = count * np.dtype(kind).itemsize
        if at > limit:
            raise ValueError("an array runs beyond its node")
        if size > max(_ANY_SIZE, _RATIO * len(self.data)):
            raise ValueError(f"an array declares {size} bytes, far more than the file can hold")
        if packed:
            # Limited to the stated size: a small file may unpack to a huge one.
            raw = zlib.decompressobj().decompress(raw, size + 1)
        if len(raw) != size:
            raise ValueError(f"an array of {count} values has {len(raw)} bytes, not {size}")
        return np.frombuffer(raw, kind), at
