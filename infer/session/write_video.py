"""Write H.264 videos that browsers play."""

import os
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import av.error
import cv2
import numpy as np

from muybridge.arrays import ByteArray
from muybridge.errors import OutputError
from muybridge.infer.runtime.stages import partial_name
from muybridge.infer.session.probe import reason


def fit_inside(width: int, height: int, long_side: int) -> tuple[int, int]:
    """The even size with the same proportions whose longer side is at most `long_side` (never enlarged)."""
    scale = min(1.0, long_side / max(width, height))
    return max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2)


class VideoWriter:
    """An H.264 file that browsers play, written under a temporary name and renamed when complete.

    Used as a context manager: an exception inside leaves no file behind.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float, crf: int = 20, preset: str = "veryfast"):
        """Open `path` for frames of `width` x `height` (even numbers) px."""
        self.path = path
        self._partial = partial_name(path)
        self.size = (width, height)
        try:
            self._container: Any = av.open(str(self._partial), "w", format="mp4", options={"movflags": "+faststart"})
            rate = Fraction(fps).limit_denominator(1001)
            self._stream = self._container.add_stream("libx264", rate=rate)
        except (av.error.FFmpegError, OSError) as error:
            raise OutputError(f"{path} cannot be written ({reason(error)}); choose another --out") from None
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.thread_count = 1
        self._stream.options = {"crf": str(crf), "preset": preset}

    def __enter__(self) -> "VideoWriter":
        return self

    def write(self, image: ByteArray) -> None:
        """Add one (H, W, 3) RGB frame, scaled to the file's size where it differs."""
        if (image.shape[1], image.shape[0]) != self.size:
            image = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        self._encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24"))

    def _encode(self, frame: av.VideoFrame | None) -> None:
        """A frame, or with None what the encoder still holds."""
        try:
            for packet in self._stream.encode(frame):
                self._container.mux(packet)
        except (av.error.FFmpegError, OSError) as error:
            raise self._failure(error) from None

    def _failure(self, error: Exception) -> OutputError:
        return OutputError(f"{self.path} cannot be written ({reason(error)}); free its disk or choose another --out")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._encode(None)
            try:
                self._container.close()
                if kind is None:
                    os.replace(self._partial, self.path)
            except (av.error.FFmpegError, OSError) as failed:
                if kind is None:  # else there is an error already, and it is the one to be told
                    raise self._failure(failed) from None
        finally:
            self._partial.unlink(missing_ok=True)
