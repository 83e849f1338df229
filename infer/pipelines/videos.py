"""The whole chain for one session: videos to 2D landmarks, to 3D points, to motion, to files."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from muybridge import __version__
from muybridge.errors import SessionError
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.sync.clocks import synchronised
from muybridge.infer.detection.detect import (
    CameraResult,
    DetectOptions,
    Models,
    detect,
    file_names,
    first_look,
    open_models,
)
from muybridge.infer.detection.pose_estimator import first_frames, merge_markers, merge_tracks
from muybridge.infer.detection.refine import RefinementOptions, TopDownRefinement
from muybridge.infer.detection.resample import in_time, repeats_notice
from muybridge.infer.pipelines.warm_up import CompiledAhead
from muybridge.infer.reconstruction import judge_calibration as calibration_stage
from muybridge.infer.reconstruction import refine_cameras
from muybridge.infer.reconstruction.gravity import estimate_gravity
from muybridge.infer.reconstruction.landmarks import Solution, SolveOptions, solve
from muybridge.infer.reconstruction.quality import Quality, assess, unsure_landmarks
from muybridge.infer.results import write as exports
from muybridge.infer.results.folder import WORK, OutputFolder, open_output
from muybridge.infer.results.overlay import OverlayOptions
from muybridge.infer.results.provenance import calibration_facts, machine, session_facts, stage_facts, versions
from muybridge.infer.runtime.digests import digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.session.session import Session, SessionOptions, open_session, with_frames, with_notice
from muybridge.infer.session.sync_file import SYNC_FILE

RUN_FORMAT = 1
DEFAULT_OUT = "muybridge"
# Where `muybridge adapt` leaves a session's own network.
ADAPTED = Path("adapted") / "keypoints-int8.onnx"


@dataclass(frozen=True)
class RunOptions:
    """Every stage's options.

    Attributes:
        session: how the session folder is read.
        detect: 2D landmarks.
        solve: 3D points and motion.
        refinement: views that lack the person, looked at again where the others know them to be.
        overlay: the videos with what was found.
        refine_cameras: make the cameras' poses better by the person first.
        world: whose axes results have: the `calibration`'s, or turned `upright` where its Z axis is not up.
        overwrite: replace files of our names in the results folder that muybridge did not write.
    """

    session: SessionOptions = field(default_factory=SessionOptions)
    detect: DetectOptions = field(default_factory=DetectOptions)
    solve: SolveOptions = field(default_factory=SolveOptions)
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    overlay: OverlayOptions = field(default_factory=OverlayOptions)
    refine_cameras: bool = False
    world: Literal["calibration", "upright"] = "calibration"
    overwrite: bool = False


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    Attributes:
        out: the results folder.
        session: what was worked on.
        solution: what was found.
        quality: how good it is.
        seconds: how long this run took.
        others: how good the other people are who were written, by number from 2.
        problems: what spoils the result, a sentence each, as the report has them.
    """

    out: Path
    session: Session
    solution: Solution
    quality: Quality
    seconds: float
    others: tuple[Quality, ...] = ()
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class Followed:
    """A session whose person was followed.

    Attributes:
        session: with as many frames as every camera has, and the cameras that were used.
        detected: what each camera found, in its own frames.
        solution: the person's motion.
        calibration: how good the cameras are; None where that cannot be told.
    """

    session: Session
    detected: Sequence[CameraResult]
    solution: Solution
    calibration: CalibrationQuality | None


