"""Images of a calibration board: one video or folder of images per camera, and which of them belong together.

Moments are integers. They count the frames of videos (by time where frame rates differ), unless `sync.toml` (clocks,
as `muybridge sync` writes them) or `timestamps.csv`
beside the videos (columns `sync_index`, `cam_id`, `frame_time`, one row per frame) says otherwise. Images are numbered
by their names or, where these have numbers of 19 digits and more, by their order among those of all cameras.
"""

import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray, IntArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board, BoardDetector
from muybridge.geometry.calibration.board.intrinsics import View
from muybridge.geometry.sync.clocks import Clock
from muybridge.infer.runtime.progress import Progress, Task
from muybridge.infer.session.discover import IMAGE_SUFFIXES, VIDEO_FOLDERS
from muybridge.infer.session.pairing import natural_key
from muybridge.infer.session.probe import VideoInfo, is_video, probe_video
from muybridge.infer.session.sync_file import SYNC_FILE, clocks_in
from muybridge.infer.session.timestamps import read_time_table, time_table_in
from muybridge.infer.session.video import read_chunks

_SEARCHES_PER_SECOND = 6.0
_MOST_SEARCHES = 600


@dataclass(frozen=True)
class BoardImages:
    """Images of one camera.

    Attributes:
        name: the camera's.
        path: its video, or its folder of images.
        video: of a video.
        images: of a folder.
        moments: (n,) the moment of each image.
        searched: (m,) numbers of the images in which the board is searched for.
    """

    name: str
    path: Path
    video: VideoInfo | None
    images: tuple[Path, ...]
    moments: IntArray
    searched: IntArray


def find_images(
    folder: Path, timestamps: Path | None = None, every: int | None = None, moment: int | None = None
) -> list[BoardImages]:
    """The videos or folders of images in a folder, or in `videos/` in it.

    Args:
        folder: where to look.
        timestamps: CSV file of the frames that belong together; None for `timestamps.csv` in the folder, if any.
        every: search every n-th moment of videos; None for about six per second.
        moment: also search this one.

    Raises:
        CalibrationError: there is nothing, or time stamps do not fit the videos.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no such folder; name one with a video or a folder of images per camera")
    entries = sorted((p for p in folder.iterdir() if not p.name.startswith(".")), key=lambda p: natural_key(p.name))
    videos = [p for p in entries if p.is_file() and p.suffix.lower() not in IMAGE_SUFFIXES and is_video(p)]
    folders = [(p, _images(p)) for p in entries if p.is_dir()]
    folders = [(p, images) for p, images in folders if images]
    if not videos and not folders and (folder / "videos").is_dir():
        return find_images(folder / "videos", timestamps, every, moment)
    if not videos and not folders and _images(folder):
        folders = [(folder, _images(folder))]
    if not videos and not folders:
        raise CalibrationError(f"{folder}: neither videos nor folders of images; there must be one per camera")
    if videos and folders:
        names = ", ".join(p.name for p in (videos + [p for p, _ in folders])[:6])
        raise CalibrationError(f"{folder}: videos and folders of images ({names}); leave only those of the board")
    if folders:
        numbered = _as_arrays([_numbers(images) for _, images in folders])
        return [
            BoardImages(p.name, p, None, tuple(images), n, np.arange(len(images)))
            for (p, images), n in zip(folders, numbered, strict=True)
        ]
    stamps = timestamps or time_table_in(folder)
    clocks = clocks_in(_sync_folder(folder), [p.stem for p in videos]) if stamps is None else None
    return _of_videos(videos, stamps, every, moment, clocks)


def _sync_folder(folder: Path) -> Path:
    """Where the clocks of the videos in a folder are: in a session, beside the folder `videos`."""
    beside = folder.name in VIDEO_FOLDERS and not (folder / SYNC_FILE).is_file()
    return folder.parent if beside else folder


def clocks_of(folder: Path, timestamps: Path | None, images: Sequence[BoardImages]) -> Path | None:
    """The `sync.toml` by which `find_images` paired the videos in a folder, if it did."""
    videos = [i.path.parent for i in images if i.video is not None]
    if not videos or timestamps is not None or time_table_in(videos[0]) is not None:
        return None
    path = _sync_folder(videos[0]) / SYNC_FILE
    return path if path.is_file() else None


def _images(folder: Path) -> list[Path]:
    found = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".")]
    return sorted(found, key=lambda p: natural_key(p.name))


def _numbers(images: Sequence[Path]) -> list[int]:
    """Moments by the last number in the names that differs from image to image, else by order."""
    found = [[int(n) for n in re.findall(r"\d+", p.stem)] for p in images]
    if len({len(f) for f in found}) == 1:
        for column in reversed(range(len(found[0]))):
            numbers = [f[column] for f in found]
            if len(set(numbers)) == len(numbers):
                return numbers
    return list(range(len(images)))


def _as_arrays(numbered: Sequence[Sequence[int]]) -> list[IntArray]:
    """Every camera's moments as arrays; numbers beyond 64 bits become their order among those of all cameras."""
    every = sorted(set().union(*numbered))
    if every[-1] > np.iinfo(np.int64).max:
        rank = {n: k for k, n in enumerate(every)}
        numbered = [[rank[n] for n in mine] for mine in numbered]
    return [np.array(mine, dtype=np.int64) for mine in numbered]


