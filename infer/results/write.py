"""The files of a result."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.geometry.landmarks.marker_sets import MarkerChoice
from muybridge.infer.detection.detect import CameraResult
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.reconstruction.quality import Quality, plain
from muybridge.infer.reconstruction.virtual_markers import marker_set
from muybridge.infer.report.page import ReportData, Thumbnail, pick_thumbnail_frames, problems, write_report
from muybridge.infer.report.sections import PersonPage
from muybridge.infer.results.folder import OutputFolder
from muybridge.infer.results.overlay import OverlayOptions, write_overlay
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress, Task
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.session import Session
from muybridge.infer.session.video import read_chunks
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.points.c3d import write_c3d
from muybridge.motion.formats.points.trc import write_trc
from muybridge.motion.formats.skeletal.bvh import write_bvh

POINTS_TRC, POINTS_C3D, MARKERS_C3D = "points.trc", "points.c3d", "markers.c3d"
MOTION_BVH, MOTION_GLB = "motion.bvh", "motion.glb"
CALIBRATION, REPORT, RUN = "calibration.toml", "report.html", "run.json"
THUMBNAILS = 4
# Of a run that follows everyone; whoever comes after these in interest is left out.
MOST_PEOPLE = 12
_OVERLAY = "overlay_"
# The code that overlays depend on.
_CODE = ("muybridge.geometry", "muybridge.infer.results", "muybridge.infer.session")


def overlay_name(camera_file: str) -> str:
    """Name of a camera's overlay."""
    return f"{_OVERLAY}{camera_file}.mp4"


def result_names(camera_files: Sequence[str]) -> tuple[str, ...]:
    """Every file that a run writes into its results folder.

    Args:
        camera_files: the cameras' names as file names.
    """
    overlays = tuple(overlay_name(name) for name in camera_files)
    personal = POINTS_TRC, POINTS_C3D, MOTION_BVH, MOTION_GLB, MARKERS_C3D, REPORT
    people = tuple(of_person(name, n) for n in range(1, MOST_PEOPLE + 1) for name in personal)
    return (*people, *overlays, RUN, CALIBRATION)


def is_overlay(name: str) -> bool:
    """Whether a result is a camera's overlay."""
    return name.startswith(_OVERLAY)


def of_person(name: str, number: int) -> str:
    """`points.trc` of the second person is `points_2.trc`."""
    path = Path(name)
    return name if number == 1 else f"{path.stem}_{number}{path.suffix}"


def written_people(solution: Solution) -> tuple[Solution, ...]:
    """Everybody who gets files: the person of interest, then the others."""
    return solution, *solution.others[: MOST_PEOPLE - 1]


def write_motion(output: OutputFolder, session: Session, solution: Solution, markers: MarkerChoice) -> list[str]:
    """Write the points, the motion, the markers of a set and the calibration as used; returns their names."""
    output.write(CALIBRATION, lambda path: save_calibration(session.cameras, path))
    names = [CALIBRATION]
    for number, person in enumerate(written_people(solution), start=1):
        for name, write in _writers(person, markers).items():
            output.write(of_person(name, number), write)
            names.append(of_person(name, number))
    return names


def _writers(person: Solution, markers: MarkerChoice) -> dict[str, Callable[[Path], object]]:
    """The files of one person by name."""
    motion, skin = person.motion, person.markers
    writers: dict[str, Callable[[Path], object]] = {
        POINTS_TRC: lambda path: write_trc(path, person.points),
        POINTS_C3D: lambda path: write_c3d(path, person.points),
    }
    if skin is not None:
        writers[MARKERS_C3D] = lambda path: write_c3d(path, marker_set(skin, markers))
    if motion is not None:
        writers[MOTION_BVH] = lambda path: write_bvh(path, motion)
        writers[MOTION_GLB] = lambda path: write_glb(path, motion)
    return writers


def write_overlays(
    output: OutputFolder,
    store: StageStore,
    session: Session,
    camera_files: Sequence[str],
    detected: Sequence[CameraResult],
    solution: Solution,
    options: OverlayOptions,
    workers: int,
    progress: Progress,
) -> tuple[dict[str, StageResult], list[Thumbnail]]:
    """Draw what was found into the small copies of the videos.

    Returns:
        The stages by name, and pictures for the report.
    """
    frames = len(solution.points.points_world)
    with progress.task("overlays", len(detected) * frames) as task, ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(_write_overlay, output, store, session, camera_files[c], result, c, solution, options, task)
            for c, result in enumerate(detected)
        ]
        stages = [job.result() for job in jobs]
    thumbnails = [
        Thumbnail(session.cameras.names[c], int(key), stage.arrays[key].tobytes())
        for c, stage in enumerate(stages)
        for key in sorted(stage.arrays, key=int)
    ]
    return {f"overlay {camera_files[c]}": stage for c, stage in enumerate(stages)}, thumbnails


