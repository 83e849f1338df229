"""The overlays of a session, one stage per camera, drawn into the small copies of the videos."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import ByteArray
from muybridge.infer.detection.detect import CameraResult
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.report.data import Thumbnail
from muybridge.infer.report.page import pick_thumbnail_frames
from muybridge.infer.results.overlay import OverlayOptions, write_overlay
from muybridge.infer.results.overlay_drawing import OverlayData
from muybridge.infer.results.people import written_people
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Task
from muybridge.infer.runtime.stages import StageResult
from muybridge.infer.session.discover import OVERLAY
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.session import Session
from muybridge.infer.session.video import read_chunks

THUMBNAILS = 4
# The code that overlays depend on.
_CODE = ("muybridge.geometry", "muybridge.infer.results", "muybridge.infer.session")


def overlay_name(camera_file: str) -> str:
    """Name of a camera's overlay."""
    return f"{OVERLAY}{camera_file}.mp4"


def is_overlay(name: str) -> bool:
    """Whether a result is a camera's overlay."""
    return name.startswith(OVERLAY)


def write_overlays(
    run: Run, session: Session, camera_files: Sequence[str], detected: Sequence[CameraResult], solution: Solution,
    options: OverlayOptions, workers: int,
) -> list[Thumbnail]:  # fmt: skip
    """Draw 2D landmarks and the projected skeleton into the small copies of the videos.

    Args:
        run: receives the files and the stages.
        session: C cameras and their videos.
        camera_files: (C,) the cameras' names as file names.
        detected: (C,) 2D stages, which have the small copies.
        solution: the person of interest, and the others.
        options: drawing and encoding.
        workers: cameras worked on at the same time.

    Returns:
        Thumbnails for the report.
    """
    frames = len(solution.points.points_world)
    with run.progress.task("overlays", len(detected) * frames) as task, ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(_Overlay(run, session, name, found, c, solution, options, task).write)
            for c, (name, found) in enumerate(zip(camera_files, detected, strict=True))
        ]
        stages = [job.result() for job in jobs]
    run.stages |= {f"overlay {name}": stage for name, stage in zip(camera_files, stages, strict=True)}
    run.written += [overlay_name(name) for name in camera_files]
    return [
        Thumbnail(session.cameras.names[c], int(key), stage.arrays[key].tobytes())
        for c, stage in enumerate(stages)
        for key in sorted(stage.arrays, key=int)
    ]


@dataclass(frozen=True)
class _Overlay:
    """One camera's overlay."""

    run: Run
    session: Session
    camera_file: str
    detected: CameraResult
    index: int
    solution: Solution
    options: OverlayOptions
    task: Task

    def write(self) -> StageResult:
        """The stage, whose arrays are thumbnails by frame number."""
        name, stage, data = overlay_name(self.camera_file), f"overlay-{self.camera_file}", self._data()
        camera = self.session.cameras[self.index]
        key = digest(code_digest(*_CODE), self.detected.stage.key, camera, self.options, data)
        stored = self.run.store.load(stage, key)
        if stored is not None and self.run.output.owns(name):
            self.task.advance(len(data.projected_px))
            return stored
        start = time.perf_counter()
        proxy = probe_video(self.detected.proxy)
        scale = proxy.width / camera.width, proxy.height / camera.height
        thumbnails: dict[int, bytes] = {}

        def write(path: Path) -> None:
            frames = self._counted(read_chunks(proxy))
            wanted = pick_thumbnail_frames(self.solution.measured, THUMBNAILS)
            thumbnails.update(write_overlay(path, frames, scale, data, wanted, self.options).thumbnails)

        self.run.output.write(name, write)
        arrays = {str(t): np.frombuffer(jpeg, np.uint8) for t, jpeg in thumbnails.items()}
        return self.run.store.save(stage, key, arrays, {}, time.perf_counter() - start)

    def _data(self) -> OverlayData:
        solution, camera, c = self.solution, self.session.cameras[self.index], self.index
        return OverlayData(
            camera_name=camera.name,
            fps=self.session.fps,
            landmarks=solution.points.landmarks,
            keypoints_px=solution.points_px[c],
            projected_px=camera.project_seen(solution.points.points_world),
            residual_px=solution.measured.residual_px[c],
            inlier=solution.measured.inlier[c],
            others_px=tuple(camera.project_seen(o.points.points_world) for o in written_people(solution)[1:]),
        )

    def _counted(self, chunks: Iterator[ByteArray]) -> Iterator[ByteArray]:
        for chunk in chunks:
            yield from chunk
            self.task.advance(len(chunk))
