"""MJCF's ways to write a frame, its default classes and its included files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat

MOST_INCLUDES = 100


def parse_xml(path: Path) -> Element:
    """The root element of an XML file.

    Raises:
        FormatError: the file cannot be opened; the message names it, which another may include.
        ElementTree.ParseError: it is no XML.
    """
    try:
        return ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from error


def check_names(what: str, names: Sequence[str]) -> None:
    """ValueError where two links or joints have one name."""
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"two {what}s are called {twice!r}")


def numbers(text: str | None, default: tuple[float, ...] = ()) -> FloatArray:
    """The finite numbers of an attribute; ValueError where one is not."""
    if text is None:
        return np.array(default, dtype=np.float64)
    out = np.array([float(word) for word in text.split()], dtype=np.float64)
    if not np.isfinite(out).all():
        raise ValueError(f"{text!r} holds a number that is not finite")
    return out


def vector(text: str | None, default: tuple[float, ...] = (0.0, 0.0, 0.0)) -> FloatArray:
    """(3,) of an attribute."""
    out = numbers(text, default)
    if out.shape != (3,):
        raise ValueError(f"{text!r} is not three numbers")
    return out


def unit_vector(values: FloatArray) -> FloatArray:
    """At length one; ValueError for a vector without a direction."""
    size = float(np.linalg.norm(values))
    if size < 1e-12:
        raise ValueError(f"{values.tolist()} has no direction")
    return np.asarray(values / size)


def axis_from_z(direction: FloatArray) -> FloatArray:
    """(3, 3) the smallest rotation that brings z to a direction."""
    z = unit_vector(direction)
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, z[2]))
    axis = axis / sine if sine > 1e-10 else np.array([1.0, 0.0, 0.0])
    return exp_so3(axis * angle)


@dataclass(frozen=True)
class Compiler:
    """What `<compiler>` states.

    Attributes:
        degrees: whether angles are degrees.
        eulerseq: axes of Euler angles; capitals turn about fixed axes.
        autolimits: whether a range limits a joint that does not say whether it is limited.
    """

    degrees: bool = True
    eulerseq: str = "xyz"
    autolimits: bool = True

    def with_element(self, element: Element) -> "Compiler":
        """As a further `<compiler>` changes it."""
        if element.get("coordinate", "local") != "local":
            raise ValueError('coordinate="global" is of MuJoCo before 2.3; save the file again with a newer one')
        degrees = element.get("angle", "degree" if self.degrees else "radian") == "degree"
        limits = element.get("autolimits", "true" if self.autolimits else "false") == "true"
        sequence = element.get("eulerseq", self.eulerseq)
        if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
            raise ValueError(f"eulerseq {sequence!r} is not three of x, y and z")
        return Compiler(degrees, sequence, limits)

    def radians(self, values: FloatArray) -> FloatArray:
        """Angles of the file in radians."""
        return np.radians(values) if self.degrees else values

    def turn(self, attributes: Mapping[str, str]) -> FloatArray:
        """(3, 3) of quat, axisangle, euler, xyaxes or zaxis; the identity without any."""
        if "quat" in attributes:
            quat = numbers(attributes["quat"])
            if quat.shape != (4,):
                raise ValueError(f"{attributes['quat']!r} is no quaternion")
            return matrix_from_quat(unit_vector(quat))
        if "axisangle" in attributes:
            x, y, z, angle = numbers(attributes["axisangle"])
            return exp_so3(unit_vector(np.array([x, y, z])) * self.radians(np.array(angle)))
        if "euler" in attributes:
            out = np.eye(3)
            for letter, angle in zip(self.eulerseq, self.radians(vector(attributes["euler"])), strict=True):
                step = exp_so3(np.eye(3)["xyz".index(letter.lower())] * angle)
                out = step @ out if letter.isupper() else out @ step
            return out
        if "xyaxes" in attributes:
            axes = numbers(attributes["xyaxes"]).reshape(2, 3)
            x = unit_vector(axes[0])
            y = unit_vector(axes[1] - (axes[1] @ x) * x)
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in attributes:
            return axis_from_z(vector(attributes["zaxis"]))
        return np.eye(3)


@dataclass
class Defaults:
    """Attributes that classes give to elements.

    Attributes:
        classes: class -> tag -> attributes, with those of the classes above.
    """

    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=lambda: {"main": {}})

    def read(self, element: Element, parent: str | None = None) -> None:
        """A `<default>` and those within it."""
        name = element.get("class") or ("main" if parent is None else "")
        if not name:
            raise ValueError("a default class inside another has no name")
        inherited = self.classes.get(parent or "main", {})
        mine = self.classes.setdefault(name, {tag: dict(values) for tag, values in inherited.items()})
        for child in element:
            if child.tag != "default":
                mine.setdefault(child.tag, {}).update(child.attrib)
        for child in element.findall("default"):
            self.read(child, name)

    def of(self, element: Element, child_class: str | None) -> dict[str, str]:
        """An element's attributes, its class's where it does not state them itself."""
        name = element.get("class") or child_class or "main"
        if name not in self.classes:
            raise ValueError(f"there is no default class {name!r}")
        given = self.classes[name].get(element.tag, {})
        if any(key in element.attrib for key in ("quat", "axisangle", "euler", "xyaxes", "zaxis", "fromto")):
            given = {
                k: v for k, v in given.items() if k not in ("quat", "axisangle", "euler", "xyaxes", "zaxis", "fromto")
            }
        return {**given, **element.attrib}


def load_included(path: Path) -> Element:
    """The root of an MJCF with its included files in place.

    Raises:
        ValueError: a file is included twice, or too many are.
        OSError: one cannot be read.
    """
    seen: set[Path] = set()

    def load(file: Path) -> Element:
        if file.resolve() in seen:
            raise ValueError(f"{file.name} is included twice")
        seen.add(file.resolve())
        if len(seen) > MOST_INCLUDES:
            raise ValueError(f"more than {MOST_INCLUDES} files are included")
        element = parse_xml(file)
        expand(element, file.parent)
        return element

    def expand(element: Element, folder: Path) -> None:
        children: list[Element] = []
        for child in list(element):
            if child.tag == "include":
                named = child.get("file", "")
                file = folder / named
                children.extend(load(file if file.is_file() else path.parent / named))
            else:
                expand(child, folder)
                children.append(child)
        element[:] = children

    return load(path)
