"""All edits by name: the table from which the command line, its help and its page of documentation are made.

A step is a function from a motion (or points) to another, and one row of `STEPS`. Steps are written one behind the
other, each with its arguments: `trim 0.5 3.2 in-place loop`.
"""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.geometry.smoothing.filters import METHODS
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.contacts.planting import plant_feet
from muybridge.motion.editing import cutting, filtering, looping, naming, placing, reducing, resampling, root_path
from muybridge.motion.editing.arguments import Parameter, Step, Unresolved, bind, meant, resolved
from muybridge.motion.editing.channels import body_roles, check_editable, duration, frame_count, role_map
from muybridge.motion.editing.mirroring import mirror, rest_images
from muybridge.motion.editing.pairing import find_sides, pair_names
from muybridge.motion.formats.points.world import FARTHEST
from muybridge.motion.signals.steps import SIGNAL_STEPS
from muybridge.motion.take import Take
from muybridge.wording import counted


@dataclass(frozen=True)
class Call:
    """A step with its arguments.

    Attributes:
        step: which.
        values: of its parameters, by name.
        words: as the user wrote them.
    """

    step: Step
    values: dict[str, Unresolved]
    words: tuple[str, ...]


def _edited(take: Take, function: Callable[..., Any], *args: Any, **values: Any) -> Take:
    """The take with its motion or points edited. What else a C3D holds is of the unedited take: it is left out."""
    if take.motion is not None:
        return replace(take, motion=function(take.motion, *args, **values), keys=None)
    return replace(take, points=function(take.points, *args, **values), c3d=None)


def _of(take: Take) -> Motion | Points3D:
    thing = take.motion if take.motion is not None else take.points
    assert thing is not None  # a take has the one or the other
    return thing


def _motion(take: Take) -> Motion:
    assert take.motion is not None  # checked before a step is applied
    return take.motion


def _roles(take: Take) -> dict[str, int]:
    """Role -> joint; empty where there is no human body."""
    return role_map(take).roles


def _trim(take: Take, start: float, end: float | None) -> tuple[Take, str]:
    thing = _of(take)
    a, b = cutting.trim_frames(thing, start, end)
    out = replace(_edited(take, cutting.trim, start, end), start=take.start + a / thing.fps)
    return out, f"frames {a + 1} to {b} of {frame_count(thing)} are kept, {(b - a) / thing.fps:.3f} s"


def _resample(take: Take, fps: float) -> tuple[Take, str]:
    thing = _of(take)
    out = _edited(take, resampling.resample, fps)
    return out, f"{thing.fps:g} to {fps:g} frames/s, {frame_count(thing)} to {counted(frame_count(_of(out)), 'frame')}"


def _mirror(take: Take, plane: str) -> tuple[Take, str]:
    if take.motion is None:
        assert take.points is not None
        names = take.points.landmarks.names
        pairs = pair_names(names)
        first = f", such as {names[next(iter(pairs))]} with {names[next(iter(pairs.values()))]}" if pairs else ""
        alone = len(names) - 2 * len(pairs)
        note = f"{counted(len(pairs), 'pair')} of points exchanged{first}; {alone} without a counterpart"
        return _edited(take, mirror, plane), note
    skeleton = take.motion.skeleton
    roles = _roles(take)
    sides = find_sides(skeleton, roles)
    pairs = {j: p for j, p in enumerate(sides.partner) if p > j}
    a, b = next(iter(pairs.items()))
    how = ", ".join(f"{count} by {source}" for source, count in sides.how.items() if count)
    note = (f"{counted(len(pairs), 'pair')} of joints exchanged ({how}), such as {skeleton.names[a]} with "
            f"{skeleton.names[b]}; {len(skeleton) - 2 * len(pairs)} in the middle")  # fmt: skip
    if sides.alone:
        note += f", of which without a counterpart {', '.join(skeleton.names[j] for j in sides.alone[:5])}"
    angle = np.degrees(rest_images(skeleton, sides).largest_angle)
    if angle > 1:
        note += f"; the sides of the rest pose differ by up to {counted(round(angle), 'degree')}, which is allowed for"
    return _edited(take, mirror, plane, roles), note


