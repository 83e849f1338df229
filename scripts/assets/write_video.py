"""H.264 videos that browsers play, for what scripts render and what benchmarks and tests change."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from muybridge.arrays import ByteArray


@contextmanager
def video_writer(
    path: Path, size: tuple[int, int], fps: float, crf: int = 20, preset: str = "veryfast"
) -> Iterator[Callable[[ByteArray], None]]:
    """Open a file for RGB frames of `size`, width and height in px; yields the function that adds one."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        # Without the macroblock tree, whose bytes vary on processors with AVX-512.
        stream.options = {"crf": str(crf), "preset": preset, "x264-params": "mbtree=0"}

        def write(image: ByteArray) -> None:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))

        yield write
        container.mux(stream.encode())
