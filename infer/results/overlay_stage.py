"""The overlays of a session, one stage per camera, drawn into small copies of the frames."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray
from muybridge.infer import report
from muybridge.infer.detection.detect import CameraResult
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.report.data import Thumbnail
from muybridge.infer.results.overlay import OverlayOptions, encode_thumbnail, write_overlay
from muybridge.infer.results.overlay_drawing import OverlayData, draw_overlay
from muybridge.infer.results.people import written_people
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Task
from muybridge.infer.runtime.stages import StageResult
from muybridge.infer.session.discover import OVERLAY
from muybridge.infer.session.frame_copies import fit_inside
from muybridge.infer.session.session import Session
from muybridge.infer.session.video import read_chunks

THUMBNAILS = 4
_LONG_SIDE_PX = 960
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
    options: OverlayOptions, workers: int, videos: bool = True,
) -> list[Thumbnail]:  # fmt: skip
    """Draw 2D landmarks and the projected skeleton into small copies of the frames.

    Args:
        run: receives the files and the stages.
        session: C cameras and their videos.
        camera_files: (C,) the cameras' names as file names.
        detected: (C,) 2D stages, which may have the copies.
        solution: the person of interest, and the others.
        options: drawing and encoding.
        workers: cameras worked on at the same time.
        videos: write the videos; otherwise only the thumbnails are drawn, where there are copies.

    Returns:
        Thumbnails for the report.
    """
    frames = len(solution.points.points_world)
    with run.progress.task("overlays", len(detected) * frames) as task, ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(overlay.write if videos else overlay.draw_thumbnails)
            for overlay in (
                _Overlay(run, session, name, found, c, solution, options, task)
                for c, (name, found) in enumerate(zip(camera_files, detected, strict=True))
            )
        ]
        stages = [job.result() for job in jobs]
    what = "overlay" if videos else "thumbnails"
    run.stages |= {f"{what} {name}": stage for name, stage in zip(camera_files, stages, strict=True)}
    run.written += [overlay_name(name) for name in camera_files] if videos else []
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
        key = self._key(data)
        stored = self.run.store.load(stage, key)
        if stored is not None and self.run.output.owns(name):
            self.task.advance(len(data.projected_px))
            return stored
        start = time.perf_counter()
        size, scale = self._size()
        thumbnails: dict[int, bytes] = {}

        def write(path: Path) -> None:
            frames = self._shrunk(size)
            wanted = report.pick_thumbnail_frames(self.solution.measured, THUMBNAILS)
            thumbnails.update(write_overlay(path, frames, scale, data, wanted, self.options).thumbnails)

        self.run.output.write(name, write)
        arrays = {str(t): np.frombuffer(jpeg, np.uint8) for t, jpeg in thumbnails.items()}
        return self.run.store.save(stage, key, arrays, {}, time.perf_counter() - start)

    def draw_thumbnails(self) -> StageResult:
        """The same stage without the video; no thumbnails where that would mean decoding it."""
        stage, data = f"thumbnails-{self.camera_file}", self._data()
        key = self._key(data)
        stored = self.run.store.load(stage, key)
        self.task.advance(len(data.projected_px))
        if stored is not None:
            return stored
        start = time.perf_counter()
        arrays: dict[str, NDArray[Any]] = {}
        if self.detected.copies_scale:
            size, scale = self._size()
            wanted = np.array(report.pick_thumbnail_frames(self.solution.measured, THUMBNAILS), dtype=np.intp)
            frames = (frame for chunk in self.detected.read_copies(wanted) for frame in chunk)
            for t, frame in zip(wanted.tolist(), frames, strict=True):
                drawn = draw_overlay(_resized(frame, size), t, scale, data, self.options.legend)
                arrays[str(t)] = np.frombuffer(encode_thumbnail(drawn, self.options), np.uint8)
        return self.run.store.save(stage, key, arrays, {}, time.perf_counter() - start)

    def _key(self, data: OverlayData) -> str:
        camera = self.session.cameras[self.index]
        return digest(code_digest(*_CODE), self.detected.stage.key, camera, self.options, data)

    def _size(self) -> tuple[tuple[int, int], tuple[float, float]]:
        """Width and height of the overlay, px, and both over those of the frames."""
        camera = self.session.cameras[self.index]
        size = fit_inside(camera.width, camera.height, _LONG_SIDE_PX)
        return size, (size[0] / camera.width, size[1] / camera.height)

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

    def _shrunk(self, size: tuple[int, int]) -> Iterator[ByteArray]:
        """The frames at a smaller size (width, height), from the copies where these are large enough."""
        camera, video = self.session.cameras[self.index], self.session.videos[self.index]
        scale = self.detected.copies_scale
        if scale and camera.width // scale >= size[0]:
            chunks = self.detected.read_copies()
        else:
            indices = self.session.frame_indices[self.index, : self.session.lasts(self.index)]
            chunks = read_chunks(video, indices, reuse=True)
        for chunk in chunks:
            for frame in chunk:
                yield _resized(frame, size)
            self.task.advance(len(chunk))


def _resized(frame: ByteArray, size: tuple[int, int]) -> ByteArray:
    """A frame at another size, width and height."""
    if frame.shape[1::-1] == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
