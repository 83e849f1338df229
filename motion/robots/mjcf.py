"""MJCF, MuJoCo's format of models: the kinematic tree and the simple shapes of one robot.

Source: MuJoCo's XML reference (https://mujoco.readthedocs.io/en/stable/XMLreference.html). Actuators, sensors,
contacts, assets and everything of dynamics are passed over.
"""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.robots.mjcf_frames import (
    Compiler,
    Defaults,
    axis_from_z,
    check_names,
    load_included,
    numbers,
    unit_vector,
    vector,
)
from muybridge.motion.robots.robot import Joint, Mimic, Robot, Shape

_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
_UNKNOWN = ("attach", "replicate", "composite", "flexcomp")


@dataclass
class _Builder:
    path: Path
    compiler: Compiler
    defaults: Defaults
    links: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    places: list[FloatArray] = field(default_factory=list)
    turns: list[FloatArray] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    masses: list[float] = field(default_factory=list)
    centres: list[FloatArray] = field(default_factory=list)

    def add_body(self, body: Element, parent: int, frame: tuple[FloatArray, FloatArray], inherited: str | None) -> None:
        """A body, which is in a `<frame>` of its parent, and everything below it."""
        place, turn = self._within(body.attrib, frame)
        link = len(self.links)
        self.links.append(body.get("name") or f"body_{link}")
        self.parents.append(parent)
        self.places.append(place)
        self.turns.append(turn)
        inertial = body.find("inertial")
        self.masses.append(float(inertial.get("mass", "0")) if inertial is not None else 0.0)
        self.centres.append(vector(inertial.get("pos")) if inertial is not None else np.full(3, np.nan))
        self._add_contents(body, link, (np.zeros(3), np.eye(3)), body.get("childclass") or inherited)

    def _add_contents(
        self, element: Element, link: int, frame: tuple[FloatArray, FloatArray], inherited: str | None
    ) -> None:
        # MuJoCo numbers a body's joints before those of the bodies below it, wherever they stand.
        for child in element:
            if child.tag == "joint":
                self._add_joint(child, link, frame, inherited)
            elif child.tag == "geom":
                self._add_shape(child, link, frame, inherited)
            elif child.tag in _UNKNOWN:
                raise FormatError(f"{self.path}: <{child.tag}> is not known here", remedy="compile_mjcf")
        for child in element:
            if child.tag == "body":
                self.add_body(child, link, frame, inherited)
            elif child.tag == "frame":
                within = self._within(child.attrib, frame)
                self._add_contents(child, link, within, child.get("childclass") or inherited)

    def _within(
        self, attributes: dict[str, str], frame: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        place, turn = frame
        return place + turn @ vector(attributes.get("pos")), turn @ self.compiler.turn(attributes)

    def _add_joint(
        self, element: Element, link: int, frame: tuple[FloatArray, FloatArray], inherited: str | None
    ) -> None:
        given = self.defaults.of(element, inherited)
        kind = given.get("type", "hinge")
        if kind == "free":
            return
        name = element.get("name") or f"joint_{len(self.joints)}"
        if kind not in ("hinge", "slide"):
            raise FormatError(
                f"{self.path}: the joint {name!r} is of the type {kind!r}; hinge and slide are known",
                remedy="split_joint",
            )
        angular = kind == "hinge"
        ends = numbers(given.get("range"), (0.0, 0.0))
        if ends.shape != (2,):
            raise ValueError(f"the joint {name!r} has a range that is not two numbers")
        told = given.get("limited", "auto")
        limited = told == "true" or (told == "auto" and self.compiler.autolimits and "range" in given)
        ends = self.compiler.radians(ends) if angular else ends
        lower, upper = ends if limited else (-np.inf, np.inf)
        if lower > upper:
            raise ValueError(f"the joint {name!r} has the range {lower:g} to {upper:g}")
        rest = numbers(given.get("ref"), (0.0,))[:1]
        rest = self.compiler.radians(rest) if angular else rest
        axis = frame[1] @ unit_vector(vector(given.get("axis"), (0.0, 0.0, 1.0)))
        anchor = frame[0] + frame[1] @ vector(given.get("pos"))
        self.joints.append(
            Joint(
                name,
                link,
                "hinge" if angular else "slide",
                axis,
                anchor,
                float(lower),
                float(upper),
                rest=float(rest[0]),
            )
        )

    def _add_shape(
        self, element: Element, link: int, frame: tuple[FloatArray, FloatArray], inherited: str | None
    ) -> None:
        given = self.defaults.of(element, inherited)
        kind = given.get("type", "sphere")
        if kind not in _SIZES or "mesh" in given:
            return
        size = np.zeros(3)
        stated = numbers(given.get("size"))
        place, turn = vector(given.get("pos")), self.compiler.turn(given)
        if "fromto" in given and kind != "sphere":
            start, stop = numbers(given["fromto"]).reshape(2, 3)
            place, turn = (start + stop) / 2, axis_from_z(start - stop)
            half = float(np.linalg.norm(stop - start)) / 2
            wide = stated[:1] if _SIZES[kind] == 2 else np.repeat(stated[:1], 2)
            stated = np.append(wide, half)
        if len(stated) < _SIZES[kind]:
            raise ValueError(f"a {kind} of {self.links[link]!r} has {len(stated)} sizes; it needs {_SIZES[kind]}")
        size[: _SIZES[kind]] = stated[: _SIZES[kind]]
        solid = any(given.get(key, "1") != "0" for key in ("contype", "conaffinity"))
        self.shapes.append(Shape(link, kind, size, frame[0] + frame[1] @ place, frame[1] @ turn, solid))  # type: ignore[arg-type]


def read_mjcf(path: Path) -> Robot:
    """The robot of an MJCF: the body of the world with the most joints below it.

    Raises:
        ValueError, OSError, ElementTree.ParseError: the file is not MJCF, or is beyond what is known here.
    """
    root = load_included(path)
    if root.tag != "mujoco":
        raise ValueError(f"the outermost element is <{root.tag}>, not <mujoco>")
    compiler, defaults = Compiler(), Defaults()
    for element in root.findall("compiler"):
        compiler = compiler.with_element(element)
    for element in root.findall("default"):
        defaults.read(element)
    bodies = _top_bodies(root, compiler)
    if not bodies:
        raise ValueError("there is no body in the world")
    chosen, frame, inherited = max(bodies, key=lambda each: _joint_count(each[0]))
    builder = _Builder(path, compiler, defaults)
    builder.add_body(chosen, -1, frame, inherited)
    # Joints between the world and the root are those of the free root, whatever they are.
    at_root = [joint for joint in builder.joints if joint.link == 0]
    notices = []
    if at_root:
        names = ", ".join(joint.name for joint in at_root)
        notices.append(f"the root moves freely; its joints {names} are left out")
    joints = [joint for joint in builder.joints if joint.link != 0]
    check_names("link", builder.links)
    check_names("joint", [joint.name for joint in joints])
    return Robot(
        root.get("model") or path.stem, path, tuple(builder.links), tuple(builder.parents), np.array(builder.places),
        np.array(builder.turns), tuple(_with_mimics(joints, root)), tuple(builder.shapes), np.array(builder.masses),
        np.array(builder.centres), tuple(notices),
    )  # fmt: skip


def _top_bodies(root: Element, compiler: Compiler) -> list[tuple[Element, tuple[FloatArray, FloatArray], str | None]]:
    """Bodies of the world, with the frame and the class that they are in."""
    out: list[tuple[Element, tuple[FloatArray, FloatArray], str | None]] = []

    def collect(element: Element, frame: tuple[FloatArray, FloatArray], inherited: str | None) -> None:
        for child in element:
            if child.tag == "body":
                out.append((child, frame, inherited))
            elif child.tag == "frame":
                place = frame[0] + frame[1] @ vector(child.get("pos"))
                collect(child, (place, frame[1] @ compiler.turn(child.attrib)), child.get("childclass") or inherited)

    for world in root.findall("worldbody"):
        collect(world, (np.zeros(3), np.eye(3)), world.get("childclass"))
    return out


def _joint_count(body: Element) -> int:
    return sum(1 for _ in body.iter("joint")) + sum(1 for _ in body.iter("freejoint"))


def _with_mimics(joints: list[Joint], root: Element) -> list[Joint]:
    """Joints that an equality ties to another one follow it; only its linear part counts."""
    known = {joint.name: k for k, joint in enumerate(joints)}
    out = list(joints)
    for element in root.findall("equality/joint"):
        one, other = element.get("joint1", ""), element.get("joint2", "")
        if one not in known or other not in known or element.get("active", "true") == "false":
            continue
        shape = np.append(numbers(element.get("polycoef"), (0.0, 1.0)), [0.0, 0.0])
        mine, theirs = joints[known[one]], joints[known[other]]
        offset = mine.rest + shape[0] - shape[1] * theirs.rest
        out[known[one]] = Joint(
            mine.name, mine.link, mine.kind, mine.axis, mine.anchor, mine.lower, mine.upper, mine.velocity, mine.rest,
            Mimic(other, float(shape[1]), float(offset)),
        )  # fmt: skip
    return out
