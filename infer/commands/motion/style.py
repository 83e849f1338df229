"""The command `style`: a prior of poses learned from takes, for steps that solve poses from goals."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.pipelines.characters.style import StyleRequest, describe, learn_from_files
from muybridge.infer.pipelines.characters.takes import takes_of
from muybridge.infer.results.ownership import check_replaceable, refuse_root
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.style import StyleOptions, save_style

COMMON_OPTIONS = {"style": ("out", "mirror", "map", "overwrite")}
_FEWEST, _MOST = 20, 5000


def style(
    takes: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="TAKE...")],
    /,
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    mirror: bool = False,
    map: Path | None = None,
    take_map: Path | None = None,
    clip: str | None = None,
    examples: int = StyleRequest.most,
    components: int | None = None,
    overwrite: bool = False,
) -> int:
    """Learn a style from takes, in which poses are then solved from a few goals.

    A style knows how the joints of a body turn together in the takes. `muybridge edit TAKE reach ... style=mine.style
    OUT` gives what a goal leaves open to it. Takes are files of motion, folders of them, and session or results
    folders; the style is of the first one's skeleton, and what moves another body is put onto that.

    Examples:
        muybridge style takes/ --out mine.style
        muybridge style walk1.bvh walk2.bvh --out walk.style --mirror

    Args:
        takes: files of motion, folders of them, session folders.
        out: file to write, with the suffix .style.
        mirror: learn from each pose a second time, with left and right exchanged.
        map: TOML file that says which joint of the first take is which part of the body (see `muybridge retarget
            --suggest`).
        take_map: such a map for takes of other skeletons.
        clip: name or number (from 0) of the animation, of takes that hold several (default: the first).
        examples: poses to learn from at most; those that differ most are taken.
        components: Gaussians of the mixture (default: chosen by the likelihood of examples that are left out).
        overwrite: replace a file that is no style.
    """
    refuse_root(out)
    if out.suffix.lower() != ".style":
        raise MuybridgeError(f"{out}: a style has the suffix .style", remedy="other_name")
    if not _FEWEST <= examples <= _MOST:
        raise MuybridgeError(f"--examples is a number from {_FEWEST} to {_MOST}, not {examples}")
    if components is not None and not 1 <= components <= 50:
        raise MuybridgeError(f"--components is a number from 1 to 50, not {components}")
    found = takes_of(takes, clip)
    progress = Progress()
    for notice in found.notices:
        progress.notice(notice)
    maps = [m for m in (map, take_map) if m is not None]
    check_replaceable([out], overwrite, [*found.files, *maps], make_folders=False)
    request = StyleRequest(found.files, mirror, clip, map, take_map, examples, StyleOptions(components))
    with Progress() as shown, shown.task("reading", len(found.files)) as task:
        learned = learn_from_files(request, task.advance)
    for notice in learned.notices:
        progress.notice(notice)
    save_style(out, learned.style)
    print(describe(learned.style))
    print(out)
    return 0
