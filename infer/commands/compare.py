"""The command `compare`: distances between two results."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import OutputError
from muybridge.infer.pipelines.compare import Align, PairOptions, compare_files, format_table, write_plot
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress

Up = Literal["y", "z"]


def compare(
    first: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="A")],
    second: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="B")],
    /,
    align: Align = "none",
    shift: float = 0.0,
    plot: Path | None = None,
    units: Annotated[tuple[str, str] | None, tyro.conf.arg(metavar="UNIT UNIT")] = None,
    up: Annotated[tuple[Up, Up] | None, tyro.conf.arg(metavar="{y,z} {y,z}")] = None,
    fps: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="FPS FPS")] = None,
    overwrite: bool = False,
) -> int:
    """Compare two results, points or motions of any format: distances per joint and over time.

    Joints are matched by their names or by the meaning of their names, frames by time.

    Example:
        muybridge compare results/motion.bvh reference.c3d --align rigid --plot distances.png

    Args:
        first: the reference.
        second: the result that is compared with it.
        align: how B is aligned to A before: not at all; by its root (the middle of the hips) in every frame; the whole
            take by one rigid movement; the same with one scale.
        shift: seconds that B is behind A: B's time t is compared with A's t + shift.
        plot: figure of the distances to write (.png, .svg or .pdf).
        units: units of A and of B, where the files do not say.
        up: the axis that is up in A and in B, where the files do not say.
        fps: frames per second of A and of B, where the files do not say.
        overwrite: replace the figure if it exists.
    """
    if plot is not None:
        if plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise OutputError(f"{plot} is no .png, .svg or .pdf: choose another name")
        check_replaceable([plot], overwrite, (first, second))
    found, late = compare_files((first, second), align, shift, PairOptions(units, up, fps))
    progress = Progress()
    for notice in found.notices:
        progress.notice(notice)
    if shift == 0 and late != 0:
        progress.notice(
            f"{second.name} begins {late:.3f} s later in its recording than {first.name}; they are compared from their "
            f"first frames on. --shift {late:.3f} compares them by the times of the recordings"
        )
    print(format_table(found))
    if plot is not None:
        write_plot(plot, found, f"{second.name} against {first.name}")
        print(f"figure: {plot}")
    return 0
