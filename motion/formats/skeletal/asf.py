"""ASF, the skeleton of Acclaim's pair of files; `amc` has the motion."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD

INCH = 0.0254


LENGTH = 0.45


_CHANNELS = ("tx", "ty", "tz", "rx", "ry", "rz", "l")


_SHORTEST_M = 0.01


@dataclass
class Bone:
    name: str
    line: int
    direction: FloatArray = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    length: float = 0.0
    axes: Rotation = field(default_factory=Rotation.identity)
    channels: tuple[str, ...] = ()
    parent: str | None = None


@dataclass
class Asf:
    metres: float = INCH / LENGTH
    degrees: bool = True
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    orientation: Rotation = field(default_factory=Rotation.identity)
    bones: dict[str, Bone] = field(default_factory=dict)


class Lines:
    """The lines of a file that are not empty, with their numbers; every error names file and line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\r", "\n")
        lines = ((n, line.split("#")[0].split()) for n, line in enumerate(text.split("\n"), start=1))
        self._lines: Iterator[tuple[int, list[str]]] = ((n, words) for n, words in lines if words)
        self._kept: list[tuple[int, list[str]]] = []
        self.number = 1

    def next(self) -> list[str] | None:
        """The words of the next line; None at the end."""
        found = self._kept.pop() if self._kept else next(self._lines, None)
        if found is None:
            return None
        self.number = found[0]
        return found[1]

    def back(self, words: list[str]) -> None:
        """Return a line, so that it is read again."""
        self._kept.append((self.number, words))

    def error(self, problem: str) -> FormatError:
        return FormatError(f"{self.path}: line {self.number}: {problem}; correct or re-export the file")

    def numbers(self, words: list[str], count: int, what: str) -> FloatArray:
        """`count` finite numbers."""
        if len(words) < count:
            raise self.error(f"{what} has {len(words)} numbers where {count} are expected")
        try:
            values = np.array([float(w) for w in words[:count]])
        except ValueError:
            raise self.error(f"{what} has a word that is not a number: {' '.join(words[:count])}") from None
        if not (np.abs(values) < 1e12).all():
            raise self.error(f"{what} must be finite")
        return values


def read_asf(path: Path) -> Skeleton:
    """Read a skeleton into metres, Z up; see `read_amc`.

    Raises:
        FormatError: malformed; the message names the line.
    """
    with parsing(path, FormatError, "an ASF"):
        return skeleton_of_asf(Path(path), read_asf_file(Path(path)))


def find_asf(amc: Path) -> Path:
    """The skeleton that belongs to an AMC by its name.

    Raises:
        FormatError: none, or more than one that might.
    """
    beside = sorted(p for p in amc.parent.glob("*") if p.suffix.lower() == ".asf") if amc.parent.is_dir() else []
    same = [p for p in beside if p.stem == amc.stem]
    begins = [p for p in beside if amc.stem.startswith((p.stem + "_", p.stem + "-", p.stem + "."))]
    for found in (same, begins, beside):
        if len(found) == 1:
            return found[0]
    names = ", ".join(p.name for p in beside) or "none there"
    raise FormatError(f"{amc}: no ASF file beside it is clearly its skeleton ({names}); name the ASF to be used")


def word(name: str) -> str:
    """A name as a single word that is not a keyword of the format."""
    return "_".join(name.replace("#", "_").replace(":", "_").split()) or "_"


def bones_of(skeleton: Skeleton, names: list[str]) -> tuple[list[tuple[str, FloatArray, bool]], list[tuple[str, str]]]:
    """Bones as name, vector to the end and whether it turns; and pairs of parent and child."""
    bones: list[tuple[str, FloatArray, bool]] = []
    links: list[tuple[str, str]] = []
    for j, name in enumerate(names):
        children = [k for k, parent in enumerate(skeleton.parents) if parent == j]
        ends = [skeleton.offsets[k] for k in children]
        if j == 0:
            end = np.zeros(3)
        elif children:
            end = max(ends, key=lambda e: float(e @ e))
        else:
            end = np.nan_to_num(skeleton.tips[j])
            end = end if np.linalg.norm(end) >= _SHORTEST_M else np.array([0.0, 0.0, _SHORTEST_M])
        if j:
            bones.append((name, end, True))
        for k, offset in zip(children, ends, strict=True):
            if np.linalg.norm(offset - end) < 1e-9:
                links.append((name, names[k]))
            else:
                base = f"{names[k]}_base"
                bones.append((base, offset - end, False))
                links += [(name, base), (base, names[k])]
    return bones, links


