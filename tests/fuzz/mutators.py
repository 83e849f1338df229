"""Damage to files: seeded, of every kind that transfers, editors, other programs and strangers do."""

import io
import re
import struct
import zipfile
from collections.abc import Callable
from typing import Literal

import numpy as np

Kind = Literal["text", "binary", "zip", "glb"]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_ODD_NUMBERS = (
    b"nan", b"-nan", b"inf", b"-1", b"0", b"1e999", b"1e300", b"-1e18", b"99999999999999999999999999", b"2147483648",
    b"1e-320", b"0x10", b"1_0", b"1,5", b"", b"x", b"9" * 5000, b"1e12", b"true",
)  # fmt: skip
_ODD_WORDS = struct.pack("<8i", 0, -1, 2**31 - 1, -(2**31), 1, 255, 65535, 2**24)
_ODD_FLOATS = struct.pack("<6f", np.nan, np.inf, 1e30, -1e18, 1e-40, -0.0)
_DEEP = 3000
_NESTS = ((b"[", b"]"), (b"{", b"}"), (b"(", b")"), (b"<a>", b"</a>"), (b'{"a":', b"}"), (b"x=[", b"]"), (b"- ", b""))

Mutator = Callable[[bytearray, np.random.Generator], bytearray]


def _place(data: bytearray, rng: np.random.Generator, longest: int = 60) -> tuple[int, int]:
    """A piece's begin and end."""
    at = int(rng.integers(len(data)))
    return at, at + int(rng.integers(1, 1 + min(longest, len(data) - at)))


def flip_bits(data: bytearray, rng: np.random.Generator) -> bytearray:
    """One to eight bits."""
    for _ in range(int(rng.integers(1, 9))):
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return data


def cut_off(data: bytearray, rng: np.random.Generator) -> bytearray:
    """The end is missing."""
    return data[: int(rng.integers(len(data)))]


def delete_piece(data: bytearray, rng: np.random.Generator) -> bytearray:
    """A piece is missing."""
    begin, end = _place(data, rng)
    del data[begin:end]
    return data


def double_piece(data: bytearray, rng: np.random.Generator) -> bytearray:
    """A piece is there twice, or many times."""
    begin, end = _place(data, rng)
    data[begin:begin] = data[begin:end] * int(rng.choice([1, 2, 50]))
    return data


def swap_pieces(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Two pieces have changed places."""
    (a, b), (c, d) = sorted([_place(data, rng), _place(data, rng)])
    if b > c:
        return data[::-1] if rng.random() < 0.05 else data[c:] + data[:c]
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def shuffle_lines(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Lines in another order, one deleted, one doubled."""
    lines = bytes(data).split(b"\n")
    some = rng.permutation(len(lines))[: int(rng.integers(2, 6))]
    for a, b in zip(some, rng.permutation(some), strict=True):
        lines[a], lines[b] = lines[b], lines[a]
    k = int(rng.integers(len(lines)))
    if rng.random() < 0.5:
        lines[k:k] = [lines[k]] * int(rng.choice([1, 30]))
    else:
        del lines[k]
    return bytearray(b"\n".join(lines))


def odd_number(data: bytearray, rng: np.random.Generator) -> bytearray:
    """One to three numbers of a text become huge, tiny, negative, endless or nothing."""
    for _ in range(int(rng.integers(1, 4))):
        found = list(_NUMBER.finditer(data))
        if not found:
            break
        where = found[int(rng.integers(len(found)))]
        data[where.start() : where.end()] = _ODD_NUMBERS[int(rng.integers(len(_ODD_NUMBERS)))]
    return data


def odd_word(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Four bytes of a binary file become an extreme integer or float."""
    from_ = _ODD_WORDS if rng.random() < 0.6 else _ODD_FLOATS
    k, at = 4 * int(rng.integers(len(from_) // 4)), int(rng.integers(len(data)))
    data[at : at + 4] = from_[k : k + 4]
    return data


def nest_deeply(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Thousands of brackets, closed or not."""
    begin, end = _NESTS[int(rng.integers(len(_NESTS)))]
    closed = end * _DEEP if rng.random() < 0.5 else b""
    at = int(rng.integers(len(data)))
    if rng.random() < 0.5:  # where a value may stand
        found = list(_NUMBER.finditer(data))
        at = found[int(rng.integers(len(found)))].start() if found else at
    data[at:at] = begin * _DEEP + closed
    return data


def other_encoding(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Another encoding, other line ends, bytes that no text has."""
    text = bytes(data).decode("utf-8", "replace")
    kind = int(rng.integers(7))
    if kind < 3:
        return bytearray(text.encode(("utf-16", "utf-8-sig", "utf-32")[kind], "replace"))
    if kind == 3:
        return bytearray(text.replace("\n", "\r").encode())
    if kind == 4:
        return bytearray(text.replace(".", ",").encode())
    at = int(rng.integers(len(data)))
    data[at:at] = (b"\xff\xfe\xe9", b"\0" * 40)[kind - 5]
    return data


_TEXT: tuple[Mutator, ...] = (
    flip_bits, cut_off, delete_piece, double_piece, swap_pieces, shuffle_lines, odd_number, odd_number, odd_number,
    nest_deeply, other_encoding,
)  # fmt: skip
_BINARY: tuple[Mutator, ...] = (flip_bits, cut_off, delete_piece, double_piece, swap_pieces, odd_word, odd_word)


def mutated(data: bytes, rng: np.random.Generator, kind: Kind) -> bytes:
    """The data with one to three damages of its kind; of containers mostly inside, with lengths and sums that fit."""
    if not data:
        return data
    if kind == "zip" and rng.random() < 0.7:
        return _inside_zip(data, rng)
    if kind == "glb" and rng.random() < 0.7:
        return _inside_glb(data, rng)
    choices, out = _TEXT if kind == "text" else _BINARY, bytearray(data)
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        if out:
            out = choices[int(rng.integers(len(choices)))](out, rng)
    return bytes(out)


def _inside_zip(data: bytes, rng: np.random.Generator) -> bytes:
    """An entry damaged, renamed, left out or doubled, in a valid archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = [(i.filename, archive.read(i)) for i in archive.infolist()]
    k, what = int(rng.integers(len(entries))), int(rng.integers(8))
    name, content = entries[k]
    if what < 5:
        head = content[: min(len(content), 128)]  # the header of an array, where most of the meaning is
        entries[k] = name, mutated(head, rng, "text" if what < 3 else "binary") + content[len(head) :]
    elif what == 5:
        entries[k] = (
            mutated(name.encode(), rng, "text")[:200].decode("utf-8", "replace").replace("\0", "") or "x",
            content,
        )
    elif what == 6:
        del entries[k]
    else:
        entries[k] = name, entries[int(rng.integers(len(entries)))][1]
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in dict(entries).items():
            archive.writestr(name, content)
    return out.getvalue()


def _inside_glb(data: bytes, rng: np.random.Generator) -> bytes:
    """The JSON or the numbers of a GLB damaged, with lengths that fit."""
    (size,) = struct.unpack_from("<I", data, 12)
    text, rest = data[20 : 20 + size], data[28 + size :]
    if rng.random() < 0.75:
        text = mutated(text, rng, "text")
    else:
        rest = mutated(rest, rng, "binary")
    text, rest = text + b" " * (-len(text) % 4), rest + b"\0" * (-len(rest) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(rest), b"BIN\0") + rest