def _loop(take: Take, shortest: float | None, longest: float | None, travel: looping.Travel) -> tuple[Take, str]:
    motion = _motion(take)
    cut = looping.find_loop(motion, shortest, longest)
    part = motion.select(slice(cut.start, cut.end + 1))
    way = looping.kept_way(part, travel)
    out = replace(take, motion=looping.close_loop(part, travel), start=take.start + cut.start / motion.fps, keys=None)
    note = (f"frames {cut.start + 1} to {cut.end + 1} of {len(motion)}, {(cut.end - cut.start) / motion.fps:.3f} s; "
            f"closed a gap of {cut.pose_gap * 1e3:.0f} mm and {cut.speed_gap * 1e2:.0f} cm/s per joint")  # fmt: skip
    goes, turns = float(np.linalg.norm(way.places[-1] - way.places[0])), float(np.degrees(way.yaw[-1] - way.yaw[0]))
    kept = [*([f"{goes:.2f} m"] if goes > 1e-6 else []), *([f"a turn of {turns:.0f} degrees"] if turns else [])]
    return out, note + (f"; each round goes on by {' and '.join(kept)}" if kept else "; it returns to its place")


def _in_place(take: Take, smoothing: float, turning: str) -> tuple[Take, str]:
    roles = _roles(take)
    path = root_path.ground_path(_motion(take), smoothing, roles=roles)
    return _edited(take, root_path.in_place, smoothing, turning == "remove", roles), f"{_of_path(path)} taken out"


def _root_motion(take: Take, name: str | None, smoothing: float, turning: str) -> tuple[Take, str]:
    before = _motion(take)
    roles = _roles(take)
    path = root_path.ground_path(before, smoothing, turning == "follow", roles)
    out = _edited(take, root_path.extract_root_motion, name, smoothing, turning == "follow", roles)
    bone, new = _motion(out).skeleton.names[0], len(_motion(out).skeleton) - len(before.skeleton)
    out = replace(out, humanoid={part: j + new for part, j in take.humanoid.items()})
    return out, f"{_of_path(path)} given to {'the new bone' if new else 'the bone'} {bone}"


def _of_path(path: root_path.GroundPath) -> str:
    length = float(np.linalg.norm(np.diff(path.places, axis=0), axis=1).sum())
    turned = round(float(np.degrees(path.yaw[-1] - path.yaw[0])))
    return f"a path of {length:.2f} m with a turn of {counted(turned, 'degree')} is"


def _turn(take: Take, angle: float, about: placing.About) -> tuple[Take, str]:
    where = "where the take starts" if about == "start" else "the origin"
    return _edited(take, placing.turn, angle, about), f"by {np.degrees(angle):g} degrees about {where}"


def _move(take: Take, x: float, y: float, z: float, start: str) -> tuple[Take, str]:
    first = "the start put over the origin, then " if start == "origin" else ""
    return _edited(take, placing.move, x, y, z, start), f"{first}by {x:g}, {y:g}, {z:g} m"


def _floor(take: Take, height: float) -> tuple[Take, str]:
    lift = height - placing.lowest_height(_of(take))
    return _edited(take, placing.put_on_floor, height), f"moved {'up' if lift >= 0 else 'down'} by {abs(lift):.3f} m"


def _plant(take: Take) -> tuple[Take, str]:
    motion = _motion(take)
    try:
        planted = plant_feet(motion, roles=body_roles(take))
    except ValueError as error:  # legs that are not known
        raise MuybridgeError(str(error)) from error
    count = sum(len(contact_spans(planted.contacts.contact[:, k, p])) for k in range(2) for p in range(2))
    note = (f"{counted(count, 'contact')} of heels and balls held still; ankles are moved by at most "
            f"{planted.moved_feet_m * 1e3:.0f} mm, the root by {planted.moved_root_m * 1e3:.0f} mm")  # fmt: skip
    return replace(take, motion=planted.motion, keys=None), note


