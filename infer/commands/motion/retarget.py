"""The command `retarget`: takes on a user's own character."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.motion.retarget_robot import RobotRequest, run_retarget_robot
from muybridge.infer.pipelines.retarget import (
    check_output,
    clip_names,
    describe_roles,
    find_takes,
    measures,
    output_paths,
    place,
    read_target,
    suggest,
    write_placed,
)
from muybridge.infer.results.ownership import check_replaceable, refuse_root
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.retargeting.solver import RetargetOptions
from muybridge.motion.robots.read import is_robot

COMMON_OPTIONS = {"retarget": ("to", "out", "map", "suggest_map", "clip_name", "overwrite")}


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
    overwrite: bool = False,
) -> int:
    """Put takes onto your own character: its file comes back with one more clip a take.

    Directions of limbs, trunk and head are the take's, the path over the ground is scaled by the length of the legs,
    and the feet are planted on the character's own soles. Takes are files of motion, folders of them, and session or
    results folders. A .glb, .gltf or .vrm keeps everything that it had; a .bvh or .fbx is written anew with the
    skeleton and the take.

    Examples:
        muybridge retarget walk.bvh --to hero.glb
        muybridge retarget --to hero.glb --suggest

    Args:
        takes: files of motion, folders of them, session folders.
        to: file of the character.
        out: file to write (default: HERO_TAKE in the current folder).
        map: TOML file that says which joint of the character is which part of the body (see `--suggest`).
        suggest_map: write such a file (default name: HERO.map.toml) with what was found, say how, and stop.
        clip_name: name of the clip (default: that of the take's file).
        take_map: such a map for the takes.
        take_clip: name or number (from 0) of the animation to take, of takes that hold several.
        fps: frames per second of the clips (default: those of the character's clips, else the take's).
        plant: plant feet, and put soles on the floor.
        overwrite: replace files that are there.
    """
    if out is not None:
        refuse_root(out)
    if is_robot(to):
        return run_retarget_robot(RobotRequest(takes, to, out, map, suggest_map, take_map, take_clip, fps, overwrite))
    target = read_target(to, map)
    progress = Progress()
    for notice in (*target.notices, *(f"{to.name}: {note}" for note in target.roles.notes)):
        progress.notice(notice)
    if suggest_map:
        path = out or Path(f"{to.stem}.map.toml")
        check_replaceable([path], overwrite, [to])
        path.write_text(suggest(target), encoding="utf-8", newline="\n")
        print(f"{describe_roles(target)}\n{path}: correct what is wrong in it, and give it with --map")
        return 0
    target.roles.require(str(to))
    files = find_takes(takes)
    if not files:
        raise MuybridgeError("no take is named; name files of motion, folders of them, or session folders")
    names = clip_names(files, clip_name, target.character.clips)
    paths = output_paths(out, to, names)
    check_output(paths, to)
    check_replaceable(paths, overwrite, [to, *files])
    print(describe_roles(target))
    options = RetargetOptions(plant=plant)
    placed = [place(file, target, name, options, fps, take_clip, take_map)
              for file, name in zip(files, names, strict=True)]  # fmt: skip
    for notice in [n for one in placed for n in one.notices] + write_placed(placed, target, paths):
        progress.notice(notice)
    for one in placed:
        print(measures(one, target))
    print("\n".join(str(path) for path in paths))
    return 0
