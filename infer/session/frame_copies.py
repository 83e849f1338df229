"""Small copies of a video's frames, kept in a run's working folder so that the video is decoded once.

A file of copies is one JPEG after another. It is bounded: a take that is too long for it has none, and is decoded again
where its frames are needed again.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray, IndexArray, IntArray
from muybridge.files import replacing
from muybridge.infer.session.video import MAX_CHUNK

# The longer side of a copy is at least this, and less than twice this.
_LEAST_SIDE_PX = 640
# Most bytes of one file: about 1,300 frames of a video in full HD.
_MOST_BYTES = 96 * 2**20
_QUALITY = 92


def halved(image: ByteArray, out: ByteArray | None = None) -> ByteArray:
    """(H, W, 3) averaged over two by two pixels, many times as fast as any other scale; H and W are even."""
    size = image.shape[1] // 2, image.shape[0] // 2
    return np.asarray(cv2.resize(image, size, dst=out, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def halved_to(image: ByteArray, long_side: int) -> ByteArray:
    """(H, W, 3) halved while its long side is at least twice `long_side`, as far as its sides are even."""
    while max(image.shape[:2]) >= 2 * long_side and not (image.shape[0] % 2 or image.shape[1] % 2):
        image = halved(image)
    return image


def times_halved(width: int, height: int) -> int:
    """How often frames of this size are halved for their copies; 0 for small frames, which have none."""
    count = 0
    while max(width, height) >= 2 * _LEAST_SIDE_PX and not (width % 2 or height % 2):
        width, height, count = width // 2, height // 2, count + 1
    return count


def fit_inside(width: int, height: int, long_side: int) -> tuple[int, int]:
    """The even size with the same proportions whose longer side is at most `long_side` (never enlarged)."""
    scale = min(1.0, long_side / max(width, height))
    return max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2)


class CopyWriter:
    """Writes the copies of a video's frames, given in order; a context manager, whose file is there at its end."""

    def __init__(self, path: Path, most_bytes: int = _MOST_BYTES) -> None:
        """For a file at `path` of at most `most_bytes`; a larger one is given up, and there is none."""
        self._path, self._most = path, most_bytes
        self._ends: list[int] = []
        self._size = 0
        self._file: IO[bytes] | None = None

    def __enter__(self) -> CopyWriter:
        self._place = replacing(self._path)
        self._file = self._place.__enter__().open("wb")
        return self

    def add(self, image: ByteArray) -> None:
        """Add one (H, W, 3) RGB frame, as it is or halved already."""
        if self._file is None or self._size > self._most:
            return
        image = halved_to(image, _LEAST_SIDE_PX)
        quality = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
        data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)[1].tobytes()
        self._size += len(data)
        self._ends.append(self._size)
        if self._size <= self._most:
            self._file.write(data)

    @property
    def ends(self) -> NDArray[np.int64]:
        """(T,) where each frame ends in the file, bytes; none where there is no file."""
        return np.array(self._ends if self._size <= self._most else [], dtype=np.int64)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._file is not None
        self._file.close()
        if kind is not None:
            self._place.__exit__(kind, error, trace)
            return
        self._place.__exit__(None, None, None)
        if not len(self.ends):
            self._path.unlink()


def holds(path: Path, ends: IntArray) -> bool:
    """Whether a file has the copies that end at `ends` (T,) bytes; none are always there."""
    return not len(ends) or (path.is_file() and path.stat().st_size == ends[-1])


def read_copies(path: Path, ends: IntArray, frames: IndexArray | None = None) -> Iterator[ByteArray]:
    """The copies of some frames (default all), in chunks (n, h, w, 3) of RGB as `read_chunks` gives them.

    Args:
        path: of the file.
        ends: (T,) as `CopyWriter` had them.
        frames: (K,) numbers of frames.
    """
    frames = np.arange(len(ends)) if frames is None else frames
    begins = np.concatenate([[0], ends[:-1]])
    with path.open("rb") as file:
        for at in range(0, len(frames), MAX_CHUNK):
            images = []
            for frame in frames[at : at + MAX_CHUNK]:
                file.seek(int(begins[frame]))
                data = np.frombuffer(file.read(int(ends[frame] - begins[frame])), np.uint8)
                image = cv2.imdecode(data, cv2.IMREAD_COLOR)
                images.append(cv2.cvtColor(np.asarray(image), cv2.COLOR_BGR2RGB))
            yield np.asarray(np.stack(images), dtype=np.uint8)
