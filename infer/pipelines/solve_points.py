"""From a file of labelled points to a moving skeleton, with files and a record of how well the two agree."""

import logging
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.fitting.body_fit import FitOptions
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import SURFACE, MarkerSet
from muybridge.geometry.skeleton.joint_centres import USUAL, JointCentres, Measurements, centres_from_markers
from muybridge.infer.networks.correction import SolverNetwork
from muybridge.infer.reconstruction.body import (
    BodySolution,
    body_facts,
    fit_labelled_markers,
    fit_landmarks,
    open_corrector,
    unpack_body,
)
from muybridge.infer.reconstruction.measurements import measurements_of
from muybridge.infer.reconstruction.recognise import RecognisedPoints, check_size, recognise, tilt_deg
from muybridge.infer.report.data import ReportData
from muybridge.infer.report.page import problems, write_report
from muybridge.infer.results.names import MOTION_BVH, MOTION_GLB, MOTION_MOT, REPORT
from muybridge.infer.results.provenance import versions
from muybridge.infer.results.record import json_value
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.digests import code_digest, file_digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import Arrays, Facts, Stages
from muybridge.motion.contacts.events import contact_events, contact_facts
from muybridge.motion.contacts.find import find_contacts
from muybridge.motion.formats.points.c3d import C3DTake
from muybridge.motion.formats.points.marker_protocol import find_marker_set
from muybridge.motion.formats.registry import ReadOptions, read_file

_log = logging.getLogger(__name__)

# With so many markers on the skin a body is fitted to them, not to landmarks derived from them.
_ENOUGH_MARKERS = 12
_MOST_TILT_DEG = 60.0
LANDMARKS_TRC, LANDMARKS_C3D = "landmarks.trc", "landmarks.c3d"
RESULTS = (MOTION_BVH, MOTION_GLB, MOTION_MOT, LANDMARKS_TRC, LANDMARKS_C3D, REPORT)
# The code that the fit depends on.
_CODE = ("muybridge.geometry", "muybridge.models", "muybridge.motion", "muybridge.infer.networks",
         "muybridge.infer.reconstruction")  # fmt: skip

Units = Literal["m", "cm", "mm", "in"]
Up = Literal["y", "z"]
Method = Literal["auto", "markers", "landmarks"]
Centres = Literal[
    "midpoint", "plane", "chord", "harrington", "bell", "davis", "hara", "regressions", "functional", "file", "body"
]
# Metres, standard deviation of a coordinate of a joint centre that a gait model computed.
_MODELLED_M = 0.010


@dataclass(frozen=True)
class SolvePointsOptions:
    """How labelled points become a moving skeleton.

    Attributes:
        units: unit of lengths, where the file does not say or says it wrongly.
        up: the axis that is up, where the file does not say or says it wrongly.
        fps: frames per second, where the file does not say or says it wrongly.
        method: `markers` fits the body to the markers on its skin, `landmarks` to joint centres that are first computed
            from the markers; `auto` takes the first where there are a dozen markers or more.
        centres: joint centres that count besides the markers: `midpoint` of the markers on either side, `chord` behind
            one marker by the hinge's axis over the take (the shoulder below the acromion), `plane` of three markers of
            a limb, the hip by `harrington`, `bell`, `davis`, `hara` or the mean of them (`regressions`), or by its
            motion (`functional`, the shoulder too), or those that a gait model left in the `file` (`LKJC`). Where two
            give the same joint, the one named first counts; after those named come `midpoint`, `regressions` and
            `chord`, unless `body` is named, which leaves the rest to the statistical body.
        markerset: the set that the labels are of: a name, or a text file (`muybridge markerset`); by default all
            built-in sets are known.
        network: file of a network that corrects the joints of a body fitted to markers (`muybridge train solver`);
            if not given, the shipped one where `centres` has `body`, none otherwise.
        correct: correct the joints with the network.
        fit: skeleton and joint angles, fitted to landmarks.
        markers: skeleton and joint angles, fitted to markers.
    """

    units: Units | None = None
    up: Up | None = None
    fps: float | None = None
    method: Method = "auto"
    centres: tuple[Centres, ...] = ()
    markerset: str | None = None
    network: Path | None = None
    correct: bool = True
    fit: FitOptions = field(default_factory=FitOptions)
    markers: MarkerFitOptions = field(default_factory=MarkerFitOptions)

    @property
    def read(self) -> ReadOptions:
        """How the file is read."""
        return ReadOptions(self.units, self.up, self.fps)


