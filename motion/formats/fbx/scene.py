"""The objects of an FBX file: its tree of models, their curves, and the poses that skins are bound in.

Sources beside the files themselves: the order of a node's transforms is Autodesk's own ("Computing transformation
matrices", FBX SDK help): T Roff Rp Rpre R Rpost^-1 Rp^-1 Soff Sp S Sp^-1.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import FormatError
from muybridge.motion.formats.clip_choice import choose_clip
from muybridge.motion.formats.fbx.container import Node, Property
from muybridge.motion.formats.skeletal.joint_frames import different_names

ErrorFactory = Callable[..., FormatError]
Table = Mapping[str, tuple[Property, ...]]
Links = Sequence[tuple[Property, ...]]
Objects = Mapping[Any, Node]

TICKS_A_SECOND = 46186158000
# Frames per second by their numbers; 14 is any other. Of two of one rate the first is what is written.
RATES = {1: 120.0, 2: 100.0, 3: 60.0, 4: 50.0, 5: 48.0, 6: 30.0, 7: 30.0, 8: 30 / 1.001, 9: 30 / 1.001, 10: 25.0,
         11: 24.0, 12: 1000.0, 13: 24 / 1.001, 15: 96.0, 16: 72.0, 17: 60 / 1.001}  # fmt: skip
CUSTOM_RATE = 14
# Of a node's rotation, by its number; 6 is "spheric", which no program writes.
ORDERS = ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX")
_CONSTANT, _LINEAR, _CUBIC = 2, 4, 8
_USER_TANGENTS = 0x400
_VECTORS = {
    "Lcl Translation": 0.0, "Lcl Rotation": 0.0, "Lcl Scaling": 1.0, "PreRotation": 0.0, "PostRotation": 0.0,
    "RotationOffset": 0.0, "RotationPivot": 0.0, "ScalingOffset": 0.0, "ScalingPivot": 0.0,
}  # fmt: skip


@dataclass
class Curve:
    """Keys of one number over time.

    Attributes:
        times: (K,) seconds, ascending.
        values: (K,).
        kinds: (K,) interpolation after each key: 2 constant, 4 linear, 8 cubic.
        slopes: (K, 2) per second, out of each key and into the next; NaN where the file does not state them.
    """

    times: FloatArray
    values: FloatArray
    kinds: IntArray
    slopes: FloatArray

    def at(self, times: FloatArray) -> FloatArray:
        """(T,) values, constant before the first and after the last key."""
        if len(self.times) == 1:
            return np.full(len(times), self.values[0])
        t = np.clip(times, self.times[0], self.times[-1])
        # A key counts from a little before it: times were rounded to the file's clock.
        k = np.clip(np.searchsorted(self.times, t + 1e-6, side="right") - 1, 0, len(self.times) - 2)
        step = self.times[k + 1] - self.times[k]
        s = np.clip((t - self.times[k]) / step, 0.0, 1.0)
        before, after = self.values[k], self.values[k + 1]
        out, into = (slope[k] * step for slope in self._tangents())
        cubic = (
            (2 * s**3 - 3 * s**2 + 1) * before + (s**3 - 2 * s**2 + s) * out
            + (3 * s**2 - 2 * s**3) * after + (s**3 - s**2) * into
        )  # fmt: skip
        straight = before + s * (after - before)
        held = np.where(s >= 1.0, after, before)
        return np.select([self.kinds[k] == _CONSTANT, self.kinds[k] == _CUBIC], [held, cubic], straight)

    def _tangents(self) -> tuple[FloatArray, FloatArray]:
        """(K - 1,) slopes out of each key and into the next; unstated ones as of a smooth curve through the keys,
        flat where it turns."""
        step, rise = np.diff(self.times), np.diff(self.values)
        smooth = np.zeros(len(self.times))
        turns = rise[1:] * rise[:-1] <= 0
        smooth[1:-1] = np.where(turns, 0.0, (rise[1:] + rise[:-1]) / (step[1:] + step[:-1]))
        smooth[0], smooth[-1] = rise[0] / step[0], rise[-1] / step[-1]
        stated = self.slopes[:-1]
        return (
            np.where(np.isfinite(stated[:, 0]), stated[:, 0], smooth[:-1]),
            np.where(np.isfinite(stated[:, 1]), stated[:, 1], smooth[1:]),
        )


@dataclass
class Model:
    """A node of the scene.

    Attributes:
        name, kind: `kind` is LimbNode, Null, Root, Mesh, ...
        parent: number of the model of its parent, 0 for the scene.
        vectors: its transforms, by their names in the file; degrees and the file's units.
        order: of its rotation: three axes, the first turned about first.
        curves: by the name of the transform and the axis ("X").
    """

    name: str
    kind: str
    parent: int
    vectors: dict[str, FloatArray]
    order: str
    curves: dict[tuple[str, str], Curve] = field(default_factory=dict)

    def over_time(self, what: str, times: FloatArray) -> FloatArray:
        """(T, 3) one of its transforms."""
        still = self.vectors[what]
        columns = [
            self.curves[what, axis].at(times) if (what, axis) in self.curves else np.full(len(times), still[k])
            for k, axis in enumerate("XYZ")
        ]
        return np.stack(columns, axis=-1)

    def turns(self, angles_deg: FloatArray) -> FloatArray:
        """(T, 3, 3) parent from node, from the angles of its rotation (T, 3)."""
        columns = ["XYZ".index(axis) for axis in self.order]
        moving = Rotation.from_euler(self.order.lower(), np.radians(angles_deg[:, columns])).as_matrix()
        before, after = self.around()
        return np.asarray(before @ moving @ after.T)

    def around(self) -> tuple[FloatArray, FloatArray]:
        """(3, 3) its constant rotations: a turn is the first, the one that changes, and the inverse of the second."""
        before, after = (
            Rotation.from_euler("xyz", np.radians(self.vectors[name])).as_matrix()
            for name in ("PreRotation", "PostRotation")
        )
        return before, after


@dataclass
class Scene:
    """A file's models, by their numbers.

    Attributes:
        models: all of them.
        bound: (4, 4) world from model, columns as in mathematics, of models that a skin or a pose binds.
        metres: that one of the file's units is.
        axes: (3, 3) our world (Z up) from the file's.
        fps: as the file states it, NaN where it does not.
        clips: names of its animation stacks.
        top: the file's nodes.
        objects: by their numbers.
        links: what each connection joins.
    """

    models: dict[int, Model]
    bound: dict[int, FloatArray]
    metres: float
    axes: FloatArray
    fps: float
    clips: tuple[str, ...]
    top: Node
    objects: Objects
    links: Links

    def below(self, number: object, kind: str, what: str | None = None) -> list[Any]:
        """Numbers of the objects of one kind that are connected to another, in the file's order.

        Args:
            number: of the other.
            kind: name of their nodes.
            what: the property of the other that they are connected to; None for any.
        """
        return [link[1] for link in self.links
                if link[2] == number and link[1] in self.objects and self.objects[link[1]].name == kind
                and (what is None or link[3:4] == (what,))]  # fmt: skip


def read_scene(top: Node, error: ErrorFactory, clip: str | int | None = None) -> Scene:
    """The scene of a file's nodes, moved by one of its animations (None: the first); `error` makes exceptions."""
    objects = {n.properties[0]: n for section in top.all("Objects") for n in section.children or [] if n.properties}
    links = [c.properties for section in top.all("Connections") for c in section.all("C") if len(c.properties) >= 3]
    defaults = _template(top)
    models = {
        int(number): _model(node, defaults, error)
        for number, node in objects.items() if node.name == "Model" and isinstance(number, int)
    }  # fmt: skip
    for link in links:
        kind, child, parent = link[:3]
        if kind == "OO" and child in models and parent in models and child != parent:
            models[int(child)].parent = int(parent)
    stacks = {n: o for n, o in objects.items() if o.name == "AnimationStack"}
    names = different_names([str((*o.properties[1:2], "")[0]).split("\x00")[0] for o in stacks.values()])
    number = choose_clip(names, clip, error)
    _animate(models, objects, links, None if number is None else list(stacks)[number], error)
    settings = next((properties(n) for n in top.all("GlobalSettings")), {})
    return Scene(models, _bound(models, objects, links), *_units(settings, error), names, top, objects, links)