def asf_lines(name: str, bones: list[tuple[str, FloatArray, bool]], links: list[tuple[str, str]]) -> list[str]:
    lines = [
        "# written by muybridge", ":version 1.10", f":name {word(name)}", ":units", "  mass 1.0",
        f"  length {LENGTH}", "  angle deg", ":documentation", "   Y up, facing +Z, lengths of 1 / 0.45 inch", ":root",
        "   order TX TY TZ RX RY RZ", "   axis XYZ", "   position 0 0 0", "   orientation 0 0 0", ":bonedata",
    ]  # fmt: skip
    for number, (bone, vector, turns) in enumerate(bones, start=1):
        length = float(np.linalg.norm(vector))
        direction = BVH_FROM_WORLD @ vector / length if length > 0 else np.array([0.0, 1.0, 0.0])
        lines += [
            "  begin",
            f"     id {number}",
            f"     name {bone}",
            "     direction " + " ".join(f"{v + 0.0:.12f}" for v in direction),
            f"     length {length * LENGTH / INCH:.12f}",
            "     axis 0 0 0  XYZ",
        ]
        if turns:
            lines += ["     dof rx ry rz", *(f"     {w}(-180.0 180.0)" for w in ("limits ", " " * 7, " " * 7))]
        lines.append("  end")
    lines += [":hierarchy", "  begin"]
    parents = list(dict.fromkeys(parent for parent, _ in links))
    lines += [f"    {p} " + " ".join(c for q, c in links if q == p) for p in parents]
    return [*lines, "  end"]


def skeleton_of_asf(path: Path, asf: Asf) -> Skeleton:
    """The skeleton, joints in depth-first order."""
    children: dict[str, list[str]] = {name: [] for name in asf.bones}
    for bone in asf.bones.values():
        if bone.parent is not None:
            children[bone.parent].append(bone.name)
    order: list[str] = []
    waiting = ["root"]
    while waiting:
        order.append(waiting.pop())
        waiting += reversed(children[order[-1]])
    loose = [name for name in asf.bones if name not in order]
    if loose:
        raise FormatError(f"{path}: the bone {loose[0]!r} has no parent in the hierarchy; add it there")
    ends = np.array([asf.bones[n].direction * asf.bones[n].length for n in order]) @ BVH_FROM_WORLD * asf.metres
    ends[0] = 0.0
    parents = [order.index(asf.bones[n].parent or "") if n != "root" else -1 for n in order]
    free = np.full((len(order), 3), np.inf)
    return Skeleton(
        names=tuple(order),
        parents=tuple(parents),
        offsets=np.array([ends[p] if p >= 0 else np.zeros(3) for p in parents]),
        tips=np.array([np.full(3, np.nan) if children[n] else ends[i] for i, n in enumerate(order)]),
        twist_axis=(2,) * len(order),
        lower=-free,
        upper=free,
    )


def read_asf_file(path: Path) -> Asf:
    lines = Lines(path)
    asf = Asf()
    asf.bones["root"] = Bone("root", 1, channels=_CHANNELS[:6])
    seen: set[str] = set()
    while (words := lines.next()) is not None:
        section = words[0].lower()
        if not section.startswith(":"):
            raise lines.error(f"{words[0]!r} found where a section (:units, :root, ...) is expected")
        seen.add(section)
        if section == ":units":
            _read_units(lines, asf)
        elif section == ":root":
            _read_root(lines, asf)
        elif section == ":bonedata":
            _read_bones(lines, asf)
        elif section == ":hierarchy":
            _read_hierarchy(lines, asf)
        else:
            _skip(lines)
    missing = [s for s in (":root", ":bonedata", ":hierarchy") if s not in seen]
    if missing:
        raise FormatError(f"{path}: has no section {missing[0]}; is it an ASF file, and complete?")
    return asf


