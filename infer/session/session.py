"""A session on disk: a folder with `videos/`, one file a camera, and a calibration.

Opening a session looks at everything that can go wrong before any frame is worked on: which file is which
camera, truncated recordings, frame rates, sizes, rotation flags and lengths that differ. What can be mended
is mended and said in `Session.notices`; what cannot is an error with its remedy.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import SessionError
from muybridge.geometry.calibration import VideoFit, find_calibration, fit_to_video, read_calibration, sized_like
from muybridge.geometry.calibration.gravity import levelled
from muybridge.geometry.cameras.camera import Camera, CameraGroup
from muybridge.geometry.sync.clocks import Clock
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.sync_file import SYNC_FILE, clocks_in, first_frames_in_common
from muybridge.infer.session.timestamps import TIMESTAMPS, nearest, paired_by_time, time_table_in
from muybridge.infer.session.video import VideoInfo, is_video, probe_video, read_chunks

# A file of one of these kinds that cannot be opened is a broken video; any other is something else.
VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .avi .mkv .webm .mpg .mpeg .mts .m2ts .ts .mxf .wmv .flv .3gp .h264 .hevc".split()
)
# Small copies that action cameras and drones write beside their films.
PROXY_SUFFIXES = frozenset((".lrv", ".lrf", ".thm"))
# Where a session's videos are: in the first of these folders that is there (other programs have their own names for
# it), else in the session itself.
VIDEO_FOLDERS = ("videos", "synchronized_videos", "videos-raw")
# Where other programs keep a folder of pictures a camera, which are no films.
PICTURE_FOLDERS = ("images", "imgs", "frames")
PICTURE_SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"))
# Rates this close are one rate written down differently (29.97 and 30).
_SAME_RATE = 0.005


@dataclass(frozen=True)
class SessionOptions:
    """How a session folder is read.

    Attributes:
        calibration: file to use in place of the session's own.
        cameras: only these cameras of the calibration take part; empty for all.
        video_size: what was done to the calibrated picture where a video has another size; `auto` decides
            and says so.
        video_rotation: whether a file's rotation flag turns its frames; `auto` applies it unless only the
            frames as coded have the calibration's size.
    """

    calibration: Path | None = None
    cameras: tuple[str, ...] = ()
    video_size: VideoFit = "auto"
    video_rotation: Literal["auto", "apply", "ignore"] = "auto"


@dataclass(frozen=True)
class Session:
    """A take that is ready to be worked on.

    Attributes:
        path: the session's folder.
        calibration: the calibration file.
        cameras: C cameras, fitted to their videos' sizes.
        videos: C videos, in the cameras' order.
        frame_indices: (C, T) which frame of each video is frame t of the take.
        fps: frames a second of the take.
        notices: plain sentences about what was assumed or mended.
        late: (C, T) seconds from a moment of the take to the time of the camera's frame; None where frames are paired
            by number.
        clocks: (C,) of the cameras, counted from their first frames of the take, where a `sync.toml` says that they run
            apart: what is left are fractions of a frame, and drifts.
        upright: the cameras in a world with Z up, where the calibration's has not and people have told.
    """

    path: Path
    calibration: Path
    cameras: CameraGroup
    videos: tuple[VideoInfo, ...]
    frame_indices: NDArray[np.int64]
    fps: float
    notices: tuple[str, ...]
    late: NDArray[np.float64] | None = None
    clocks: tuple[Clock, ...] | None = None
    upright: CameraGroup | None = None

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name

    @property
    def frames(self) -> int:
        """How many frames (T) every camera has part in."""
        return int(self.frame_indices.shape[1])

    @cached_property
    def level_cameras(self) -> CameraGroup:
        """The cameras in a world that is turned upright where the calibration's is not: people are read in these."""
        return self.upright or levelled(self.cameras)