def properties(node: Node) -> Table:
    """Values of an object's `Properties70`, by their names."""
    lines = [line.properties for table in node.all("Properties70") for line in table.all("P")]
    return {str(line[0]): tuple(line[4:]) for line in lines if len(line) > 4}


def _template(top: Node) -> Table:
    """Properties of models that do not set them."""
    for definitions in top.all("Definitions"):
        for kind in definitions.all("ObjectType"):
            if kind.properties[:1] == ("Model",):
                for template in kind.all("PropertyTemplate"):
                    return properties(template)
    return {}


def _model(node: Node, defaults: Table, error: ErrorFactory) -> Model:
    name, kind = (str(p) for p in (*node.properties[1:3], "", "")[:2])
    name = name.split("\x00")[0]
    own = {**defaults, **properties(node)}
    vectors = {}
    for what, usual in _VECTORS.items():
        vectors[what] = np.array(own.get(what, (usual,) * 3)[:3], dtype=object)
        if vectors[what].shape != (3,) or not all(isinstance(v, int | float) for v in vectors[what]):
            raise error(f"the {what} of {name!r} is not three numbers")
        vectors[what] = vectors[what].astype(np.float64)
        if not (np.abs(vectors[what]) < 1e9).all():
            raise error(f"the {what} of {name!r} is not finite")
    order = 0
    if (own.get("RotationActive") or (0,))[0]:
        order = (own.get("RotationOrder") or (0,))[0]  # type: ignore[assignment]
        if not isinstance(order, int) or not 0 <= order < len(ORDERS):
            raise error(f"{name!r} turns in an order that is not about three axes ({order!r})")
    else:  # these count only where rotation is "active"
        vectors["PreRotation"] = vectors["PostRotation"] = np.zeros(3)
    return Model(name, kind, 0, vectors, ORDERS[order])


