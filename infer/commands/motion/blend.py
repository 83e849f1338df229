"""The command `blend`: one motion between several."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.infer.commands.convert import Units
from muybridge.infer.commands.motion.join import write_made
from muybridge.infer.pipelines.characters.blending import blend_files, check_files, read_material
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.registry import ReadOptions

COMMON_OPTIONS = {"blend": ("out", "weights", "times", "overwrite")}


def blend(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE...")],
    /,
    *,
    out: Path,
    weights: tuple[float, ...] = (),
    times: tuple[float, ...] = (),
    plant: bool = True,
    fps: float | None = None,
    units: Units | None = None,
    clip: str | None = None,
    to_units: Literal["m", "cm"] = "m",
    overwrite: bool = False,
) -> int:
    """Make one motion between several of one skeleton, such as a walk between a slow and a fast one.

    The motions should do the same in the same order. Their frames are matched in time and laid over each other on the
    ground before they are averaged; feet that stand in them stand in the blend.

    Examples:
        muybridge blend slow.bvh fast.bvh --weights 0.5 0.5 --out middle.bvh
        muybridge blend slow.bvh fast.bvh --weights 1 0 0 1 --out faster.bvh

    Args:
        files: files of motion, in any formats, of one skeleton.
        out: file to write, in any format of motion.
        weights: one for each file, which sum to 1; or as many for one time after the other (default: all alike).
        times: seconds of OUT at which several sets of weights hold (default: spread evenly over it).
        plant: hold feet still while they stand.
        fps: frames per second of OUT (default: those of the first file).
        units: unit of lengths, of files that do not say or say it wrongly; cmu is 0.0254 / 0.45 m.
        clip: name or number (from 0) of the animation, of files that hold several (default: the first).
        to_units: unit of lengths in a BVH file that is written; every other format has its own.
        overwrite: replace OUT if it exists.
    """
    check_fps(fps)
    check_files(files, out, overwrite, "a blend")
    progress = Progress()
    material = read_material(files, ReadOptions(units=units, clip=clip), fps)
    for notice in material.notices:
        progress.notice(notice)
    return write_made(blend_files(material, weights, times, plant), out, to_units, progress)
