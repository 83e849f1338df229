"""Motion matching from files: a database of takes, and a steered figure as a take."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles, load_role_map
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.characters.takes import clip_names, takes_of
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.contacts.planting import plant_feet
from muybridge.motion.formats.registry import ReadOptions, can_use
from muybridge.motion.matching import (
    Built,
    FeatureOptions,
    Goal,
    Ignored,
    MatchDatabase,
    Steered,
    SteerOptions,
    build_database,
    steer,
)
from muybridge.motion.matching import Path as GoalPath

_IGNORED = re.compile(r"(?P<clip>.+):(?P<start>[\d.]+)-(?P<end>[\d.]+)")
# Times the seconds that a path takes at its speed, after which a figure that has not arrived gives up.
_PATIENCE = 3.0


@dataclass(frozen=True)
class BuildRequest:
    """What a database is made of.

    Attributes:
        takes: files of motion, folders of them, session folders.
        fps: frames per second; None takes those of the first take.
        mirrored: whether each clip is there a second time with left and right exchanged.
        ignore: parts of clips, as CLIP:FROM-TO in seconds.
        clip: the animation to take, of takes that hold several.
        map: file of the roles of the skeleton's joints.
    """

    takes: Sequence[Path]
    fps: float | None = None
    mirrored: bool = False
    ignore: Sequence[str] = ()
    clip: str | None = None
    map: Path | None = None


def build_from_files(
    request: BuildRequest, options: FeatureOptions, advance: Callable[[str], None] | None = None
) -> Built:
    """Read takes and make a database of them.

    Args:
        request: what it is made of.
        options: what is compared.
        advance: called with the name of each file that is about to be read.

    Raises:
        MuybridgeError: a file cannot be read or holds no motion, or as `build_database`.
    """
    found = takes_of(request.takes, request.clip)
    names = clip_names(found.files, None, ())
    ignore = [parse_ignored(text) for text in request.ignore]
    motions, notices = [], list(found.notices)
    for file in found.files:
        if advance is not None:
            advance(file.name)
        motion, said = _read_motion(file, request.clip)
        motions.append(motion)
        notices += said
    roles = None if request.map is None else find_roles(motions[0].skeleton, map=load_role_map(request.map))
    built = build_database(motions, names, options, fps=request.fps, mirrored=request.mirrored, ignore=ignore,
                           role_map=roles)  # fmt: skip
    return replace(built, notices=tuple(dict.fromkeys((*notices, *built.notices))))


def _read_motion(file: Path, clip: str | None) -> tuple[Motion, tuple[str, ...]]:
    take = read_for_command(file, ReadOptions(clip=clip if can_use(file, "clip") else None))
    if take.motion is None:
        raise MuybridgeError(f"{file}: holds points, not a motion", remedy="fit_points")
    return take.motion, take.notices


def parse_ignored(text: str) -> Ignored:
    """A part of a clip, written CLIP:FROM-TO in seconds.

    Raises:
        MuybridgeError: it is written otherwise.
    """
    found = _IGNORED.fullmatch(text)
    try:
        if found is not None:
            return Ignored(found["clip"], float(found["start"]), float(found["end"]))
    except ValueError:
        pass
    raise MuybridgeError(f"{text!r} names no part of a clip; write CLIP:FROM-TO in seconds, such as walk:1.5-2.25")


def walk_of(
    database: MatchDatabase, goal: Goal, seconds: float | None, options: SteerOptions, plant: bool = False
) -> Steered:
    """Let a figure follow a goal.

    Args:
        database: of what is known.
        goal: what steers it.
        seconds: after which it ends at the latest; None, of a path, gives it time enough.
        options: how it is steered.
        plant: whether feet are planted afterwards.
    """
    if seconds is None:
        assert isinstance(goal, GoalPath)
        seconds = _PATIENCE * goal.length / goal.speed + 5.0
    steered = steer(database, goal, seconds, options)
    if plant:
        steered = replace(steered, motion=plant_feet(steered.motion, roles=database.roles).motion)
    return steered