def _smooth(take: Take, cutoff: float | None, method: str) -> tuple[Take, str]:
    if method == "butterworth" and cutoff is None:
        cutoff = filtering.cutoff_of(_of(take))
        return _edited(take, filtering.smooth, cutoff, method), f"butterworth, {cutoff:.1f} Hz by residual analysis"
    return _edited(take, filtering.smooth, cutoff, method), method + (f", {cutoff:g} Hz" if cutoff else "")


def _reduce(take: Take, tolerance: float, angle: float) -> tuple[Take, str]:
    motion = _motion(take)
    reduced = reducing.reduce_keys(motion, tolerance, angle)
    every = reduced.keys.rotations.size + reduced.keys.positions.size
    note = f"{every} keys to {reduced.keys.count}; no joint is moved by more than {reduced.error * 1e3:.2f} mm"
    return replace(take, motion=reduced.motion, keys=reduced.keys), note


def _rename(take: Take, profile: str) -> tuple[Take, str]:
    motion = _motion(take)
    roles = body_roles(take)
    new = naming.new_names(motion, profile, roles)
    moved = naming.displaced_names(motion.skeleton.names, new)
    kept = [name for name in motion.skeleton.names if name not in new and name not in moved]
    note = f"{counted(len(new), 'joint')} named as in {profile}"
    note += "".join(f"; another joint of the name {old} is now {free}" for old, free in moved.items())
    note += f"; without a name there, and kept: {', '.join(kept[:8])}{' ...' if len(kept) > 8 else ''}" if kept else ""
    return _edited(take, naming.rename_joints, profile, roles), note


def _scale(take: Take, factor: float) -> tuple[Take, str]:
    return _edited(take, placing.scale, factor), f"by {factor:g}"


_SMOOTHING = Parameter("smoothing", "time", "faster movements, such as swaying, stay with the body (0.3 s)", 0.3)
STEPS: dict[str, Step] = {step.name: step for step in (
    Step("trim", "keep the frames from START up to END, in seconds", _trim, (
        Parameter("start", "time", "first time that is kept", required=True),
        Parameter("end", "time", "first time that is left out (the end of the clip)")), points=True),
    Step("resample", "change the frame rate; the movement stays the same", _resample, (
        Parameter("fps", "frame rate", "frames per second", required=True),), points=True),
    Step("mirror", "exchange left and right", _mirror, (
        Parameter("plane", "name", "along the heading at the start, or the world's plane x = 0 or y = 0 (start)",
                  "start", choices=("start", "x", "y")),), points=True),
    Step("loop", "cut where the clip repeats best and close the gap", _loop, (
        Parameter("shortest", "time", "shortest loop (half of the clip)"),
        Parameter("longest", "time", "longest loop (the whole clip)"),
        Parameter("travel", "name", "whether repeats travel on or close at the start (auto: on if it travels)", "auto",
                  choices=("auto", "keep", "close")))),
    Step("in-place", "remove the travel over the ground, as on a treadmill", _in_place, (
        _SMOOTHING, Parameter("turning", "name", "whether the body still turns (keep)", "keep",
                              choices=("keep", "remove")))),
    Step("root-motion", "move the travel over the ground to a root bone", _root_motion, (
        _SMOOTHING, Parameter("turning", "name", "whether the bone turns with the body (follow)", "follow",
                              choices=("follow", "ignore")),
        Parameter("name", "name", "of the new bone, where there is none above the hips yet (root)"))),
    Step("turn", "turn about the vertical, in degrees, counter-clockwise from above", _turn, (
        Parameter("angle", "angle", "degrees; 90 is a quarter of a turn to the left", required=True),
        Parameter("about", "name", "where the body starts, or the origin (start)", "start",
                  choices=("start", "origin"))), points=True),
    Step("move", "move by metres along the world's axes, z up", _move, (
        Parameter("x", "length", "metres (0)", 0.0), Parameter("y", "length", "metres (0)", 0.0),
        Parameter("z", "length", "metres up (0)", 0.0),
        Parameter("start", "name", "from where: here, or origin to put the start over the origin first (here)", "here",
                  choices=("here", "origin"))), points=True),
    Step("floor", "move up or down until the lowest point is on the floor", _floor, (
        Parameter("height", "length", "metres of the lowest joint, bone end or point (0)", 0.0),), points=True),
    Step("plant", "lock heels and balls of the feet to the ground while they stand", _plant),
    Step("smooth", "smooth over time, without delay", _smooth, (
        Parameter("cutoff", "frequency", "in Hz, for butterworth only (found by residual analysis)"),
        Parameter("method", "name", "the filter (butterworth)", "butterworth", choices=tuple(METHODS))), points=True),
    Step("reduce", "remove keys that are not needed", _reduce, (
        Parameter("tolerance", "small length", "how far any joint may move, in millimetres (1)", 1e-3),
        Parameter("angle", "angle", "how far any joint may turn, in degrees (0.5)", float(np.radians(0.5))))),
    Step("rename", "rename the joints to those of another program", _rename, (
        Parameter("profile", "name", "the program", required=True, choices=tuple(PROFILES)),)),
    Step("scale", "scale bones and paths by a factor", _scale, (
        Parameter("factor", "factor", "above zero; 120% is 1.2", required=True),), points=True),
    *SIGNAL_STEPS,
)}  # fmt: skip


