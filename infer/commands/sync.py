"""`muybridge sync`: offsets and drifts of the cameras' clocks, found, compared, written and applied.

`sync.toml` in the session says what was found; `muybridge run` reads it and interpolates the 2D landmarks.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import av
import numpy as np
import tyro
from numpy.typing import NDArray

from muybridge.errors import MuybridgeError, SessionError
from muybridge.files import replacing
from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.sync.motion import Clock, audio_clock, epipolar_clocks, motion_clocks
from muybridge.infer.commands.calibrate.people import session_keypoints
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import Session, SessionOptions, open_session
from muybridge.infer.session.sync_file import SYNC_FILE, SYNC_VERSION

Floats = NDArray[np.float64]

_AUDIO_RATE = 16000
_DRIFT_FROM = 60.0  # seconds of take from which pictures are asked for drift
_DISAGREE_SIGMA = 4.0
_DISAGREE_FRAMES = 0.5

Method = Literal["audio", "epipolar", "motion"]
_METHODS: tuple[Method, ...] = ("audio", "epipolar", "motion")


@dataclass(frozen=True)
class SyncResult:
    """The clocks of a session's cameras.

    Attributes:
        clocks: (C,) the ones to use.
        methods: (C,) where they are from; `reference` for the first camera, `none` where nothing was found.
        found: every method's clocks, (C,) each.
        disagreements: sentences about methods that contradict each other.
    """

    clocks: tuple[Clock, ...]
    methods: tuple[str, ...]
    found: dict[str, tuple[Clock, ...]]
    disagreements: tuple[str, ...]


def read_audio(path: Path, rate: int = _AUDIO_RATE) -> Floats | None:
    """A file's first audio stream from the video's time zero, mono, at `rate`; None where it has none.

    Raises:
        SessionError: the stream cannot be decoded.
    """
    try:
        with av.open(str(path)) as container:
            if not container.streams.audio:
                return None
            stream = container.streams.audio[0]
            zero = 0.0
            if container.streams.video:
                video = container.streams.video[0]
                zero = float((video.start_time or 0) * (video.time_base or 0))
            resampler = av.AudioResampler(format="flt", layout="mono", rate=rate)
            pieces: list[Floats] = []
            begins: float | None = None
            for frame in container.decode(stream):
                if begins is None:
                    begins = float(frame.time or 0.0)
                pieces += [f.to_ndarray().ravel().astype(np.float64) for f in resampler.resample(frame)]
            pieces += [f.to_ndarray().ravel().astype(np.float64) for f in resampler.resample(None)]
    except av.error.FFmpegError as error:
        raise SessionError(f"{path}: its sound cannot be read ({error}); use --methods epipolar motion") from None
    if not pieces:
        return None
    sound, ahead = np.concatenate(pieces), round(((begins or 0.0) - zero) * rate)
    return np.concatenate([np.zeros(ahead), sound]) if ahead >= 0 else sound[-ahead:]


def find_clocks(
    session: Session, keypoints: Keypoints2D | None, methods: Sequence[str], max_offset: float
) -> SyncResult:
    """Clocks of all cameras by every method asked for.

    Args:
        session: C cameras and their videos.
        keypoints: everyone's landmarks; None where only sound is asked.
        methods: of `audio`, `epipolar`, `motion`; the first that knows a camera is believed.
        max_offset: seconds.
    """
    found: dict[str, tuple[Clock, ...]] = {}
    if "audio" in methods:
        sounds = [read_audio(v.path) for v in session.videos]
        found["audio"] = tuple(_by_sound(sounds, c, max_offset) for c in range(len(sounds)))
    if keypoints is not None:
        found |= _by_pictures(session, keypoints, methods, max_offset)
    clocks, origins = [], []
    for c in range(len(session.cameras)):
        order = [m for m in methods if m in found and np.isfinite(found[m][c].offset_sd)]
        chosen = min(order, key=lambda m: found[m][c].offset_sd) if order else ""
        clocks.append(found[chosen][c] if chosen else Clock(0.0, 0.0, np.inf, np.inf, 0.0))
        origins.append("reference" if c == 0 else chosen or "none")
    clocks[0] = Clock(0.0, 0.0, 0.0, 0.0, 1.0)
    said = disagreements(session.cameras.names, found, session.fps)
    return SyncResult(tuple(clocks), tuple(origins), found, said)


def _by_sound(sounds: Sequence[Floats | None], c: int, max_offset: float) -> Clock:
    first, other = sounds[0], sounds[c]
    if c == 0:
        return Clock(0.0, 0.0, 0.0, 0.0, 1.0)
    if first is None or other is None:
        return Clock(0.0, 0.0, np.inf, np.inf, 0.0)
    near = audio_clock(first, other, _AUDIO_RATE, max_offset)
    return near if np.isfinite(near.offset_sd) else audio_clock(first, other, _AUDIO_RATE)


def _by_pictures(
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
    said = []
    methods = list(found)
    for c, name in enumerate(names):
        for k, a in enumerate(methods):
            for b in methods[k + 1 :]:
                one, two = found[a][c], found[b][c]
                gap, sd = abs(one.offset - two.offset), float(np.hypot(one.offset_sd, two.offset_sd))
                if np.isfinite(sd) and gap > max(_DISAGREE_SIGMA * sd, _DISAGREE_FRAMES / fps):
                    said.append(
                        f"camera {name}: {a} says {one.offset * 1e3:.1f} ms, {b} {two.offset * 1e3:.1f} ms; "
                        f"look at a fast movement in both videos, and choose with --methods"
                    )
    return tuple(said)


def write_sync(path: Path, names: Sequence[str], result: SyncResult) -> None:
    """Write `sync.toml`."""
    rows = [
        "# Clocks of the cameras: a camera's own time is t + offset + drift t at the reference's time t.",
        f"muybridge_sync = {SYNC_VERSION}",
        f"reference = {json.dumps(names[0])}",
    ]
    for name, clock, method in zip(names, result.clocks, result.methods, strict=True):
        rows += [
            "",
            f"[cameras.{json.dumps(name)}]",
            f"offset = {clock.offset!r}  # seconds",
            f"drift_ppm = {clock.drift * 1e6!r}",
            f'method = "{method}"',
        ]
        if np.isfinite(clock.offset_sd):
            rows.append(f"offset_sd = {clock.offset_sd!r}")
        if np.isfinite(clock.drift_sd):
            rows.append(f"drift_sd_ppm = {clock.drift_sd * 1e6!r}")
    with replacing(path) as partial:
        partial.write_text("\n".join(rows) + "\n", encoding="utf-8")


def sync(
    session: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    methods: tuple[Method, ...] = _METHODS,
    max_offset: float = 2.0,
    work: Path | None = None,
    read: Annotated[SessionOptions, tyro.conf.arg(name="")] = SessionOptions(),  # noqa: B008
    detect: Annotated[DetectOptions, tyro.conf.arg(name="")] = DetectOptions(),  # noqa: B008
    quiet: bool = False,
) -> int:
    """Offsets and drifts of a session's cameras, by sound, by movement and by epipolar geometry.

    Args:
        session: folder with `videos/` and a calibration.
        out: file to write (default: `sync.toml` in the session, where `muybridge run` reads it).
        methods: which are tried; where several know a camera, the surest is used.
        max_offset: largest offset that is looked for, seconds; by sound, first, and then any.
        work: results folder whose finished 2D landmarks are used (default: `muybridge/` inside the session).
        read: how the session folder is read.
        detect: 2D landmarks.
        quiet: say only what should be known.
    """
    if not methods:
        raise MuybridgeError(f"name at least one of {', '.join(_METHODS)} after --methods")
    if not max_offset > 0:
        raise MuybridgeError(f"--max-offset is {max_offset:g}: name the largest offset in seconds, more than 0")
    with Progress(quiet=quiet) as progress:
        opened = open_session(session, read, in_step=False)
        keypoints = None
        if set(methods) - {"audio"}:
            opened, keypoints = session_keypoints(opened, work, detect, progress)
        result = find_clocks(opened, keypoints, methods, max_offset)
    names = opened.cameras.names
    for name, clock, method in zip(names, result.clocks, result.methods, strict=True):
        print(f"{name}: {_told(clock, method)}")
    for name, clock, method in zip(names, result.clocks, result.methods, strict=True):
        if method == "audio" and clock.offset_sd > 1 / opened.fps:
            print(f"{name}: its sound repeats itself, so that other offsets fit as well: check a fast movement")
    for line in result.disagreements:
        print(f"methods disagree: {line}")
    if all(m in ("reference", "none") for m in result.methods):
        raise SessionError(
            f"{session}: no way ({', '.join(methods)}) to find how the cameras' clocks stand; nothing was written. "
            "Sound needs to be in all videos, pictures need a person who moves in two views or more and offsets of at "
            f"most {max_offset:g} s (--max-offset)"
        )
    write_sync(out or session / SYNC_FILE, names, result)
    return 0


def _told(clock: Clock, method: str) -> str:
    if method in ("reference", "none"):
        return "reference" if method == "reference" else "nothing found, taken to be in step"
    drift = f", drift {clock.drift * 1e6:.1f} +- {clock.drift_sd * 1e6:.1f} ppm" if np.isfinite(clock.drift_sd) else ""
    return f"offset {clock.offset * 1e3:.2f} +- {clock.offset_sd * 1e3:.2f} ms{drift} (by {method})"
