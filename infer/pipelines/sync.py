"""Offsets and drifts of the clocks of a session's cameras, from sound or from images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import av
import numpy as np
import tomli_w

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError, SessionError
from muybridge.files import replacing
from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.sync.audio import audio_clock
from muybridge.geometry.sync.clocks import Clock
from muybridge.geometry.sync.epipolar import epipolar_clocks
from muybridge.geometry.sync.motion import motion_clocks
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import Session, SessionOptions, open_session
from muybridge.infer.session.sync_file import SYNC_VERSION

_AUDIO_RATE = 16000
# Seconds; the drift of clocks is estimated from the images of takes that are at least as long.
_DRIFT_FROM = 60.0
_DISAGREE_SIGMA = 4.0
_DISAGREE_FRAMES = 0.5
_HEADER = """# Clocks of the cameras: a camera's own time is t + offset + drift t at the reference's time t.
# Offsets in seconds, drifts in parts per million.
"""

Method = Literal["audio", "epipolar", "motion"]
METHODS: tuple[Method, ...] = ("audio", "epipolar", "motion")


@dataclass(frozen=True)
class SyncResult:
    """The clocks of a session's cameras.

    Attributes:
        clocks: (C,) the ones to use.
        methods: (C,) which method estimated them; `reference` for the first camera, `none` where none did.
        found: every method's clocks, (C,) each.
        disagreements: sentences about methods that contradict each other.
    """

    clocks: tuple[Clock, ...]
    methods: tuple[str, ...]
    found: dict[str, tuple[Clock, ...]]
    disagreements: tuple[str, ...]


def sync_session(
    path: Path,
    results: Path | None,
    methods: Sequence[Method],
    max_offset: float,
    session: SessionOptions,
    detect: DetectOptions,
    progress: Progress,
) -> tuple[Session, SyncResult]:
    """Estimate the clocks of a session's cameras.

    Args:
        path: the session's folder.
        results: results folder whose 2D landmarks are used where they are there; None for the session's own.
        methods: which are tried; where several succeed for a camera, the most certain one is used.
        max_offset: seconds, largest offset.
        session: how the session folder is read.
        detect: how 2D landmarks are detected.
        progress: receives progress messages.

    Raises:
        SessionError: no method succeeded for any camera.
        MuybridgeError: the session cannot be used, or an argument makes no sense.
    """
    if not methods:
        raise MuybridgeError(f"no method to synchronise by; there are {', '.join(METHODS)}")
    if not max_offset > 0:
        raise MuybridgeError(f"the largest offset must be more than 0 seconds, not {max_offset:g}")
    opened = open_session(path, session, in_step=False)
    keypoints = None
    if set(methods) - {"audio"}:
        opened, keypoints = session_keypoints(opened, results, detect, progress)
    result = find_clocks(opened, keypoints, methods, max_offset)
    if all(m in ("reference", "none") for m in result.methods):
        raise SessionError(
            f"{path}: the cameras' clocks cannot be estimated ({', '.join(methods)}). Sound must be in all videos; "
            f"images must show a person who moves in two views or more, and offsets of at most {max_offset:g} s",
            remedy="max_offset",
        )
    return opened, result


def format_summary(session: Session, result: SyncResult) -> list[str]:
    """The result in sentences, one line per camera."""
    names = session.cameras.names
    rows = list(zip(names, result.clocks, result.methods, strict=True))
    lines = [f"{name}: {_clock_text(clock, method)}" for name, clock, method in rows]
    lines += [
        f"{name}: its sound is periodic, so other offsets fit as well: check a fast movement"
        for name, clock, method in rows
        if method == "audio" and clock.offset_sd > 1 / session.fps
    ]
    return [*lines, *(f"methods disagree: {line}" for line in result.disagreements)]


def _clock_text(clock: Clock, method: str) -> str:
    if method in ("reference", "none"):
        return "reference" if method == "reference" else "not estimated, assumed to be synchronised"
    drift = f", drift {clock.drift * 1e6:.1f} +- {clock.drift_sd * 1e6:.1f} ppm" if np.isfinite(clock.drift_sd) else ""
    return f"offset {clock.offset * 1e3:.2f} +- {clock.offset_sd * 1e3:.2f} ms{drift} (by {method})"


def read_audio(path: Path, rate: int = _AUDIO_RATE) -> FloatArray | None:
    """A file's first audio stream from the video's time zero, mono, at `rate`; None where it has none.

    Raises:
        SessionError: the stream cannot be decoded.
    """
    try:
        with av.open(str(path)) as container:
            if not container.streams.audio or container.streams.audio[0].codec_context is None:
                return None
            stream = container.streams.audio[0]
            zero = 0.0
            if container.streams.video:
                video = container.streams.video[0]
                zero = float((video.start_time or 0) * (video.time_base or 0))
            resampler = av.AudioResampler(format="flt", layout="mono", rate=rate)
            pieces: list[FloatArray] = []
            begins: float | None = None
            for frame in container.decode(stream):
                if begins is None:
                    begins = float(frame.time or 0.0)
                pieces += [f.to_ndarray().ravel().astype(np.float64) for f in resampler.resample(frame)]
            pieces += [f.to_ndarray().ravel().astype(np.float64) for f in resampler.resample(None)]
    except av.error.FFmpegError as error:
        raise SessionError(f"{path}: its sound cannot be read ({error})", remedy="sync_by_images") from None
    if not pieces:
        return None
    sound, ahead = np.concatenate(pieces), round(((begins or 0.0) - zero) * rate)
    return np.concatenate([np.zeros(ahead), sound]) if ahead >= 0 else sound[-ahead:]


def find_clocks(
    session: Session, keypoints: Keypoints2D | None, methods: Sequence[str], max_offset: float
) -> SyncResult:
    """Clocks of all cameras by every given method.

    Args:
        session: C cameras and their videos.
        keypoints: everyone's landmarks; None where only sound is used.
        methods: of `audio`, `epipolar`, `motion`; the most certain one is used.
        max_offset: seconds.
    """
    found: dict[str, tuple[Clock, ...]] = {}
    if "audio" in methods:
        sounds = [read_audio(v.files[0]) for v in session.videos]
        found["audio"] = tuple(_clock_from_audio(sounds, c, max_offset) for c in range(len(sounds)))
    if keypoints is not None:
        found |= _clocks_from_images(session, keypoints, methods, max_offset)
    clocks, origins = [], []
    for c in range(len(session.cameras)):
        order = [m for m in methods if m in found and np.isfinite(found[m][c].offset_sd)]
        chosen = min(order, key=lambda m: found[m][c].offset_sd) if order else ""
        clocks.append(found[chosen][c] if chosen else Clock(0.0, 0.0, np.inf, np.inf, 0.0))
        origins.append("reference" if c == 0 else chosen or "none")
    clocks[0] = Clock(0.0, 0.0, 0.0, 0.0, 1.0)
    contradictions = disagreements(session.cameras.names, found, session.fps)
    return SyncResult(tuple(clocks), tuple(origins), found, contradictions)


def _clock_from_audio(sounds: Sequence[FloatArray | None], c: int, max_offset: float) -> Clock:
    first, other = sounds[0], sounds[c]
    if c == 0:
        return Clock(0.0, 0.0, 0.0, 0.0, 1.0)
    if first is None or other is None:
        return Clock(0.0, 0.0, np.inf, np.inf, 0.0)
    near = audio_clock(first, other, _AUDIO_RATE, max_offset)
    return near if np.isfinite(near.offset_sd) else audio_clock(first, other, _AUDIO_RATE)


def _clocks_from_images(
    session: Session, keypoints: Keypoints2D, methods: Sequence[str], max_offset: float
) -> dict[str, tuple[Clock, ...]]:
    selection = select_person(session.cameras, keypoints, fps=session.fps)
    px, variance, _ = take_person(keypoints, selection)
    drift = px.shape[1] / session.fps >= _DRIFT_FROM
    motion = motion_clocks(px, variance, session.fps, max_offset, drift)
    found = {"motion": motion} if "motion" in methods else {}
    if "epipolar" in methods:
        start = tuple(m if np.isfinite(m.offset) else replace(m, offset=0.0) for m in motion)
        found["epipolar"] = epipolar_clocks(session.cameras, px, variance, session.fps, start, with_drift=drift)
    return found


def disagreements(names: Sequence[str], found: dict[str, tuple[Clock, ...]], fps: float) -> tuple[str, ...]:
    """Sentences about cameras for which two methods differ by more than both their uncertainties allow."""
    sentences = []
    methods = list(found)
    for c, name in enumerate(names):
        for k, a in enumerate(methods):
            for b in methods[k + 1 :]:
                one, two = found[a][c], found[b][c]
                gap, sd = abs(one.offset - two.offset), float(np.hypot(one.offset_sd, two.offset_sd))
                if np.isfinite(sd) and gap > max(_DISAGREE_SIGMA * sd, _DISAGREE_FRAMES / fps):
                    sentences.append(
                        f"camera {name}: {a} says {one.offset * 1e3:.1f} ms, {b} {two.offset * 1e3:.1f} ms; "
                        "look at a fast movement in both videos, and choose a method"
                    )
    return tuple(sentences)


def write_sync(path: Path, names: Sequence[str], result: SyncResult) -> None:
    """Write `sync.toml`.

    Args:
        path: the file.
        names: (C,) of the cameras.
        result: their clocks.

    Raises:
        OutputError: it cannot be written.
    """
    cameras = {
        name: _clock_table(clock, method)
        for name, clock, method in zip(names, result.clocks, result.methods, strict=True)
    }
    content = {"muybridge_sync": SYNC_VERSION, "reference": names[0], "cameras": cameras}
    with replacing(path) as temporary:
        temporary.write_text(_HEADER + tomli_w.dumps(content), encoding="utf-8", newline="\n")


def _clock_table(clock: Clock, method: str) -> dict[str, float | str]:
    values = {"offset": clock.offset, "drift_ppm": clock.drift * 1e6}
    spread = {"offset_sd": clock.offset_sd, "drift_sd_ppm": clock.drift_sd * 1e6}
    known = {name: float(value) for name, value in spread.items() if np.isfinite(value)}
    return {**{name: float(value) for name, value in values.items()}, "method": method, **known}
