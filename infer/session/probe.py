"""Properties of a video: size, frame rate and frame times, without decoding it."""

import contextlib
import functools
import mmap
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.error
import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import VideoError, parsing
from muybridge.infer.runtime.digests import digest, sampled_digest
from muybridge.infer.session.chapters import camera_videos, recorded_order

# Containers that list every frame in an index, so that a shortfall means lost frames.
_COUNTED = {"mov", "mp4", "m4a", "3gp", "3g2", "mj2"}


# Where containers state the codec of a video: the sample entry of a MOV or MP4 track with a video's header, Matroska's
# CodecID, the stream header of an AVI.
_CODEC_NAMES = tuple(
    re.compile(pattern, re.DOTALL)
    for pattern in (rb"vmhd.{1,400}?stsd.{12}([ -~]{4})", rb"\x86[\x81-\xbf](V_[ -~]{1,40})", rb"vids([ -~]{4})")
)


# Rates of two chapters that are one.
_SAME_RATE = 0.005


# Demuxers that open an image or a text as a video of one frame.
_STILLS = ("image2", "_pipe", "tty", "gif")


@dataclass(frozen=True)
class VideoInfo:
    """Properties of a video file, without decoding more than its first frame.

    Attributes:
        path: the file, or the folder of a camera whose files are its video.
        container, codec: FFmpeg's names.
        width, height: size of a delivered frame, px (after rotation).
        rotation_deg: counterclockwise rotation applied to the coded frames: 0, 90, 180 or 270.
        tagged_rotation_deg: the rotation that the file's rotation flag asks for.
        fps: frames per second, measured from the time stamps; the usual rate where it varies.
        frames: expected number of frames.
        declares_count: whether the container lists its frames, so that fewer mean damage.
        times: (frames,) seconds since the file's first image; not the same as index / fps where `variable_rate`. A
            recorder that joined a stream has frames at its beginning that cannot be decoded: the first is then later.
        coded_at: (frames,) the place of each frame in the order in which frames are decoded.
        stands_alone: (frames,) whether a frame is coded without others, so that decoding can begin with it.
        variable_rate: whether the spacing of frames varies by more than a quarter of a frame.
        pixel_aspect: width of a pixel divided by its height.
        size_bytes: size of the file.
        recorded_fps: the rate of the recording by the word of a phone, where it differs for slow motion; None without.
        chapters: the files that are read one after the other, where `path` is a folder.
    """

    path: Path
    container: str
    codec: str
    width: int
    height: int
    rotation_deg: int
    tagged_rotation_deg: int
    fps: float
    frames: int
    declares_count: bool
    times: FloatArray = field(repr=False)
    coded_at: IntArray = field(repr=False)
    stands_alone: BoolArray = field(repr=False)
    variable_rate: bool
    pixel_aspect: float
    size_bytes: int
    recorded_fps: float | None = None
    chapters: tuple[Path, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that hold the frames."""
        return self.chapters or (self.path,)

    @functools.cached_property
    def content(self) -> str:
        """Digest of the file's content; the key of stages that read the video."""
        if not self.chapters:
            return sampled_digest(self.path)
        return digest([sampled_digest(file) for file in self.chapters])

    def unrotated(self) -> "VideoInfo":
        """The same video with its rotation flag ignored."""
        turned = self.rotation_deg % 180 != 0
        width, height = (self.height, self.width) if turned else (self.width, self.height)
        return replace(self, width=width, height=height, rotation_deg=0)


@dataclass(frozen=True)
class _Packets:
    """Time stamps (s, sorted) of the packets that become frames, their order in the file, whether they stand alone, and
    signs of damage."""

    times: FloatArray
    coded_at: IntArray
    stands_alone: BoolArray
    total: int
    damaged_at: int | None
    ends: float  # the latest end of any packet of any stream, s


def is_video(path: Path) -> bool:
    """Whether FFmpeg finds a video (not an image, a text or sound alone) in this file."""
    try:
        with av.open(str(path)) as container:
            if any(container.format.name == s or container.format.name.endswith(s) for s in _STILLS):
                return False
            return container.streams.best("video") is not None
    except (av.error.FFmpegError, OSError, ValueError):
        return False


def probe_video(path: Path) -> VideoInfo:
    """Read a video's properties without decoding it.

    Args:
        path: the file, or a folder with the chapters of one recording.

    Raises:
        VideoError: not a video, undecodable, or with fewer frames than its container declares.
        SessionError: a folder with other files than the chapters of one recording.
    """
    if path.is_dir():
        return _joined(path, [probe_video(file) for file in recorded_order(path, camera_videos(path))])
    with parsing(path, VideoError, "a video"):
        return _probe_file(path)


def _joined(folder: Path, parts: Sequence[VideoInfo]) -> VideoInfo:
    """Chapters as one video, each beginning where the one before ends."""
    if not parts:
        raise VideoError(f"{folder} holds no video")
    first = parts[0]
    for part in parts[1:]:
        if (part.width, part.height, part.rotation_deg) != (first.width, first.height, first.rotation_deg) or abs(
            part.fps / first.fps - 1
        ) > _SAME_RATE:
            raise VideoError(
                f"{folder}: {first.path.name} has {first.width}x{first.height} px at {first.fps:.4g} fps and "
                f"{part.path.name} {part.width}x{part.height} px at {part.fps:.4g} fps: they are not one recording; "
                "leave the files of this take there"
            )
    lasts = [part.times[-1] + 1 / part.fps for part in parts]
    begins = np.concatenate([[0.0], np.cumsum(lasts)[:-1]])
    counts = np.concatenate([[0], np.cumsum([part.frames for part in parts])[:-1]])
    return replace(
        first,
        path=folder,
        chapters=tuple(part.path for part in parts),
        frames=sum(part.frames for part in parts),
        declares_count=all(part.declares_count for part in parts),
        times=np.concatenate([begin + part.times for begin, part in zip(begins, parts, strict=True)]),
        coded_at=np.concatenate([count + part.coded_at for count, part in zip(counts, parts, strict=True)]),
        stands_alone=np.concatenate([part.stands_alone for part in parts]),
        variable_rate=any(part.variable_rate for part in parts),
        size_bytes=sum(part.size_bytes for part in parts),
    )


def _probe_file(path: Path) -> VideoInfo:
    size_bytes = path.stat().st_size
    if size_bytes == 0:
        raise VideoError(f"{path} is empty (0 bytes); record or copy it again")
    with open(path) as container:
        stream = container.streams.best("video")
        if stream is None:
            raise VideoError(f"{path} has no video stream; put one video per camera into the videos folder")
        if stream.codec_context is None:
            raise VideoError(
                f"{path}: FFmpeg does not know its video's codec{_stated_codec(path)}; the file is damaged, or must be "
                "exported as H.264"
            )
        formats = set(container.format.name.split(","))
        packets = _walk(path, container, stream)
        declared, rate = int(stream.frames), stream.average_rate
        guessed = stream.guessed_rate or rate
        declared_end = _declared_end(container, stream)
        codec, in_order = stream.codec_context.name, stream.codec_context.codec.intra_only
        name, recorded_fps = container.format.name, _recorded_fps(container, stream)
    counted = bool(formats & _COUNTED) and declared > 0
    _refuse_truncated(path, packets, declared if counted else 0, declared_end, guessed)
    width, height, rotation, aspect, shown_from = _first_frame(path)
    # AVI counts frames, also dropped ones that the program left empty, and keeps no time stamps: the times that a
    # demuxer reports for frames that are not stored in order are guesses.
    reliable = name != "avi" or (in_order and bool((np.diff(packets.times) > 0).all()))
    times = packets.times if reliable or not guessed else np.arange(len(packets.times)) / float(guessed)
    begin, shown = times[0], np.ones(len(times), dtype=np.bool_)
    if reliable and shown_from is not None and not counted:
        usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        shown = times >= shown_from - 0.5 * usual
    times = times[shown] - begin
    fps, variable = _rate(times, guessed)
    if rotation % 180:
        width, height = height, width
    return VideoInfo(
        path=path,
        container=name,
        codec=codec,
        width=width,
        height=height,
        rotation_deg=rotation,
        tagged_rotation_deg=rotation,
        fps=fps,
        frames=len(times),
        declares_count=counted,
        times=times,
        coded_at=packets.coded_at[shown],
        stands_alone=packets.stands_alone[shown],
        variable_rate=variable,
        pixel_aspect=aspect,
        size_bytes=size_bytes,
        recorded_fps=recorded_fps,
    )


def open(path: Path, **options: str) -> Any:
    """A video container.

    Raises:
        VideoError: it does not exist, cannot be read, or is no video.
    """
    try:
        return av.open(str(path), options=options)
    except FileNotFoundError:
        raise VideoError(f"{path} does not exist") from None
    except PermissionError:
        raise VideoError(f"{path} cannot be read: permission denied; give yourself read access to it") from None
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise VideoError(
            f"{path} cannot be decoded ({reason(error)}): it is truncated, still being written or not a "
            "video; copy or export it again"
        ) from None


def _stated_codec(path: Path) -> str:
    """The codec that a file states, for a message; empty where it cannot be found. PyAV does not tell it where FFmpeg
    does not know it."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found = next((bytes(match[1]) for pattern in _CODEC_NAMES if (match := pattern.search(data))), b"")
    return f" {found.decode('latin-1').strip()}" if found else ""


def reason(error: BaseException) -> str:
    """What an error of FFmpeg or the system says, in one line of lower case."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return str(text).splitlines()[0].lower()


def _walk(path: Path, container: Any, stream: Any) -> _Packets:
    """Read every packet's time stamp; nothing is decoded."""
    times: list[float] = []
    alone: list[bool] = []
    total, damaged, ends = 0, None, 0.0
    fallback = float(1 / (stream.guessed_rate or stream.average_rate or 25))
    try:
        for packet in container.demux():
            if packet.size == 0 and packet.dts is None:
                continue  # the flush at the end of a stream
            stamp = packet.pts if packet.pts is not None else packet.dts
            base = float(packet.time_base) if packet.time_base is not None else 0.0
            if stamp is not None:
                ends = max(ends, (stamp + (packet.duration or 0)) * base)
            if packet.stream.index != stream.index:
                continue
            total += 1
            if packet.is_corrupt and damaged is None:
                damaged = total
            if not packet.is_discard:
                times.append(stamp * base if stamp is not None else len(times) * fallback)
                alone.append(packet.is_keyframe)
    except (av.error.FFmpegError, OSError) as error:
        raise VideoError(f"{path} breaks off after {total} frames ({reason(error)}); copy or export it again") from None
    order = np.argsort(np.asarray(times, dtype=np.float64), kind="stable")
    return _Packets(np.asarray(times)[order], order, np.asarray(alone, np.bool_)[order], total, damaged, ends)


def _recorded_fps(container: Any, stream: Any) -> float | None:
    """Frames per second at which a phone recorded, where it says so."""
    tags = {key.lower(): value for tagged in (container, stream) for key, value in tagged.metadata.items()}
    with contextlib.suppress(KeyError, ValueError):
        rate = float(tags["com.android.capture.fps"])
        return rate if np.isfinite(rate) and rate > 0 else None
    return None


def _declared_end(container: Any, stream: Any) -> float | None:
    """When (s) the last frame ends according to the file's header; None where it is not stated."""
    if stream.frames and stream.average_rate:
        return float(stream.frames / stream.average_rate)
    tags = {key.upper(): value for key, value in stream.metadata.items()}
    with contextlib.suppress(KeyError, ValueError):
        hours, minutes, seconds = tags["DURATION"].split(":")
        return int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    videos_only = len(container.streams) == 1
    return container.duration / av.time_base if container.duration and videos_only else None


def _refuse_truncated(
    path: Path, packets: _Packets, declared: int, declared_end: float | None, rate: Fraction | None
) -> None:
    """Raise if the file holds fewer frames than it declares, or none."""
    remedy = "copy the file again, or re-encode the rest of it (ffmpeg -i IN -c:v libx264 OUT.mp4)"
    held = len(packets.times)
    if held == 0:
        raise VideoError(f"{path} holds no frames; {remedy}")
    if packets.damaged_at is not None:
        of = f" of the {declared} that it declares" if declared else ""
        raise VideoError(f"{path} is truncated or damaged at frame {packets.damaged_at}{of}; {remedy}")
    if declared:
        # An edit list may leave samples out on purpose: then they are all there once it is ignored.
        if packets.total < declared:
            with open(path, ignore_editlist="1") as container:
                whole = _walk(path, container, container.streams.best("video")).total
            if whole < declared:
                raise VideoError(f"{path} is truncated: it declares {declared} frames and holds {whole}; {remedy}")
        return
    if declared_end is not None and rate:
        missing = (declared_end - (packets.times[-1] + 1 / float(rate))) * float(rate)
        if missing > 1.5:
            count = held + round(missing)
            raise VideoError(f"{path} is truncated: it declares about {count} frames and holds {held}; {remedy}")


def _first_frame(path: Path) -> tuple[int, int, int, float, float | None]:
    """Coded width, height, counterclockwise rotation flag in degrees, pixel aspect and time, s, of the first frame that
    can be decoded."""
    with open(path) as container:
        stream = container.streams.best("video")
        try:
            for frame in container.decode(stream):
                aspect = stream.sample_aspect_ratio
                turn = int(round(frame.rotation / 90)) * 90 % 360
                return frame.width, frame.height, turn, float(aspect) if aspect else 1.0, frame.time
        except (av.error.FFmpegError, OSError) as error:
            raise VideoError(
                f"{path} cannot be decoded from its first frame on ({reason(error)}); copy it again"
            ) from None
    raise VideoError(f"{path} holds no frame that can be decoded; copy or export it again")


def _rate(times: FloatArray, nominal: Fraction | None) -> tuple[float, bool]:
    """Frames per second from time stamps, and whether their spacing varies."""
    if len(times) < 3 or times[-1] <= times[0]:
        return float(nominal or 25), False
    steps = np.diff(times)
    fps = (len(times) - 1) / (times[-1] - times[0])
    # Containers round their stamps (Matroska to milliseconds): the nominal rate is more accurate.
    if nominal and abs(float(nominal) / fps - 1) < 2e-3:
        fps = float(nominal)
    if np.all(np.abs(steps * fps - 1) <= 0.25 + 1e-3 * fps):
        return fps, False
    # Where frames were dropped, the usual step is the camera's rate; the mean is not.
    usual = float(1 / np.median(steps)) if np.median(steps) > 0 else fps
    if nominal and abs(float(nominal) / usual - 1) < 0.02:
        usual = float(nominal)
    return usual, True