def open_session(path: Path, options: SessionOptions = SessionOptions(), in_step: bool = True) -> Session:
    """Read a session folder, its calibration and what its videos hold; no frame is worked on yet.

    Args:
        path: the folder.
        options: how it is read.
        in_step: whether its `sync.toml` counts, if it has one.

    Raises:
        SessionError: no folder, no videos, fewer than two cameras, or cameras and videos that do not pair up.
        VideoError: a video that is truncated or cannot be decoded.
        CalibrationError: no calibration, several, or one that cannot be read.
    """
    files, notices = find_videos(path)
    calibration = options.calibration or find_calibration(path)
    read = read_calibration(calibration)
    group = read.cameras
    notices += [f"{calibration.name}: {note}" for note in read.notes]
    if options.cameras:
        group, files = _chosen(group, files, options.cameras, calibration)
    if len(files) < 2 or len(group) < 2:
        raise SessionError(_too_few(path, files, calibration, group))
    order, said = match_cameras([f.stem for f in files], group.names, path, calibration, read.no_pose)
    notices += said
    videos = [probe_video(files[k]) for k in order]
    cameras: list[Camera] = []
    for k, camera in enumerate(group):
        videos[k], said = _turn(videos[k], camera, options.video_rotation)
        notices += said
        if camera.name in read.guessed_sizes:
            camera = sized_like(camera, videos[k].width, videos[k].height)
        fitted, assumed = _fitted(camera, videos[k], options.video_size)
        cameras.append(fitted)
        if assumed:
            notices.append(assumed)
    table = time_table_in(path) or time_table_in(_video_folder(path))
    clocks = clocks_in(path, group.names) if in_step else None
    if table is None:
        fps, indices, late, clocks, said = _common_time(videos, clocks)
    else:
        fps, indices, late, said = paired_by_time(table, videos)
    notices += said + _oddities(videos, group)
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
    )


def find_videos(path: Path) -> tuple[list[Path], list[str]]:
    """The video files of a session in natural order, and what else was found among them.

    Raises:
        SessionError: no such folder, no `videos/` in it, no video there, or two files of one name.
    """
    layout = "a session is a folder with `videos/` (one file a camera) and a calibration"
    if not path.is_dir():
        what = "is a file" if path.exists() else "does not exist"
        raise SessionError(f"{path} {what}; {layout}")
    folder = _video_folder(path)
    if folder == path and not any(p.is_file() and p.suffix.lower() in VIDEO_SUFFIXES for p in path.iterdir()):
        hint = _pictures_hint(next((f for f in (path / name for name in PICTURE_FOLDERS) if f.is_dir()), path))
        raise SessionError(
            f"{path} has no folder `videos`: put the videos into {path / 'videos'}, one file a camera{hint}"
        )
    found: list[Path] = []
    ignored: list[str] = []
    for entry in sorted(folder.iterdir(), key=lambda p: natural_key(p.name)):
        if entry.name.startswith("."):
            continue
        kind = entry.suffix.lower()
        if entry.is_file() and (kind in VIDEO_SUFFIXES or (kind not in PROXY_SUFFIXES and is_video(entry))):
            found.append(entry)
        elif entry.name not in TIMESTAMPS:
            ignored.append(entry.name)
    if not found:
        beside = f" (it has {', '.join(ignored[:5])}, which are no videos or small copies)" if ignored else ""
        raise SessionError(f"{folder} holds no videos{beside}: put one film a camera there{_pictures_hint(folder)}")
    twice = [stem for stem, n in Counter(f.stem.lower() for f in found).items() if n > 1]
    if twice:
        names = ", ".join(f.name for f in found if f.stem.lower() == twice[0])
        raise SessionError(f"{folder} has more than one video named {twice[0]} ({names}): keep one file a camera")
    if folder == path:  # beside the calibration and whatever else a session has
        return found, [f"{path} has no folder `videos`: the videos in it itself are used"]
    return found, [f"{folder} also holds {', '.join(ignored)}: not videos, or small copies; ignored"] if ignored else []


def _pictures_hint(folder: Path) -> str:
    """How films are made of what a folder has, where that is folders of pictures, one a camera."""
    for camera in sorted((f for f in folder.iterdir() if f.is_dir()), key=lambda f: natural_key(f.name)):
        kinds = Counter(f.suffix for f in camera.iterdir() if f.suffix.lower() in PICTURE_SUFFIXES)
        kind, pictures = kinds.most_common(1)[0] if kinds else ("", 0)
        if pictures > 1:
            return (
                f"; {folder} has folders of pictures: make a film of each at the cameras' rate, such as `ffmpeg "
                f"-framerate 30 -pattern_type glob -i '{camera}/*{kind}' -c:v mjpeg -q:v 2 videos/{camera.name}.mkv`"
            )
    return ""


