"""The command `assist`: a key-framed clip completed by captured takes."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.pipelines.characters.assist import AssistRequest, complete
from muybridge.infer.pipelines.characters.takes import takes_of
from muybridge.infer.pipelines.convert import written_files
from muybridge.infer.results.ownership import check_replaceable, refuse_root
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.assistance import AssistOptions
from muybridge.motion.formats.registry import check_writable, write_file
from muybridge.motion.take import Take

COMMON_OPTIONS = {"assist": ("takes", "out", "make", "drive", "texture", "overwrite")}


def assist(
    keys: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="KEYS")],
    /,
    *,
    takes: Annotated[tuple[Path, ...], tyro.conf.arg(name="from", metavar="TAKE...")],
    out: Path,
    make: tuple[str, ...] = (),
    drive: tuple[str, ...] = (),
    texture: float = 0.0,
    mirror: bool = True,
    map: Path | None = None,
    take_map: Path | None = None,
    take_clip: str | None = None,
    overwrite: bool = False,
) -> int:
    """Complete a key-framed clip by captured takes: animate the legs, and get arms, spine and head that go with them.

    The clip is divided where its movement turns, and each piece gets the one of the takes that moves most alike, so
    that they follow each other without a break. Joints that were animated stay exactly as they are. Takes may have
    other skeletons and frame rates; files of motion, folders of them, and session folders are takes.

    Examples:
        muybridge assist legs.bvh --from walk1.bvh walk2.fbx --out walk.bvh
        muybridge assist rough.bvh --from takes/ --make spine chest head --texture 1 --out fine.glb

    Args:
        keys: file of the clip, with a pose in every frame.
        takes: captured takes: files of motion, folders of them, session folders.
        out: file to write, in any format of motion.
        make: joints, or parts of the body, to be made (default: all that never turn).
        drive: those that takes are matched by (default: thighs, else upper arms, else the two that move most).
        texture: how much of the takes' movement above 6 Hz is added to the animated joints; 1 is all of it.
        mirror: use each take a second time, with left and right exchanged.
        map: TOML file that says which joint of KEYS is which part of the body (see `muybridge retarget --suggest`).
        take_map: such a map for the takes.
        take_clip: name or number (from 0) of the animation to take, of takes that hold several.
        overwrite: replace OUT if it exists.
    """
    refuse_root(out)
    if not 0 <= texture <= 10:
        raise MuybridgeError(f"--texture is a factor from 0 to 10, not {texture:g}")
    check_writable(out)
    if not keys.is_file():
        raise MuybridgeError(f"{keys}: no such file; give an existing one")
    progress = Progress()
    found = takes_of(takes, take_clip, but=keys)
    for notice in found.notices:
        progress.notice(notice)
    check_replaceable(written_files(out), overwrite, [keys, *found.files], make_folders=False)
    request = AssistRequest(keys, found.files, make, drive, mirror, map, take_map, take_clip,
                            AssistOptions(texture=texture))  # fmt: skip
    with Progress() as shown, shown.task(f"completing {keys.name}", len(found.files) + 1) as task:
        done = complete(request, task.advance)
    for notice in done.notices:
        progress.notice(notice)
    print("\n".join(done.described()))
    write_file(out, Take(motion=done.result.motion))
    print(out)
    return 0
