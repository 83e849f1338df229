"""From a session's videos to 2D landmarks, 3D points, motion and files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from muybridge.errors import SessionError
from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.sync.clocks import resample_keypoints
from muybridge.geometry.triangulation.mirrored import exchanged_instead, find_mirrored
from muybridge.infer.detection.detect import CameraResult, DetectOptions, damage_notices, detect, file_names, first_pass
from muybridge.infer.detection.frozen_frames import repeats_notice
from muybridge.infer.detection.refine import RefinementOptions, TopDownRefinement
from muybridge.infer.detection.resample import resample_tracks
from muybridge.infer.detection.tracks import first_frames, merge_tracks
from muybridge.infer.networks.models import Models, open_models
from muybridge.infer.pipelines.warm_up import CompiledAhead
from muybridge.infer.reconstruction import judge_calibration, refine_cameras
from muybridge.infer.reconstruction.gravity import estimate_gravity
from muybridge.infer.reconstruction.landmarks import Solution, SolveOptions, solve
from muybridge.infer.reconstruction.quality import Quality, assess, unsure_landmarks
from muybridge.infer.results.folder import WORK
from muybridge.infer.results.names import DEFAULT_OUT, MOST_PEOPLE, PERSONAL, REPORT, of_person
from muybridge.infer.results.overlay import OverlayOptions
from muybridge.infer.results.overlay_stage import is_overlay, overlay_name, write_overlays
from muybridge.infer.results.people import write_people, write_reports, written_people
from muybridge.infer.results.provenance import calibration_facts, session_facts, versions
from muybridge.infer.results.record import json_value
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.digests import digest
from muybridge.infer.runtime.presets import Preset, with_preset
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.runtime.threads import opencv_in_one_thread
from muybridge.infer.session.session import Session, SessionOptions, open_session, with_frames, with_notice
from muybridge.infer.session.sync_file import SYNC_FILE
from muybridge.motion import contacts as foot_contacts

if TYPE_CHECKING:
    from muybridge.infer.viewer.data import Scene
    from muybridge.motion.contacts.find import Contacts

_log = logging.getLogger(__name__)

CALIBRATION = "calibration.toml"
# Where `muybridge adapt` leaves a session's own network.
ADAPTED = Path("adapted") / "keypoints-int8.onnx"


@dataclass(frozen=True)
class RunOptions:
    """Every stage's options.

    Attributes:
        preset: how much time is spent for how accurate a result; it sets what other options leave at their defaults.
        session: how the session folder is read.
        detect: 2D landmarks.
        solve: 3D points and motion.
        refinement: when a person's views are read again with crops predicted from 3D.
        overlay: the videos with landmarks and skeleton overlaid.
        overlays: write those videos; a later run with the same options writes only what is missing.
        diagnose: look for a camera that was turned or moved, is out of step or has the wrong lens.
        refine_cameras: refine the cameras' poses from the person first.
        world: axes of the results: those of the `calibration`, or turned `upright` where its Z axis is not up.
        overwrite: replace files of our names in the results folder that muybridge did not write.
    """

    preset: Preset = "balanced"
    session: SessionOptions = field(default_factory=SessionOptions)
    detect: DetectOptions = field(default_factory=DetectOptions)
    solve: SolveOptions = field(default_factory=SolveOptions)
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    overlay: OverlayOptions = field(default_factory=OverlayOptions)
    overlays: bool = True
    diagnose: bool = True
    refine_cameras: bool = False
    world: Literal["calibration", "upright"] = "calibration"
    overwrite: bool = False


class RunCharacter(Protocol):
    """A character that a run's motion is put onto (see `muybridge.infer.commands.motion.run_character`)."""

    @property
    def path(self) -> Path:
        """Its file, which is read."""

    @property
    def names(self) -> tuple[str, ...]:
        """Every file that may be written into the results folder."""

    def put_on(self, run: Run) -> dict[int, Scene]:
        """Write the character with the motion that the run has written; what the report of each person shows."""


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    Attributes:
        out: the results folder.
        session: the session, with what was assumed about it.
        solution: the person in 3D.
        quality: the person's quality figures.
        seconds: how long this run took.
        others: quality figures of the other people who were written, by number from 2.
        problems: what spoils the result, as sentences; the report has the same.
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
    """A session whose person was tracked.

    Attributes:
        session: with as many frames as every camera has, and the cameras that were used.
        detected: each camera's 2D landmarks, in its own frames.
        solution: the person's motion.
        calibration: how good the cameras are; None where that cannot be judged.
    """

    session: Session
    detected: Sequence[CameraResult]
    solution: Solution
    calibration: CalibrationQuality | None


def result_names(camera_files: Sequence[str]) -> tuple[str, ...]:
    """Every file that a run writes into its results folder, except `run.json`.

    Args:
        camera_files: the cameras' names as file names.
    """
    people = tuple(of_person(name, n) for n in range(1, MOST_PEOPLE + 1) for name in PERSONAL)
    return (*people, *(overlay_name(name) for name in camera_files), CALIBRATION)


