"""The command `edit`: steps of editing on a motion or points, from one file to another."""

import textwrap
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.convert import Units, Up
from muybridge.infer.pipelines.convert import read_files, written_files
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.editing.channels import duration, frame_count
from muybridge.motion.editing.steps import STEPS, edit_take, parse_steps
from muybridge.motion.formats.registry import ReadOptions, check_writable, write_file
from muybridge.motion.take import Take
from muybridge.wording import counted

COMMON_OPTIONS = {"edit": ("dry_run", "overwrite", "clip", "fps", "units")}


def edit(
    words: Annotated[tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="IN STEPS... OUT")],
    /,
    dry_run: bool = False,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = None,
    asf: Path | None = None,
    clip: str | None = None,
    to_units: Literal["m", "cm"] = "m",
    overwrite: bool = False,
) -> int:
    """Edit motion or points: trim, loop, mirror, smooth and more, in one go.

    The first word is the file to read, the last one the file to write, in any formats; the steps stand between
    them, each with its arguments, and are done in this order.

    Arguments in brackets may be left out; `name=value` says which one a value is for. Times are in seconds, or in
    frames (`12f`); lengths in metres (`5cm`, `2mm`), those of `reduce` in millimetres; angles in degrees. The steps:

    {steps}

    Examples:
        muybridge edit walk.bvh trim 0.5 3.2 in-place loop walk.glb
        muybridge edit walk.bvh mirror turn 90 walk-left.fbx --dry-run

    Args:
        words: file to read, steps with their arguments, file to write.
        dry_run: say what each step would do, and write nothing.
        units: unit of lengths in IN, where the file does not say or says it wrongly; cmu is 0.0254 / 0.45 m.
        up: the axis that is up in IN, where the file does not say (points only). An option that IN's format cannot use
            is refused.
        fps: frames per second of IN, where the file does not say or says it wrongly (the step `resample` changes them).
        asf: skeleton of an .amc file (default: the .asf beside it with the same name).
        clip: name or number (from 0) of the animation, of a file that holds several (default: the first).
        to_units: unit of lengths in a BVH file that is written; every other format has its own.
        overwrite: replace OUT if it exists, and the .asf that goes with an .amc.
    """
    source, steps, target = _split(words)
    calls = parse_steps(steps)
    check_writable(target)
    if not source.is_file():
        raise MuybridgeError(f"{source}: no such file; give an existing one")
    progress = Progress()
    if not dry_run:
        check_replaceable(written_files(target), overwrite, read_files(source, asf), make_folders=False)
    elif source.resolve() == target.resolve():
        raise MuybridgeError(f"{target} is the file to be read", remedy="other_name")
    elif target.exists() and not overwrite:
        progress.notice(f"{target} is there already; without --dry-run, --overwrite is needed")
    take = read_for_command(source, ReadOptions(units, up, fps, asf, clip))
    for notice in take.notices:
        progress.notice(notice)
    take, _ = edit_take(take, calls, partial(print, flush=True))
    if take.keys is None and any(call.step.name == "reduce" for call in calls):
        progress.notice("a step behind `reduce` put its keys back; do it last")
    elif take.keys is not None and target.suffix.lower() != ".glb":
        progress.notice(f"{target.name}: has a key in each frame, since of all formats only .glb stores single keys")
    if not dry_run:
        write_file(target, take, to_units)
    print(f"{target}: {'would have' if dry_run else 'has'} {_contents(take)}")
    return 0


def _split(words: tuple[str, ...]) -> tuple[Path, tuple[str, ...], Path]:
    """The file to read, the steps, and the file to write.

    Raises:
        MuybridgeError: one is missing.
    """
    usage = "write IN STEPS... OUT, such as `walk.bvh trim 0.5 3.2 loop walk.glb`"
    if not words:
        raise MuybridgeError(f"there is no file to edit: {usage}")
    if words[0] in STEPS and not Path(words[0]).exists():
        raise MuybridgeError(f"the step {words[0]!r} stands where the file to read belongs: {usage}")
    if len(words) > 1 and (words[-1] in STEPS or not Path(words[-1]).suffix.strip(".0123456789")):
        raise MuybridgeError(f"{words[-1]!r} stands where the file to write belongs, which has a suffix: {usage}")
    if len(words) < 3:
        raise MuybridgeError(f"there is no step: {usage}; the steps are {', '.join(STEPS)}")
    return Path(words[0]), words[1:-1], Path(words[-1])


def _contents(take: Take) -> str:
    points = take.positions
    thing = points if take.motion is None else take.motion
    count = counted(len(points.landmarks), "joint" if take.motion is not None else "point")
    return f"{counted(frame_count(thing), 'frame')} at {thing.fps:.6g} fps ({duration(thing):.3f} s), {count}"


def _steps_text() -> str:
    """The steps with their arguments, as a paragraph of the command's description."""
    lines = []
    for step in STEPS.values():
        lines.append(f"    {step.usage}")
        lines += textwrap.wrap(step.text, 72, initial_indent=" " * 8, subsequent_indent=" " * 8)
        for p in step.parameters:
            more = f"; one of {', '.join(p.choices)}" if len(p.choices) > 3 else ""
            lines += textwrap.wrap(f"{p.name}: {p.text}{more}", 72, initial_indent=" " * 10,
                                   subsequent_indent=" " * 12)  # fmt: skip
    return "\n".join(lines)


# The table of steps is the one place where they are described.
edit.__doc__ = (edit.__doc__ or "").replace("    {steps}", textwrap.indent(_steps_text(), "    "))
