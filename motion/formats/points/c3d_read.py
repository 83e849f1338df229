"""The bytes of a C3D file, read without trust: header, parameters, points, analog samples.

A reader of our own, in a page of numpy: the library that writes our C3D files ends the process or asks for all
memory on a few damaged files in a hundred. Both are compared in the tests.

Source: Motion Lab Systems, The C3D File Format User Guide (2008). All three byte orders are read.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import FormatError, parsing

Parameters = dict[str, dict[str, Any]]

_BLOCK = 512
_INTEL, _DEC, _MIPS = 84, 85, 86
_EVENT_LABELS = 12345
LAST_COUNTED = 65535  # the last frame that the header can name


@dataclass(frozen=True, eq=False)
class RawC3D:
    """The contents of the file, in its own units and axes.

    Attributes:
        parameters: by group and name, upper case: strings as list of str, numbers as array in the file's shape
            (the first index runs fastest in the file).
        points: (T, N, 3).
        residuals: (T, N), negative where a point is missing.
        analog: (T * K, M) scaled samples.
        analog_per_frame: K.
        fps: points per second by the header.
        first_frame: number of the first frame, from 1.
        header_events: label and seconds, where the old way of writing them was used.
        notices: contradictions in the file and what was made of them, one sentence each.
    """

    parameters: Parameters
    points: FloatArray
    residuals: FloatArray
    analog: FloatArray
    analog_per_frame: int
    fps: float
    first_frame: int
    header_events: tuple[tuple[str, float], ...]
    notices: tuple[str, ...] = ()

    def numbers(self, group: str, name: str) -> FloatArray:
        """A parameter as a flat array; empty where it is not there or is text."""
        value = self.parameters.get(group, {}).get(name)
        return np.asarray(value, dtype=np.float64).ravel() if isinstance(value, np.ndarray) else np.zeros(0)

    def texts(self, group: str, name: str) -> list[str]:
        """A parameter as strings, and its continuations (LABELS2, ...); empty where it is not there."""
        held = self.parameters.get(group, {})
        out: list[str] = []
        for key in (name, *(f"{name}{k}" for k in range(2, 259))):
            value = held.get(key)
            if not isinstance(value, list):
                break
            out += value
        return out


def read_raw_c3d(path: Path) -> RawC3D:
    """Read the whole file.

    Raises:
        FormatError: it is not a C3D, is cut off, or contradicts itself.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: no such file, or it cannot be read ({error.strerror}); give a C3D file") from error
    with parsing(path, FormatError, "a C3D"):
        return _Reader(path, data).read()