def _animate(models: dict[int, Model], objects: Objects, links: Links, stack: object, error: ErrorFactory) -> None:
    """Give the models the curves of the animation stack of this number."""
    of_kind = {kind: {n for n, o in objects.items() if o.name == kind}
               for kind in ("AnimationLayer", "AnimationCurveNode", "AnimationCurve")}  # fmt: skip
    layers = _heard(objects, [n for _, n, to, *_ in links if n in of_kind["AnimationLayer"] and to == stack])
    nodes = {link[1]: link[2] for link in links if link[1] in of_kind["AnimationCurveNode"] and link[2] in layers}
    driven = {link[1]: (link[2], str(link[3])) for link in links if link[1] in nodes and len(link) > 3}
    taken: dict[tuple[object, str], object] = {}
    for link in links:
        number, node = link[1], link[2]
        if number not in of_kind["AnimationCurve"] or node not in driven or len(link) < 4:
            continue
        model, what = driven[node]
        if model not in models or what not in ("Lcl Translation", "Lcl Rotation", "Lcl Scaling"):
            continue
        if taken.setdefault((model, what), nodes[node]) != nodes[node]:
            raise error(
                f"{models[model].name!r} is moved by several layers of animation at once; merge them into one (in Maya "  # type: ignore[index]
                "and MotionBuilder: Merge Layers; in Blender: Bake Action)"
            )
        axis = str(link[3])[-1:]
        curve = _curve(objects[number], error)
        if axis in "XYZ" and curve is not None:
            models[model].curves[what, axis] = curve  # type: ignore[index]


def _heard(objects: Objects, layers: list[Property]) -> set[Property]:
    """The layers of animation that count: not muted, of some weight, and the soloed alone where some are."""
    table = {n: properties(objects[n]) for n in layers}

    def stated(layer: Property, name: str, usual: float) -> float:
        value = next(iter(table[layer].get(name, ())), usual)
        return float(value) if isinstance(value, int | float) else usual

    active = {n for n in layers if not stated(n, "Mute", 0.0) and stated(n, "Weight", 100.0) > 0}
    return {n for n in active if stated(n, "Solo", 0.0)} or active


