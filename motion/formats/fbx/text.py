"""FBX as text, of version 7.0 on, into the same nodes as the binary form has."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError, parsing
from muybridge.motion.formats.fbx.container import Node, Property, check_version, read_fbx_nodes

_DEEPEST = 64
_TOKEN = re.compile(
    r'\s+|;[^\n]*|(?P<text>"[^"]*")|(?P<name>[A-Za-z_][\w|-]*)[ \t]*:|(?P<count>\*\d+)|(?P<mark>[{},])'
    r"|(?P<number>[-+]?[\d.][^\s,{}]*)|(?P<word>[A-Za-z][\w]*)|(?P<bad>.)"
)


def is_text(data: bytes) -> bool:
    """Whether a file is FBX as text."""
    return b"FBXHeaderExtension" in data[:4000] and b"\0" not in data[:1000]


def read_fbx_document(path: Path) -> Node:
    """A file's nodes, within one without a name, whether it is binary or text.

    Raises:
        FormatError: no such file, of a version before 2011, damaged.
    """
    with parsing(path, FormatError, "an FBX", "resave_fbx"):
        data = Path(path).read_bytes()
        if not is_text(data):
            return read_fbx_nodes(path)
        top = read_fbx_text(data.decode("utf-8-sig", "replace"))
        stated = [v.properties[0] for h in top.all("FBXHeaderExtension") for v in h.all("FBXVersion") if v.properties]
        check_version(path, stated[0] if stated and isinstance(stated[0], int) else 0)
        return top


def read_fbx_text(text: str) -> Node:
    """The nodes of a file, within one without a name.

    Raises:
        ValueError: it is damaged.
    """
    tokens = _tokens(text)
    top, ended = _children(tokens, 0)
    if ended:
        raise ValueError("a brace closes what was never opened")
    return Node("", (), top)


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    for found in _TOKEN.finditer(text):
        kind = found.lastgroup
        if kind == "bad":
            raise ValueError(f"{found.group()!r} in line {text.count(chr(10), 0, found.start()) + 1}")
        if kind is not None:
            yield kind, found.group(kind)


def _children(tokens: Iterator[tuple[str, str]], depth: int) -> tuple[list[Node], bool]:
    """The nodes up to the brace that closes them, and whether there was one."""
    if depth > _DEEPEST:
        raise ValueError("its nodes are nested too deeply")
    out: list[Node] = []
    values: list[Property] = []
    count: int | None = None
    for kind, token in tokens:
        if kind == "name":
            if out:
                _close(out[-1], values)
            out.append(Node(token))
            values, count = [], None
        elif token == "}":
            if out:
                _close(out[-1], values)
            return out, True
        elif not out:
            raise ValueError(f"{token!r} before any name")
        elif token == "{":
            if count is not None:
                values, count = [_array(tokens, count)], None
            else:
                within, ended = _children(tokens, depth + 1)
                if not ended:
                    raise ValueError(f"{out[-1].name!r} is not closed; is it cut off?")
                out[-1].children = within
        elif kind == "count":
            count = int(token[1:])
        elif kind != "mark":
            values.append(_value(kind, token))
    if out:
        _close(out[-1], values)
    return out, False


def _close(node: Node, values: list[Property]) -> None:
    if node.name == "KeyAttrDataFloat":  # single precision, of which the text has the bits as whole numbers
        values = [v.astype(np.int32).view(np.float32) if isinstance(v, np.ndarray) and v.dtype.kind == "i" else v
                  for v in values]  # fmt: skip
    node.properties = tuple(values)


def _value(kind: str, token: str) -> Property:
    if kind == "text":
        text = token[1:-1].replace("&quot;", '"')
        head, between, name = text.partition("::")
        # Objects are called Model::hips here, and hips with the class behind two marks in binary files.
        return f"{name}\x00\x01{head}" if between and head.isalnum() else text
    if kind == "word":
        return token
    return _number(token)


def _number(token: str) -> int | float:
    return int(token) if token.lstrip("+-").isdigit() else float(token)


def _array(tokens: Iterator[tuple[str, str]], count: int) -> NDArray[np.generic]:
    """The numbers of a list, up to the brace that closes it."""
    words = []
    for kind, token in tokens:
        if token == "}":
            break
        if kind == "number":
            words.append(token)
    if len(words) != count:
        raise ValueError(f"a list of {count} numbers has {len(words)}")
    whole = all(w.lstrip("+-").isdigit() for w in words)
    return np.array([int(w) for w in words], np.int64) if whole else np.array([float(w) for w in words])
