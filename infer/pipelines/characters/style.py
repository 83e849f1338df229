"""A style from files of motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import CORE_ROLES, find_motion_roles, load_role_map
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.assistance.takes import same_skeleton
from muybridge.motion.character.character import Character
from muybridge.motion.formats.registry import ReadOptions, can_use
from muybridge.motion.retargeting.solver import RetargetOptions, retarget
from muybridge.motion.style import Examples, Style, StyleOptions, examples_of, learn_style
from muybridge.wording import counted

Advance = Callable[[int], object]


@dataclass(frozen=True)
class StyleRequest:
    """What a style is learned from.

    Attributes:
        takes: files of motion; the first one's skeleton is that of the style.
        mirror: whether each pose counts a second time, with left and right exchanged.
        clip: name or number of the animation, of takes that hold several.
        map, take_map: files with the roles of the joints of the first take's skeleton and of others.
        most: examples.
        options: how it is learned.
    """

    takes: Sequence[Path]
    mirror: bool = False
    clip: str | None = None
    map: Path | None = None
    take_map: Path | None = None
    most: int = 1000
    options: StyleOptions = field(default_factory=StyleOptions)


@dataclass(frozen=True, eq=False)
class Learned:
    """A style, and what was assumed, one sentence each."""

    style: Style
    notices: tuple[str, ...]


def learn_from_files(request: StyleRequest, advance: Advance | None = None) -> Learned:
    """Read takes one after the other, and learn a style from their poses. Only the examples are kept in memory.

    Args:
        request: what from.
        advance: called with 1 behind each take.

    Raises:
        FormatError: a file cannot be read, or holds points.
        MuybridgeError: a take is too short, its joints slide, it is of another skeleton and joints of one of both are
            not recognised, or all together have too few poses.
    """
    notices: list[str] = []
    first: Motion | None = None
    roles: dict[str, int] = {}
    examples: Examples | None = None
    for path in request.takes:
        motion, said = _read(path, request.clip)
        notices += said
        if first is None:
            first, roles = motion.select(slice(0, 1)), _roles(path, motion, request.map, "role_map")
        elif not same_skeleton(motion.skeleton, first.skeleton):
            theirs = _roles(path, motion, request.take_map, "take_map")
            motion = _carried(motion, theirs, first, roles)
            notices.append(f"{path.name} moves another body; its poses are put onto that of {request.takes[0].name}")
        else:
            order = [motion.skeleton.index(n) for n in first.skeleton.names]
            motion = replace(motion, quat_wxyz=motion.quat_wxyz[:, order], translations=None,
                             skeleton=replace(first.skeleton, sliding=()))  # fmt: skip
        found = examples_of(path.name, motion, request.mirror, roles, most=request.most)
        examples = found if examples is None else examples.merged(found, most=request.most)
        if advance is not None:
            advance(1)
    assert examples is not None  # there is at least one take
    return Learned(learn_style(examples, roles, request.options), tuple(dict.fromkeys(notices)))


def _read(path: Path, clip: str | None) -> tuple[Motion, tuple[str, ...]]:
    take = read_for_command(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
    if take.motion is None:
        raise FormatError(f"{path}: holds points, which have no skeleton", remedy="fit_points")
    if not len(take.motion):
        raise MuybridgeError(f"{path}: holds no frame")
    return take.motion, take.notices


def _roles(path: Path, motion: Motion, role_map: Path | None, remedy: str) -> dict[str, int]:
    """The roles of a take's joints, without which no goal can be given for a hand or a foot."""
    found = find_motion_roles(motion, map=None if role_map is None else load_role_map(role_map))
    if missing := [role for role in CORE_ROLES if role not in found.roles]:
        raise MuybridgeError(f"{path}: no joint was found for {', '.join(missing)}", remedy=remedy)
    return dict(found.roles)


def _carried(motion: Motion, roles: dict[str, int], first: Motion, first_roles: dict[str, int]) -> Motion:
    """The poses of another body on the first take's skeleton; feet need no floor, since only poses count."""
    pose = replace(first, skeleton=replace(first.skeleton, sliding=()), translations=None)
    hero = Character(Path("style"), pose.skeleton, np.zeros(3), pose)
    return retarget(motion, roles, hero, first_roles, RetargetOptions(plant=False, touch=False)).motion


def describe(style: Style) -> str:
    """What a style was learned from, and how much it knows, in one line."""
    turning = len(set(style.hinge_joints.tolist()))
    return (
        f"{counted(style.examples, 'example pose')} of {counted(len(style.takes), 'take')}, "
        f"{counted(len(style.hinge_joints), 'angle')} of {counted(turning, 'joint')}, "
        f"{counted(len(style.prior.means), 'Gaussian')}"
    )
