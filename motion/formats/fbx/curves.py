"""Curves of an animation as nodes of an FBX file: a key a frame, straight lines between them."""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.formats.fbx.container import Node, Table
from muybridge.motion.formats.fbx.scene import TICKS_A_SECOND

# Keys with linear interpolation: no tangents; the numbers are the defaults.
_LINEAR = np.array([4], np.int32)
_TANGENTS = np.array([0, 0, 9.419963346924634e-30, 0], np.float32)


def object_name(name: str, kind: str) -> str:
    """A name in the form of binary files: the name, two marks, its class."""
    return f"{name}\x00\x01{kind}"


def ticks(frame: int, fps: float) -> int:
    """The time of a frame on the file's clock."""
    return round(frame * TICKS_A_SECOND / fps)


def add_stack(objects: Node, links: Node, numbers: tuple[int, int], name: str, last: int) -> None:
    """An animation stack with its one layer, of these numbers, from 0 to the time `last`."""
    table = Table()
    for key, at in (("LocalStart", 0), ("LocalStop", last), ("ReferenceStart", 0), ("ReferenceStop", last)):
        table.line(key, "KTime", "Time", "", at)
    stack, layer = numbers
    objects.append(Node("AnimationStack", (stack, object_name(name, "AnimStack"), ""), [table.node]))
    objects.append(Node("AnimationLayer", (layer, object_name("BaseLayer", "AnimLayer"), ""), []))
    links.add("C", "OO", layer, stack)


def add_curves(
    objects: Node, links: Node, numbers: tuple[int, int], layer: int, model: int, what: str, times: IntArray,
    values: FloatArray,
) -> None:  # fmt: skip
    """Three curves of a model's "Lcl Translation" or "Lcl Rotation": keys at `times` (T,) of `values` (T, 3).

    `numbers` are the curve node's and the first curve's.
    """
    kind, (number, first_curve), table = what[4], numbers, Table()
    for axis, first in zip("XYZ", values[0], strict=True):
        table.line(f"d|{axis}", "Number", "", "A", float(first))
    objects.append(Node("AnimationCurveNode", (number, object_name(kind, "AnimCurveNode"), ""), [table.node]))
    links.add("C", "OO", number, layer)
    links.add("C", "OP", number, model, what)
    for k, axis in enumerate("XYZ"):
        curve = Node("AnimationCurve", (first_curve + k, object_name("", "AnimCurve"), ""), [])
        curve.add("Default", float(values[0, k]))
        curve.add("KeyVer", np.int32(4008))
        curve.add("KeyTime", times)
        curve.add("KeyValueFloat", values[:, k].astype(np.float32))
        curve.add("KeyAttrFlags", _LINEAR)
        curve.add("KeyAttrDataFloat", _TANGENTS)
        curve.add("KeyAttrRefCount", np.array([len(times)], np.int32))
        objects.append(curve)
        links.add("C", "OP", first_curve + k, number, f"d|{axis}")


def take(name: str, last: int) -> Node:
    """The entry of a stack in the list of takes."""
    out = Node("Take", (name,), [])
    out.add("FileName", f"{name.replace(' ', '_')}.tak")
    out.add("LocalTime", 0, last)
    out.add("ReferenceTime", 0, last)
    return out
