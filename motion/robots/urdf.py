"""URDF: the kinematic tree and the simple shapes of one robot.

Source: the URDF specification (http://wiki.ros.org/urdf/XML). Transmissions, sensors, materials and meshes are passed
over.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.motion.robots.mjcf_frames import check_names, numbers, parse_xml, unit_vector, vector
from muybridge.motion.robots.robot import Joint, Mimic, Robot, Shape

_MOVING = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}


@dataclass(frozen=True)
class _Edge:
    """A joint of the file: the links that it is between, and the child's frame in the parent's."""

    element: Element
    parent: str
    child: str
    place: FloatArray
    turn: FloatArray
    kind: str

    @property
    def name(self) -> str:
        return self.element.get("name", "")


def read_urdf(path: Path) -> Robot:
    """The robot of a URDF; its root moves freely.

    Raises:
        ValueError, OSError, ElementTree.ParseError: the file is no URDF, or its links are no tree.
    """
    root = parse_xml(path)
    if root.tag != "robot":
        raise ValueError(f"the outermost element is <{root.tag}>, not <robot>")
    _refuse_xacro(path, root)
    names_of_links = [link.get("name", "") for link in root.findall("link")]
    check_names("link", names_of_links)
    links = dict(zip(names_of_links, root.findall("link"), strict=True))
    if not links:
        raise ValueError("there is no link")
    edges = [_edge(path, element, links) for element in root.findall("joint")]
    world = _world(edges, links)
    if world is not None:
        edges = [replace(edge, kind="floating") if edge is world else edge for edge in edges]
    floating = [edge for edge in edges if edge.kind == "floating"]
    order, above = _tree(list(links), edges, {edge.child for edge in floating})
    index = {name: k for k, name in enumerate(order)}
    start = next((edge for edge in floating if edge.child == order[0]), None)
    places, turns = np.zeros((len(order), 3)), np.tile(np.eye(3), (len(order), 1, 1))
    if start is not None:
        places[0], turns[0] = start.place, start.turn
    parents = [-1]
    for k, name in enumerate(order[1:], start=1):
        edge = above[name]
        parents.append(index[edge.parent])
        places[k], turns[k] = edge.place, edge.turn
    joints = [_joint(edge, index) for edge in edges if edge.child in index and edge.kind in _MOVING]
    check_names("joint", [joint.name for joint in joints])
    names = {joint.name for joint in joints}
    for joint in joints:
        if joint.mimic is not None and joint.mimic.joint not in names:
            raise ValueError(f"{joint.name!r} follows {joint.mimic.joint!r}, which is no joint")
    inertial = [links[name].find("inertial") for name in order]
    return Robot(
        root.get("name") or path.stem, path, tuple(order), tuple(parents), places, turns, tuple(joints),
        tuple(shape for name in order for shape in _shapes(links[name], index[name])),
        np.array([_mass(each) for each in inertial]), np.array([_centre(each) for each in inertial]),
        _notices(order, links, start),
    )  # fmt: skip


def _refuse_xacro(path: Path, root: Element) -> None:
    """FormatError where macros are not expanded."""
    if any("xacro" in element.tag or any("${" in v for v in element.attrib.values()) for element in root.iter()):
        raise FormatError(f"{path}: holds xacro macros, which have to be expanded first", remedy="expand_xacro",
                          xacro=path.name, urdf=f"{path.stem}_expanded.urdf")  # fmt: skip


def _world(edges: list[_Edge], links: dict[str, Element]) -> _Edge | None:
    """The joint that fixes a robot to the link `world`, by which simulators hold it in place; None without one."""
    below = [edge for edge in edges if edge.parent == "world"]
    held = any(edge.child == "world" for edge in edges)
    is_empty = "world" in links and not any(links["world"].find(tag) is not None for tag in ("inertial", "visual"))
    return below[0] if len(below) == 1 and is_empty and not held and below[0].kind == "fixed" else None


def _notices(order: list[str], links: dict[str, Element], start: _Edge | None) -> tuple[str, ...]:
    """What was left out: links that hang from no joint of the tree, but for the world that the root hangs from."""
    known = {*order, *([start.parent] if start is not None else [])}
    lost = [name for name in links if name not in known]
    if not lost:
        return ()
    some = ", ".join(lost[:5]) + (", ..." if len(lost) > 5 else "")
    return (f"links that no joint fixes to {order[0]} are left out: {some}",)


def _edge(path: Path, element: Element, links: dict[str, Element]) -> _Edge:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in (*_MOVING, "fixed", "floating"):
        raise FormatError(
            f"{path}: the joint {name!r} is of the type {kind!r}; {', '.join(_MOVING)}, fixed and floating are known",
            remedy="split_joint",
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = end.get("link", "") if end is not None else ""
        if link not in links:
            raise ValueError(f"the joint {name!r} has no {tag} among the links")
        ends.append(link)
    place, turn = _origin(element)
    return _Edge(element, ends[0], ends[1], place, turn, kind)


def _origin(element: Element) -> tuple[FloatArray, FloatArray]:
    origin = element.find("origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    roll, pitch, yaw = vector(origin.get("rpy"))
    about = np.eye(3)
    return vector(origin.get("xyz")), exp_so3(about[2] * yaw) @ exp_so3(about[1] * pitch) @ exp_so3(about[0] * roll)


def _tree(links: list[str], edges: list[_Edge], free: set[str]) -> tuple[list[str], dict[str, _Edge]]:
    """Links of the largest tree, depth first in the file's order, and the joint above each."""
    above: dict[str, _Edge] = {}
    below: dict[str, list[str]] = {name: [] for name in links}
    for edge in edges:
        if edge.kind == "floating":
            continue
        if edge.child in above or edge.child in free:
            raise ValueError(f"the link {edge.child!r} hangs from two joints")
        above[edge.child] = edge
        below[edge.parent].append(edge.child)
    trees = []
    for name in links:
        if name not in above:
            order, stack = [], [name]
            while stack:
                here = stack.pop()
                order.append(here)
                stack.extend(reversed(below[here]))
            trees.append(order)
    if sum(len(tree) for tree in trees) != len(links):
        raise ValueError("the links form a circle")
    return max(trees, key=len), above


