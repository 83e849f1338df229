"""Write H.264 videos that browsers play."""

from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import av.error
import cv2
import numpy as np

from muybridge.arrays import ByteArray
from muybridge.files import cannot_write, replacing


def fit_inside(width: int, height: int, long_side: int) -> tuple[int, int]:
    """The even size with the same proportions whose longer side is at most `long_side` (never enlarged)."""
    scale = min(1.0, long_side / max(width, height))
    return max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2)


class VideoWriter:
    """An H.264 file that browsers play, written under a temporary name and renamed when complete.

    Used as a context manager: an exception inside leaves no file behind.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float, crf: int = 20, preset: str = "veryfast"):
        """Open `path` for frames of `width` x `height` (even numbers) px.

        Raises:
            OutputError: the file cannot be written.
        """
        self.path = path
        self.size = (width, height)
        self._place = replacing(path)
        temporary = self._place.__enter__()
        try:
            self._container: Any = av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"})
            rate = Fraction(fps).limit_denominator(1001)
            self._stream = self._container.add_stream("libx264", rate=rate)
        except (av.error.FFmpegError, OSError) as error:
            self._abandon()
            raise cannot_write(path, error) from None
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.thread_count = 1
        # Without the macroblock tree, whose bytes vary on processors with AVX-512.
        self._stream.options = {"crf": str(crf), "preset": preset, "x264-params": "mbtree=0"}

    def __enter__(self) -> "VideoWriter":
        return self

    def write(self, image: ByteArray) -> ByteArray:
        """Add one (H, W, 3) RGB frame, scaled to the file's size where it differs; returns it as it was added.

        Raises:
            OutputError: the file cannot be written.
        """
        if (image.shape[1], image.shape[0]) != self.size:
            image = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        image = np.ascontiguousarray(image)
        self._encode(av.VideoFrame.from_ndarray(image, format="rgb24"))
        return image

    def _encode(self, frame: av.VideoFrame | None) -> None:
        """Encode a frame; None flushes what the encoder still holds."""
        try:
            for packet in self._stream.encode(frame):
                self._container.mux(packet)
        except (av.error.FFmpegError, OSError) as error:
            raise cannot_write(self.path, error) from None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._encode(None)
            self._container.close()
        except (av.error.FFmpegError, OSError) as failure:
            self._abandon()
            if kind is None:  # otherwise the first error is the one to report
                raise cannot_write(self.path, failure) from None
        except BaseException:
            self._abandon()
            raise
        else:
            if kind is None:
                self._place.__exit__(None, None, None)
            else:
                self._abandon()

    def _abandon(self) -> None:
        """Remove the temporary file; nothing replaces `path`."""
        stop = _Abandoned()
        with suppress(_Abandoned):
            self._place.__exit__(_Abandoned, stop, None)


class _Abandoned(Exception):
    """Ends a block of `replacing` without a file."""
