"""A session on disk: a folder with `videos/`, one file per camera, and a calibration.

Opening a session checks everything that can go wrong before any frame is processed: which file belongs to which
camera, truncated recordings, and differing frame rates, sizes, rotation flags and lengths. Problems are corrected where
possible and reported in `Session.notices`; otherwise an error says what to do.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import SessionError
from muybridge.geometry.calibration import find_calibration, read_calibration
from muybridge.geometry.calibration.gravity import level_cameras, tilt_notes
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.video_size import VideoFit, fit_to_video, guess_calibrated_size
from muybridge.geometry.sync.clocks import Clock
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.discover import find_videos, select_cameras, video_folder
from muybridge.infer.session.pairing import match_cameras
from muybridge.infer.session.probe import VideoInfo, probe_video
from muybridge.infer.session.sync_file import clocks_in
from muybridge.infer.session.timeline import common_time
from muybridge.infer.session.timestamps import paired_by_time, time_table_in
from muybridge.infer.session.video import read_chunks

_log = logging.getLogger(__name__)

UPRIGHT_ADVICE = (
    "`muybridge run --world upright` turns the results upright, `muybridge calibrate world` the calibration"
)


@dataclass(frozen=True)
class SessionOptions:
    """How a session folder is read.

    Attributes:
        calibration: file to use in place of the session's own.
        cameras: use only these cameras of the calibration; empty for all.
        video_size: how the calibrated image was changed where a video has another size; `auto` decides and reports it.
        video_rotation: whether a file's rotation flag turns its frames; `auto` applies it unless only the coded frames
            have the calibration's size.
    """

    calibration: Path | None = None
    cameras: tuple[str, ...] = ()
    video_size: VideoFit = "auto"
    video_rotation: Literal["auto", "apply", "ignore"] = "auto"


@dataclass(frozen=True)
class Session:
    """A take that is ready to be processed.

    Attributes:
        path: the session's folder.
        calibration: the calibration file.
        cameras: C cameras, fitted to their videos' sizes.
        videos: C videos, in the cameras' order.
        frame_indices: (C, T) which frame of each video is frame t of the take.
        fps: frames per second of the take.
        notices: sentences about what was assumed or corrected.
        late: (C, T) seconds from a time of the take to the time of the camera's frame; None where frames are paired by
            number.
        clocks: (C,) of the cameras, counted from their first frames of the take, where a `sync.toml` gives them: the
            remaining fractions of a frame, and drifts.
        ended: (C, T) whether a camera's video has ended before; its last frame stands in `frame_indices` then. None
            where all videos last to the end of the take.
        upright: the cameras in a world with Z up, where the calibration's Z axis is not up and people show it.
    """

    path: Path
    calibration: Path
    cameras: CameraGroup
    videos: tuple[VideoInfo, ...]
    frame_indices: IntArray
    fps: float
    notices: tuple[str, ...]
    late: FloatArray | None = None
    clocks: tuple[Clock, ...] | None = None
    upright: CameraGroup | None = None
    ended: BoolArray | None = None

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name

    @property
    def frames(self) -> int:
        """Number of frames (T) of the take."""
        return int(self.frame_indices.shape[1])

    def lasts(self, c: int) -> int:
        """Number of frames of the take that a camera's video has."""
        return self.frames if self.ended is None else int((~self.ended[c]).sum())

    @cached_property
    def level_cameras(self) -> CameraGroup:
        """The cameras in a world turned upright where the calibration's is not; landmarks are detected with these."""
        return self.upright or level_cameras(self.cameras)


def open_session(path: Path, options: SessionOptions = SessionOptions(), in_step: bool = True) -> Session:
    """Read a session folder, its calibration and the properties of its videos; no frame is processed.

    Args:
        path: the folder.
        options: how it is read.
        in_step: whether its `sync.toml` is applied, if it has one.

    Raises:
        SessionError: no folder, no videos, fewer than two cameras, or cameras and videos that do not pair up.
        VideoError: a video that is truncated or cannot be decoded.
        CalibrationError: no calibration, several, or one that cannot be read.
    """
    files, notices = find_videos(path)
    calibration = options.calibration or find_calibration(path)
    read = read_calibration(calibration)
    group = read.cameras
    leaning = tilt_notes(group)
    notices += [
        f"{calibration.name}: {note}" + (f"; {UPRIGHT_ADVICE}" if note in leaning else "") for note in read.notes
    ]
    if options.cameras:
        group, files = select_cameras(group, files, options.cameras, calibration)
    if len(files) < 2 or len(group) < 2:
        raise SessionError(_too_few(path, files, calibration, group))
    order, notes = match_cameras([f.stem for f in files], group.names, path, calibration, read.no_pose)
    notices += notes
    videos = [probe_video(files[k]) for k in order]
    cameras: list[Camera] = []
    for k, camera in enumerate(group):
        videos[k], notes = _turn(videos[k], camera, options.video_rotation)
        notices += notes
        if camera.name in read.guessed_sizes:
            camera = guess_calibrated_size(camera, videos[k].width, videos[k].height)
        fitted, assumed = _fitted(camera, videos[k], options.video_size)
        cameras.append(fitted)
        if assumed:
            notices.append(assumed)
    table = time_table_in(path) or time_table_in(video_folder(path))
    clocks = clocks_in(path, group.names) if in_step else None
    ended = None
    if table is None:
        fps, indices, late, clocks, ended, notes = common_time(videos, clocks)
    else:
        fps, indices, late, notes = paired_by_time(table, videos)
    notices += notes + _oddities(videos, group)
    for notice in notices:
        _log.info("%s: %s", path, notice)
    return Session(
        path=path,
        calibration=calibration,
        cameras=CameraGroup(tuple(cameras)),
        videos=tuple(videos),
        frame_indices=indices,
        fps=fps,
        notices=tuple(notices),
        late=late,
        clocks=clocks,
        ended=ended,
    )


