"""Motion graphs of takes: what is read and brought together, and walks that are written."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.characters.takes import take_names
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.blending.material import same_skeleton
from muybridge.motion.character.character import Character
from muybridge.motion.contacts.planting import plant_feet
from muybridge.motion.editing.channels import body_joint
from muybridge.motion.editing.resampling import resample
from muybridge.motion.formats.registry import ReadOptions, can_use
from muybridge.motion.graphs.following import follow_path
from muybridge.motion.graphs.graph import Built, GraphOptions, MotionGraph, build_graph
from muybridge.motion.graphs.paths import Deviation, FloorPath, deviation
from muybridge.motion.graphs.walks import Walk, action_walk, random_walk, walk_motion
from muybridge.motion.retargeting.solver import retarget
from muybridge.wording import counted

Advance = Callable[[int], object]
SECONDS = 60.0  # of a walk that nobody gave a length


@dataclass(frozen=True, eq=False)
class Clips:
    """Takes, ready to be a graph.

    Attributes:
        motions: of one skeleton and frame rate.
        names: of the takes.
        labels: what is done in them.
        notices: what was assumed or changed, one sentence each.
    """

    motions: tuple[Motion, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    notices: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Walked:
    """A walk and its motion.

    Attributes:
        walk: in the graph.
        motion: of it.
        trail: (T, 2) metres, where the hips are over the floor.
        deviation: from the path; None without one.
        notices: one sentence each.
    """

    walk: Walk
    motion: Motion
    trail: FloatArray
    deviation: Deviation | None
    notices: tuple[str, ...]


def label_of(name: str) -> str:
    """What is done in a take, by its name: without the number at its end, in lower case."""
    stem = re.sub(r"[\s_.\-()]*\d+[\s_.\-()]*$", "", name).strip(" _.-").lower()
    return stem if re.search(r"[a-z]", stem) else name.lower()


def read_clips(
    takes: Sequence[Path], clip: str | None = None, labels: Sequence[str] = (), fps: float | None = None,
    advance: Advance | None = None,
) -> Clips:  # fmt: skip
    """The takes as clips of the first one's skeleton and frame rate; what moves another body is put onto that one.

    Args:
        takes: files of motion.
        clip: name or number of the animation, of files that hold several.
        labels: one for each take; none takes them from the names.
        fps: frames per second; None for those of the first take.
        advance: called with 1 behind each take.

    Raises:
        FormatError: a file cannot be read, or holds points.
        MuybridgeError: a take has no frames, is of another skeleton that has no human body, or there are more or fewer
            labels than takes.
    """
    if labels and len(labels) != len(takes):
        raise MuybridgeError(
            f"there are {counted(len(labels), 'label')} for {counted(len(takes), 'take')}; give one for each, in order"
        )
    notices: list[str] = []
    motions: list[Motion] = []
    for path in takes:
        take = read_for_command(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
        if take.motion is None:
            raise FormatError(f"{path}: holds points, which have no skeleton", remedy="fit_points")
        notices += take.notices
        motion = take.motion
        if not motions and fps is not None and motion.fps != fps:
            notices.append(f"{path.name} is resampled from {motion.fps:g} to {fps:g} frames/s")
            motion = resample(motion, fps)
        motion, more = _like_the_first(motions[0] if motions else motion, motion, (takes[0].name, path.name))
        notices += more
        motions.append(motion)
        if advance is not None:
            advance(1)
    names = take_names(takes)
    return Clips(tuple(motions), tuple(names), tuple(labels) or tuple(label_of(n) for n in names), tuple(notices))


def _like_the_first(first: Motion, motion: Motion, names: tuple[str, str]) -> tuple[Motion, list[str]]:
    """A motion on the first one's skeleton, and what had to be done for that."""
    try:
        found, notes = same_skeleton([first, motion], names)
        return found[1], notes
    except MuybridgeError as error:
        if error.remedy != "other_skeleton":
            raise
        why = error
    roles = [find_motion_roles(m) for m in (motion, first)]
    if any(r.missing for r in roles):
        raise why
    skeleton = first.skeleton
    character = Character(Path(names[0]), skeleton, np.zeros(3), first.select(slice(0, 1)))
    placed = retarget(motion, roles[0].roles, character, roles[1].roles).motion
    if placed.skeleton.sliding != skeleton.sliding:
        raise why
    found, notes = same_skeleton([first, placed], names)
    return found[1], [f"{names[1]} moves another body and is put onto that of {names[0]}", *notes]


def build(clips: Clips, options: GraphOptions | None = None, advance: Advance | None = None) -> Built:
    """The graph of takes; see `build_graph`."""
    return build_graph(clips.motions, clips.names, clips.labels, options, advance)