def _write_overlay(
    output: OutputFolder,
    store: StageStore,
    session: Session,
    camera_file: str,
    detected: CameraResult,
    index: int,
    solution: Solution,
    options: OverlayOptions,
    task: Task,
) -> StageResult:
    name, camera = overlay_name(camera_file), session.cameras[index]
    projected = camera.project_seen(solution.points.points_world)
    others = [camera.project_seen(o.points.points_world) for o in written_people(solution)[1:]]
    residual, inlier = solution.measured.residual_px[index], solution.measured.inlier[index]
    key = digest(
        code_digest(*_CODE), detected.stage.key, camera, options, solution.points_px[index],
        projected, residual, inlier, session.fps, others,
    )  # fmt: skip
    stored = store.load(f"overlay-{camera_file}", key)
    if stored is not None and output.owns(name):
        task.advance(len(projected))
        return stored
    start = time.perf_counter()
    proxy = probe_video(detected.proxy)
    pictures: dict[int, bytes] = {}

    def write(path: Path) -> None:
        pictures.update(
            write_overlay(
                path,
                _counted(read_chunks(proxy), task),
                session.fps,
                (proxy.width / camera.width, proxy.height / camera.height),
                solution.points_px[index],
                projected,
                solution.points.landmarks,
                camera.name,
                residual,
                inlier,
                thumbnail_frames=pick_thumbnail_frames(solution.measured, THUMBNAILS),
                options=options,
                others_px=others,
            ).thumbnails
        )

    output.write(name, write)
    arrays = {str(t): np.frombuffer(jpeg, np.uint8) for t, jpeg in pictures.items()}
    return store.save(f"overlay-{camera_file}", key, arrays, {}, time.perf_counter() - start)


def _counted(chunks: Iterator[ByteArray], task: Task) -> Iterator[ByteArray]:
    for chunk in chunks:
        yield from chunk
        task.advance(len(chunk))


def write_report_pages(
    output: OutputFolder,
    session: Session,
    solution: Solution,
    qualities: Sequence[Quality],
    calibration: CalibrationQuality | None,
    thumbnails: Sequence[Thumbnail],
    timings: Mapping[str, float],
    options: Mapping[str, Any],
    versions: Mapping[str, str],
    files: Sequence[str],
) -> tuple[list[str], tuple[str, ...]]:
    """Write `report.html`, and one more for each further person; `qualities` are everybody's.

    Returns:
        The pages' names, and what the first says that spoils the result.
    """
    grave: tuple[str, ...] = ()
    people = written_people(solution)
    names = [of_person(REPORT, n) for n in range(1, len(people) + 1)]
    pages = tuple(PersonPage(name, q.coverage, q.leave_one_out_px) for name, q in zip(names, qualities, strict=True))
    shared = {
        "cameras": session.cameras, "warnings": session.notices, "timings_s": timings, "options": plain(options),
        "versions": versions, "pages": pages if len(pages) > 1 else (), "files": tuple(files),
    }  # fmt: skip
    for n, (person, quality) in enumerate(zip(people, qualities, strict=True)):
        # Overlays are drawn with the first person's points.
        own = {"calibration": calibration, "thumbnails": tuple(thumbnails)} if n == 0 else {}
        others = tuple(p.points.points_world for p in people if p is not person)
        data = _report_data(session.name, n + 1, person, others, quality, shared | own)
        output.write(names[n], partial(write_report, data=data))
        grave = problems(data) if n == 0 else grave
    return names, grave


def _report_data(
    name: str,
    number: int,
    person: Solution,
    others: tuple[FloatArray, ...],
    quality: Quality,
    shared: Mapping[str, Any],
) -> ReportData:
    motion = person.motion
    tables = ("cameras", "landmarks")
    return ReportData(
        title=name if number == 1 else f"{name}, person {number}",
        points=person.measured,
        delivered=person.points,
        number=number,
        others=others,
        keypoints_px=person.points_px,
        leave_one_out_px=person.leave_one_out_px,
        joint_positions_world=None if motion is None else motion.joint_positions_world(),
        joint_names=() if motion is None else motion.skeleton.names,
        joint_parents=() if motion is None else tuple(motion.skeleton.parents),
        person=person.person,
        quality=plain({k: v for k, v in asdict(quality).items() if k not in tables}),
        **shared,
    )


def write_run(output: OutputFolder, facts: Mapping[str, Any]) -> None:
    """Write `run.json`."""
    output.write_text(RUN, json.dumps(plain(facts), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
