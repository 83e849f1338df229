"""Decoding of EXT_meshopt_compression: attributes, triangles, indices, and the filters over attributes.

Source: Khronos Group, glTF extension EXT_meshopt_compression, appendices A (bitstreams) and B (filters).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray

_GROUP = 16  # elements whose differences are packed together
_BLOCK_BYTES, _LARGEST_BLOCK = 8192, 256
_LARGEST_STRIDE = 256
_TAIL = 32  # bytes at the end, which hold the element before the first
_RATIO = 256  # bytes that a compressed byte can stand for: more is damage


def decode_meshopt(data: bytes, count: int, stride: int, mode: str, filtered: str = "NONE") -> bytes:
    """The uncompressed bytes of a buffer view.

    Args:
        data: the compressed bytes.
        count: of elements.
        stride: bytes of one.
        mode: ATTRIBUTES, TRIANGLES or INDICES.
        filtered: NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL.

    Raises:
        ValueError: the data are damaged, or of another version or mode.
        IndexError: they end too early.
    """
    if count < 0 or count * stride > _RATIO * max(len(data), 1):
        raise ValueError(f"{len(data)} compressed bytes cannot hold {count} elements of {stride} bytes")
    if mode == "ATTRIBUTES":
        return _filtered(_attributes(data, count, stride), filtered).tobytes()
    if mode not in ("TRIANGLES", "INDICES") or stride not in (2, 4):
        raise ValueError(f"the compression mode {mode!r} with {stride} bytes an element is unknown")
    values = _triangles(data, count) if mode == "TRIANGLES" else _indices(data, count)
    return np.array(values, np.int64).astype(np.uint32).astype(f"<u{stride}").tobytes()


def _attributes(data: bytes, count: int, stride: int) -> ByteArray:
    """(N, stride) bytes: each byte of an element is the one before it plus a difference."""
    if data[0] != 0xA0 or stride % 4 or not 0 < stride <= _LARGEST_STRIDE:
        raise ValueError(f"attributes with header {data[0]:#x} and {stride} bytes an element are unknown")
    out = np.zeros((count, stride), np.uint8)
    last = np.frombuffer(data[-stride:], np.uint8)
    block = min(_BLOCK_BYTES // stride // _GROUP * _GROUP, _LARGEST_BLOCK)
    at = 1
    for start in range(0, count, block):
        size = min(block, count - start)
        groups = -(-size // _GROUP)
        for k in range(stride):
            modes = [data[at + g // 4] >> 2 * (g % 4) & 3 for g in range(groups)]
            at += -(-groups // 4)
            differences = np.zeros(groups * _GROUP, np.uint8)
            for g, mode in enumerate(modes):
                if mode:
                    at = _group(data, at, mode, differences[g * _GROUP : (g + 1) * _GROUP])
            turned = (differences >> 1) ^ (-(differences & 1).astype(np.int16)).astype(np.uint8)
            out[start : start + size, k] = (np.cumsum(turned[:size], dtype=np.uint8) + last[k]).astype(np.uint8)
        last = out[start + size - 1]
    if at + max(stride, _TAIL) != len(data):
        raise IndexError("the attributes end elsewhere than their data")
    return out


def _group(data: bytes, at: int, mode: int, out: ByteArray) -> int:
    """Unpack sixteen differences of 2, 4 or 8 bits into `out`; returns where the next ones begin."""
    if mode == 3:
        out[:] = np.frombuffer(data, np.uint8, _GROUP, at)
        return at + _GROUP
    bits = 2 * mode
    packed = np.frombuffer(data, np.uint8, 2 * bits, at)
    shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
    out[:] = (packed[:, None] >> shifts & (2**bits - 1)).ravel()
    at += 2 * bits
    whole = np.flatnonzero(out == 2**bits - 1)  # these follow as bytes of their own
    out[whole] = np.frombuffer(data, np.uint8, len(whole), at)
    return at + len(whole)


class _Stream:
    """Numbers of seven bits a byte, the lowest first."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at, self.last = data, at, 0

    def number(self) -> int:
        value, shift = 0, 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128 or shift > 28:
                return value

    def index(self) -> int:
        """The index that was read last, plus a signed difference."""
        value = self.number()
        self.last = self.last + (value >> 1 ^ -(value & 1)) & 0xFFFFFFFF
        return self.last


