"""Takes put onto a user's own character: which joints mean what, and what is written."""

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, MuybridgeError
from muybridge.files import replacing
from muybridge.geometry.roles import RoleMap, find_motion_roles, find_roles, load_role_map, suggest_role_map
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.characters.takes import find_takes, person_clip_names, person_of
from muybridge.infer.results.folder import OutputFolder
from muybridge.infer.results.names import MOTION_BVH, of_person
from muybridge.infer.runtime.reading import read_for_command, size_notices
from muybridge.motion.character.character import Character
from muybridge.motion.character.read import read_character
from muybridge.motion.character.write import check_takes_clips, write_character_clip
from muybridge.motion.editing.resampling import resample
from muybridge.motion.formats.clip_choice import first_clip_notice
from muybridge.motion.formats.registry import ReadOptions, can_use, check_writable, write_file
from muybridge.motion.retargeting.solver import Retargeted, RetargetOptions, retarget
from muybridge.motion.take import Take
from muybridge.wording import counted

Advance = Callable[[int], object]
CLIPS = (".glb", ".gltf", ".vrm", ".fbx")  # files that take one more clip and keep all else
# Units of progress: of a take's reading and of putting it onto the character, by the time that they take.
READ_UNITS, PLACE_UNITS = 1, 3
_ONE_CLIP = (".vrma", ".bvh")  # files whose motion another one takes the place of


@dataclass(frozen=True, eq=False)
class Target:
    """The character that takes are put onto.

    Attributes:
        character: as its file has it.
        roles: of its joints.
    """

    character: Character
    roles: RoleMap

    @property
    def notices(self) -> tuple[str, ...]:
        """Those of reading it, but for the clip that was read: only the skeleton and the meshes count."""
        of_clip = first_clip_notice(self.character.path, self.character.clips)
        sizes = size_notices(self.character.path, self.character.skeleton, self.roles.roles)
        return (*(n for n in self.character.notices if n != of_clip), *sizes)

    @property
    def clips(self) -> tuple[str, ...]:
        """Names of the clips that its file keeps."""
        return self.character.clips if self.character.path.suffix.lower() in CLIPS else ()


@dataclass(frozen=True, eq=False)
class Placed:
    """A take on the character.

    Attributes:
        name: of the clip.
        result: the motion, contacts and measures.
        notices: what was assumed, one sentence each.
    """

    name: str
    result: Retargeted
    notices: tuple[str, ...]


def read_target(path: Path, role_map: Path | None = None) -> Target:
    """The character of a file, and the roles of its joints.

    Raises:
        FormatError: the file, or the map, cannot be read.
    """
    character = read_character(path)
    table = {bone: character.skeleton.names[j] for bone, j in character.humanoid.items()}
    if path.suffix.lower() in CLIPS:
        check_takes_clips(character)
    chosen = load_role_map(role_map) if role_map is not None else None
    try:
        places = character.motion.joint_positions_world() if len(character.motion) > 1 else None
        return Target(character, find_roles(character.skeleton, table, chosen, places))
    except MuybridgeError as error:
        raise error.about(str(role_map)) from None


def describe_roles(target: Target) -> str:
    """One line on how the roles were found."""
    found, count = target.roles, len(target.character.skeleton)
    name = target.character.path.name
    if not found.roles:
        return f"{name}: no human body was recognised among its {counted(count, 'joint')}"
    return f"{name}: {len(found.roles)} of {counted(count, 'joint')} have a role, by {found.source}"


def suggest(target: Target) -> str:
    """The text of a map of the character's roles."""
    return suggest_role_map(target.character.skeleton, target.roles)