def parse_steps(words: Sequence[str]) -> tuple[Call, ...]:
    """Steps from words: a step's name, then its arguments, up to the next name of a step.

    Raises:
        MuybridgeError: a word is no step, or no argument of the step before it.
    """
    groups: list[list[str]] = []
    for word in words:
        if word in STEPS:
            groups.append([word])
        elif groups:
            groups[-1].append(word)
        else:
            hint = meant(word.lower().replace("_", "-"), STEPS)
            raise MuybridgeError(f"step 1: there is no step {word!r}; the steps are {', '.join(STEPS)}{hint}")
    if not groups:
        raise MuybridgeError(f"there is no step to do; the steps are {', '.join(STEPS)}")
    calls = []
    for k, (name, *rest) in enumerate(groups, start=1):
        try:
            calls.append(Call(STEPS[name], bind(STEPS[name].parameters, rest), (name, *rest)))
        except MuybridgeError as error:
            # A word that looks like the next step's name explains more than that it is no argument.
            near = [m for w in rest for m in difflib.get_close_matches(w.lower(), STEPS, n=1, cutoff=0.75)]
            hint = f"; if a step was meant, it is {near[0]!r}" if near else ""
            raise error.reworded(f"step {k}, {name}: {error.message}{hint}") from error
    return tuple(calls)


def edit_take(take: Take, calls: Sequence[Call], tell: Callable[[str], object] | None = None) -> tuple[Take, list[str]]:
    """Apply steps one after the other.

    Args:
        take: a motion or points.
        calls: the steps, of `parse_steps`.
        tell: called with each sentence as soon as its step is done.

    Returns:
        The edited take, and what each step did, a sentence each.

    Raises:
        MuybridgeError: a step cannot be done with the take; the message names the step.
    """
    check_editable(_of(take))
    notes = []
    for k, call in enumerate(calls, start=1):
        label = f"step {k}, {' '.join(call.words)}"
        if take.motion is None and not call.step.points:
            raise MuybridgeError(f"{label}: needs a motion, not points", remedy="fit_points")
        before = take.c3d
        try:
            take, note = call.step.apply(take, **resolved(call.values, _of(take).fps))
        except MuybridgeError as error:
            raise error.about(label) from error
        thing = _of(take)
        _check_room(label, thing)
        if before is not None and take.c3d is None and (before.events or before.analog or before.force_platforms):
            note += "; events, analog channels and force plates of the C3D are left out"
        notes.append(f"{label}: {note} ({counted(frame_count(thing), 'frame')}, {duration(thing):.3f} s)")
        if tell is not None:
            tell(notes[-1])
    return take, notes


def _check_room(label: str, thing: Motion | Points3D) -> None:
    """Check that a take can still be read when it is written: `check_room` refuses what is farther away."""
    if isinstance(thing, Points3D):
        places = np.nan_to_num(thing.points_world)
    else:
        places = np.concatenate([thing.root_positions_world, thing.skeleton.offsets])
    farthest = float(np.abs(places).max())
    if not farthest <= FARTHEST:
        raise MuybridgeError(f"{label}: takes the body {farthest:.3g} m away; {FARTHEST:g} m are the most")