def _joint(edge: _Edge, index: dict[str, int]) -> Joint:
    given = edge.element
    stated = given.find("axis")
    axis = unit_vector(vector(stated.get("xyz") if stated is not None else None, (1.0, 0.0, 0.0)))
    limit, mimic = given.find("limit"), given.find("mimic")
    lower, upper, velocity = -np.inf, np.inf, np.inf
    if limit is not None:
        if edge.kind != "continuous":
            lower, upper = float(numbers(limit.get("lower"), (0.0,))[0]), float(numbers(limit.get("upper"), (0.0,))[0])
        velocity = float(numbers(limit.get("velocity"), (0.0,))[0]) or np.inf
    if lower > upper:
        raise ValueError(f"the joint {edge.name!r} has the limits {lower:g} to {upper:g}")
    follows = None
    if mimic is not None:
        gain = float(numbers(mimic.get("multiplier"), (1.0,))[0])
        follows = Mimic(mimic.get("joint", ""), gain, float(numbers(mimic.get("offset"), (0.0,))[0]))
    kind = "hinge" if _MOVING[edge.kind] == "hinge" else "slide"
    return Joint(edge.name, index[edge.child], kind, axis, np.zeros(3), lower, upper, abs(velocity), 0.0, follows)  # type: ignore[arg-type]


def _shapes(link: Element, index: int) -> list[Shape]:
    out = []
    for tag in ("collision", "visual"):
        for element in link.findall(tag):
            place, turn = _origin(element)
            for shape in element.findall("geometry/*"):
                size = np.zeros(3)
                if shape.tag == "box":
                    size[:] = vector(shape.get("size")) / 2
                elif shape.tag == "sphere":
                    size[0] = numbers(shape.get("radius"))[0]
                elif shape.tag in ("cylinder", "capsule"):
                    size[:2] = numbers(shape.get("radius"))[0], numbers(shape.get("length"))[0] / 2
                else:
                    continue
                out.append(Shape(index, shape.tag, size, place, turn, tag == "collision"))  # type: ignore[arg-type]
    return out


def _mass(inertial: Element | None) -> float:
    mass = inertial.find("mass") if inertial is not None else None
    return float(numbers(mass.get("value"), (0.0,))[0]) if mass is not None else 0.0


def _centre(inertial: Element | None) -> FloatArray:
    return _origin(inertial)[0] if inertial is not None else np.full(3, np.nan)