def _video_folder(path: Path) -> Path:
    return next((path / name for name in VIDEO_FOLDERS if (path / name).is_dir()), path)


def natural_key(text: str) -> tuple[tuple[int, int | str], ...]:
    """Sorting key under which `cam2` comes before `cam10`."""
    parts = re.findall(r"\d+|\D+", text.lower())
    return tuple((0, int(p)) if p.isdigit() else (1, p) for p in parts)


def _chosen(
    group: CameraGroup, files: list[Path], names: tuple[str, ...], calibration: Path
) -> tuple[CameraGroup, list[Path]]:
    """Only the named cameras and, where videos pair with cameras by name, only their videos."""
    unknown = [n for n in names if n not in group.names]
    if unknown:
        raise SessionError(
            f"{calibration} has no camera {', '.join(unknown)}; --cameras may name {', '.join(group.names)}"
        )
    names = tuple(dict.fromkeys(names))
    if len(names) < 2:
        raise SessionError(f"--cameras names {names[0]} alone: motion needs at least two cameras that see the person")
    pairs = _pair_by_name([f.stem for f in files], group.names)
    kept = [files[pairs[n]] for n in names if n in pairs]
    return group.select(names), kept if kept else files


def _too_few(path: Path, files: Sequence[Path], calibration: Path, group: CameraGroup) -> str:
    if len(files) < 2:
        what = f"{path / 'videos'} holds one video ({files[0].name})" if files else f"{path} has no usable video"
        return f"{what}: motion needs at least two cameras that see the person; add another camera's video"
    return f"{calibration} has one camera ({group.names[0]}): motion needs at least two; calibrate them together"


def _tokens(name: str) -> tuple[str, ...]:
    """Words and numbers of a name: `Take 2_cam01` -> take, 2, cam, 1."""
    return tuple(str(int(t)) if t.isdigit() else t for t in re.findall(r"\d+|[^\W\d_]+", name.lower()))


