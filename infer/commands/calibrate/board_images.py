"""Pictures of a calibration board: films or folders of images, one a camera, and which of them belong together.

Moments are whole numbers. Films count frames (by time where their rates differ); `timestamps.csv` beside them
(columns `sync_index`, `cam_id`, `frame_time`: a row a frame) says otherwise; images are numbered by their names, or
where these hold numbers of 19 digits and more, by their order among those of all cameras.
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
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.discover import IMAGE_SUFFIXES
from muybridge.infer.session.pairing import natural_key
from muybridge.infer.session.probe import VideoInfo, is_video, probe_video
from muybridge.infer.session.timestamps import read_time_table, time_table_in
from muybridge.infer.session.video import read_chunks

_LOOKS_A_SECOND = 6.0
_MOST_LOOKS = 600


@dataclass(frozen=True)
class Pictures:
    """What one camera saw.

    Attributes:
        name: the camera's.
        path: its film, or its folder of images.
        video: of a film.
        images: of a folder.
        moments: (n,) which moment each picture is of.
        looked_at: (m,) which pictures are looked at.
    """

    name: str
    path: Path
    video: VideoInfo | None
    images: tuple[Path, ...]
    moments: IntArray
    looked_at: IntArray


def find_pictures(
    folder: Path, timestamps: Path | None = None, every: int | None = None, moment: int | None = None
) -> list[Pictures]:
    """The cameras' films or folders of images in `folder` (or in `videos/` in it).

    Args:
        folder: where to look.
        timestamps: which frames belong together; None for `timestamps.csv` in the folder, if there.
        every: look at every so many-th moment of films; None for about six a second.
        moment: also look at this one.

    Raises:
        CalibrationError: nothing there, or time stamps that do not fit the films.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no such folder; name one with a film or a folder of images for each camera")
    entries = sorted((p for p in folder.iterdir() if not p.name.startswith(".")), key=lambda p: natural_key(p.name))
    films = [p for p in entries if p.is_file() and p.suffix.lower() not in IMAGE_SUFFIXES and is_video(p)]
    folders = [(p, _images(p)) for p in entries if p.is_dir()]
    folders = [(p, images) for p, images in folders if images]
    if not films and not folders and (folder / "videos").is_dir():
        return find_pictures(folder / "videos", timestamps, every, moment)
    if not films and not folders and _images(folder):
        folders = [(folder, _images(folder))]
    if not films and not folders:
        raise CalibrationError(f"{folder}: neither films nor folders of images; there must be one for each camera")
    if films and folders:
        names = ", ".join(p.name for p in (films + [p for p, _ in folders])[:6])
        raise CalibrationError(f"{folder}: films and folders of images ({names}); leave only what shows the board")
    if folders:
        numbered = _ranked([_numbers(images) for _, images in folders])
        return [
            Pictures(p.name, p, None, tuple(images), n, np.arange(len(images)))
            for (p, images), n in zip(folders, numbered, strict=True)
        ]
    stamps = timestamps or time_table_in(folder)
    return _films(films, stamps, every, moment)


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


def _ranked(numbered: Sequence[Sequence[int]]) -> list[IntArray]:
    """Every camera's moments as arrays; numbers that these do not hold by their order among those of all cameras."""
    every = sorted(set().union(*numbered))
    if every[-1] > np.iinfo(np.int64).max:
        rank = {n: k for k, n in enumerate(every)}
        numbered = [[rank[n] for n in mine] for mine in numbered]
    return [np.array(mine, dtype=np.int64) for mine in numbered]