def read_take(path: Path, clip: str | None = None, role_map: Path | None = None) -> tuple[Motion, RoleMap, list[str]]:
    """The motion of a file, its roles, and notices.

    Raises:
        FormatError: it cannot be read, or holds points.
        MuybridgeError: it has no frames, or no human body.
    """
    take = read_for_command(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
    if take.motion is None:
        raise FormatError(f"{path}: holds points, which have no skeleton", remedy="fit_points")
    motion, names = take.motion, take.motion.skeleton.names
    if not len(motion):
        raise FormatError(f"{path}: has no frames; there is nothing to put onto a character")
    chosen = load_role_map(role_map) if role_map is not None else None
    try:
        found = find_motion_roles(motion, {bone: names[j] for bone, j in take.humanoid.items()}, chosen)
    except MuybridgeError as error:
        raise error.about(str(role_map)) from None
    found.require(str(path), remedy="take_map")
    return motion, found, list(take.notices)


def place(
    path: Path, target: Target, name: str, options: RetargetOptions, fps: float | None = None,
    clip: str | None = None, take_map: Path | None = None, advance: Advance | None = None,
) -> Placed:  # fmt: skip
    """One take on the character.

    Args:
        path: file of motion.
        target: whose `roles` have all core roles.
        name: of the clip.
        options: of retargeting.
        fps: frames per second of the clip; None for those of the character's clips, or of the take where it has none.
        clip: of the take's file.
        take_map: roles of the take's joints.
        advance: called with `READ_UNITS` when the take is read, with `PLACE_UNITS` at the end.
    """
    take = read_take(path, clip, take_map)
    if advance is not None:
        advance(READ_UNITS)
    placed = put_on(path, take, target, name, options, fps)
    if advance is not None:
        advance(PLACE_UNITS)
    return placed


def put_on(
    path: Path, take: tuple[Motion, RoleMap, list[str]], target: Target, name: str, options: RetargetOptions,
    fps: float | None = None,
) -> Placed:  # fmt: skip
    """A take that `read_take` has read from `path` on the character; the other arguments are those of `place`."""
    motion, roles, notices = take[0], take[1], list(take[2])
    wanted = fps or (target.character.motion.fps if target.character.clips else motion.fps)
    if abs(wanted - motion.fps) > 1e-6 * wanted and len(motion) > 1:
        why = "as asked" if fps else f"which {target.character.path.name} has"
        notices.append(f"{path.name}: resampled from {motion.fps:g} to {wanted:g} frames per second, {why}")
        motion = resample(motion, wanted)
    notices += [f"{path.name}: {note}" for note in roles.notes]
    result = retarget(motion, roles.roles, target.character, target.roles.roles, options)
    if not result.contacts.feet.any():
        notices.append(f"{path.name}: no foot stands in it, so none was planted")
    return Placed(name, result, tuple(notices))


def output_paths(out: Path | None, to: Path, names: Sequence[str]) -> list[Path]:
    """The files that are written: one for all clips where the format takes several, else one a take."""
    suffix = to.suffix.lower()
    if suffix in CLIPS:
        return [out or Path(f"{to.stem}_{names[0] if len(names) == 1 else 'takes'}{to.suffix}")]
    if len(names) == 1:
        return [out or Path(f"{to.stem}_{names[0]}{to.suffix}")]
    base = out or Path(f"{to.stem}{to.suffix}")
    return [base.with_name(f"{base.stem}_{name}{to.suffix}") for name in names]


def check_output(paths: Sequence[Path], to: Path) -> None:
    """Refuse files of another format than the character's, and formats that cannot be written."""
    for path in paths:
        if path.suffix.lower() != to.suffix.lower():
            raise MuybridgeError(f"{path}: takes on {to.name} are written as {to.suffix.lower()}, as the character is",
                                 remedy="other_name")  # fmt: skip
        if path.suffix.lower() not in CLIPS + _ONE_CLIP:
            check_writable(path)


def write_placed(
    placed: Sequence[Placed], target: Target, paths: Sequence[Path], advance: Advance | None = None
) -> list[str]:
    """Write the clips; what else had to change is returned, one sentence each. `advance(1)` is called behind each."""
    character = target.character
    if character.path.suffix.lower() in CLIPS:
        return _write_clips(placed, character, paths[0], advance)
    notices: list[str] = []
    for one, path in zip(placed, paths, strict=True):
        if character.path.suffix.lower() in _ONE_CLIP:
            notices += _write_alone(one, character, path)
        else:
            write_file(path, Take(motion=one.result.motion))
        if advance is not None:
            advance(1)
    return list(dict.fromkeys(notices))


def _write_alone(one: Placed, character: Character, path: Path) -> tuple[str, ...]:
    """The character's file with another motion; a BVH whose channels cannot hold it gets a hierarchy of its own."""
    try:
        return write_character_clip(character, one.result.motion, path, one.name, alone=True)
    except FormatError as error:
        if path.suffix.lower() != ".bvh":
            raise
        write_file(path, Take(motion=one.result.motion))
        return (f"{error.message}; the hierarchy is written anew, with such channels",)


def read_run_target(path: Path) -> Target:
    """The character of a file that `muybridge run` puts motion onto.

    Raises:
        MuybridgeError: it cannot be written into a results folder as one file, or has no human body.
    """
    if path.suffix.lower() == ".gltf":
        raise MuybridgeError(f"{path}: is of several files, which a results folder does not take; save it as .glb")
    check_output([path], path)
    target = read_target(path)
    target.roles.require(str(path))
    return target


def retarget_results(
    folder: Path, target: Target, options: RetargetOptions | None = None, people: Sequence[int] | None = None
) -> list[str]:
    """Put the motion of people in a results folder onto a character, whose file goes there; clips are called after the
    people: `person_1` and so on.

    Args:
        folder: of results.
        target: the character.
        options: of retargeting.
        people: numbers of those with a motion; None for everyone in the folder.

    Returns:
        Notices.
    """
    if people is None:
        people = [person_of(take) or 1 for take in find_takes([folder]).files]
    names = person_clip_names(people, target.clips)
    placed = [place(folder / of_person(MOTION_BVH, number), target, name, options or RetargetOptions())
              for number, name in zip(people, names, strict=True)]  # fmt: skip
    paths = output_paths(Path(target.character.path.name), target.character.path, names)
    results, notices = OutputFolder(folder), [notice for one in placed for notice in one.notices]
    groups = [placed] if len(paths) == 1 else [[one] for one in placed]
    for path, group in zip(paths, groups, strict=True):
        results.write(path.name, partial(_write_group, group, target, notices))
    return list(dict.fromkeys(notices))


def _write_group(group: Sequence[Placed], target: Target, notices: list[str], path: Path) -> None:
    notices.extend(write_placed(group, target, [path]))


def _write_clips(
    placed: Sequence[Placed], character: Character, path: Path, advance: Advance | None = None
) -> list[str]:
    """One file with all clips, made one after the other in a temporary folder."""
    notices: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        last = character
        for k, one in enumerate(placed):
            step = Path(folder) / str(k) / path.name
            step.parent.mkdir()
            notices += write_character_clip(last, one.result.motion, step, one.name)
            if k + 1 < len(placed):
                last = read_character(step)
            if advance is not None:
                advance(1)
        extra = [f for f in step.parent.iterdir() if f != step]
        for file in [*extra, step]:
            with replacing(path.with_name(file.name)) as temporary:
                shutil.copyfile(file, temporary)
    return list(dict.fromkeys(notices))


def measures(placed: Placed) -> str:
    """One line on a take: frames, contacts, what planting did."""
    result = placed.result
    steps = int((np.diff(result.contacts.feet.astype(int), axis=0) > 0).sum() + result.contacts.feet[0].sum())
    soles = "" if result.soles.measured else "; the file has no mesh of the feet, so soles were assumed"
    frames = f"{counted(len(result.motion), 'frame')} at {result.motion.fps:g} fps"
    path = f"path scaled by {result.scale:.3g}{soles}"
    return f"{placed.name}: {frames}, {counted(steps, 'step')} planted, {path}"