def _curve(node: Node, error: ErrorFactory) -> Curve | None:
    def array(name: str) -> FloatArray:
        found = next((n.properties[0] for n in node.all(name) if n.properties), None)
        if found is not None and not isinstance(found, np.ndarray):
            raise error(f"a curve's {name} is not a list of numbers")
        return np.zeros(0) if found is None else np.asarray(found, dtype=np.float64)

    times, values = array("KeyTime") / TICKS_A_SECOND, array("KeyValueFloat")
    if not len(times):
        return None
    if len(values) != len(times) or (np.diff(times) <= 0).any() or not (np.abs(values) < 1e9).all():
        raise error(f"a curve has {len(times)} times and {len(values)} values that do not fit together")
    flags, data, counts = array("KeyAttrFlags"), array("KeyAttrDataFloat"), array("KeyAttrRefCount")
    kinds, slopes = np.full(len(times), _LINEAR), np.full((len(times), 2), np.nan)
    if len(flags) == len(counts) and len(data) == 4 * len(flags) and counts.sum() == len(times) and (counts >= 0).all():
        flag = np.repeat(flags.astype(np.int64), counts.astype(np.int64))
        kinds = np.where(flag & _CONSTANT, _CONSTANT, np.where(flag & _CUBIC, _CUBIC, _LINEAR))
        stated = np.repeat(data.reshape(-1, 4)[:, :2], counts.astype(np.int64), axis=0)
        slopes = np.where((flag & _USER_TANGENTS > 0)[:, None] & (np.abs(stated) < 1e9), stated, np.nan)
    return Curve(times, values, kinds, slopes)


def _bound(models: dict[int, Model], objects: Objects, links: Links) -> dict[int, FloatArray]:
    """World from model where a skin was bound; where there is no skin, by the poses in the file."""
    out: dict[int, FloatArray] = {}
    for node in objects.values():
        if node.name == "Pose" and node.properties[2:3] == ("BindPose",):
            for entry in node.all("PoseNode"):
                number = next((n.properties[0] for n in entry.all("Node") if n.properties), None)
                out.update(_matrices(models, number, entry.all("Matrix")))
    for link in links:  # a cluster has its model below it
        cluster = objects.get(link[2])
        if link[1] in models and cluster is not None and cluster.properties[2:3] == ("Cluster",):
            out.update(_matrices(models, link[1], cluster.all("TransformLink")))
    return out


def _matrices(models: dict[int, Model], number: object, found: list[Node]) -> Iterator[tuple[int, FloatArray]]:
    for node in found[:1]:
        values = node.properties[0] if node.properties else None
        if number in models and isinstance(values, np.ndarray) and values.shape == (16,):
            yield number, values.astype(np.float64).reshape(4, 4).T


def _units(settings: Table, error: ErrorFactory) -> tuple[float, FloatArray, float]:
    """Metres per unit, our world from the file's, and frames per second."""

    def number(name: str, usual: float) -> float:
        value = (settings.get(name) or (usual,))[0]
        return float(value) if isinstance(value, int | float) else usual

    scale = number("UnitScaleFactor", 1.0) / 100
    if not 1e-6 < scale < 1e6:
        raise error(f"its unit of {scale:g} m is not plausible")
    axes = []
    for name, usual in (("Coord", 0), ("Up", 1)):
        axis, sign = number(f"{name}Axis", usual), number(f"{name}AxisSign", 1)
        if axis not in (0, 1, 2) or abs(sign) != 1:
            raise error(f"its {name}Axis is {axis:g} with the sign {sign:g}, which is not an axis")
        axes.append(sign * np.eye(3)[int(axis)])
    x, z = axes
    if abs(x @ z) > 0:
        raise error("two of its axes coincide")
    mode = int(number("TimeMode", 0))
    fps = number("CustomFrameRate", np.nan) if mode == CUSTOM_RATE else RATES.get(mode, np.nan)
    return scale, np.stack([x, np.cross(z, x), z]), fps if 0 < fps < 1e5 else np.nan