@dataclass(frozen=True)
class PointsResult:
    """A solved file.

    Attributes:
        out: the results folder.
        body: the fitted body.
        recognised: the file's points.
        seconds: how long it took.
    """

    out: Path
    body: BodySolution
    recognised: RecognisedPoints
    seconds: float

    @property
    def summary(self) -> str:
        """One line about the result."""
        body, error = self.body, body_facts(self.body)["residual_mm"]
        return (
            f"{self.out}: {len(body.motion)} frames at {body.motion.fps:.6g} fps; {self.recognised.how}; stature "
            f"{body.stature_m:.2f} m; {body.method} lie {error['median']:.1f} mm (median) and {error['p95']:.1f} mm "
            "(95 %) from the body's"
        )


def solve_points(
    path: Path, out: Path, options: SolvePointsOptions, overwrite: bool, progress: Progress
) -> PointsResult:
    """Fit a body to a file of labelled points and write it.

    Args:
        path: the file.
        out: the results folder.
        options: how.
        overwrite: replace files in the results folder that muybridge did not write.
        progress: receives progress messages.

    Raises:
        MuybridgeError: of some kind, for everything that the user can fix; nothing is written then.
    """
    take = read_file(path, options.read)
    worn = find_marker_set(options.markerset).markers if options.markerset else None
    recognised = recognise(path, take.positions, take.c3d.modelled if take.c3d else (), worn)
    stature = check_size(path, recognised, options.read, worn)
    notices = _notices(take.notices, recognised)
    by_markers = options.method == "markers" or (
        options.method == "auto" and len(recognised.columns) >= _ENOUGH_MARKERS
    )
    corrector = _check_method(path, recognised, options, by_markers)
    run = Run("points", out, RESULTS, [path.resolve()], overwrite, progress)
    _log.info("%s: %s; fitted to %s", path, recognised.how, "markers" if by_markers else "landmarks")
    for notice in notices:
        progress.notice(notice)
    network = None if corrector is None else file_digest(corrector.path)
    stage = Stages(run.store, progress, [file_digest(path), options.read, code_digest(*_CODE)])
    given = [
        by_markers,
        options.centres,
        list(recognised.columns.items()),
        options.markers if by_markers else options.fit,
        network,
    ]

    def compute() -> tuple[Arrays, Facts]:
        if not by_markers:
            return fit_landmarks(recognised.points, options.fit)
        return _fit_markers(take.positions, recognised, options, corrector, measurements_of(path))

    fitted = stage("body", given, compute)
    body = unpack_body(fitted.arrays, fitted.facts)
    run.stages |= stage.done
    run.write_motion([MOTION_BVH, MOTION_GLB, MOTION_MOT], body.motion)
    contacts = find_contacts(body.motion, plates=take.c3d)
    events = C3DTake(body.landmarks, events=contact_events(contacts))
    run.write_points({LANDMARKS_TRC: body.landmarks, LANDMARKS_C3D: events})
    shown = _chosen_points(take.positions, recognised) if by_markers else recognised.points
    data = _report_data(path, shown, body, run, options, notices)
    run.write(REPORT, partial(write_report, data=data))
    seconds = run.finish(
        frames=len(body.motion), fps=body.motion.fps, notices=notices, problems=problems(data), options=asdict(options),
        quality={"coverage": float(np.isfinite(body.residual_m).mean())},
        file=_file_facts(path, recognised, stature), body=body_facts(body) | {"joint_centres": list(options.centres)},
        contacts=contact_facts(contacts),
    )  # fmt: skip
    return PointsResult(run.output.path, body, recognised, seconds)


def _notices(given: tuple[str, ...] | list[str], recognised: RecognisedPoints) -> list[str]:
    """What was assumed about the file, as sentences."""
    notices = [*given, *([recognised.whose] if recognised.whose else []), *recognised.notes]
    tilt = tilt_deg(recognised.points.points_world)
    if tilt > _MOST_TILT_DEG:
        notices.append(f"the trunk is {tilt:.0f} degrees from upright in most frames: does the person lie? If not, "
                       "the file's up axis is another one: see --up")  # fmt: skip
    return notices


