"""Network files without the outputs that nobody asked for: onnxruntime works out all that a file promises, wanted or
not, and what packages there are to change files come with training.

A file is one Protocol Buffers message, of which only the few fields on the way to the outputs are read here:
https://protobuf.dev/programming-guides/encoding/ and https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from collections.abc import Collection, Iterator
from typing import NamedTuple

# Numbers of the fields: of the model, of its graph, of one of its nodes, of one of its outputs.
_GRAPH = 7
_NODE, _OUTPUT = 1, 12
_NODE_INPUT, _NODE_OUTPUT = 1, 2
_NAME = 1
# How a field's end is found.
_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5


class _Field(NamedTuple):
    number: int
    whole: memoryview  # with its number and length
    content: memoryview


def without_outputs(model: bytes, names: Collection[str]) -> bytes:
    """An ONNX file without some of its outputs and the nodes that make them.

    Args:
        model: the file.
        names: of the outputs; what the file has not, or what other nodes need too, is passed over.

    Raises:
        ValueError: not such a file.
    """
    fields = list(_fields(memoryview(model)))
    parts = [_graph_without(field, names) if field.number == _GRAPH else field.whole for field in fields]
    return b"".join(parts)


def _graph_without(graph: _Field, names: Collection[str]) -> bytes:
    fields = list(_fields(graph.content))
    nodes = [field for field in fields if field.number == _NODE]
    gone = set(names) - {name for node in nodes for name in _texts(node, _NODE_INPUT)}

    def kept(field: _Field) -> bool:
        if field.number == _NODE:
            made = _texts(field, _NODE_OUTPUT)
            return not made or not gone.issuperset(made)
        return field.number != _OUTPUT or gone.isdisjoint(_texts(field, _NAME))

    content = b"".join(field.whole for field in fields if kept(field))
    return _varint(_GRAPH << 3 | _LENGTH) + _varint(len(content)) + content


def _texts(message: _Field, number: int) -> list[str]:
    """The texts of one of a message's fields."""
    return [bytes(field.content).decode() for field in _fields(message.content) if field.number == number]


def _fields(message: memoryview) -> Iterator[_Field]:
    """A message's fields; ValueError where it is none."""
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
    """A whole number, seven bits a byte, the lowest first, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            break
        byte, at = message[at], at + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("number beyond its message's end")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out + bytes([value]))