def run_session(path: Path, out: Path | None, options: RunOptions, progress: Progress) -> RunResult:
    """Work on one session folder.

    Args:
        path: the session's folder.
        out: the results folder; None for `muybridge/` inside the session.
        options: how.
        progress: whom to tell.

    Raises:
        MuybridgeError: of some kind, for everything that the user can mend. Everything that can be known
            beforehand is checked before the first frame is worked on, and before anything is written.
    """
    start, began = time.perf_counter(), datetime.now(UTC)
    session = open_session(path, options.session)
    models = open_models(options.detect)
    files = file_names(session.cameras.names)
    inputs = [session.calibration, *(v.path for v in session.videos)]
    place = path / DEFAULT_OUT if out is None else out
    output = open_output(place, exports.result_names(files), inputs, options.overwrite, path)
    store = StageStore(output.work)
    progress.say(f"{session.name}: {len(session.cameras)} cameras, {session.frames} frames at {session.fps:.4g} fps")
    for notice in session.notices:
        progress.notice(notice)
    if options.detect.keypoint_model is None and (path / ADAPTED).is_file():
        progress.notice(f"{path / ADAPTED} was adapted to this session and is not used; --keypoint-model names it")
    followed = follow(session, models, store, options, progress)
    session, solution, calibration = followed.session, followed.solution, followed.calibration
    if solution.motion is None:
        session = replace(session, notices=(*session.notices, f"there is no motion: {solution.no_motion}"))
    qualities = [assess(session.cameras, person) for person in exports.written_people(solution)]
    written, stages, problems = _write(
        output, store, session, files, followed.detected, solution, qualities, calibration, options, progress
    )
    seconds = time.perf_counter() - start
    facts = _facts(began, seconds, session, written, qualities, calibration, solution, stages, options, models.metadata)
    facts["problems"] = problems
    exports.write_run(output, facts)
    if solution.motion is None:
        raise SessionError(
            f"{path}: {solution.no_motion}; {output.path / exports.REPORT} and the overlays beside it show "
            "what was found: if the marks are on the person, the calibration does not belong to these videos"
        )
    return RunResult(output.path, session, solution, qualities[0], seconds, tuple(qualities[1:]), problems)


def follow(session: Session, models: Models, store: StageStore, options: RunOptions, progress: Progress) -> Followed:
    """Everything from a session's videos to its person's motion, before anything is written.

    Args:
        session: C cameras and their videos.
        models: the networks.
        store: where finished stages are.
        options: how; those of overlays are not looked at.
        progress: whom to tell.

    Raises:
        SessionError: a video gave no frame.
    """
    files = file_names(session.cameras.names)
    look = options.refinement
    first = first_look(options.detect) if look.enabled and look.everywhere else options.detect
    with CompiledAhead() as ahead:
        session = estimate_gravity(session, files, models, store, first, progress, turn=options.world == "upright")
        detected = detect(session, files, models, store, first, progress)
        ahead.wait(progress)
    session, keypoints, markers = _common(session, detected, progress)
    if session.clocks is not None:
        session = with_notice(session, f"the cameras' 2D landmarks were put in step by {SYNC_FILE}", progress)
    key = digest([d.stage.key for d in detected], session.frames, session.cameras.cameras, session.clocks, session.late)
    session, calibration, before = _calibrated(session, keypoints, key, store, options, progress)
    key = digest(key, session.cameras.cameras)
    again = TopDownRefinement(session, detected, files, models, store, options.detect, options.refinement, progress)
    how = options.solve.with_card(models.min_confidence)
    solution = solve(session.cameras, keypoints, session.fps, key, store, how, progress, markers, again)
    progress.say(solution.person)
    for notice in unsure_landmarks(solution):
        session = with_notice(session, notice, progress)
    solution.stages.update(before)
    return Followed(session, detected, solution, calibration)


def _facts(
    began: datetime,
    seconds: float,
    session: Session,
    written: Sequence[str],
    qualities: Sequence[Quality],
    calibration: CalibrationQuality | None,
    solution: Solution,
    stages: Mapping[str, StageResult],
    options: RunOptions,
    models: Mapping[str, Any],
) -> dict[str, Any]:
    """What `run.json` says."""
    return {
        "format": RUN_FORMAT,
        "muybridge": __version__,
        "started": began.isoformat(timespec="seconds"),
        "seconds": seconds,
        "session": session_facts(session),
        "results": [*written, exports.RUN],
        "quality": asdict(qualities[0]),
        "calibration": calibration_facts(calibration),
        "person": solution.person,
        "people": 1 + len(solution.others),
        "others": [{"person": n, "quality": asdict(q)} for n, q in enumerate(qualities[1:], start=2)],
        "notices": session.notices,
        "stages": stage_facts(stages),
        "options": asdict(options),
        "models": models,
        "versions": versions(),
        "machine": machine(),
    }


def _calibrated(
    session: Session,
    keypoints: Keypoints2D,
    key: str,
    store: StageStore,
    options: RunOptions,
    progress: Progress,
) -> tuple[Session, CalibrationQuality | None, dict[str, StageResult]]:
    """The session with its cameras refined if that was asked, how good they are, and the stages by name."""
    stages: dict[str, StageResult | None] = {}
    if options.refine_cameras:
        session, stages[refine_cameras.STAGE] = refine_cameras.refined(session, keypoints, key, store, progress)
        key = digest(key, session.cameras.cameras)
    judged, stages[calibration_stage.STAGE] = calibration_stage.judge(
        session.cameras, keypoints, session.fps, key, store, progress
    )
    return session, judged, {name: stage for name, stage in stages.items() if stage is not None}