def _check_method(
    path: Path, recognised: RecognisedPoints, options: SolvePointsOptions, by_markers: bool
) -> SolverNetwork | None:
    """The network that corrects the joints, if any.

    Raises:
        FormatError: the options are for points of another kind.
    """
    if by_markers:
        if not recognised.columns:
            raise FormatError(
                f"{path}: the method `markers` needs labelled markers on the skin, and the file has {recognised.how}"
            )
        # It was trained on the statistical body's joints, which are others than a laboratory's.
        return open_corrector(options.network, options.correct, () if "body" in options.centres else USUAL)
    if options.centres or options.network:
        what = "joint centres" if options.centres else "a network"
        raise FormatError(
            f"{path}: {what} can be chosen for markers on the skin only, and the file has {recognised.how}",
            remedy="centres_of_landmarks" if options.centres else "network_of_landmarks",
        )
    return None


def _chosen_points(points: Points3D, recognised: RecognisedPoints) -> Points3D:
    """The markers that the body was fitted to, in their order."""
    columns = list(recognised.columns.values())
    surface = tuple(recognised.columns)
    # A marker set tolerates markers without a counterpart on the other side.
    names = MarkerSet("markers", surface, (), surface)
    none = (0, len(points.points_world), len(columns))
    return replace(points, landmarks=names, points_world=points.points_world[:, columns],
                   covariance_world=points.covariance_world[:, columns], residual_px=np.empty(none),
                   inlier=np.empty(none, dtype=np.bool_))  # fmt: skip


def _report_data(
    path: Path, points: Points3D, body: BodySolution, run: Run, options: SolvePointsOptions, notices: list[str]
) -> ReportData:
    skeleton = body.motion.skeleton
    return ReportData(
        title=path.name,
        cameras=None,
        points=points,
        body_residual_m=body.residual_m,
        joint_positions_world=body.motion.joint_positions_world(),
        joint_names=skeleton.names,
        joint_parents=tuple(skeleton.parents),
        warnings=tuple(notices),
        timings_s=run.timings_s,
        options=json_value(asdict(options)),
        versions=versions(),
        files=tuple(run.written),
    )


def _fit_markers(
    points: Points3D, recognised: RecognisedPoints, options: SolvePointsOptions, corrector: SolverNetwork | None,
    measured: Measurements,
) -> tuple[Arrays, Facts]:  # fmt: skip
    columns = dict(recognised.columns)
    chosen = points.points_world[:, list(columns.values())]
    surface = np.array([SURFACE.index(n) for n in columns])
    known = _centres(points.points_world, recognised, options.centres, measured)
    return fit_labelled_markers(chosen, surface, tuple(columns), points.fps, options.markers, known, corrector)


def _centres(
    points_world: FloatArray, recognised: RecognisedPoints, asked: tuple[Centres, ...], measured: Measurements
) -> JointCentres:
    """Joint centres by the methods that were asked for, and the usual ones after them; of two for one joint the first
    counts."""
    methods: tuple[str, ...] = tuple(m for m in asked if m != "body")
    methods += () if "body" in asked else USUAL
    if "file" not in methods:
        return centres_from_markers(points_world, dict(recognised.columns), methods, measured)
    at = methods.index("file")
    found: dict[str, tuple[FloatArray, float]] = {}
    own = {joint: (points_world[:, column], _MODELLED_M) for joint, column in recognised.centres.items()}
    for part in (methods[:at], None, methods[at + 1 :]):
        if part is None:
            new = own
        else:
            made = centres_from_markers(points_world, dict(recognised.columns), part, measured)
            new = {n: (made.points_world[:, i], float(made.sigma[i])) for i, n in enumerate(made.names)}
        found = new | found
    if not found:
        return JointCentres()
    return JointCentres(tuple(found), np.stack([p for p, _ in found.values()], 1),
                        np.array([sigma for _, sigma in found.values()]))  # fmt: skip


def _file_facts(path: Path, recognised: RecognisedPoints, stature: float) -> dict[str, Any]:
    """The file for `run.json`."""
    return {
        "name": path.name,
        "recognised": recognised.how,
        "labels_used": recognised.used,
        "labels_unused": recognised.unused,
        "stature_m": round(stature, 4) if np.isfinite(stature) else None,
    }
