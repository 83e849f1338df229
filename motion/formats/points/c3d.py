"""C3D, the binary file of biomechanics: written through ezc3d (Z up, millimetres, 4-byte floats), read by `c3d_read`.

A missing point has the residual -1 (and zeros as coordinates: every reader goes by the residual). A known
point's residual is one standard deviation of its position where a covariance is known: the format means "the
average residual of the intersecting rays", which the same figure stands for. It has one byte: whole
millimetres from 1 to 127, and 0 for "not measured". Readers disagree on which of two bytes that is, the other being
a mask of cameras: the format's text and most readers take the low one, ezc3d the high one. We write it into both, as
there is no mask to tell, and read the low one.
"""

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from muybridge import __version__
from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.c3d_read import LAST_COUNTED, RawC3D, read_raw_c3d
from muybridge.motion.formats.points.common import (
    METRES_OF_UNIT,
    UP_PERMUTATION,
    check_unit,
    check_up,
)
from muybridge.motion.formats.points.world import Trajectories, points_of_file

# The axis parameters as the C3D manual has them: what points right and up on a screen that shows the subject
# from its left.
_SCREEN = {"z": ("+Y", "+Z"), "y": ("+X", "+Y")}
# Results of gait models that are stored as points but are none; the names of the parameters that list them.
_NOT_POINTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "ENERGIES", "REACTIONS", "MODEL_OUTPUTS")


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        label: what, such as "Foot Strike".
        time: seconds, as the file counts: frame 1 of the recording is at zero, also where the file begins later.
        context: "Left", "Right" or "General".
        subject: the subject that it concerns.
        description: more about it.
    """

    label: str
    time: float
    context: str = "General"
    subject: str = ""
    description: str = ""


@dataclass(frozen=True, eq=False)
class Analog:
    """Sampled channels beside the points: force plates, muscles.

    Attributes:
        labels: (M,)
        units: (M,)
        rate: samples per second, a whole multiple of the points' frames.
        values: (S, M) in `units`.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    rate: float
    values: FloatArray


@dataclass(frozen=True, eq=False)
class C3DTake:
    """All of a C3D file that we keep.

    Attributes:
        points: metres, Z up.
        first_frame: number of the first frame in the recording, from 1.
        events: in order of time.
        analog: None where there are no channels.
        force_platforms: parameters of the group FORCE_PLATFORM, in millimetres and the points' axes.
        notices: what was assumed or left out in reading, one sentence each.
        modelled: names of points that the file lists as computed from markers (POINT:MODELED_MARKERS).
    """

    points: Points3D
    first_frame: int = 1
    events: tuple[Event, ...] = ()
    analog: Analog | None = None
    force_platforms: Mapping[str, Any] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    modelled: tuple[str, ...] = ()


