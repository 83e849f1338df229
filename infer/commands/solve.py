"""The command `solve`: a body fitted to anyone's labelled points."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.fitting.body_fit import FitOptions
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.infer.pipelines.solve_points import Centres, Method, SolvePointsOptions, Units, Up, solve_points
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {"solve": ("out", "units", "up", "fps", "overwrite", "method", "centres", "network", "correct")}


def solve(
    points: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POINTS")],
    /,
    out: Path,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = None,
    overwrite: bool = False,
    method: Method = "auto",
    centres: tuple[Centres, ...] = (),
    network: Path | None = None,
    correct: bool = True,
    fit: FitOptions = FitOptions(),  # noqa: B008 - frozen
    markers: MarkerFitOptions = MarkerFitOptions(),  # noqa: B008
) -> int:
    """A moving skeleton from labelled 3D points of any program: .trc .c3d .csv .parquet .npz

    Understood are the landmarks of COCO, HALPE, OpenPose, Pose2Sim and MediaPipe, the joints of common skeletons, and
    the markers of Plug-in Gait and CMU. Written are motion.bvh, motion.glb, motion.mot (OpenSim's joint angles), the
    body's own landmarks as landmarks.trc and landmarks.c3d, and run.json with how well they agree.

    Args:
        points: labelled points of one person.
        out: folder of the results.
        units: unit of the file's numbers, where it does not say or says it wrongly.
        up: which axis is up, where the file does not say or says it wrongly.
        fps: frames a second, where the file does not say or says it wrongly.
        overwrite: replace files in the results folder that muybridge did not write or that were changed.
        method: `markers` fits a body with the markers on its skin, `landmarks` one with joint centres that are first
            found from the markers; `auto` takes the first where there are a dozen markers or more.
        centres: joint centres that count besides the markers: `midpoint` of the markers on either side, `plane` of
            three markers of a limb, the hip by `harrington`, `bell` or `davis`, or by its motion (`functional`, the
            shoulder too); of two for one joint the first named counts.
        network: a network of `muybridge train solver`, which corrects the joints of a body fitted to markers; by
            default the shipped one, where no `centres` are named.
        correct: `--no-correct` leaves the joints as they were fitted.
        fit: skeleton and joint angles, of landmarks.
        markers: the same of markers.
    """
    options = SolvePointsOptions(units, up, fps, method, centres, network, correct, fit, markers)
    with Progress(quiet=True) as progress:
        result = solve_points(points, out, options, overwrite, progress)
    print(result.summary)
    return 0
