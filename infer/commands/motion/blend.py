"""The command `blend`: one motion between several."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.infer.commands.motion.join import Making
from muybridge.infer.pipelines.characters.blending import blend_files
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {"blend": ("out", "weights", "times", "overwrite")}


def blend(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE...")],
    /,
    *,
    options: Annotated[Making, tyro.conf.arg(name="")],
    weights: tuple[float, ...] = (),
    times: tuple[float, ...] = (),
    plant: bool = True,
) -> int:
    """Make one motion between several of one skeleton, such as a walk between a slow and a fast one.

    The motions should do the same in the same order. Their frames are matched in time and laid over each other on the
    ground before they are averaged; feet that stand in them stand in the blend.

    Examples:
        muybridge blend slow.bvh fast.bvh --weights 0.5 0.5 --out middle.bvh
        muybridge blend slow.bvh fast.bvh --weights 1 0 0 1 --out faster.bvh

    Args:
        files: files of motion, in any formats, of one skeleton.
        options: what is read and written.
        weights: one for each file, which sum to 1; or as many for one time after the other (default: all alike).
        times: seconds of OUT at which several sets of weights hold (default: spread evenly over it).
        plant: hold feet still while they stand.
    """
    progress = Progress()
    material = options.read(files, "a blend", progress)
    return options.write(blend_files(material, weights, times, plant), progress)
