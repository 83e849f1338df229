"""The container of glTF 2.0: JSON, and numbers in buffers behind accessors.

Source: Khronos Group, glTF 2.0 Specification, sections 3.6 (buffers, accessors) and 4.4 (GLB).
"""

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.formats.gltf.meshopt import decode_meshopt

FLOAT, UNSIGNED_BYTE, UNSIGNED_SHORT = 5126, 5121, 5123
ARRAY_BUFFER = 34962
# Values that a sparse accessor without values of its own may start from, which are zeros.
_MOST_ABSENT = 2**24
GLB_HEAD, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_KINDS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Buffer:
    """Collects arrays into one buffer with a view and an accessor each."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self, values: NDArray[Any], kind: str, component: int = FLOAT, target: int | None = None, bounds: bool = False
    ) -> int:
        """Append an array; returns its accessor's index.

        Args:
            values: (N,) or (N, K) with as many components as `kind` has.
            kind: the accessor's type.
            component: the numbers' type.
            target: use of the view, where that must be stated.
            bounds: whether minimum and maximum are stated.
        """
        array = np.ascontiguousarray(values, dtype=_DTYPES[component])
        self.data += b"\0" * (-len(self.data) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.data += array.tobytes()
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": component,
            "count": len(array),
            "type": kind,
        }
        if bounds:
            flat = array.reshape(len(array), -1)
            accessor["min"], accessor["max"] = flat.min(axis=0).tolist(), flat.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def pack_glb(document: dict[str, Any], data: bytes) -> bytes:
    """The bytes of a GLB file with one buffer."""
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % 4)
    data = data + b"\0" * (-len(data) % 4)
    head = struct.pack("<III", GLB_HEAD, 2, 12 + 8 + len(text) + 8 + len(data))
    return head + struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(data), BINARY_CHUNK) + data


class Document:
    """The contents of a glTF file: its JSON, and its accessors as arrays.

    Attributes:
        path: the file.
        text: its JSON as it is spelled.
        json: the same, read.
        binary: the binary chunk of a GLB; None where there is none.
        chunks: kind and contents of all chunks of a GLB; empty of any other file.
    """

    def __init__(self, path: Path) -> None:
        """Read a `.glb`, or a `.gltf` with the files it names; called within `parsing`.

        Raises:
            FormatError: it is neither, is cut off, or a file it names is missing.
        """
        self.path = path
        data = path.read_bytes()
        if not data.strip(b"\0 \r\n\t"):
            raise self.error("is empty")
        self.binary: bytes | None = None
        self.chunks: list[tuple[int, bytes]] = []
        text = self._unpack(data) if data[:4] == b"glTF" else data
        self.text = text.decode("utf-8-sig")
        self.json: Any = json.loads(self.text)
        if not isinstance(self.json, dict) or not str(self.json["asset"]["version"]).startswith("2."):
            raise self.error("is not glTF 2.0")
        self._buffers: dict[int, bytes] = {}
        self._unpacked: dict[int, bytes] = {}

    def error(self, problem: str, remedy: str = "export_gltf") -> FormatError:
        """An error that names the file."""
        return FormatError(f"{self.path}: {problem}", remedy=remedy)

    def _unpack(self, data: bytes) -> bytes:
        magic, version, length = struct.unpack_from("<III", data)
        if version != 2 or length > len(data):
            raise self.error(f"is of version {version} and has {len(data)} of {length} bytes: is it cut off?")
        at, text = 12, b""
        while at + 8 <= length:
            size, kind = struct.unpack_from("<II", data, at)
            chunk = data[at + 8 : at + 8 + size]
            if len(chunk) != size:
                raise self.error("ends within a chunk")
            if kind == JSON_CHUNK and not text:
                text = chunk
            elif kind == BINARY_CHUNK and self.binary is None:
                self.binary = chunk
            self.chunks.append((kind, chunk))
            at += 8 + size
        return text

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.json["buffers"][index].get("uri")
            if uri is None:
                if self.binary is None or index != 0:
                    raise self.error(f"buffer {index} has no data")
                self._buffers[index] = self.binary
            elif uri.startswith("data:"):
                try:
                    self._buffers[index] = base64.b64decode(uri.partition(",")[2], validate=True)
                except binascii.Error as error:
                    raise self.error(f"buffer {index} is damaged ({error})") from error
            else:
                beside = self.path.parent / unquote(uri)
                if beside.exists() and not beside.is_file():  # a device never ends
                    raise self.error(f"its buffer {unquote(uri)} is no file")
                try:
                    self._buffers[index] = beside.read_bytes()
                except OSError as error:
                    raise self.error(f"its buffer {unquote(uri)} cannot be read ({error.strerror})") from error
        return self._buffers[index]

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view, decompressed where they are compressed by meshopt."""
        view = self.json["bufferViews"][index]
        extensions = view.get("extensions") or {}
        packed = extensions.get("EXT_meshopt_compression") or extensions.get("KHR_meshopt_compression")
        if packed is None:
            return self._part(index, view)
        if index not in self._unpacked:
            data = self._part(index, packed)
            sizes = int(packed["count"]), int(packed["byteStride"])
            try:
                whole = decode_meshopt(data, *sizes, str(packed["mode"]), str(packed.get("filter", "NONE")))
            except (ValueError, IndexError) as error:
                raise self.error(
                    f"the compressed buffer view {index} cannot be read ({error})", "plain_gltf"
                ) from error
            self._unpacked[index] = whole
        return self._unpacked[index]

    def _part(self, index: int, view: dict[str, Any]) -> bytes:
        buffer, start, size = self._buffer(int(view["buffer"])), int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or size < 0 or start + size > len(buffer):
            raise self.error(f"buffer view {index} reaches beyond its buffer")
        return buffer[start : start + size]

    def _values(self, view: int, start: int, count: int, shape: tuple[np.dtype[Any], int], what: str) -> NDArray[Any]:
        """(N, K) numbers of a view from a byte on; `shape` is their type and K."""
        dtype, width = shape
        data, size = self.view(view), dtype.itemsize * width
        stride = int(self.json["bufferViews"][view].get("byteStride", size))
        # Values that overlap would let a small file declare any amount of data.
        if start < 0 or stride < size or start + max(count - 1, 0) * stride + size > len(data):
            raise self.error(f"{what} reaches beyond its buffer")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def accessor(self, index: int) -> FloatArray:
        """(N, K) numbers of an accessor; normalised integers are 0..1 or -1..1."""
        accessor = self.json["accessors"][index]
        dtype = np.dtype(_DTYPES[accessor["componentType"]])
        count, width = int(accessor["count"]), _KINDS[accessor["type"]]
        sparse = accessor.get("sparse")
        if count < 0 or "bufferView" not in accessor and (sparse is None or count > _MOST_ABSENT):
            raise self.error(f"accessor {index} holds nothing")
        if "bufferView" in accessor:
            start = int(accessor.get("byteOffset", 0))
            values = self._values(accessor["bufferView"], start, count, (dtype, width), f"accessor {index}").astype(
                float
            )
        else:
            values = np.zeros((count, width))
        if sparse is not None:
            self._replace(values, sparse, dtype, f"accessor {index}")
        if accessor.get("normalized") and dtype.kind != "f":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        if not (np.abs(values) < 1e12).all():
            raise self.error(f"accessor {index} holds numbers that are not finite")
        return np.asarray(values)

    def _replace(self, values: FloatArray, sparse: dict[str, Any], dtype: np.dtype[Any], what: str) -> None:
        """Put a sparse accessor's own values into those it starts from."""
        indices, own, count = sparse["indices"], sparse["values"], int(sparse["count"])
        kind = np.dtype(_DTYPES[indices["componentType"]])
        at = self._values(indices["bufferView"], int(indices.get("byteOffset", 0)), count, (kind, 1), what)[:, 0]
        if count and at.max() >= len(values):
            raise self.error(f"{what} replaces value {at.max()} of {len(values)}")
        values[at] = self._values(
            own["bufferView"], int(own.get("byteOffset", 0)), count, (dtype, values.shape[1]), what
        )  # fmt: skip