def _section(lines: Lines) -> Iterator[list[str]]:
    """The lines up to the next section."""
    while (words := lines.next()) is not None:
        if words[0].startswith(":"):
            lines.back(words)
            return
        yield words


def _skip(lines: Lines) -> None:
    for _ in _section(lines):
        pass


def _read_units(lines: Lines, asf: Asf) -> None:
    for words in _section(lines):
        if words[0].lower() == "length":
            length = lines.numbers(words[1:], 1, "the unit of length")[0]
            if not 1e-6 < length < 1e6:
                raise lines.error(f"the unit of length is {length:g}, which must be above zero")
            asf.metres = INCH / length
        elif words[0].lower() == "angle":
            if words[1:2] not in (["deg"], ["rad"]):
                raise lines.error(f"the unit of angles is {' '.join(words[1:])!r} where deg or rad is expected")
            asf.degrees = words[1] == "deg"


def _read_root(lines: Lines, asf: Asf) -> None:
    root, angles = asf.bones["root"], np.zeros(3)
    axis = "XYZ"
    for words in _section(lines):
        key = words[0].lower()
        if key == "order":
            root.channels = _read_channels(lines, words[1:])
        elif key == "axis":
            axis = _axis_order(lines, words[1:2])
        elif key == "position":
            asf.position = lines.numbers(words[1:], 3, "the root's position")
        elif key == "orientation":
            angles = lines.numbers(words[1:], 3, "the root's orientation")
    asf.orientation = Rotation.from_euler(axis.lower(), angles, degrees=asf.degrees)


def _read_channels(lines: Lines, words: list[str]) -> tuple[str, ...]:
    channels = tuple(w.lower() for w in words)
    if len(set(channels)) != len(channels) or any(c not in _CHANNELS for c in channels):
        raise lines.error(f"{' '.join(words)!r} are not distinct channels of {', '.join(_CHANNELS)}")
    return channels


def _axis_order(lines: Lines, words: list[str]) -> str:
    if not words or sorted(words[0].upper()) != ["X", "Y", "Z"]:
        raise lines.error(f"{' '.join(words)!r} is not an order of axes such as XYZ")
    return words[0].upper()


def _read_bones(lines: Lines, asf: Asf) -> None:
    bone: Bone | None = None
    for words in _section(lines):
        key = words[0].lower()
        if key == "begin":
            bone = Bone("", lines.number)
        elif bone is None:
            raise lines.error(f"{words[0]!r} found where a bone is expected")
        elif key == "name":
            if len(words) < 2 or words[1] in asf.bones:
                raise lines.error(f"{' '.join(words)!r} gives no name, or one that appears twice")
            bone.name = words[1]
        elif key == "direction":
            direction = lines.numbers(words[1:], 3, "the direction")
            bone.direction = direction / max(float(np.linalg.norm(direction)), 1e-12)
        elif key == "length":
            bone.length = float(lines.numbers(words[1:], 1, "the length")[0])
        elif key == "axis":
            order = _axis_order(lines, words[4:5])
            angles = lines.numbers(words[1:], 3, "the axis")
            bone.axes = Rotation.from_euler(order.lower(), angles, degrees=asf.degrees)
        elif key == "dof":
            bone.channels = _read_channels(lines, words[1:])
        elif key == "end":
            if not bone.name:
                raise lines.error(f"the bone that begins in line {bone.line} has no name")
            asf.bones[bone.name] = bone
            bone = None
    if bone is not None:
        raise lines.error(f"the bone that begins in line {bone.line} does not end")


def _read_hierarchy(lines: Lines, asf: Asf) -> None:
    for words in _section(lines):
        if len(words) == 1 and words[0].lower() in ("begin", "end"):
            continue
        for name in words:
            if name not in asf.bones:
                raise lines.error(f"the bone {name!r} is not among the bone data")
        for name in words[1:]:
            if name == "root" or asf.bones[name].parent is not None:
                raise lines.error(f"the bone {name!r} has two parents")
            asf.bones[name].parent = words[0]