def _of_videos(
    videos: Sequence[Path], stamps: Path | None, every: int | None, moment: int | None, clocks: Sequence[Clock] | None
) -> list[BoardImages]:
    """Videos, of which the same moments are searched, by the largest step that one of them needs."""
    infos = [probe_video(p) for p in videos]
    rate, usual, near = infos[0].fps, 1, False
    moments: list[FloatArray] = []
    if stamps is not None:
        moments = [of_frames.astype(float) for _, of_frames in read_time_table(stamps, infos, CalibrationError)]
    else:
        usual = max(1, round(rate / _SEARCHES_PER_SECOND))
        near = not all(abs(i.fps / rate - 1) < 0.01 and not i.variable_rate for i in infos)
        near = near or clocks is not None
        moments = [i.times * rate if near else np.arange(i.frames, dtype=float) for i in infos]
        if clocks is not None:  # by the reference's clock
            moments = [(m - k.offset * rate) / (1 + k.drift) for m, k in zip(moments, clocks, strict=True)]
    step = every or max(usual, *(-(-int(min(i.frames, np.ptp(m) + 1)) // _MOST_SEARCHES)
                                 for i, m in zip(infos, moments, strict=True)))  # fmt: skip
    out = []
    for info, mine in zip(infos, moments, strict=True):
        wanted = np.arange(-(-np.floor(mine.min()) // step) * step, mine.max() + 1, step) if near else (
            mine[mine % step == 0]
        )  # fmt: skip
        searched, their_moments = _nearest(mine, np.union1d(wanted, [] if moment is None else [moment]), near)
        whole = np.round(mine).astype(np.int64)
        whole[searched] = their_moments
        out.append(BoardImages(info.path.stem, info.path, info, (), whole, searched))
    return out


def _nearest(mine: FloatArray, wanted: FloatArray, near: bool) -> tuple[IntArray, IntArray]:
    """Numbers of the images (ascending) of wanted moments, and these; with `near`, of images up to half a frame off."""
    order = np.argsort(mine, kind="stable")
    times = mine[order]
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    chosen = np.where(np.abs(times[before] - wanted) < np.abs(times[after] - wanted), before, after)
    off = np.abs(times[chosen] - wanted)
    apart = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    kept = np.argsort(off, kind="stable")  # no image is of two moments: of the nearer one
    kept = kept[off[kept] <= (0.5 * max(1.0, apart) if near else 0.0) + 1e-6]
    numbers, first = np.unique(order[chosen[kept]], return_index=True)
    return numbers, np.round(wanted[kept[first]]).astype(np.int64)


def at_moment(cameras: Sequence[BoardImages], moment: int, argument: str) -> list[BoardImages]:
    """The cameras that have an image of a moment, with that one alone to be searched.

    Args:
        cameras: found with this moment.
        moment: which.
        argument: name of the argument that gave it, for the message.

    Raises:
        CalibrationError: no camera has one.
    """
    rows = [p.searched[p.moments[p.searched] == moment] for p in cameras]
    if not any(len(r) for r in rows):
        first, last = min(int(p.moments.min()) for p in cameras), max(int(p.moments.max()) for p in cameras)
        raise CalibrationError(
            f"{argument} {moment}: no camera has an image of that number; they have numbers from {first} to {last}"
        )
    return [replace(p, searched=r) for p, r in zip(cameras, rows, strict=True) if len(r)]


def read_gray(images: BoardImages, numbers: IntArray) -> Iterator[ByteArray]:
    """The images of these numbers (ascending), in gray.

    Raises:
        CalibrationError: an image cannot be read.
        VideoError: a video cannot be decoded.
    """
    if images.video is not None:
        for chunk in read_chunks(images.video, numbers):
            for image in chunk:
                yield cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        return
    for k in numbers:
        image = cv2.imread(str(images.images[k]), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise CalibrationError(f"{images.images[k]}: cannot be read as an image; copy it again or remove it")
        yield image.astype(np.uint8, copy=False)


def find_board(
    cameras: Sequence[BoardImages], board: Board, progress: Progress
) -> tuple[dict[str, dict[int, View]], dict[str, tuple[int, int]]]:
    """Detect the board's corners in all images.

    Returns:
        Views by camera and moment (those with any corner), and (width, height) by camera.

    Raises:
        CalibrationError: an image cannot be read, or images of a camera have different sizes.
    """
    views: dict[str, dict[int, View]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    total = sum(len(c.searched) for c in cameras)
    with progress.task("detecting the board", total) as task, ThreadPoolExecutor() as pool:
        found = pool.map(lambda images: _views(images, board, task), cameras)
        for images, (mine, size) in zip(cameras, found, strict=True):
            views[images.name], sizes[images.name] = mine, size
    return views, sizes


def _views(images: BoardImages, board: Board, task: Task) -> tuple[dict[int, View], tuple[int, int]]:
    """Views of the board by moment, and the size of the images."""
    detector, found = BoardDetector(board), {}
    size: tuple[int, int] | None = None
    for k, image in zip(images.searched, read_gray(images, images.searched), strict=False):
        seen = (image.shape[1], image.shape[0])
        if size is not None and seen != size:
            raise CalibrationError(
                f"{images.images[k]}: {seen[0]} x {seen[1]} px, the other images of camera {images.name} "
                f"{size[0]} x {size[1]}; a lens can only be calibrated from images of one size and zoom"
            )
        size = seen
        ids, px = detector.detect(image)
        if len(ids):
            found[int(images.moments[k])] = (ids, px)
        task.advance()
    if size is None:
        raise CalibrationError(f"camera {images.name}: no image at the moments that are searched", remedy="every_frame")
    return found, size


def sample_images(images: BoardImages, count: int) -> list[ByteArray]:
    """A few of the images that were searched, spread over all of them."""
    last = len(images.searched) - 1
    chosen = np.unique(np.linspace(0, last, min(count, last + 1) + 2)[1:-1].round().astype(int))
    return list(read_gray(images, images.searched[chosen]))
