"""The text of a BVH: its hierarchy and the numbers of its frames, as they stand in the file."""

from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.formats.points.world import unique_names

AXES = "xyz"
_PRECISE = 0.02  # share of a frame's time that its text may deviate by for the rate to be recognised
# Frame times beyond the first are of no motion, and within the second are milliseconds.
_LONGEST_S, _MILLISECONDS = 2.0, (4.0, 1000.0)


@dataclass
class BvhJoint:
    """A joint as the file has it.

    Attributes:
        name: different from all others.
        parent: its number, -1 of a root.
        line: of the file.
        offset, tip: (3,) in the file's unit and axes.
        channels: in small letters.
    """

    name: str
    parent: int
    line: int
    offset: FloatArray | None = None
    tip: FloatArray | None = None
    channels: tuple[str, ...] | None = None


class BvhWords:
    """The words of a file with their line numbers; every error names file and line."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.size = len(text)
        self.notices: list[str] = []
        self._words = ((number, word) for number, line in enumerate(text.split("\n"), 1) for word in line.split())
        self._ahead: tuple[int, str] | None = None
        self.line = 1

    def next(self, wanted: str) -> str:
        word, self._ahead = self._ahead or next(self._words, None), None
        if word is None:
            raise FormatError(f"{self.path}: ends after line {self.line}, where {wanted} must follow; is it cut off?")
        self.line = word[0]
        return word[1]

    def more(self) -> bool:
        """Whether another word follows."""
        self._ahead = self._ahead or next(self._words, None)
        return self._ahead is not None

    def notice(self, sentence: str) -> None:
        """Remember what was assumed."""
        self.notices.append(f"{self.path.name}: {sentence}")

    def bad(self, found: str, wanted: str) -> FormatError:
        return FormatError(
            f"{self.path}: line {self.line}: {found!r} found where {wanted} is expected; correct or re-export the file"
        )

    def expect(self, *words: str) -> str:
        found = self.next(" or ".join(words))
        if found.lower() not in [w.lower() for w in words]:
            raise self.bad(found, " or ".join(words))
        return found.lower()

    def number(self, wanted: str) -> float:
        return self.value(self.next(wanted), wanted)

    def value(self, found: str, wanted: str) -> float:
        try:
            value = float(found)
        except ValueError:
            value = np.nan
        if not abs(value) < 1e12:
            raise self.bad(found, wanted)
        return value

    def count(self, wanted: str) -> int:
        value = self.number(wanted)
        if value < 0 or value != int(value):
            raise self.bad(f"{value:g}", wanted)
        return int(value)

    def vector(self) -> FloatArray:
        return np.array([self.number("an offset's number") for _ in range(3)])


def read_joints(words: BvhWords, joints: list[BvhJoint]) -> None:
    """The hierarchy, after the word ROOT to the brace that closes it; not recursive, so depth is no
    risk."""
    open_joints: list[int] = []
    while True:
        name = words.next("a joint's name")
        line = words.line
        after = words.next("{")
        while after != "{":  # names with spaces
            if words.line != line or after == "}":
                raise words.bad(after, "{")
            name, after = f"{name}_{after}", words.next("{")
        joints.append(BvhJoint(name, open_joints[-1] if open_joints else -1, line))
        open_joints.append(len(joints) - 1)
        while True:
            joint = joints[open_joints[-1]]
            word = words.expect("OFFSET", "CHANNELS", "JOINT", "End", "}")
            if word == "joint":
                break
            if word == "offset":
                joint.offset = words.vector()
            elif word == "channels":
                joint.channels = _read_channels(words)
            elif word == "end":
                joint.tip = _read_end_site(words)
            else:
                if joint.offset is None:
                    raise FormatError(
                        f"{words.path}: line {joint.line}: the joint {joint.name!r} has no OFFSET; add one"
                    )
                open_joints.pop()
                if not open_joints:
                    return


def _read_channels(words: BvhWords) -> tuple[str, ...]:
    count = words.count("the number of channels")
    valid = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in AXES]
    channels = tuple(words.expect(*valid) for _ in range(min(count, 7)))
    if count > 6 or len(set(channels)) != count:
        raise words.bad(f"{count} channels", "at most six different ones")
    return channels


def _read_end_site(words: BvhWords) -> FloatArray:
    words.expect("Site")
    while words.next("{") != "{":  # some give the end site a name
        pass
    words.expect("OFFSET")
    tip = words.vector()
    words.expect("}")
    return tip


def read_values(words: BvhWords, channels: int) -> tuple[FloatArray, float]:
    """(T, channels) and frames per second, after the word MOTION."""
    words.expect("Frames:")
    frames = words.count("the number of frames")
    words.expect("Frame")
    words.expect("Time:")
    text = words.next("the seconds of a frame")
    seconds = words.value(text, "the seconds of a frame")
    if seconds <= 0:
        raise words.bad(f"{seconds:g}", "a frame time above zero")
    if frames * max(channels, 1) > words.size:
        raise FormatError(
            f"{words.path}: announces {frames} frames of {channels} numbers, more than it can hold; is it cut off?"
        )
    if seconds > _LONGEST_S and _MILLISECONDS[0] <= seconds <= _MILLISECONDS[1]:
        words.notice(f"its frame time, {text}, is taken to be milliseconds")
        text, seconds = str(Decimal(text) / 1000), seconds / 1000
    rows: list[FloatArray] = []
    # Some programs count the rest pose, others leave it out: one frame more or less is no damage.
    while channels and words.more() and len(rows) <= frames:
        rows.append(_read_row(words, channels, len(rows) + 1))
    if channels and len(rows) < max(frames - 1, 1) and frames:
        words.next(f"frame {len(rows) + 1} of {frames}")
    if words.more():
        words.next("")
        raise FormatError(
            f"{words.path}: line {words.line}: more follows the {frames} frames that the file announces; correct "
            "Frames:"
        )
    if channels and len(rows) != frames:
        words.notice(f"it announces {frames} frames and has {len(rows)}, which were read")
    values = np.array(rows).reshape(-1, channels) if channels else np.empty((frames, 0))
    return values, _rate(text, seconds)


def _read_row(words: BvhWords, channels: int, frame: int) -> FloatArray:
    row, begun = np.empty(channels), 0
    for c in range(channels):
        row[c] = words.number(f"number {c + 1} of {channels} of frame {frame}")
        begun = begun or words.line
        if words.line != begun:
            raise FormatError(
                f"{words.path}: line {begun} has {c} numbers, but the {channels} channels need as many; "
                "correct the line"
            )
    return row


def _rate(text: str, seconds: float) -> float:
    """Frames per second: a whole number where the text is its rounded or truncated reciprocal."""
    fps = 1 / seconds
    whole, last = float(max(round(fps), 1)), Decimal(text).as_tuple().exponent
    decimals = -last if isinstance(last, int) else 0
    ulp = 10.0**-decimals
    rounded = ulp < 2 * _PRECISE * seconds and -ulp < seconds - 1 / whole <= 0.5 * ulp
    return whole if rounded or abs(fps - whole) < 2e-5 * fps else fps


def offset_of(joint: BvhJoint) -> FloatArray:
    """(3,) its OFFSET, which every joint that was read has."""
    assert joint.offset is not None
    return joint.offset


def name_apart(words: BvhWords, joints: list[BvhJoint]) -> None:
    """Give joints of one name different ones: `Hand`, `Hand_2`."""
    names, said = unique_names([joint.name for joint in joints])
    for joint, name in zip(joints, names, strict=True):
        joint.name = name
    for sentence in said:
        words.notice(sentence)