def _distinctive(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Each name's tokens without those that all names begin and end with."""
    tokens = [_tokens(n) for n in names]
    if len(tokens) < 2:
        return tokens
    while all(tokens) and len({t[0] for t in tokens}) == 1:
        tokens = [t[1:] for t in tokens]
    while all(tokens) and len({t[-1] for t in tokens}) == 1:
        tokens = [t[:-1] for t in tokens]
    return tokens


def _pair_by_name(stems: Sequence[str], names: Sequence[str]) -> dict[str, int]:
    """Camera name -> index of its video, by the strictest of four readings of the names that pairs any.

    Names are the same; the same but for case, separators and leading zeros (`Cam 1`, `cam_01`); the
    camera's name is a part of the file's (`take2_cam01`) or the reverse; what tells the cameras apart is the
    same (`Miqus_1` and `video1`). A reading under which anything pairs twice counts for nothing.
    """

    def pairs(test: list[list[bool]]) -> dict[str, int]:
        table = np.asarray(test, dtype=bool).reshape(len(names), len(stems))
        if not table.any() or (table.sum(0) > 1).any() or (table.sum(1) > 1).any():
            return {}
        return {names[c]: int(np.argmax(row)) for c, row in enumerate(table) if row.any()}

    files, cameras = [_tokens(s) for s in stems], [_tokens(n) for n in names]
    file_parts, camera_parts = _distinctive(stems), _distinctive(names)
    readings = [
        [[s.lower() == n.lower() for s in stems] for n in names],
        [[f == c and bool(f) for f in files] for c in cameras],
        [[_within(c, f) or _within(f, c) for f in files] for c in cameras],
        [[f == c and bool(f) for f in file_parts] for c in camera_parts],
    ]
    best: dict[str, int] = {}
    for reading in readings:
        found = pairs(reading)
        if len(found) > len(best):
            best = found
    return best


def _within(part: tuple[str, ...], whole: tuple[str, ...]) -> bool:
    n = len(part)
    return n > 0 and any(whole[k : k + n] == part for k in range(len(whole) - n + 1))


def match_cameras(
    stems: Sequence[str], names: Sequence[str], session: Path, calibration: Path, no_pose: Sequence[str] = ()
) -> tuple[list[int], list[str]]:
    """Which video belongs to which camera.

    Args:
        stems: the videos' names without their endings, in natural order.
        names: the calibration's camera names.
        session: for messages.
        calibration: for messages.
        no_pose: names of cameras that the calibration has without a pose, for messages.

    Returns:
        For each camera the index of its video, and a notice unless the names are plainly the same.

    Raises:
        SessionError: a camera has no video or a video no camera; both are named.
    """
    paired = _pair_by_name(stems, names)
    lonely_cameras = [n for n in names if n not in paired]
    lonely_videos = [s for k, s in enumerate(stems) if k not in paired.values()]
    if paired and not lonely_cameras and not lonely_videos:
        unlike = [(n, stems[k]) for n, k in paired.items() if n.lower() != stems[k].lower()]
        said = [f"cameras and videos were paired by name: {_pairing(unlike)}"] if unlike else []
        return [paired[n] for n in names], said
    if not paired and len(stems) == len(names):
        order = sorted(range(len(names)), key=lambda c: natural_key(names[c]))
        indices = [order.index(c) for c in range(len(names))]
        pairing = _pairing([(names[c], stems[indices[c]]) for c in range(len(names))])
        return indices, [
            f"no video has a camera's name, so they were paired in alphabetical order: {pairing}; "
            "rename the videos if that is wrong"
        ]
    problems = []
    if lonely_cameras:
        problems.append(f"{calibration} has no video for camera {', '.join(lonely_cameras)}")
    if lonely_videos:
        problems.append(f"{session / 'videos'} has no camera for video {', '.join(lonely_videos)}")
    if unposed := [n for n in no_pose if _pair_by_name(lonely_videos, [n])]:
        problems.append(f"{calibration} does not say where {', '.join(unposed)} is")
    remedy = "name each video after its camera"
    if len(paired) >= 2:
        remedy += f", or choose the cameras with --cameras {' '.join(n for n in names if n in paired)}"
    raise SessionError(f"{' and '.join(problems)}; {remedy}")


def _pairing(pairs: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{name} = {stem}" for name, stem in pairs)


def _turn(video: VideoInfo, camera: Camera, how: str) -> tuple[VideoInfo, list[str]]:
    """Decide about the file's rotation flag."""
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
            f"pixels {video.pixel_aspect:.3f} times as wide as high: taken as the same picture (scale)"
        )
    image = None
    if how == "auto" and size != (camera.width, camera.height):
        image = next(read_chunks(video, np.zeros(1, np.int64)))[0]
    return fit_to_video(camera, *size, how, image)


def _squeezed(camera: Camera, video: VideoInfo) -> bool:
    """Whether a video's pixels are not square, and the picture that players show has the calibrated shape."""
    shown = video.width * video.pixel_aspect / video.height / (camera.width / camera.height)
    return _odd_pixels(video) and (video.width, video.height) != (camera.width, camera.height) and abs(shown - 1) < 0.02


def _odd_pixels(video: VideoInfo) -> bool:
    return abs(video.pixel_aspect - 1) > 0.01


def _common_time(
    videos: Sequence[VideoInfo], clocks: tuple[Clock, ...] | None
) -> tuple[float, NDArray[np.int64], NDArray[np.float64] | None, tuple[Clock, ...] | None, list[str]]:
    """The take's frame rate, which frames of each video make it up, how late they were taken, how the clocks stand from
    there on, and what had to be assumed."""
    rates = np.array([v.fps for v in videos])
    near = rates.max() / rates.min() - 1 < _SAME_RATE
    listed = ", ".join(f"{v.path.name} {v.fps:.4g}" for v in videos)
    notices: list[str] = []
    by_number, apart = _by_number(videos)
    if near:
        fps = _commonest(rates)
        if len(set(np.round(rates, 2))) > 1:
            how = "frames are paired by number" if by_number else "the films end together, so frames are paired by time"
            much = f"; by these rates the last ones are {apart:.2g} s apart" if by_number and apart * fps > 0.5 else ""
            notices.append(f"frame rates differ slightly ({listed} fps): {how} at {fps:.4g} fps{much}")
    else:
        fps = float(rates.min())
        notices.append(
            f"frame rates differ ({listed} fps): the take runs at the lowest, {fps:.4g} fps, with each "
            "camera's landmarks put between its frames, all videos taken to start together"
        )
    wander = [v.path.name for v in videos if v.variable_rate]
    if wander:
        notices.append(
            f"the frame rate of {', '.join(wander)} varies (frames were dropped or the camera adapts it): "
            f"the take runs in even steps of {fps:.4g} fps, and landmarks are put between frames"
        )
    late_to_show = [f"{v.times[0]:.2g} s of {v.path.name}" for v in videos if v.times[0] * fps > 0.5]
    if late_to_show:
        notices.append(f"the first {', '.join(late_to_show)} cannot be decoded, as where a recorder joined a stream")
    by_time = not near or not by_number or bool(wander) or bool(late_to_show)
    if by_time:
        counts = [int(np.floor(v.times[-1] * fps + 0.5)) + 1 for v in videos]
    else:
        counts = [v.frames for v in videos]
    first, clocks, said = _beginnings(videos, counts, clocks, fps)
    own = first[:, None] + np.arange(int((np.array(counts) - first).min()))
    notices += said
    if not by_time:
        return fps, own, None, clocks, notices
    indices = np.stack([nearest(v.times, grid) for v, grid in zip(videos, own / fps, strict=True)])
    late = np.stack([v.times[at] for v, at in zip(videos, indices, strict=True)]) - own / fps
    return fps, indices, late, clocks, notices


def _beginnings(
    videos: Sequence[VideoInfo], counts: Sequence[int], clocks: tuple[Clock, ...] | None, fps: float
) -> tuple[NDArray[np.int64], tuple[Clock, ...] | None, list[str]]:
    """(C,) the frame of each video with which the take begins, the clocks from there on, and what is left out."""
    names = [v.path.name for v in videos]
    first = np.zeros(len(videos), dtype=np.int64)
    if clocks is not None:
        first, clocks = first_frames_in_common(clocks, names, counts, fps)
    frames = int((np.array(counts) - first).min())
    lengths = ", ".join(f"{name} {n}" for name, n in zip(names, counts, strict=True))
    if first.any():
        begins = ", ".join(f"{name} {n}" for name, n in zip(names, first, strict=True))
        said = f"by {SYNC_FILE} the take begins with frames {begins}: {frames} frames of all videos ({lengths})"
        return first, clocks, [said]
    if len(set(counts)) > 1:
        said = f"the videos differ in length ({lengths} frames): the first {frames} frames are used"
        return first, clocks, [said]
    return first, clocks, []


def _by_number(videos: Sequence[VideoInfo]) -> tuple[bool, float]:
    """Whether frames of one number belong together, of films of nearly one rate, and how far the last common ones are
    apart by their times, seconds. Cameras that are triggered together write as many frames, whatever rate their files
    say; cameras with clocks of their own that are stopped together last equally long."""
    frames = np.array([v.frames for v in videos])
    last = np.array([v.times[-1] for v in videos])
    apart = float(np.ptp([v.times[frames.min() - 1] for v in videos]))
    return bool(np.ptp(frames) <= 1 + np.ptp(last) * max(v.fps for v in videos)), apart


def _commonest(rates: NDArray[np.float64]) -> float:
    return float(Counter(float(r) for r in rates).most_common(1)[0][0])


def _oddities(videos: Sequence[VideoInfo], calibrated: CameraGroup) -> list[str]:
    """Differences that are harmless but worth knowing."""
    notices = []
    if len({(v.width, v.height) for v in videos}) > 1:
        sizes = ", ".join(f"{v.path.name} {v.width}x{v.height}" for v in videos)
        notices.append(f"frame sizes differ ({sizes} px)")
    for camera, video in zip(calibrated, videos, strict=True):
        if _odd_pixels(video) and not _squeezed(camera, video):
            notices.append(
                f"{video.path.name} says that its pixels are not square (aspect {video.pixel_aspect:.3f}): "
                "taken as square, as calibrations are made on stored pixels"
            )
    return notices


def with_frames(session: Session, frames: int) -> Session:
    """The session's first `frames` frames."""
    late = None if session.late is None else session.late[:, :frames]
    return replace(session, frame_indices=session.frame_indices[:, :frames], late=late)


def with_notice(session: Session, notice: str, progress: Progress) -> Session:
    """The session with one more notice, which is said at once, too."""
    progress.notice(notice)
    return replace(session, notices=(*session.notices, notice))