class _Reader:
    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data = path, data
        self.notices: list[str] = []
        if len(data) < 2 * _BLOCK or data[1] != 0x50:
            raise self.error("does not begin as a C3D file does, or is shorter than one can be")
        self.section = (data[0] - 1) * _BLOCK
        if self.section < _BLOCK or self.section + 4 > len(data):
            raise self.error(f"its parameters are stated to begin in block {data[0]}, which is not in the file")
        processor = data[self.section + 3]
        if processor not in (_INTEL, _DEC, _MIPS):
            raise self.error(f"is of processor type {processor}; known are 84 (Intel), 85 (DEC), 86 (MIPS)")
        self.order = ">" if processor == _MIPS else "<"
        self.dec = processor == _DEC

    def error(self, problem: str) -> FormatError:
        return FormatError(f"{self.path}: is not a readable C3D: {problem}; export it again")

    def words(self, at: int, count: int, kind: str) -> NDArray[Any]:
        """`count` numbers at byte `at`; kind is a numpy type without its byte order."""
        size = np.dtype(kind).itemsize
        if at < 0 or count < 0 or at + count * size > len(self.data):
            raise self.error(f"it ends at byte {len(self.data)}, before {at + count * size}: is it cut off?")
        if kind == "f4" and self.dec:
            halves = np.frombuffer(self.data, "<u2", 2 * count, at).reshape(-1, 2)
            flipped = np.ascontiguousarray(halves[:, ::-1]).view("<f4").ravel()
            return np.asarray(flipped / 4.0)
        return np.frombuffer(self.data, self.order + kind, count, at)

    def read(self) -> RawC3D:
        header = self.words(0, 10, "u2").astype(int)
        scale, rate = (float(self.words(at, 1, "f4")[0]) for at in (12, 20))
        start = (int(header[8]) - 1) * _BLOCK
        # The pointer of some files' last parameter leads beyond the section, into the data.
        parameters = self.parameters(start if start > self.section else len(self.data))
        point, analog = parameters.get("POINT", {}), parameters.get("ANALOG", {})
        count, per_frame = int(header[1]), int(header[9])
        used = _first(point, "USED", count)
        if int(used) % 65536 != count:
            raise self.error(f"its header has {count} points, POINT:USED {used:g}")
        channels = int(header[2]) // per_frame if per_frame else 0
        if per_frame and header[2] % per_frame:
            raise self.error(f"{header[2]} analog values per frame are no multiple of {per_frame} samples per channel")
        if not (np.isfinite(scale) and scale != 0):
            raise self.error(f"its scale is {scale}")
        kind = "f4" if scale < 0 else "i2"
        width = 4 * count + channels * per_frame
        if start < self.section:
            raise self.error(f"its data are stated to begin in block {header[8]}")
        frames, first = self.frames(header, parameters, start, width * np.dtype(kind).itemsize)
        raw = self.words(start, frames * width, kind).reshape(frames, width)
        fourth = raw[:, : 4 * count].reshape(frames, count, 4)
        points = fourth[..., :3].astype(np.float64) * (1.0 if scale < 0 else scale)
        fourth_word = np.nan_to_num(fourth[..., 3].astype(np.float64), nan=-1.0, posinf=-1.0, neginf=-1.0)
        quality: IntArray = np.clip(fourth_word, -1, 32767).astype(np.int64)
        residuals = np.where(quality < 0, -1.0, np.bitwise_and(quality, 0xFF) * abs(scale))
        samples = raw[:, 4 * count :].reshape(frames * per_frame, channels)
        unsigned = [t.upper() for t in _texts(analog, "FORMAT")][:1] == ["UNSIGNED"]
        if unsigned and kind == "i2":
            samples = samples.view(samples.dtype.str.replace("i", "u"))
        return RawC3D(
            parameters, points, residuals, self.scaled(samples, analog, unsigned), per_frame,
            _first(point, "RATE", rate) or rate, max(first, 1), self.header_events(), tuple(self.notices),
        )  # fmt: skip

    def scaled(self, samples: NDArray[Any], analog: dict[str, Any], unsigned: bool) -> FloatArray:
        channels = samples.shape[1]
        scale, offset = np.ones(channels), np.zeros(channels)
        for out, key in ((scale, "SCALE"), (offset, "OFFSET")):
            given = analog.get(key)
            if isinstance(given, np.ndarray):
                flat = given.ravel()[:channels]
                out[: len(flat)] = flat
        if unsigned:  # the 16 bits of an offset are, too
            offset = np.where((offset < 0) & (offset >= -32768), offset + 65536, offset)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray((samples.astype(np.float64) - offset) * scale * _first(analog, "GEN_SCALE", 1.0))

    def frames(self, header: NDArray[Any], parameters: Parameters, start: int, size: int) -> tuple[int, int]:
        """How many frames, of `size` bytes each, and the number of the first; 65,535 is as far as the header counts."""
        first, last = int(header[3]), int(header[4])
        trial, point = parameters.get("TRIAL", {}), parameters.get("POINT", {})
        ends = [trial.get(k) for k in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD")]
        if all(isinstance(e, np.ndarray) and e.size == 2 for e in ends):
            low_high = [e.ravel().astype(np.int64) % 65536 for e in ends if e is not None]
            real_first, real_last = (int(e[0] + 65536 * e[1]) for e in low_high)
            fits = start + (real_last - real_first + 1) * size <= len(self.data)
            if real_first % 65536 == first and real_last >= last and fits:
                return real_last - real_first + 1, real_first
        count = last - first + 1
        if count < 1 and not (first, last) == (1, 0) and not (first, last) == (0, 0):
            raise self.error(f"its frames go from {first} to {last}")
        long = max(_first(point, key, 0) for key in ("LONG_FRAMES", "FRAMES"))
        stated = int(_first(point, "FRAMES", 0)) % 65536
        if last == LAST_COUNTED and long > LAST_COUNTED:
            count = int(long)
        elif last == LAST_COUNTED and stated in (0, LAST_COUNTED):
            count = self.frames_there(count, start, size)
        elif last != LAST_COUNTED and stated not in (0, LAST_COUNTED, max(count, 0)):
            there = self.frames_of_two(count, stated, start, size)
            self.notices.append(f"its header has {count} frames, POINT:FRAMES {stated}: {there} were read")
            count = there
        if first < 1:
            self.notices.append("its frames are numbered from 0; the first was read as frame 1")
        return max(count, 0), first

    def frames_of_two(self, a: int, b: int, start: int, size: int) -> int:
        """Which of two counts of frames the data have: the larger one that is there and is not filled up with zeros."""
        less, more = sorted((a, b))
        if less < 0 or start + less * size > len(self.data):
            raise self.error(f"its header has {a} frames, POINT:FRAMES {b}, and the file ends before")
        if start + more * size > len(self.data):
            return less
        rest = np.frombuffer(self.data, np.uint8, (more - less) * size, start + less * size)
        return more if rest.any() else less

    def frames_there(self, count: int, start: int, size: int) -> int:
        """The file's frames where what counts them has come to its end; zeros behind `count` fill up the last block."""
        if not size:
            return count
        rest = np.frombuffer(self.data, np.uint8, offset=min(start + count * size, len(self.data)))
        rest = rest[: len(rest) // size * size].reshape(-1, size)
        return count + int(np.nonzero(rest.any(axis=1))[0].max(initial=-1)) + 1

    def parameters(self, end: int) -> Parameters:
        """All groups before byte `end`; a group's name may follow its parameters."""
        names: dict[int, str] = {}
        found: list[tuple[int, str, Any]] = []
        at = self.section + 4
        while at + 2 <= min(end, len(self.data)):
            length, group = struct.unpack_from("bb", self.data, at)
            if length == 0 or group == 0:
                break
            length = abs(length)
            name = self.text(at + 2, length).upper()
            at += 2 + length
            step = int(self.words(at, 1, "i2")[0])
            if step < 0:
                raise self.error(f"its parameter {name} leads back")
            if group < 0:
                names[-group] = name
            else:
                found.append((group, name, self.value(at + 2, name)))
            if step == 0:
                break
            at += step
        out: Parameters = {}
        for group, name, value in found:
            out.setdefault(names.get(group, str(group)), {})[name] = value
        return out

    def value(self, at: int, name: str) -> Any:
        kind, dimensions = struct.unpack_from("bB", self.data, at)
        if kind not in (-1, 1, 2, 4) or dimensions > 7:
            raise self.error(f"its parameter {name[:20]!a} is of type {kind} with {dimensions} dimensions")
        shape = [int(n) for n in self.words(at + 2, dimensions, "u1")]
        at += 2 + dimensions
        size = int(np.prod(shape, dtype=np.int64)) if shape else 1
        if size > len(self.data):
            raise self.error(f"its parameter {name} is larger than the file")
        if kind == -1:
            width = shape[0] if shape else 1
            count = int(np.prod(shape[1:], dtype=np.int64))
            if count > len(self.data):
                raise self.error(f"its parameter {name} is larger than the file")
            text = [self.text(at + k * width, width) for k in range(count)]
            return [t.strip() for t in text]
        numbers = self.words(at, size, {1: "i1", 2: "i2", 4: "f4"}[kind])
        return numbers.astype(np.float64).reshape(shape, order="F")

    def text(self, at: int, length: int) -> str:
        if at + length > len(self.data):
            raise self.error("it ends within a name: is it cut off?")
        raw = self.data[at : at + length]
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
        text = text.rstrip("\0 ")
        return "".join(c if c.isprintable() else "?" for c in text)

    def header_events(self) -> tuple[tuple[str, float], ...]:
        """Up to 18 events of four letters each, in the header itself."""
        key, count = (int(v) for v in self.words(296, 2, "u2"))
        if key != _EVENT_LABELS or not 0 < count <= 18:
            return ()
        seconds = self.words(304, count, "f4")
        labels = [self.text(396 + 4 * k, 4).strip() for k in range(count)]
        return tuple((label, float(s)) for label, s in zip(labels, seconds, strict=True) if np.isfinite(s))


def _texts(group: dict[str, Any], name: str) -> list[str]:
    value = group.get(name)
    return value if isinstance(value, list) else []


def _first(group: dict[str, Any], name: str, default: float) -> float:
    """A parameter's first number."""
    value = group.get(name)
    if not isinstance(value, np.ndarray) or not value.size or not np.isfinite(value.flat[0]):
        return default
    return float(value.flat[0])