def describe(built: Built, names: Sequence[str]) -> list[str]:
    """What a graph is like, and how its threshold came about, one line each."""
    graph, choice = built.graph, built.choice
    lines = []
    if built.passed_over:
        short = ", ".join(names[k] for k in built.passed_over[:8]) + (", ..." if len(built.passed_over) > 8 else "")
        lines.append(f"passed over, since they are no longer than the window of {graph.window} frames: {short}")
    how = "chosen" if choice.chosen else "given"
    lines.append(
        f"threshold {100 * choice.threshold:.3g} cm, {how}; {100 * choice.needed:.3g} cm would connect nine in ten of "
        f"all frames that can be, and the motions go {100 * choice.usual:.3g} cm in half a window"
    )
    if built.rough:
        lines.append(
            f"{counted(built.rough, 'transition')} left out, in which a joint would accelerate harder than in the takes"
        )
    inside = np.bincount(graph.clip_of[graph.component], minlength=len(graph.names))
    lost = [n for n, c in zip(graph.names, inside, strict=True) if not c]
    if lost:
        some = ", ".join(lost[:8]) + (", ..." if len(lost) > 8 else "")
        lines.append(f"not connected with the others: {some}")
    return [*lines, summary(graph)]


def summary(graph: MotionGraph) -> str:
    """A line on a graph's size."""
    connected = int(graph.component.sum())
    return (
        f"{counted(len(graph.names), 'clip')}, {len(graph)} frames at {graph.fps:g} frames/s, of which {connected} "
        f"({connected / len(graph):.0%}) are connected by {counted(len(graph.transitions), 'transition')} of "
        f"{graph.window / graph.fps:.2f} s"
    )


def walk(
    graph: MotionGraph, path: FloorPath | None = None, seconds: float | None = None, actions: Sequence[str] = (),
    seed: int = 0, plant: bool = False, advance: Advance | None = None,
) -> Walked:  # fmt: skip
    """A walk along a path, through actions, or wherever chance leads.

    Args:
        graph: to walk in.
        path: to follow; None for none.
        seconds: of a walk without path; None for a minute.
        actions: labels of clips, each for an equal part of the path or of the time.
        seed: of a walk without path.
        plant: whether feet are planted in the result.
        advance: called with the number of places of the path that were passed.

    Raises:
        MuybridgeError: as `follow_path` and `action_walk`; the walk is to be too short or long; or feet are to be
            planted that are not known.
    """
    if path is not None:
        found = follow_path(graph, path, actions, advance=advance)
    else:
        lasts = SECONDS if seconds is None else seconds
        if not graph.window / graph.fps <= lasts <= 86400:
            raise MuybridgeError(f"a walk lasts from {graph.window / graph.fps:.2g} to 86,400 seconds, not {lasts:g}")
        found = action_walk(graph, actions, lasts, seed) if actions else random_walk(graph, lasts, seed)
    motion, notices = walk_motion(graph, found), []
    body = body_joint(graph.clip(0))
    if plant:
        roles = find_motion_roles(motion)
        try:
            planted = plant_feet(motion, roles=roles.roles)
        except ValueError as error:
            raise MuybridgeError(f"feet cannot be planted: {error}") from None
        motion = planted.motion
        notices.append(f"feet planted; an ankle was moved by {100 * planted.moved_feet_m:.1f} cm at most")
    trail = motion.joint_positions_world()[:, body, :2]
    off = None if path is None else deviation(path, trail)
    return Walked(found, motion, trail, off, tuple(notices))


def describe_walk(graph: MotionGraph, walked: Walked, path: FloorPath | None) -> str:
    """A line on a walk: how long it is, and how far from the path it gets."""
    count = len(walked.walk.transitions)
    goes = float(np.linalg.norm(np.diff(walked.trail, axis=0), axis=1).sum())
    text = (
        f"{counted(len(walked.motion), 'frame')} ({len(walked.motion) / graph.fps:.1f} s), {goes:.1f} m, "
        f"{counted(count, 'transition')}"
    )
    off = walked.deviation
    if off is None or path is None:
        return text
    return (
        f"{text}; from the path of {path.length:.1f} m: {off.mean:.2f} m on average, {off.most:.2f} m at most (at "
        f"{off.at:.1f} m), and {off.end:.2f} m at its end"
    )


def clip_lines(graph: MotionGraph) -> list[str]:
    """A line on each clip, or on each action where there are many clips."""
    inside = np.bincount(graph.clip_of[graph.component], minlength=len(graph.names))
    lengths = np.diff(graph.starts)
    if len(graph.names) <= 20:
        return [f"{name} ({label}): {n} frames, {int(c)} connected"
                for name, label, n, c in zip(graph.names, graph.labels, lengths, inside, strict=True)]  # fmt: skip
    out = []
    for label in sorted(set(graph.labels)):
        of = np.array([label == one for one in graph.labels])
        out.append(
            f"{label}: {counted(int(of.sum()), 'clip')}, {lengths[of].sum()} frames, {inside[of].sum()} connected"
        )
    return out
