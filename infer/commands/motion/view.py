"""The command `view`: a page that shows motion and characters."""

import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.errors import FormatError, MuybridgeError
from muybridge.files import replacing
from muybridge.infer.commands.convert import Units, Up
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.viewer import Scene, read_scene, render_page
from muybridge.motion.formats.registry import ReadOptions, can_use

# Between the sizes of files in one page.
MOST_TIMES = 8.0
COMMON_OPTIONS = {"view": ("out", "side_by_side", "clip", "no_open", "overwrite")}


def view(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE...")],
    /,
    out: Path | None = None,
    side_by_side: bool = False,
    clip: str | None = None,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = None,
    asf: Path | None = None,
    no_open: bool = False,
    overwrite: bool = False,
) -> int:
    """Show motion, points or characters in a web page.

    The page is one HTML file that needs no network. It shows the mesh of a character, else bones or points, and where
    the feet stand. Several files are shown in one place, or side by side, at the same time of their clips.

    Examples:
        muybridge view walk.bvh
        muybridge view walk.bvh knight.glb --side-by-side --out compare.html

    Args:
        files: files of points, motion or characters, in any format that `muybridge convert` reads.
        out: page to write (default: beside the first file, with its name and .html).
        side_by_side: begin with the files beside each other rather than in one place.
        clip: name or number (from 0) of the animation, of files that hold several (default: the first).
        units: unit of lengths, of files that do not say or say it wrongly; cmu is 0.0254 / 0.45 m.
        up: the axis that is up, of files of points that do not say.
        fps: frames per second, of files that do not say or say it wrongly.
        asf: skeleton of an .amc file (default: the .asf beside it with the same name).
        no_open: do not open the page in a browser; it is opened only where a person is at the terminal.
        overwrite: replace the page's file if muybridge did not write it.
    """
    if not files:
        raise MuybridgeError("there is no file to show; name at least one, such as walk.bvh")
    page = files[0].with_suffix(".html") if out is None else out
    check_replaceable([page], overwrite, [*files, *([asf] if asf is not None else [])], make_folders=False)
    options = {"units": units, "up": up, "fps": fps, "asf": asf, "clip": clip}
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if not any(can_use(path, name) for path in files):
            raise FormatError(f"{name} applies to none of these files", remedy="option_unused", option=name)
    progress, scenes = Progress(), []
    for path in files:
        used = {name: value for name, value in given.items() if can_use(path, name)}
        scenes.append(read_scene(path, ReadOptions(**used)))  # type: ignore[arg-type]
        for notice in scenes[-1].notices:
            progress.notice(notice)
    for notice in size_notices(files, scenes):
        progress.notice(notice)
    with replacing(page) as temporary:
        temporary.write_text(render_page(scenes, side_by_side), encoding="utf-8")
    for path, scene in zip(files, scenes, strict=True):
        mesh = f", {scene.vertices} vertices" if scene.vertices else ""
        what = "one pose, without animation" if scene.frames == 1 else f"{scene.frames} frames at {scene.fps:.6g} fps"
        print(f"{path}: {what}{mesh}")
    print(f"{page}: {page.stat().st_size / 1e6:.1f} MB")
    if not no_open and _has_screen():
        webbrowser.open(page.resolve().as_uri())
    return 0


def size_notices(files: Sequence[Path], scenes: Sequence[Scene]) -> list[str]:
    """A notice of each file whose body is far larger than the smallest one, unless its size was
    noticed in reading: nothing of that one could be seen."""
    named = {path for path, scene in zip(files, scenes, strict=True) if any(" scale " in n for n in scene.notices)}
    sized = [(scene.size, path) for path, scene in zip(files, scenes, strict=True) if scene.size > 0]
    if not sized:
        return []
    least, small = min(sized)
    out = []
    for size, path in sized:
        if size > MOST_TIMES * least and path not in named:
            factor = 10.0 ** -round(np.log10(size / least))
            out.append(f"{path.name}: is {size:.3g} m large, and {small.name} {least:.3g} m; if its unit is wrong, "
                       f"`muybridge edit {path.name} scale {factor:g} {path.stem}_scaled.glb` corrects it")  # fmt: skip
    return out


def _has_screen() -> bool:
    """Whether a person is at the terminal, in a session with windows."""
    windows = not sys.platform.startswith("linux") or any(os.environ.get(n) for n in ("DISPLAY", "WAYLAND_DISPLAY"))
    return windows and sys.stdout.isatty()
