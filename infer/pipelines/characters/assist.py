"""A key-framed clip completed by captured takes, from files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import find_motion_roles, load_role_map
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.assistance import (
    Assisted,
    AssistOptions,
    CapturedTake,
    assist,
    bring_take,
    check_keys,
    driving_joints,
    mirrored,
    still_joints,
)
from muybridge.motion.formats.registry import ReadOptions, can_use
from muybridge.wording import counted

Advance = Callable[[int], object]
_MOST_NAMES = 8


@dataclass(frozen=True)
class AssistRequest:
    """What is completed, and by what.

    Attributes:
        keys: file of the key-framed clip.
        takes: files of captured takes.
        make: joints or roles to be made; empty for those that never turn.
        drive: joints or roles that takes are matched by; empty for `driving_joints`.
        mirror: whether each take counts a second time, with left and right exchanged.
        map, take_map: roles of the joints of the clip and of the takes.
        take_clip: name or number of the animation, of takes that hold several.
        options: how.
    """

    keys: Path
    takes: tuple[Path, ...]
    make: tuple[str, ...] = ()
    drive: tuple[str, ...] = ()
    mirror: bool = True
    map: Path | None = None
    take_map: Path | None = None
    take_clip: str | None = None
    options: AssistOptions = field(default_factory=AssistOptions)


@dataclass(frozen=True, eq=False)
class Completed:
    """A completed clip.

    Attributes:
        result: the motion and what it was made of.
        takes: the takes as they were used, each mirrored one behind its own.
        notices: what was assumed, one sentence each.
    """

    result: Assisted
    takes: tuple[CapturedTake, ...]
    notices: tuple[str, ...]

    def described(self) -> list[str]:
        """What was made, by what, and how well it fits: a line each."""
        names = self.result.motion.skeleton.names
        used = dict.fromkeys(self.takes[f.clip] for f in self.result.match.fragments)
        by = [f"{take.name}{' mirrored' if take.mirrored else ''}" for take in used]
        return [
            f"made {counted(len(self.result.made), 'joint')}: {_listed([names[j] for j in self.result.made])}",
            f"driven by {_listed([names[j] for j in self.result.driving])}, in "
            f"{counted(len(self.result.wanted), 'fragment')}",
            f"from {_listed(by)}; mean difference {self.result.match.costs.mean():.2f} "
            "(0 is the same movement, 1 is as far off as a movement is large)",
        ]


def complete(request: AssistRequest, advance: Advance | None = None) -> Completed:
    """A key-framed clip, completed by captured takes.

    Args:
        request: what is completed, and by what.
        advance: called with 1 behind each take that is ready, and at the end.

    Raises:
        FormatError: a file cannot be read, or holds points.
        MuybridgeError: joints are not known, a clip is too short, or a take's skeleton cannot be used.
    """
    keys, key_roles, notices = _read(request.keys, request.map)
    check_keys(keys)
    made = _joints(request.make, keys.skeleton, key_roles) or still_joints(keys)
    driving = _joints(request.drive, keys.skeleton, key_roles) or driving_joints(keys, made, key_roles)
    takes: list[CapturedTake] = []
    for path in request.takes:
        motion, roles, more = _read(path, request.take_map, request.take_clip)
        one = bring_take(path.name, motion, roles, keys, key_roles)
        notices += [*more, *one.notices]
        takes.append(one)
        if request.mirror:
            takes.append(mirrored(one, key_roles))
        if advance is not None:
            advance(1)
    result = assist(keys, takes, made, driving, request.options)
    if advance is not None:
        advance(1)
    return Completed(result, tuple(takes), tuple(dict.fromkeys(notices)))


def _read(path: Path, role_map: Path | None, clip: str | None = None) -> tuple[Motion, dict[str, int], list[str]]:
    """The motion of a file, the roles of its joints, of which some may be missing, and notices."""
    take = read_for_command(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
    if take.motion is None:
        raise FormatError(f"{path}: holds points, which have no skeleton", remedy="fit_points")
    if not len(take.motion):
        raise FormatError(f"{path}: has no frames")
    names = take.motion.skeleton.names
    chosen = load_role_map(role_map) if role_map is not None else None
    try:
        found = find_motion_roles(take.motion, {bone: names[j] for bone, j in take.humanoid.items()}, chosen)
    except MuybridgeError as error:
        raise error.about(str(role_map)) from None
    return take.motion, found.roles, [*take.notices, *(f"{path.name}: {note}" for note in found.notes)]


def _joints(words: Sequence[str], skeleton: Skeleton, roles: dict[str, int]) -> tuple[int, ...]:
    """The joints of names or roles, each once.

    Raises:
        MuybridgeError: one is neither.
    """
    known = roles | {name: j for j, name in enumerate(skeleton.names)}
    for word in words:
        if word not in known:
            raise MuybridgeError(f"there is no joint {word!r}, and no role of that name; the joints are "
                                 f"{', '.join(skeleton.names)}")  # fmt: skip
    return tuple(dict.fromkeys(known[word] for word in words))


def _listed(names: Sequence[str]) -> str:
    """The first of some names."""
    return ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
