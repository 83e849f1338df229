"""Reading a skeleton and its animation from an FBX file, whichever program wrote it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.clip_choice import first_clip_notice
from muybridge.motion.formats.fbx.scene import ErrorFactory, Model, Scene, read_scene
from muybridge.motion.formats.fbx.text import read_fbx_document
from muybridge.motion.formats.skeletal.joint_frames import frame_times, motion_from_frames

_DEFAULT_FPS = 30.0
_LIMBS = ("LimbNode", "Limb", "Root")
# Ends of bones that programs write as joints: `Head_End` of `Head`.
_ENDS = ("_End", "_end", "_Nub")


def read_fbx(path: Path, clip: str | int | None = None) -> tuple[Motion, tuple[str, ...]]:
    """Read a file's largest skeleton and one of its animations into metres, Z up.

    FBX 7.0 to 7.7, binary or text. Tangents with weights count as such without; of layers of animation, those that are
    muted are left out, and the others have to move different joints.

    Args:
        path: a `.fbx` file.
        clip: name or number (from 0) of the animation stack; None is the first.

    Returns:
        A Motion at the frame rate of the keys, or the file's where they lie farther apart; one frame where nothing
        moves. Its rest pose is the bind pose of a skin or a pose, else that of no rotation. And notices of what was
        left out, one sentence each.

    Raises:
        FormatError: malformed, no skeleton, no such clip (the message lists those there are), or
            joints below a node that stretches or mirrors.
    """

    def error(problem: str, remedy: str = "export_fbx") -> FormatError:
        return FormatError(f"{path}: {problem}", remedy=remedy)

    with parsing(path, FormatError, "an FBX", "resave_fbx"):
        return _read(Path(path), clip, error)


@dataclass
class FbxRig:
    """The joints of a file.

    Attributes:
        scene: of the file, moved by one of its animations.
        above: the models above the joints, parents first.
        order: the joints and the ends of bones, parents first.
        joints: those of `order` that are joints.
        tips: the end of a joint's bone, by the joint.
        notices: what was left out, one sentence each.
    """

    scene: Scene
    above: list[int]
    order: list[int]
    joints: list[int]
    tips: dict[int, int]
    notices: list[str]

    @property
    def parents(self) -> list[int]:
        """(J,) the parent of each joint among the joints, -1 for a root."""
        place = {n: k for k, n in enumerate(self.joints)}
        return [place.get(self.scene.models[n].parent, -1) for n in self.joints]


def _read(path: Path, clip: str | int | None, error: ErrorFactory) -> tuple[Motion, tuple[str, ...]]:
    rig = read_rig(path, read_scene(read_fbx_document(path), error, clip), clip, error)
    return _motion(rig, error), tuple(rig.notices)


def read_rig(path: Path, scene: Scene, clip: str | int | None, error: ErrorFactory) -> FbxRig:
    """The joints of a scene's largest skeleton.

    Raises:
        FormatError: there is none, or a model is its own ancestor.
    """
    above = {n: _above(scene, n, error) for n in _bones(scene)}
    if not above:
        raise error("holds no skeleton (no limb nodes, no skin and no animated nodes)")
    trees: dict[int, list[list[int]]] = {}
    for line in above.values():
        trees.setdefault(line[0], []).append(line)
    largest = max(trees, key=lambda top: len(trees[top]))
    notices = []
    if len(trees) > 1:
        names = [scene.models[top].name for top in trees if top != largest]
        kept = scene.models[largest].name
        notices.append(f"{path.name}: of {len(trees)} skeletons {kept!r} was read, {', '.join(names)} not")
    if clip is None and len(scene.clips) > 1:
        notices.append(first_clip_notice(path, scene.clips))
    lines = trees[largest]
    limbs = {line[-1] for line in lines}
    wanted: set[int] = set()
    for line in lines:
        wanted.update(line[next(k for k, n in enumerate(line) if n in limbs) :])
    order = _parents_first(scene, wanted)
    higher = _parents_first(scene, {n for line in lines for n in line} - wanted)
    children = {n: [m for m in order if scene.models[m].parent == n] for n in order}
    ends = {n for n in order if scene.models[n].parent in wanted and _is_end(scene, n, children)}
    joints = [n for n in order if n not in ends]
    tips = {n: children[n][0] for n in joints if children[n] and set(children[n]) <= ends}
    return FbxRig(scene, higher, order, joints, tips, notices)


def _bones(scene: Scene) -> list[int]:
    """Limb nodes and what skins are bound to; without any, what an animation of the file moves."""
    bound = {n for link in scene.links if (n := link[1]) in scene.models and link[2] in scene.objects
             and scene.objects[link[2]].properties[2:3] == ("Cluster",)}  # fmt: skip
    bones = [n for n, m in scene.models.items() if m.kind in _LIMBS or n in bound]
    if bones:
        return bones
    moved = {link[2] for link in scene.links if link[0] == "OP" and link[1] in scene.objects
             and scene.objects[link[1]].name == "AnimationCurveNode"}  # fmt: skip
    return [n for n, m in scene.models.items() if n in moved and m.kind not in ("Camera", "Light")]


def _above(scene: Scene, number: int, error: ErrorFactory) -> list[int]:
    """A model and those above it, the topmost first."""
    line: list[int] = []
    while number:
        line.insert(0, number)
        number = scene.models[number].parent
        if len(line) > len(scene.models):
            raise error(f"{scene.models[line[-1]].name!r} is its own ancestor")
    return line


def _motion(rig: FbxRig, error: ErrorFactory) -> Motion:
    scene, kept = rig.scene, rig.joints
    fps, times = even_times(scene, rig.order, error)
    turns, places, sizes = forward(rig, times, error)
    rest = rest_turns(rig)
    tips = np.full((len(kept), 3), np.nan)
    for n, end in rig.tips.items():
        tips[kept.index(n)] = scene.metres * sizes[n] * scene.models[end].vectors["Lcl Translation"]
    return motion_from_frames(
        [scene.models[n].name for n in kept], rig.parents,
        scene.axes @ np.stack([turns[n] for n in kept], axis=1),
        scene.metres * np.stack([places[n] for n in kept], axis=1) @ scene.axes.T,
        scene.axes @ np.stack([rest[n] for n in kept]), tips, fps, scene.axes, _bound_translations(scene, kept),
    )  # fmt: skip


def _bound_translations(scene: Scene, order: list[int]) -> FloatArray:
    """(J, 3) metres from the parent, in its axes, in the pose that skins are bound in; NaN where there is none."""
    out = np.full((len(order), 3), np.nan)
    for k, n in enumerate(order):
        parent = scene.models[n].parent
        if n not in scene.bound:
            continue
        if parent not in order:
            out[k] = scene.metres * scene.axes @ scene.bound[n][:3, 3]
        elif parent in scene.bound:
            u, size, vt = np.linalg.svd(scene.bound[parent][:3, :3])
            if size.min() > 1e-9:
                out[k] = scene.metres * (u @ vt).T @ (scene.bound[n][:3, 3] - scene.bound[parent][:3, 3])
    return out


def _parents_first(scene: Scene, wanted: set[int]) -> list[int]:
    """In the order of the file, but none before its parent."""
    order: list[int] = []
    while len(order) < len(wanted):
        for n in scene.models:
            above = scene.models[n].parent
            if n in wanted and n not in order and (above in order or above not in wanted):
                order.append(n)
    return order


def _is_end(scene: Scene, number: int, children: dict[int, list[int]]) -> bool:
    model = scene.models[number]
    named = model.name in [scene.models[model.parent].name + end for end in _ENDS]
    return named and not children[number] and not model.curves


def even_times(scene: Scene, order: list[int], error: ErrorFactory) -> tuple[float, FloatArray]:
    """Frames per second, and (T,) seconds of the frames from the first key of some models to the last."""
    curves = [curve for n in order for curve in scene.models[n].curves.values()]
    fps = scene.fps if np.isfinite(scene.fps) else _DEFAULT_FPS
    if not curves:
        return fps, np.zeros(1)
    first, last = min(c.times[0] for c in curves), max(c.times[-1] for c in curves)
    finest = max((c.times for c in curves), key=len)
    if len(finest) > 1:
        keyed = float(1 / np.median(np.diff(finest)))
        # Keys that are farther apart than frames were set by hand, or left out where they changed nothing.
        fps = fps if keyed < 0.75 * fps else keyed
    fps = float(round(fps)) if abs(fps - round(fps)) < 1e-3 else fps
    return fps, frame_times(first, last, fps, sum(len(c.times) for c in curves), error)


def forward(
    rig: FbxRig, times: FloatArray, error: ErrorFactory, still: bool = False
) -> tuple[dict[int, FloatArray], dict[int, FloatArray], dict[int, float]]:
    """Orientation (T, 3, 3), place (T, 3) and size in the scene of a rig's models; `still`: without animation."""
    scene = rig.scene
    turns: dict[int, FloatArray] = {0: np.broadcast_to(np.eye(3), (len(times), 3, 3))}
    places: dict[int, FloatArray] = {0: np.zeros((len(times), 3))}
    sizes = {0: 1.0}
    order = _parents_first(scene, {*rig.above, *rig.order})
    for n in order:
        model = replace(scene.models[n], curves={}) if still else scene.models[n]
        size = _size(model, times, error)
        turn = model.turns(model.over_time("Lcl Rotation", times))
        place = model.over_time("Lcl Translation", times) + shift_of_pivots(model, turn, size)
        p = model.parent
        turns[n] = turns[p] @ turn
        places[n] = places[p] + sizes[p] * (turns[p] @ place[..., None])[..., 0]
        sizes[n] = sizes[p] * size
    return turns, places, sizes