def _films(films: Sequence[Path], stamps: Path | None, every: int | None, moment: int | None) -> list[Pictures]:
    """Films, of which the same moments are looked at: by a step that suits the one that needs the largest."""
    infos = [probe_video(p) for p in films]
    rate, usual, near = infos[0].fps, 1, False
    moments: list[FloatArray] = []
    if stamps is not None:
        moments = [of_frames.astype(float) for _, of_frames in read_time_table(stamps, infos, CalibrationError)]
    else:
        usual = max(1, round(rate / _LOOKS_A_SECOND))
        near = not all(abs(i.fps / rate - 1) < 0.01 and not i.variable_rate for i in infos)
        moments = [i.times * rate if near else np.arange(i.frames, dtype=float) for i in infos]
    step = every or max(usual, *(-(-int(min(i.frames, np.ptp(m) + 1)) // _MOST_LOOKS)
                                 for i, m in zip(infos, moments, strict=True)))  # fmt: skip
    out = []
    for info, mine in zip(infos, moments, strict=True):
        wanted = np.arange(-(-np.floor(mine.min()) // step) * step, mine.max() + 1, step) if near else (
            mine[mine % step == 0]
        )  # fmt: skip
        looked, looked_moments = _nearest(mine, np.union1d(wanted, [] if moment is None else [moment]), near)
        whole = np.round(mine).astype(np.int64)
        whole[looked] = looked_moments
        out.append(Pictures(info.path.stem, info.path, info, (), whole, looked))
    return out


def _nearest(mine: FloatArray, wanted: FloatArray, near: bool) -> tuple[IntArray, IntArray]:
    """Numbers of the pictures (ascending) of wanted moments, and these; if `near`, of pictures up to a half off."""
    order = np.argsort(mine, kind="stable")
    times = mine[order]
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    chosen = np.where(np.abs(times[before] - wanted) < np.abs(times[after] - wanted), before, after)
    off = np.abs(times[chosen] - wanted)
    apart = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    kept = np.argsort(off, kind="stable")  # no picture is of two moments: of the nearer one
    kept = kept[off[kept] <= (0.5 * max(1.0, apart) if near else 0.0) + 1e-6]
    looked, first = np.unique(order[chosen[kept]], return_index=True)
    return looked, np.round(wanted[kept[first]]).astype(np.int64)


def at_moment(cameras: Sequence[Pictures], moment: int, option: str) -> list[Pictures]:
    """Those who have a picture of a moment, to look at that one alone.

    Args:
        cameras: found with this moment.
        moment: which.
        option: that named it, for the message.

    Raises:
        CalibrationError: nobody has.
    """
    rows = [p.looked_at[p.moments[p.looked_at] == moment] for p in cameras]
    if not any(len(r) for r in rows):
        first, last = min(int(p.moments.min()) for p in cameras), max(int(p.moments.max()) for p in cameras)
        raise CalibrationError(
            f"{option} {moment}: no camera has a picture of that number; they have numbers from {first} to {last}"
        )
    return [replace(p, looked_at=r) for p, r in zip(cameras, rows, strict=True) if len(r)]


def read_gray(pictures: Pictures, numbers: IntArray) -> Iterator[ByteArray]:
    """The pictures of these numbers (ascending), in gray.

    Raises:
        CalibrationError: an image that cannot be read.
        VideoError: a film that cannot be decoded.
    """
    if pictures.video is not None:
        for chunk in read_chunks(pictures.video, numbers):
            for image in chunk:
                yield cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        return
    for k in numbers:
        image = cv2.imread(str(pictures.images[k]), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise CalibrationError(f"{pictures.images[k]}: cannot be read as an image; copy it again or remove it")
        yield image.astype(np.uint8, copy=False)


def look_for_board(
    cameras: Sequence[Pictures], board: Board, progress: Progress
) -> tuple[dict[str, dict[int, View]], dict[str, tuple[int, int]]]:
    """The board's corners in all pictures.

    Returns:
        Views by camera and moment (those with any corner), and (width, height) by camera.

    Raises:
        CalibrationError: an image that cannot be read, images of different sizes.
    """
    views: dict[str, dict[int, View]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    total = sum(len(c.looked_at) for c in cameras)
    with progress.task("looking for the board", total) as task:

        def look(pictures: Pictures) -> tuple[dict[int, View], tuple[int, int]]:
            detector, found = BoardDetector(board), {}
            size: tuple[int, int] | None = None
            for k, image in zip(pictures.looked_at, read_gray(pictures, pictures.looked_at), strict=False):
                seen = (image.shape[1], image.shape[0])
                if size is not None and seen != size:
                    raise CalibrationError(
                        f"{pictures.images[k]}: {seen[0]} x {seen[1]} px, the other images of camera {pictures.name} "
                        f"{size[0]} x {size[1]}; a lens can only be calibrated from images of one size and zoom"
                    )
                size = seen
                ids, px = detector.detect(image)
                if len(ids):
                    found[int(pictures.moments[k])] = (ids, px)
                task.advance()
            if size is None:
                raise CalibrationError(
                    f"camera {pictures.name}: no picture at the moments that are looked at; give --every 1"
                )
            return found, size

        with ThreadPoolExecutor() as pool:
            for pictures, (found, size) in zip(cameras, pool.map(look, cameras), strict=True):
                views[pictures.name], sizes[pictures.name] = found, size
    return views, sizes


def some_pictures(pictures: Pictures, count: int) -> list[ByteArray]:
    """A few of the pictures that were looked at, spread over all of them."""
    last = len(pictures.looked_at) - 1
    chosen = np.unique(np.linspace(0, last, min(count, last + 1) + 2)[1:-1].round().astype(int))
    return list(read_gray(replace(pictures), pictures.looked_at[chosen]))
