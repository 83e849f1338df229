"""The command `solve`: a skeleton fitted to labelled points of any program."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.infer.pipelines.solve_points import SolvePointsOptions, solve_points
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {
    "solve": ("out", "overwrite", "units", "up", "fps", "method", "centres", "markerset", "network", "correct")
}


def solve(
    points: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POINTS")],
    /,
    out: Path,
    overwrite: bool = False,
    options: SolvePointsOptions = SolvePointsOptions(),  # noqa: B008 - frozen
) -> int:
    """Fit a moving skeleton to labelled 3D points of any program (.trc .c3d .csv .parquet .npz).

    Recognised are the landmarks of COCO, HALPE, OpenPose, Pose2Sim and MediaPipe, the joints of common skeletons, and
    the markers of Plug-in Gait, CMU and OpenSim's models (gait2354, Rajagopal, OpenCap). The results folder gets
    motion.bvh, motion.glb, motion.mot (joint angles for OpenSim), the landmarks of the fitted body as landmarks.trc and
    landmarks.c3d, and run.json with the residuals.

    Example:
        muybridge solve gait.c3d --out results/gait

    Args:
        points: labelled points of one person.
        out: results folder.
        overwrite: replace files in the results folder that muybridge did not write or that were changed since.
        options: how the file is read and the body fitted.
    """
    with Progress(quiet=True) as progress:
        print(solve_points(points, out, options, overwrite, progress).summary)
    return 0