def _write(
    output: OutputFolder,
    store: StageStore,
    session: Session,
    files: Sequence[str],
    detected: Sequence[CameraResult],
    solution: Solution,
    qualities: Sequence[Quality],
    calibration: CalibrationQuality | None,
    options: RunOptions,
    progress: Progress,
) -> tuple[list[str], dict[str, StageResult], tuple[str, ...]]:
    """Write every result but `run.json`; returns their names, all stages by name, and what spoils the result."""
    stages = {f"2D {files[c]}": d.stage for c, d in enumerate(detected)} | solution.stages
    written = exports.write_motion(output, session, solution, options.detect.markers)
    drawn, thumbnails = exports.write_overlays(
        output, store, session, files, detected, solution, options.overlay, options.detect.workers, progress
    )
    stages |= drawn
    written += [exports.overlay_name(name) for name in files]
    timings = {name: stage.seconds for name, stage in stages.items()}
    pages, problems = exports.write_report_pages(
        output, session, solution, qualities, calibration, thumbnails, timings, asdict(options), versions(), written
    )
    written += pages
    kept = {*written, exports.RUN}
    # Overlays of cameras that take no part now, or of another session.
    earlier = (name for name in output.names if exports.is_overlay(name))
    output.retire(name for name in {*exports.result_names(files), *earlier} if name not in kept)
    return written, stages, problems


def _common(
    session: Session, detected: Sequence[CameraResult], progress: Progress
) -> tuple[Session, Keypoints2D, Keypoints2D | None]:
    """Everyone's 2D landmarks and markers, in step, over the frames that every camera really had."""
    counts = [len(d.tracks.points_px) for d in detected]
    frames = min(counts)
    if frames == 0:
        empty = session.videos[counts.index(0)].path
        raise SessionError(f"{empty} gave no frame; export it again")
    if frames < session.frames:
        shortest = session.videos[counts.index(frames)].path.name
        notice = f"{shortest} has {frames} frames, fewer than its header suggests: the first {frames} are used"
        session = with_notice(with_frames(session, frames), notice, progress)
    for c, found in enumerate(detected):
        if (repeats := repeats_notice(session, c, found.own_repeats)) is not None:
            session = with_notice(session, repeats, progress)
        if found.frozen_from is not None:
            name = session.videos[c].path.name
            notice = f"{name} hangs from frame {found.frozen_from} to its end, while others see people move"
            session = with_notice(session, f"{notice}: it is left out there", progress)
    tracks = [in_time(session, c, first_frames(d.tracks, frames), d.repeats) for c, d in enumerate(detected)]
    markers = merge_markers(tracks)
    if markers is not None:
        markers = synchronised(markers, session.clocks, session.fps)
    return session, synchronised(merge_tracks(tracks), session.clocks, session.fps), markers


def summary(result: RunResult) -> str:
    """A few plain lines about a finished run."""
    quality, session = result.quality, result.session
    rows = [
        f"{session.name}: {session.frames} frames, {len(session.cameras)} cameras, {result.seconds:.0f} s",
        f"  3D points for {quality.coverage:.1%} of all frames and landmarks",
        f"  they project {quality.reprojection_px:.1f} px (median) from the 2D landmarks",
        f"  {_left_out(quality.leave_one_out_px)}",
    ]
    width = max(len(name) for name in quality.cameras)
    for name, camera in quality.cameras.items():
        rows.append(
            f"    {name:<{width}}  sees {camera['seen']:6.1%}   reprojection "
            f"{camera['reprojection_px']:6.1f} px"
            + (f"   left out {away:6.1f} px" if np.isfinite(away := camera["leave_one_out_px"]) else "")
        )
    for number, other in enumerate(result.others, start=2):
        rows.append(f"  person {number}: 3D points for {other.coverage:.1%}, {_left_out(other.leave_one_out_px)}")
    rows += [f"  problem: {text}" for text in result.problems]
    rows.append(f"  results: {result.out} ({exports.REPORT} shows them; {WORK}/ may be deleted)")
    return "\n".join(rows)


def _left_out(away_px: float) -> str:
    if np.isfinite(away_px):
        return f"a camera left out is missed by {away_px:.1f} px (median)"
    return "no camera can be left out: never more than two see the person"