class _Triangles:
    """The state of the triangles' code: the last sixteen edges and vertices, and the next new vertex."""

    def __init__(self, data: bytes, count: int) -> None:
        self.table, self.stream = data[-16:], _Stream(data, 1 + count // 3)
        self.edges, self.vertices = [(0, 0)] * 16, [0] * 16
        self.edge_at, self.vertex_at, self.next = 0, 0, 0

    def push_edges(self, *edges: tuple[int, int]) -> None:
        for edge in edges:
            self.edges[self.edge_at & 15] = edge
            self.edge_at += 1

    def push_vertex(self, vertex: int) -> None:
        self.vertices[self.vertex_at & 15] = vertex
        self.vertex_at += 1

    def new(self) -> int:
        self.next += 1
        return self.next - 1

    def beside(self, code: int) -> tuple[int, int, int]:
        """A triangle at one of the last edges."""
        a, b = self.edges[self.edge_at - 1 - (code >> 4) & 15]
        which = code & 15
        if which == 0:
            c = self.new()
        elif which < 13:
            c = self.vertices[self.vertex_at - 1 - which & 15]
        elif which == 15:
            c = self.stream.index()
        else:
            c = self.stream.last = self.stream.last + (-1 if which == 13 else 1)
        if which == 0 or which >= 13:
            self.push_vertex(c)
        self.push_edges((c, b), (a, c))
        return a, b, c

    def apart(self, code: int) -> tuple[int, int, int]:
        """A triangle that shares no edge with the last ones."""
        if code < 0xFE:
            which = (0, *divmod(self.table[code & 15], 16))
        else:
            byte = self.stream.data[self.stream.at]
            self.stream.at += 1
            which = (0 if code == 0xFE else 15, *divmod(byte, 16))
            if byte == 0:
                self.next = 0
        at = self.vertex_at  # new and known vertices are taken before any of them is pushed
        corners = [self.new() if w == 0 else self.vertices[at - w & 15] for w in which]
        corners = [self.stream.index() if w == 15 else c for w, c in zip(which, corners, strict=True)]
        a, b, c = corners
        for k, w in enumerate(which):
            if k == 0 or w in (0, 15):
                self.push_vertex(corners[k])
        self.push_edges((b, a), (c, b), (a, c))
        return a, b, c


def _triangles(data: bytes, count: int) -> list[int]:
    if data[0] != 0xE1 or count % 3:
        raise ValueError(f"triangles with header {data[0]:#x} and {count} indices are unknown")
    state = _Triangles(data, count)
    out: list[int] = []
    for code in data[1 : 1 + count // 3]:
        out += state.beside(code) if code < 0xF0 else state.apart(code)
    if state.stream.at != len(data) - 16:
        raise IndexError("the triangles end elsewhere than their data")
    return out


def _indices(data: bytes, count: int) -> list[int]:
    if data[0] != 0xD1:
        raise ValueError(f"indices with header {data[0]:#x} are unknown")
    stream, last, out = _Stream(data, 1), [0, 0], []
    for _ in range(count):
        value = stream.number()
        which, value = value & 1, value >> 1
        last[which] = last[which] + (value >> 1 ^ -(value & 1)) & 0xFFFFFFFF
        out.append(last[which])
    if stream.at != len(data) - 4:
        raise IndexError("the indices end elsewhere than their data")
    return out


def _filtered(data: ByteArray, name: str) -> NDArray[Any]:
    stride = data.shape[1]
    if name == "NONE":
        return data
    if name == "OCTAHEDRAL" and stride in (4, 8):
        return _octahedral(data.view("<i1" if stride == 4 else "<i2"))
    if name == "QUATERNION" and stride == 8:
        return _quaternion(data.view("<i2"))
    if name == "EXPONENTIAL":
        whole = data.view("<i4")
        mantissa = whole << 8 >> 8
        return np.asarray(np.ldexp(mantissa.astype(np.float64), whole >> 24), "<f4")
    raise ValueError(f"the filter {name!r} of elements of {stride} bytes is unknown")


def _octahedral(packed: NDArray[Any]) -> NDArray[Any]:
    """Unit vectors from their places on an unfolded octahedron."""
    most = np.iinfo(packed.dtype).max
    x, y, one = packed[:, :3].astype(np.float64).T
    z = one - np.abs(x) - np.abs(y)
    back = np.minimum(z, 0.0)
    x, y = x + np.where(x >= 0, back, -back), y + np.where(y >= 0, back, -back)
    vectors = np.stack([x, y, z], axis=1)
    length = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
    out = packed.copy()
    out[:, :3] = _rounded(vectors / length * most).astype(packed.dtype)
    return out


def _quaternion(packed: NDArray[Any]) -> NDArray[Any]:
    """Unit quaternions xyzw from three components, the fourth being the largest."""
    scale = np.sqrt(0.5) / (packed[:, 3] | 3)
    three = packed[:, :3] * scale[:, None]
    largest = np.sqrt(np.maximum(1.0 - (three**2).sum(axis=1), 0.0))
    values = _rounded(np.concatenate([largest[:, None], three], axis=1) * 32767)
    places = (packed[:, 3:] & 3).astype(np.int64) + np.arange(4) & 3
    out = np.zeros_like(packed)
    np.put_along_axis(out, places, values.astype("<i2"), axis=1)
    return out


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """To the nearest whole number, halves away from zero."""
    return np.asarray(np.trunc(values + np.copysign(0.5, values)))
