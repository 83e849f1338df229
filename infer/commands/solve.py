"""The command `solve`: a body fitted to anyone's labelled points."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import FormatError
from muybridge.geometry.fitting.body_fit import BodyFit, FitOptions
from muybridge.geometry.fitting.marker_fit import MarkerFit
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.infer.pipelines.solve_points import (
    MARKERS,
    RESULTS,
    Centres,
    Method,
    Units,
    Up,
    check_size,
    fit_marker_file,
    open_corrector,
    solve_facts,
    tilt_deg,
    understand,
    write,
)

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
    body's own landmarks as landmarks.trc and landmarks.c3d, and solve.json with how well they agree.

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
    from muybridge.geometry.fitting.body_fit import fit_body
    from muybridge.infer.results.folder import open_output
    from muybridge.motion.formats.registry import ReadOptions, read_file

    take = read_file(points, ReadOptions(units, up, fps))
    notices = list(take.notices)
    labelled = understand(points, take.positions)
    notices += [labelled.whose] if labelled.whose else []
    stature = check_size(points, labelled, ReadOptions(units, up, fps))
    tilt = tilt_deg(labelled.points.points_world)
    if tilt > 60:
        notices.append(f"the trunk is {tilt:.0f} degrees from upright in most frames: does the person lie? If not, "
                       "the file's up axis is another one: see --up")  # fmt: skip
    output = open_output(out, RESULTS, [points.resolve()], overwrite)
    for notice in notices:
        print(f"note: {notice}", file=sys.stderr)
    by_markers = method == "markers" or (method == "auto" and len(labelled.columns) >= MARKERS)
    if by_markers:
        corrector = open_corrector(network, correct, centres)
        fitted: BodyFit | MarkerFit = fit_marker_file(points, labelled, take.positions, centres, markers, corrector)
    elif centres or network:
        what = "--centres" if centres else "--network"
        raise FormatError(f"{points}: {what} is for markers on the skin, and {labelled.how}; leave it out")
    else:
        fitted = fit_body(labelled.points, fit)
    names = tuple(labelled.columns) if by_markers else labelled.points.landmarks.names
    facts = solve_facts(points, labelled, fitted, stature, notices, names, centres)
    facts["network"] = corrector.version if by_markers and corrector else None
    write(output, fitted, facts)
    error = facts["residual_mm"]
    print(
        f"{out}: {len(fitted.motion)} frames at {fitted.motion.fps:.6g} fps; {labelled.how}; stature "
        f"{fitted.body.stature_m:.2f} m; {'markers' if by_markers else 'landmarks'} lie {error['median']:.1f} mm "
        f"(median) and {error['p95']:.1f} mm (95 %) from the body's"
    )
    return 0