def _too_few(path: Path, files: Sequence[Path], calibration: Path, group: CameraGroup) -> str:
    if len(files) < 2:
        what = f"{path / 'videos'} holds one video ({files[0].name})" if files else f"{path} has no usable video"
        return f"{what}: motion needs at least two cameras that see the person; add another camera's video"
    return f"{calibration} has one camera ({group.names[0]}): motion needs at least two; calibrate them together"


def _turn(video: VideoInfo, camera: Camera, how: str) -> tuple[VideoInfo, list[str]]:
    """Apply or ignore the file's rotation flag."""
    flag = video.tagged_rotation_deg
    if not flag:
        return video, []
    name, size = video.path.name, (camera.width, camera.height)
    coded = video.unrotated()
    only_coded_fits = size == (coded.width, coded.height) != (video.width, video.height)
    if how == "ignore" or (how == "auto" and only_coded_fits):
        why = "as asked" if how == "ignore" else "as the calibration has the size of its unturned frames"
        return coded, [f"{name} has a rotation flag of {flag} degrees, which was ignored {why}"]
    return video, [f"{name} has a rotation flag: its frames were turned by {flag} degrees counterclockwise"]


def _fitted(camera: Camera, video: VideoInfo, how: VideoFit) -> tuple[Camera, str | None]:
    """The camera at its video's size, and what was assumed."""
    size = (video.width, video.height)
    if how == "auto" and _squeezed(camera, video):
        return fit_to_video(camera, *size, "scale")[0], (
            f"camera {camera.name}: calibrated at {camera.width}x{camera.height}, video is {size[0]}x{size[1]} with "
            f"pixels {video.pixel_aspect:.3f} times as wide as high: assumed to show the same image (scale)"
        )
    image = None
    if how == "auto" and size != (camera.width, camera.height):
        image = next(read_chunks(video, np.zeros(1, np.int64)))[0]
    fitted, assumption = fit_to_video(camera, *size, how, image)
    if assumption is None:
        return fitted, None
    others = " or ".join(assumption.alternatives)
    return fitted, f"{assumption.sentence}; if that is wrong, give --video-size {others}"


def _squeezed(camera: Camera, video: VideoInfo) -> bool:
    """Whether a video's pixels are not square, and the image that players show has the calibrated shape."""
    shown = video.width * video.pixel_aspect / video.height / (camera.width / camera.height)
    return _odd_pixels(video) and (video.width, video.height) != (camera.width, camera.height) and abs(shown - 1) < 0.02


def _odd_pixels(video: VideoInfo) -> bool:
    return abs(video.pixel_aspect - 1) > 0.01


def with_frames(session: Session, frames: int | IntArray) -> Session:
    """The session's first `frames` frames, or those of these numbers."""
    kept = np.arange(frames) if isinstance(frames, int) else frames
    late = None if session.late is None else session.late[:, kept]
    ended = None if session.ended is None else session.ended[:, kept]
    return replace(session, frame_indices=session.frame_indices[:, kept], late=late, ended=ended)


def with_notice(session: Session, notice: str, progress: Progress) -> Session:
    """The session with one more notice, which is also reported at once."""
    progress.notice(notice)
    _log.info("%s: %s", session.name, notice)
    return replace(session, notices=(*session.notices, notice))


def _oddities(videos: Sequence[VideoInfo], calibrated: CameraGroup) -> list[str]:
    """Harmless differences between videos that are worth a notice."""
    notices = []
    if len({(v.width, v.height) for v in videos}) > 1:
        sizes = ", ".join(f"{v.path.name} {v.width}x{v.height}" for v in videos)
        notices.append(f"frame sizes differ ({sizes} px)")
    for camera, video in zip(calibrated, videos, strict=True):
        if _odd_pixels(video) and not _squeezed(camera, video):
            notices.append(
                f"{video.path.name} declares pixels that are not square (aspect {video.pixel_aspect:.3f}): "
                "assumed to be square, because calibrations refer to stored pixels"
            )
    return notices
