"""The command `retarget`: takes on a user's own character."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.motion.retarget_robot import RobotRequest, run_retarget_robot
from muybridge.infer.commands.motion.role_maps import write_map
from muybridge.infer.commands.remedies import print_error
from muybridge.infer.pipelines.characters.retarget import (
    PLACE_UNITS,
    READ_UNITS,
    Placed,
    Target,
    check_output,
    describe_roles,
    measures,
    output_paths,
    place,
    read_target,
    suggest,
    write_placed,
)
from muybridge.infer.pipelines.characters.takes import clip_names, takes_of
from muybridge.infer.results.ownership import check_replaceable, refuse_root
from muybridge.infer.runtime.each import try_each
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.retargeting.solver import RetargetOptions
from muybridge.motion.robots.read import is_robot

COMMON_OPTIONS = {"retarget": ("to", "out", "map", "suggest_map", "clip_name", "take_clip", "plant", "overwrite")}


def retarget(
    takes: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="TAKE...")] = (),
    /,
    *,
    to: Annotated[Path, tyro.conf.arg(metavar="HERO")],
    out: Path | None = None,
    map: Path | None = None,
    suggest_map: Annotated[bool, tyro.conf.arg(name="suggest")] = False,
    clip_name: str | None = None,
    take_map: Path | None = None,
    take_clip: str | None = None,
    fps: float | None = None,
    plant: bool = True,
    touch: bool = True,
    overwrite: bool = False,
) -> int:
    """Put takes onto your own character or robot: its file comes back with one more clip for each take.

    Directions of limbs, trunk and head are the take's, the path over the ground is scaled by the length of the legs,
    and the feet are planted on the character's own soles. Takes are files of motion, folders of them, and session or
    results folders. A .glb, .gltf, .vrm or .fbx keeps all that it had; in a .vrma or .bvh, which hold one motion,
    the take goes in its place.

    Examples:
        muybridge retarget walk.bvh --to hero.glb
        muybridge retarget --to hero.glb --suggest

    Args:
        takes: files of motion, folders of them, session folders.
        to: file of the character (.glb, .vrm, .fbx, .bvh ...), or of a humanoid robot (.urdf, .xml).
        out: file to write (default: HERO_TAKE in the current folder).
        map: TOML file that says which joint of the character is which part of the body (see `--suggest`).
        suggest_map: write such a file (default name: HERO.map.toml) with what was found, say how, and stop.
        clip_name: name of the clip (default: that of the take's file).
        take_map: such a map for the takes.
        take_clip: name or number (from 0) of the animation to take, of takes that hold several.
        fps: frames per second of the clips (default: those of the character's clips, else the take's).
        plant: plant feet, and put soles on the floor.
        touch: keep hands on what they touch, and out of the body.
        overwrite: replace files that are there.
    """
    if out is not None:
        refuse_root(out)
    check_fps(fps)
    if clip_name is not None and not clip_name.strip():
        raise MuybridgeError("--clip-name is empty; leave it out for the name of the take's file")
    if is_robot(to):
        _refuse_of_robots(clip_name, plant)
        return run_retarget_robot(RobotRequest(takes, to, out, map, suggest_map, take_map, take_clip, fps, overwrite))
    progress = Progress()
    target = _read_target(to, map, progress)
    if suggest_map:
        path = out or Path(f"{to.stem}.map.toml")
        return write_map(path, suggest(target), to, overwrite, describe_roles(target))
    target.roles.require(str(to))
    found = takes_of(takes, take_clip, but=to)
    for notice in found.notices:
        progress.notice(notice)
    files = found.files
    names = clip_names(files, clip_name, target.clips)
    paths = output_paths(out, to, names)
    check_output(paths, to)
    check_replaceable(paths, overwrite, [to, *files], make_folders=False)
    print(describe_roles(target))
    name_of = dict(zip(files, names, strict=True))
    options = RetargetOptions(plant=plant, touch=touch)

    def put(file: Path) -> Placed:
        with Progress() as shown, shown.task(f"{file.name} on {to.name}", READ_UNITS + PLACE_UNITS) as task:
            one = place(file, target, name_of[file], options, fps, take_clip, take_map, task.advance)
        for notice in one.notices:
            progress.notice(notice)
        print(measures(one), flush=True)
        return one

    tried = try_each(files, put, print_error)
    if len(paths) > 1:  # a file a take
        paths = [path for file, path in zip(files, paths, strict=True) if file in tried.done]
    if tried.done:
        _write(list(tried.done.values()), target, paths, progress)
    tried.report_failures("takes")
    return tried.exit_code


def _refuse_of_robots(clip_name: str | None, plant: bool) -> None:
    """MuybridgeError for options that only characters have."""
    if clip_name is not None or not plant:
        raise MuybridgeError(
            "a robot's motion has no clips, and its feet are always planted; leave out --clip-name and --no-plant"
        )


def _read_target(to: Path, role_map: Path | None, progress: Progress) -> Target:
    """Read the character, and print what was assumed."""
    target = read_target(to, role_map)
    for notice in (*target.notices, *(f"{to.name}: {note}" for note in target.roles.notes)):
        progress.notice(notice)
    return target


def _write(placed: list[Placed], target: Target, paths: list[Path], progress: Progress) -> None:
    """Write the clips, and print the files."""
    with Progress() as shown, shown.task("writing", len(placed)) as task:
        notices = write_placed(placed, target, paths, task.advance)
    for notice in notices:
        progress.notice(notice)
    print("\n".join(str(path) for path in paths))
