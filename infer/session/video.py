"""The frames of a video, decoded in order in bounded memory.

`probe_video` walks through the packets of a file without decoding them, which is enough to recognise a truncated
recording and a varying frame rate and to count the frames. Frames are then decoded once, in order; the reader checks
what the probe could only expect.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import av.error
import numpy as np

from muybridge.arrays import ByteArray, IntArray
from muybridge.errors import VideoError, parsing
from muybridge.infer.session.damage import DamageWatch
from muybridge.infer.session.probe import VideoInfo, open, reason

CHUNK_BYTES = 100 * 2**20
MAX_CHUNK = 16


def chunk_frames(info: VideoInfo) -> int:
    """Number of frames per chunk that keeps it within `CHUNK_BYTES`."""
    return int(np.clip(CHUNK_BYTES // (info.width * info.height * 3), 1, MAX_CHUNK))


def read_chunks(
    info: VideoInfo, indices: IntArray | None = None, threads: int = 1, watch: DamageWatch | None = None,
    reuse: bool = False,
) -> Iterator[ByteArray]:  # fmt: skip
    """Decode a video once, in order, in chunks of bounded memory.

    Args:
        info: from `probe_video`.
        indices: (T,) frames to deliver, never decreasing (repeats allowed); default all.
        threads: decoder threads.
        watch: is told of every frame that is decoded, so that it knows the damaged ones at the end.
        reuse: give each chunk in the memory of the one before, which is faster.

    Yields:
        (n, H, W, 3) RGB; the caller may keep the chunks, unless they are reused.

    Raises:
        VideoError: a frame cannot be decoded, or a container that lists its frames ends early. Where the container
            lists none, a file may end a little before `info.frames`: the chunks then end there.
    """
    wanted = np.arange(info.frames) if indices is None else np.asarray(indices)
    size = chunk_frames(info)
    buffer: ByteArray | None = None
    spare: ByteArray | None = None
    filled = delivered = decoded = 0
    for decoded, frame in enumerate(_decode(info, threads), start=1):
        repeats = int(np.searchsorted(wanted, decoded - 1, side="right")) - delivered
        if watch is not None:
            watch.see(decoded - 1, frame)
        if repeats > 0:
            image = _to_rgb(frame, info)
        for _ in range(repeats):
            if buffer is None and spare is not None:
                buffer, spare = spare[: len(wanted) - delivered], None
            if buffer is None:
                buffer = np.empty((min(size, len(wanted) - delivered), *image.shape), np.uint8)
            buffer[filled] = image
            filled, delivered = filled + 1, delivered + 1
            if filled == len(buffer):
                yield buffer
                buffer, filled, spare = None, 0, buffer if reuse else None
        if delivered == len(wanted):
            return
    if buffer is not None:
        yield buffer[:filled]
    if info.declares_count:
        raise VideoError(
            f"{info.path} is damaged: it declares {info.frames} frames and {decoded} can be decoded; "
            "copy the file again, or re-encode the rest of it (ffmpeg -i IN -c:v libx264 OUT.mp4)"
        )


def _decode(info: VideoInfo, threads: int) -> Iterator[Any]:
    """The frames of all files of a video, one file after the other."""
    for file in info.files:
        yield from _decode_file(file, info.frames, threads)


def _decode_file(file: Path, frames: int, threads: int) -> Iterator[Any]:
    count = 0
    with open(file) as container, parsing(file, VideoError, "a video"):
        stream = container.streams.best("video")
        stream.codec_context.thread_count = threads
        stream.thread_type = "AUTO" if threads != 1 else "SLICE"
        try:
            for frame in container.decode(stream):
                count += 1
                yield frame
        except (av.error.FFmpegError, OSError) as error:
            raise VideoError(
                f"{file} is damaged: it cannot be decoded after frame {count} of {frames} ({reason(error)}); "
                "copy the file again, or re-encode the rest of it (ffmpeg -i IN -c:v libx264 OUT.mp4)"
            ) from None


def _to_rgb(frame: Any, info: VideoInfo) -> ByteArray:
    image: ByteArray = frame.to_ndarray(format="rgb24")
    if info.rotation_deg:
        image = np.rot90(image, info.rotation_deg // 90)
    if image.shape[:2] != (info.height, info.width):
        raise VideoError(
            f"{info.path} changes its frame size from {info.width}x{info.height} to "
            f"{image.shape[1]}x{image.shape[0]} between frames; export it at one size"
        )
    return image
