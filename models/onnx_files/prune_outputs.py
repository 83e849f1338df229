"""Remove unused outputs from network files: onnxruntime computes every output of a file, whether it is requested or
not, and the packages that can edit files come only with the `train` extra.

A file is one Protocol Buffers message, of which only the few fields on the way to the outputs are parsed here:
https://protobuf.dev/programming-guides/encoding/ and https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from collections.abc import Collection, Iterator
from typing import NamedTuple

# Field numbers: of the model, of its graph, of a node, of an output.
_GRAPH = 7
_NODE, _OUTPUT = 1, 12
_NODE_INPUT, _NODE_OUTPUT = 1, 2
_NAME = 1
# Wire types, which tell the length of a field.
_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5


class _Field(NamedTuple):
    number: int
    whole: memoryview  # including its number and length
    content: memoryview


def without_outputs(model: bytes, names: Collection[str]) -> bytes:
    """An ONNX file without some of its outputs and the nodes that compute them.

    Args:
        model: content of the file.
        names: of the outputs; names that the file does not have, or that other nodes need, are ignored.

    Raises:
        ValueError: not an ONNX file.
    """
    fields = list(_fields(memoryview(model)))
    parts = [_graph_without(field, names) if field.number == _GRAPH else field.whole for field in fields]
    return b"".join(parts)


def _graph_without(graph: _Field, names: Collection[str]) -> bytes:
    fields = list(_fields(graph.content))
    nodes = [field for field in fields if field.number == _NODE]
    removed = set(names) - {name for node in nodes for name in _strings(node, _NODE_INPUT)}

    def is_kept(field: _Field) -> bool:
        if field.number == _NODE:
            outputs = _strings(field, _NODE_OUTPUT)
            return not outputs or not removed.issuperset(outputs)
        return field.number != _OUTPUT or removed.isdisjoint(_strings(field, _NAME))

    content = b"".join(field.whole for field in fields if is_kept(field))
    return _write_varint(_GRAPH << 3 | _LENGTH) + _write_varint(len(content)) + content


def _strings(message: _Field, number: int) -> list[str]:
    """The strings of one of a message's fields."""
    return [bytes(field.content).decode() for field in _fields(message.content) if field.number == number]


def _fields(message: memoryview) -> Iterator[_Field]:
    """A message's fields; ValueError if it is not one."""
    at = 0
    while at < len(message):
        start = at
        key, at = _read_varint(message, at)
        kind, content = key & 7, at
        if kind == _VARINT:
            _, at = _read_varint(message, at)
        elif kind == _LENGTH:
            length, content = _read_varint(message, at)
            at = content + length
        elif kind in (_FIXED64, _FIXED32):
            at += 8 if kind == _FIXED64 else 4
        else:
            raise ValueError(f"field of unknown kind {kind}")
        if at > len(message):
            raise ValueError("field beyond its message's end")
        yield _Field(key >> 3, message[start:at], message[content:at])


def _read_varint(message: memoryview, at: int) -> tuple[int, int]:
    """A whole number, seven bits per byte, lowest first, and the position after it."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            break
        byte, at = message[at], at + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("number beyond its message's end")


def _write_varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out + bytes([value]))
