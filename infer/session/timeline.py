"""The time that all videos of a session share."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import SessionError
from muybridge.geometry.sync.clocks import Clock
from muybridge.infer.session.probe import VideoInfo
from muybridge.infer.session.sync_file import SYNC_FILE, first_frames_in_common
from muybridge.infer.session.timestamps import nearest

# Where one camera stops so much earlier, in seconds, the others go on without it.
_GOES_ON_S = 0.5
# Slow motion is stored at a fraction of the rate at which it was recorded; rates less apart are the same one.
_SLOWED = 1.5
# A video that lasts so many times as long as the others, as the slow motion of usual recorders does, is suspected.
_SLOWED_BY, _ABOUT = (4, 8), 0.03
# Rates this close are one rate stated differently (29.97 and 30).
_SAME_RATE = 0.005


def common_time(
    videos: Sequence[VideoInfo], clocks: tuple[Clock, ...] | None
) -> tuple[float, IntArray, FloatArray | None, tuple[Clock, ...] | None, BoolArray | None, list[str]]:
    """The time line of a take.

    Args:
        videos: C videos.
        clocks: (C,) of the cameras, from a `sync.toml`; None without one.

    Returns:
        frame rate; (C, T) frames of each video; (C, T) how late they were taken, seconds (None where frames are paired
        by number); the clocks counted from the first frames; (C, T) whether a video has ended (None where all last to
        the end; its last frame is repeated then); and notices about what was assumed.

    Raises:
        SessionError: a video is slow motion, or a video ends before another begins.
    """
    _refuse_slow_motion(videos)
    rates = np.array([v.fps for v in videos])
    near = rates.max() / rates.min() - 1 < _SAME_RATE
    listed = ", ".join(f"{v.path.name} {v.fps:.4g}" for v in videos)
    notices: list[str] = []
    by_number, apart = _by_number(videos)
    if near:
        fps = _most_common(rates)
        if len(set(np.round(rates, 2))) > 1:
            how = (
                "frames are paired by number" if by_number else "the videos end together, so frames are paired by time"
            )
            much = f"; by these rates the last ones are {apart:.2g} s apart" if by_number and apart * fps > 0.5 else ""
            notices.append(f"frame rates differ slightly ({listed} fps): {how} at {fps:.4g} fps{much}")
    else:
        fps = float(rates.min())
        notices.append(
            f"frame rates differ ({listed} fps): the take runs at the lowest, {fps:.4g} fps, with each "
            "camera's landmarks interpolated between its frames, all videos assumed to start together"
        )
    varying = [v.path.name for v in videos if v.variable_rate]
    if varying:
        notices.append(
            f"the frame rate of {', '.join(varying)} varies (frames were dropped or the camera adapts it): "
            f"the take runs at an even {fps:.4g} fps, and landmarks are interpolated between frames"
        )
    late_to_show = [f"{v.times[0]:.2g} s of {v.path.name}" for v in videos if v.times[0] * fps > 0.5]
    if late_to_show:
        notices.append(f"the first {', '.join(late_to_show)} cannot be decoded, as when a recorder joins a stream")
    by_time = not near or not by_number or bool(varying) or bool(late_to_show)
    if by_time:
        counts = [int(np.floor(v.times[-1] * fps + 0.5)) + 1 for v in videos]
    else:
        counts = [v.frames for v in videos]
    first, clocks, frames, omitted = _first_frames(videos, counts, clocks, fps)
    own = first[:, None] + np.arange(frames)
    notices += omitted + _much_longer(videos)
    past = own >= np.array(counts)[:, None]
    ended = past if past.any() else None
    if not by_time:
        return fps, np.minimum(own, np.array(counts)[:, None] - 1), None, clocks, ended, notices
    indices = np.stack([nearest(v.times, grid) for v, grid in zip(videos, own / fps, strict=True)])
    late = np.stack([v.times[at] for v, at in zip(videos, indices, strict=True)]) - own / fps
    return fps, indices, late, clocks, ended, notices


def _first_frames(
    videos: Sequence[VideoInfo], counts: Sequence[int], clocks: tuple[Clock, ...] | None, fps: float
) -> tuple[IntArray, tuple[Clock, ...] | None, int, list[str]]:
    """(C,) the first frame of the take in each video, the clocks counted from there, the number of frames, and
    notices."""
    names = [v.path.name for v in videos]
    first = np.zeros(len(videos), dtype=np.int64)
    if clocks is not None:
        first, clocks = first_frames_in_common(clocks, names, counts, fps)
    left = np.array(counts) - first
    shortest, frames = int(left.min()), int(np.sort(left)[-2])  # motion needs two cameras
    if (frames - shortest) / fps <= _GOES_ON_S:
        frames = shortest
    lengths = ", ".join(f"{name} {n}" for name, n in zip(names, counts, strict=True))
    notices = []
    if first.any():
        begins = ", ".join(f"{name} {n}" for name, n in zip(names, first, strict=True))
        of_all = "" if frames > shortest else " of all videos"
        notices = [f"by {SYNC_FILE} the take begins with frames {begins}: {frames} frames{of_all} ({lengths})"]
    elif len(set(counts)) > 1:
        notices = [f"the videos differ in length ({lengths} frames): the first {frames} frames are used"]
    stopped = [f"{name} at frame {n}" for name, n in zip(names, left, strict=True) if n < frames]
    if stopped:
        notices.append(f"{', '.join(stopped)} of the take ends early: the other cameras are used from there on")
    return first, clocks, frames, notices


def _refuse_slow_motion(videos: Sequence[VideoInfo]) -> None:
    """Raise if a video says that it was recorded at a much higher rate than it is stored with."""
    slow = [v for v in videos if v.recorded_fps is not None and v.recorded_fps > _SLOWED * v.fps]
    if slow:
        named = ", ".join(f"{v.path.name} (recorded at {v.recorded_fps:.4g} fps, slowed to {v.fps:.4g})" for v in slow)
        by = (slow[0].recorded_fps or 1.0) / slow[0].fps
        name = slow[0].path.name
        raise SessionError(
            f"slow motion: {named}; restore the speed of each, such as "
            f"`ffmpeg -itsscale {1 / by:.6g} -i {name} -c copy real_time_{name}`, and use those files"
        )


def _much_longer(videos: Sequence[VideoInfo]) -> list[str]:
    """A notice about videos that last as many times as long as the others as slow motion does."""
    lengths = np.array([v.times[-1] + 1 / v.fps for v in videos])
    suspects = []
    for c, video in enumerate(videos):
        others = np.delete(lengths, c)
        ratio = lengths[c] / np.median(others)
        if np.ptp(others) < _ABOUT * others.max() and min(abs(ratio / by - 1) for by in _SLOWED_BY) < _ABOUT:
            suspects.append(f"{video.path.name} lasts {ratio:.3g} times as long as the others")
    if not suspects:
        return []
    return [f"{', '.join(suspects)}: if it is slow motion, export it again at its real speed"]


def _by_number(videos: Sequence[VideoInfo]) -> tuple[bool, float]:
    """Whether frames of the same number belong together in videos of nearly one rate, and how far apart the last common
    frames are by their times, seconds. Cameras that are triggered together write equally many frames, whatever rate
    their files state; cameras with their own clocks that are stopped together last equally long."""
    frames = np.array([v.frames for v in videos])
    last = np.array([v.times[-1] for v in videos])
    apart = float(np.ptp([v.times[frames.min() - 1] for v in videos]))
    return bool(np.ptp(frames) <= 1 + np.ptp(last) * max(v.fps for v in videos)), apart


def _most_common(rates: FloatArray) -> float:
    return float(Counter(float(r) for r in rates).most_common(1)[0][0])