@opencv_in_one_thread()
def run_session(
    path: Path, out: Path | None, options: RunOptions, progress: Progress, character: RunCharacter | None = None
) -> RunResult:
    """Process one session folder.

    Args:
        path: the session's folder.
        out: the results folder; None for `muybridge/` inside the session.
        options: of every stage.
        progress: receives progress messages.
        character: that the motion is put onto as well; its file goes into the results folder.

    Raises:
        MuybridgeError: of some kind, for everything that the user can fix. Everything that can be known beforehand is
            checked before the first frame is processed and before anything is written.
    """
    options = with_preset(options, options.preset, RunOptions())
    session = open_session(path, options.session)
    models = open_models(options.detect)
    files = file_names(session.cameras.names)
    own = () if character is None else (character.path,)
    inputs = [session.calibration, *(v.path for v in session.videos), *own]
    place = path / DEFAULT_OUT if out is None else out
    names = (*result_names(files), *(() if character is None else character.names))
    run = Run("videos", place, names, inputs, options.overwrite, progress, path)
    progress.say(f"{session.name}: {len(session.cameras)} cameras, {session.frames} frames at {session.fps:.4g} fps")
    for notice in session.notices:
        progress.notice(notice)
    if options.detect.keypoint_model is None and (path / ADAPTED).is_file():
        progress.notice(f"{path / ADAPTED} was adapted to this session and is not used; --keypoint-model names it")
    followed = follow(session, models, run.store, options, progress)
    session, solution = followed.session, followed.solution
    if solution.motion is None:
        session = replace(session, notices=(*session.notices, f"there is no motion: {solution.no_motion}"))
    qualities = [assess(session.cameras, person) for person in written_people(solution)]
    problems, contacts = _write(run, session, followed, qualities, options, character)
    earlier = (name for name in run.output.names if is_overlay(name))  # of cameras that take no part now
    seconds = run.finish(
        {*names, *earlier},
        frames=session.frames, fps=session.fps, session=session_facts(session), quality=asdict(qualities[0]),
        others=[{"person": n, "quality": asdict(q)} for n, q in enumerate(qualities[1:], start=2)],
        calibration=calibration_facts(followed.calibration), person=solution.person, notices=session.notices,
        problems=problems, options=asdict(options), models=models.metadata,
        contacts=None if contacts is None else foot_contacts.contact_facts(contacts),
    )  # fmt: skip
    if solution.motion is None:
        raise SessionError(
            f"{path}: {solution.no_motion}; {run.output.path / REPORT} and the overlays beside it show the landmarks: "
            "if they lie on the person, the calibration does not belong to these videos"
        )
    return RunResult(run.output.path, session, solution, qualities[0], seconds, tuple(qualities[1:]), problems)


def _write(
    run: Run, session: Session, followed: Followed, qualities: Sequence[Quality], options: RunOptions,
    character: RunCharacter | None,
) -> tuple[tuple[str, ...], Contacts | None]:  # fmt: skip
    """Write every result but `run.json`; returns what spoils the result, as sentences, and the first person's
    contacts."""
    solution, files = followed.solution, file_names(session.cameras.names)
    run.stages |= {f"2D {files[c]}": d.stage for c, d in enumerate(followed.detected)} | solution.stages
    run.write(CALIBRATION, partial(_save_calibration, session=session))
    contacts = write_people(run, solution, options.detect.markers)
    characters = {} if character is None or solution.motion is None else character.put_on(run)
    thumbnails = write_overlays(
        run, session, files, followed.detected, solution, options.overlay, options.detect.workers, options.overlays
    )
    shared: dict[str, Any] = {
        "cameras": session.cameras, "warnings": session.notices, "timings_s": run.timings_s,
        "options": json_value(asdict(options)), "versions": versions(),
    }  # fmt: skip
    # Overlays are drawn with the first person's points.
    first = {"calibration": followed.calibration, "thumbnails": tuple(thumbnails)}
    return write_reports(run, session.name, solution, qualities, shared, first, characters), contacts


def _save_calibration(path: Path, session: Session) -> None:
    save_calibration(session.cameras, path)