def shift_of_pivots(model: Model, turns: FloatArray, size: float) -> FloatArray:
    """(T, 3) what a model's pivots add to its translation where it turns by (T, 3, 3)."""
    v = model.vectors
    within = v["ScalingOffset"] + (1 - size) * v["ScalingPivot"] - v["RotationPivot"]
    return np.asarray(v["RotationOffset"] + v["RotationPivot"] + turns @ within)


def _size(model: Model, times: FloatArray, error: ErrorFactory) -> float:
    scale = model.over_time("Lcl Scaling", times)
    size = float(scale[0, 0])
    if not size > 0 or np.abs(scale - size).max() > 1e-3 * size:
        raise error(f"{model.name!r} stretches, mirrors or changes the size of what is below it; apply its scale (in "
                    "Blender: Apply Scale; in Maya: Freeze Transformations)")  # fmt: skip
    return size


def rest_turns(rig: FbxRig) -> dict[int, FloatArray]:
    """World from joint at rest, (3, 3) each: as bound, else as its node is without rotation of its own."""
    scene = rig.scene
    still = np.zeros((1, 3))
    rest: dict[int, FloatArray] = {0: np.eye(3)}
    for n in rig.above:
        model = scene.models[n]
        rest[n] = rest[model.parent] @ model.turns(model.vectors["Lcl Rotation"][None])[0]
    for n in rig.order:
        model = scene.models[n]
        rest[n] = rest[model.parent] @ model.turns(still)[0]
        if n in scene.bound and np.isfinite(scene.bound[n]).all():
            u, size, vt = np.linalg.svd(scene.bound[n][:3, :3])
            if size.min() > 1e-9 and np.linalg.det(u @ vt) > 0:
                rest[n] = u @ vt
    return rest