def write_c3d(path: Path, points: Points3D | C3DTake, up: Literal["y", "z"] = "z") -> None:
    """Write points in millimetres, and what else a take has.

    Args:
        path: the file to write; replaced only once it is complete.
        points: (T, J, 3) metres; NaN where unknown.
        up: which of their axes is up; nothing is rotated, the file states it.

    Raises:
        OutputError: the file cannot be written.
    """
    import ezc3d  # type: ignore[import-untyped]  # here, since it is slow to load and few need it

    take = points if isinstance(points, C3DTake) else C3DTake(points)
    points = take.points
    xyz_mm = np.asarray(points.points_world, dtype=np.float64) * 1e3
    frames, markers = xyz_mm.shape[:2]
    missing = ~np.all(np.isfinite(xyz_mm), axis=-1)
    c3d: Any = ezc3d.c3d()
    c3d["header"]["points"]["frame_rate"] = float(points.fps)
    c3d["header"]["points"]["first_frame"] = take.first_frame - 1
    parameters = c3d["parameters"]
    parameters["POINT"]["RATE"]["value"] = [float(points.fps)]
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    # More labels than one parameter holds go on in LABELS2, LABELS3, ...
    for k in range(0, max(markers, 1), 255):
        names = points.landmarks.names[k : k + 255]
        suffix = str(k // 255 + 1) if k else ""
        c3d.add_parameter("POINT", f"LABELS{suffix}", list(names))
        c3d.add_parameter("POINT", f"DESCRIPTIONS{suffix}", [f"{points.landmarks.name} landmark"] * len(names))
    for key, axis in zip(("X_SCREEN", "Y_SCREEN"), _SCREEN[up], strict=True):
        c3d.add_parameter("POINT", key, [axis])
    c3d.add_parameter("MANUFACTURER", "COMPANY", ["muybridge"])
    c3d.add_parameter("MANUFACTURER", "SOFTWARE", ["muybridge"])
    c3d.add_parameter("MANUFACTURER", "VERSION_LABEL", [__version__])
    data = np.ones((4, markers, frames))
    data[:3] = np.where(missing[..., None], np.nan, xyz_mm).transpose(2, 1, 0)
    c3d["data"]["points"] = data
    residual = np.where(missing, -1.0, _standard_deviation_mm(points.covariance_world))
    c3d["data"]["meta_points"]["residuals"] = residual.T[None]
    byte = np.maximum(residual.T, 0).astype(np.int64)
    c3d["data"]["meta_points"]["camera_masks"] = (byte[None] >> np.arange(7)[:, None, None] & 1).astype(np.bool_)
    _add_extras(c3d, take, frames)
    _add_long(c3d, take.first_frame, frames)
    with replacing(path) as temporary:
        try:
            c3d.write(str(temporary))
        except RuntimeError as error:  # ezc3d has one exception for everything
            raise OSError(str(error)) from error
        _check_whole(temporary, 4 * (data.size + np.size(c3d["data"]["analogs"])))


def _check_whole(path: Path, data_bytes: int) -> None:
    """OSError unless a written file holds its header and all data: ezc3d says nothing of a full disk."""
    with path.open("rb") as file:
        head = file.read(18)
        size = file.seek(0, os.SEEK_END)
    begin = 512 * (int.from_bytes(head[16:18], "little") - 1)  # of the data, counted in blocks from 1
    if begin <= 0 or size < begin + data_bytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _add_long(c3d: Any, first: int, frames: int) -> None:
    """What counts frames where the header cannot: their number, and both ends as low and high 16 bits."""
    last = first + frames - 1
    if last <= LAST_COUNTED:
        return
    c3d.add_parameter("POINT", "LONG_FRAMES", [float(frames)])
    for key, number in (("ACTUAL_START_FIELD", first), ("ACTUAL_END_FIELD", last)):
        high, low = divmod(number, 65536)
        c3d.add_parameter("TRIAL", key, [low - 65536 if low > 32767 else low, high])


def _add_extras(c3d: Any, take: C3DTake, frames: int) -> None:
    """Analog samples, force plates and events."""
    analog = take.analog
    if analog is not None and analog.values.size:
        parameters = c3d["parameters"]["ANALOG"]
        parameters["RATE"]["value"] = [float(analog.rate)]
        parameters["LABELS"]["value"] = tuple(analog.labels)
        parameters["UNITS"]["value"] = tuple(analog.units)
        per_frame = round(analog.rate / take.points.fps)
        values = np.zeros((frames * per_frame, len(analog.labels)))
        values[: len(analog.values)] = analog.values[: len(values)]
        c3d["data"]["analogs"] = values.T[None]
    for name, value in take.force_platforms.items():
        if isinstance(value, np.ndarray):  # ezc3d takes whole numbers only as a flat list
            value = value.astype(np.float64) if value.ndim > 1 else value.tolist()
        c3d.add_parameter("FORCE_PLATFORM", name, value)
    if take.events:
        times = np.array([divmod(e.time, 60.0) for e in take.events]).T
        c3d.add_parameter("EVENT", "USED", [len(take.events)])
        c3d.add_parameter("EVENT", "TIMES", times)
        for key in ("label", "context", "subject", "description"):
            c3d.add_parameter("EVENT", f"{key.upper()}S", [getattr(e, key) for e in take.events])
        c3d.add_parameter("EVENT", "ICON_IDS", [0.0] * len(take.events))
        c3d.add_parameter("EVENT", "GENERIC_FLAGS", [0.0] * len(take.events))


def read_c3d(path: Path, unit: str | None = None, up: str | None = None) -> Points3D:
    """Read points into metres, Z up (a file whose Y_SCREEN says +Y is turned).

    Args:
        path: the file.
        unit: m, cm or mm, overriding the file; None for what the file states.
        up: y or z, likewise.

    Returns:
        points_world (T, J, 3), NaN where the residual is negative; covariance isotropic from the residual
        where that is above zero, else NaN. Results of gait models that the file lists as angles, forces, moments or
        powers are left out.

    Raises:
        FormatError: the file is not a C3D, holds no points, or its unit or axes are of no known kind.
    """
    return read_c3d_take(path, unit, up).points


def read_c3d_take(path: Path, unit: str | None = None, up: str | None = None, fps: float | None = None) -> C3DTake:
    """Read points as `read_c3d` does, with events, analog channels, force plates and the first frame's number; `fps`
    where the file states its frame rate wrongly."""
    path, up = Path(path), None if up is None else check_up(up)
    with parsing(path, FormatError, "a C3D"):
        return _take(path, read_raw_c3d(path), unit, up, fps)


def _take(path: Path, raw: RawC3D, unit: str | None, up: str | None, fps: float | None) -> C3DTake:
    frames, count = raw.points.shape[:2]
    names = raw.texts("POINT", "LABELS")[:count]
    names += [f"point_{k + 1}" for k in range(len(names), count)]
    not_points = {n for key in _NOT_POINTS for n in raw.texts("POINT", key)}
    kept = [k for k, name in enumerate(names) if name not in not_points]
    if not kept or not frames:
        raise FormatError(f"{path}: holds no points (labels: {len(kept)}, frames: {frames}); export them")
    fps = fps or raw.fps
    if not 0 < fps < 1e9:
        raise FormatError(f"{path}: POINT:RATE is {raw.fps}; it must be above zero")
    stated = check_unit(path, unit or (raw.texts("POINT", "UNITS") or [""])[0] or "mm", "POINT:UNITS")
    axis, notices = (up, []) if up else up_of_screen(path, raw)
    xyz = raw.points[:, kept]
    residual = raw.residuals[:, kept]
    xyz[residual < 0] = np.nan
    labels = tuple(names[k] or f"point_{k + 1}" for k in kept)
    found = Trajectories(labels, xyz, raw.fps, stated, axis, 0.0, tuple(notices))
    read = points_of_file(path, found, "c3d", unit, up, fps)
    metres, turn = METRES_OF_UNIT[stated], list(UP_PERMUTATION[check_up(axis)])
    known = (residual > 0) & np.isfinite(read.points.points_world[..., 0])
    variance = np.where(known, (residual * metres) ** 2, np.nan)
    covariance = np.where(np.isfinite(variance)[..., None, None], np.eye(3) * variance[..., None, None], np.nan)
    take = take_of(raw, replace(read.points, covariance_world=covariance), metres, np.eye(3)[turn])
    return replace(take, notices=(*read.notices, *take.notices))


def up_of_screen(path: Path, raw: RawC3D) -> tuple[str, list[str]]:
    """The axis that is up by the file, y or z, and a sentence where the file states its direction oddly.

    Some programs (Qualisys) state both directions of the screen with the opposite sign; their data have Z up.

    Raises:
        FormatError: it is neither.
    """
    screen = (raw.texts("POINT", "Y_SCREEN") or [""])[0].upper() or "+Z"
    axis = screen.lstrip("+-").lower()
    if axis not in UP_PERMUTATION:
        raise FormatError(f"{path}: POINT:Y_SCREEN is {screen!r}; valid are +Z, +Y", remedy="up_axis")
    if not screen.startswith("-"):
        return axis, []
    across = (raw.texts("POINT", "X_SCREEN") or [""])[0] or "not stated"
    return axis, [f"POINT:Y_SCREEN is {screen}, X_SCREEN {across}: {axis.upper()} was taken as the axis that is up"]


def take_of(raw: RawC3D, points: Points3D, metres: float, turn: FloatArray) -> C3DTake:
    """Points with what else the file has that they come from.

    Args:
        raw: the file.
        points: of all its frames. Where their rate is another than the file's, events and samples stay at their frames.
        metres: how long a unit of the file is.
        turn: (3, 3) from the file's axes to the points'.
    """
    stretch = raw.fps / points.fps if raw.fps > 0 else 1.0
    found, said = _events(raw)
    events = tuple(replace(e, time=e.time * stretch) for e in found)
    plates, modelled = _force_platforms(raw, metres, turn), tuple(raw.texts("POINT", "MODELED_MARKERS"))
    notices = (*raw.notices, *said)
    return C3DTake(points, raw.first_frame, events, _analog(raw, points.fps), plates, notices, modelled)


def _events(raw: RawC3D) -> tuple[tuple[Event, ...], list[str]]:
    """The events that have a time, in order, and a sentence about those that have none."""
    times = raw.parameters.get("EVENT", {}).get("TIMES")
    if isinstance(times, np.ndarray) and times.shape == (2,):
        times = times[:, None]
    if not isinstance(times, np.ndarray) or times.ndim != 2 or len(times) != 2:
        return tuple(Event(label, seconds) for label, seconds in raw.header_events), []
    columns = [raw.texts("EVENT", key) for key in ("LABELS", "CONTEXTS", "SUBJECTS", "DESCRIPTIONS")]

    def word(column: list[str], k: int) -> str:
        return column[k] if k < len(column) else ""

    found = [
        Event(word(columns[0], k), float(60 * minutes + seconds), *(word(c, k) for c in columns[1:]))
        for k, (minutes, seconds) in enumerate(times.T)
        if np.isfinite(minutes + seconds)
    ]
    used = int(max((*raw.numbers("EVENT", "USED"), 0.0)))
    said = [f"EVENT:USED is {used}, and {len(found)} events have times: those were read"] if used > len(found) else []
    return tuple(sorted(found, key=lambda e: e.time)), said


def _analog(raw: RawC3D, fps: float) -> Analog | None:
    channels = raw.analog.shape[1]
    if not channels or not len(raw.analog):
        return None
    labels, units = raw.texts("ANALOG", "LABELS")[:channels], raw.texts("ANALOG", "UNITS")[:channels]
    labels += [f"channel_{k + 1}" for k in range(len(labels), channels)]
    units += [""] * (channels - len(units))
    return Analog(tuple(labels), tuple(units), fps * raw.analog_per_frame, raw.analog)


def _force_platforms(raw: RawC3D, metres: float, turn: FloatArray) -> dict[str, Any]:
    """The group's parameters; corners and origins follow the points' unit, corners their axes as well."""
    group = raw.parameters.get("FORCE_PLATFORM", {})
    if raw.analog.size == 0 or not raw.numbers("FORCE_PLATFORM", "USED").any():
        return {}
    out: dict[str, Any] = {}
    for name, value in group.items():
        if isinstance(value, np.ndarray) and name in ("CORNERS", "ORIGIN"):
            value = value * metres * 1e3
            value = np.tensordot(turn, value, 1) if name == "CORNERS" and len(value) == 3 else value
        if isinstance(value, list) or value.size:
            whole = isinstance(value, np.ndarray) and name in ("USED", "TYPE", "ZERO", "CHANNEL")
            out[name] = value.astype(int) if whole else value
    return out


def _standard_deviation_mm(covariance_world: FloatArray) -> FloatArray:
    """(T, J): root of the mean variance a coordinate, in the range the format has; 0 where it is unknown."""
    variance = np.trace(np.asarray(covariance_world, dtype=np.float64), axis1=-2, axis2=-1) / 3.0
    known = np.isfinite(variance) & (variance > 0)
    return np.where(known, np.clip(np.rint(np.sqrt(np.where(known, variance, 0.0)) * 1e3), 1, 127), 0.0)