def follow(session: Session, models: Models, store: StageStore, options: RunOptions, progress: Progress) -> Followed:
    """Everything from a session's videos to its person's motion, before anything is written.

    Args:
        session: C cameras and their videos.
        models: the networks.
        store: where finished stages are.
        options: of every stage but the overlays.
        progress: receives progress messages.

    Raises:
        SessionError: a video has no frame, or videos are mirrored.
    """
    files = file_names(session.cameras.names)
    again = options.refinement
    _log.info("%s: keypoint network %s, person detector %s", session.name, models.keypoints.name, models.people.name)
    first = first_pass(options.detect) if again.enabled and again.everywhere else options.detect
    with CompiledAhead() as ahead:
        session = estimate_gravity(session, files, models, store, first, progress, turn=options.world == "upright")
        detected = detect(session, files, models, store, first, progress)
        ahead.wait(progress)
    session, keypoints = _merge(session, detected, progress)
    if session.clocks is not None:
        session = with_notice(session, f"the cameras' 2D landmarks were synchronised by {SYNC_FILE}", progress)
    key = digest([d.stage.key for d in detected], session.frames, session.cameras.cameras, session.clocks, session.late)
    body = next(iter(keypoints.values()))
    _refuse_mirrored(session, body)
    session, stages = _refine_cameras(session, body, key, store, options, progress)
    key = digest(key, session.cameras.cameras)
    refinement = TopDownRefinement(
        session, detected, files, models, store, options.detect, options.refinement, progress
    )
    solve_options = options.solve.with_card(models.min_confidence)
    with ThreadPoolExecutor(1) as beside:  # nothing but the report waits for what it says
        judging = beside.submit(
            judge_calibration.judge, session.cameras, body, session.fps, key, store, progress, options.diagnose
        )
        solution = solve(session.cameras, keypoints, session.fps, key, store, solve_options, progress, refinement)
        calibration, judged = judging.result()
    if judged is not None:
        stages[judge_calibration.STAGE] = judged
    progress.say(solution.person)
    for notice in unsure_landmarks(solution):
        session = with_notice(session, notice, progress)
    solution.stages.update(stages)
    return Followed(session, detected, solution, calibration)


def _refuse_mirrored(session: Session, keypoints: Keypoints2D) -> None:
    """Raise if videos are mirrored: then no view agrees with any other, and a camera would be blamed for it."""
    mirrored = find_mirrored(session.cameras, keypoints)
    if mirrored:
        files = [session.videos[c].path.name for c in mirrored]
        what, instead = "it is mirrored", ""
        if len(mirrored) > 1:
            what = "all videos are mirrored, as programs for webcams record them"
            names = [v.path.name for v in session.videos]
            pairs = [f"{names[a]} and {names[b]}" for a, b in exchanged_instead(session.cameras, keypoints)]
            if pairs:
                instead = f"; or, which shows no difference, these videos are exchanged: {', '.join(pairs)}"
        raise SessionError(
            f"{', '.join(files)}: {what}: turned back, the views agree{instead}; turn each mirrored video back, such "
            f"as `ffmpeg -i {files[0]} -vf hflip -crf 18 OUT.mp4`, and record without mirroring"
        )


def _refine_cameras(
    session: Session, keypoints: Keypoints2D, key: str, store: StageStore, options: RunOptions, progress: Progress
) -> tuple[Session, dict[str, StageResult]]:
    """The session, its cameras refined if that was asked, and the stage of that by its name."""
    if not options.refine_cameras:
        return session, {}
    session, stage = refine_cameras.refine(session, keypoints, key, store, progress)
    return session, {} if stage is None else {refine_cameras.STAGE: stage}


def _merge(
    session: Session, detected: Sequence[CameraResult], progress: Progress
) -> tuple[Session, dict[str, Keypoints2D]]:
    """Everyone's 2D landmarks by set, synchronised, over the frames that every camera really has."""
    counts = [d.tracks.frames for d in detected]
    frames = min(counts)
    if frames == 0:
        empty = session.videos[counts.index(0)].path
        raise SessionError(f"{empty} gave no frame; export it again")
    if frames < session.frames:
        shortest = session.videos[counts.index(frames)].path.name
        notice = f"{shortest} has {frames} frames, fewer than its header suggests: the first {frames} are used"
        session = with_notice(with_frames(session, frames), notice, progress)
    for notice in damage_notices(session, detected):
        session = with_notice(session, notice, progress)
    for c, found in enumerate(detected):
        if (repeats := repeats_notice(session, c, found.own_repeats)) is not None:
            session = with_notice(session, repeats, progress)
        if found.frozen_from is not None:
            name = session.videos[c].path.name
            notice = f"{name} is frozen from frame {found.frozen_from} to its end, while other cameras see people move"
            session = with_notice(session, f"{notice}: its landmarks are left out there", progress)
    tracks = [resample_tracks(session, c, first_frames(d.tracks, frames), d.repeats) for c, d in enumerate(detected)]
    return session, {n: resample_keypoints(k, session.clocks, session.fps) for n, k in merge_tracks(tracks).items()}


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
            f"    {name:<{width}}  sees {camera['seen']:6.1%}"
            + (f"   reprojection {near:6.1f} px" if np.isfinite(near := camera["reprojection_px"]) else "")
            + (f"   left out {away:6.1f} px" if np.isfinite(away := camera["leave_one_out_px"]) else "")
        )
    for number, other in enumerate(result.others, start=2):
        rows.append(f"  person {number}: 3D points for {other.coverage:.1%}, {_left_out(other.leave_one_out_px)}")
    rows += [f"  problem: {text}" for text in result.problems]
    rows.append(f"  results: {result.out} ({REPORT} shows them; {WORK}/ may be deleted)")
    return "\n".join(rows)


def _left_out(away_px: float) -> str:
    if np.isfinite(away_px):
        return f"a camera left out is missed by {away_px:.1f} px (median)"
    return "no camera can be left out: never more than two see the person"
