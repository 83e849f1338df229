"""From the coordinates of any file of points to metres with Z up: the checks that all formats share.

Whatever reads a format gives `Trajectories`; `points_of_file` turns them into points. What is missing becomes NaN, and
what cannot be right is refused: coordinates beyond any room, and a person of no person's size.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.motion.formats.points.common import METRES_OF_UNIT, UNIT_NAMES, UP_PERMUTATION, check_unit, check_up
from muybridge.motion.formats.points.person import implausible_stature

# Metres from the origin: no room is so large, and no lab has its origin so far away.
FARTHEST = 1000.0
# Where the farthest coordinate is so many times the usual one, it is damaged; else the unit is another.
_OUTLIER = 100.0
# Metres that points of people have as coordinates.
_USUAL = 1.5
# Metres a second: what moves through the origin no faster was measured there.
_THROUGH_ORIGIN = 3.0
# Frames that are converted at once, so that a long file needs no second copy.
_CHUNK = 4096
_NAMED = 4


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Points as a file has them.

    Attributes:
        names: (K,) what the file calls them.
        xyz: (T, K, 3) in the file's unit and axes, NaN where missing.
        fps: frames per second; NaN where the file does not state them.
        unit: m, cm, mm or in; "" where the file does not state it.
        up: the axis that is up, y or z, by the file or by what its format usually has.
        start: seconds of the recording at which the first frame is.
        notices: what was assumed or left out in reading, one sentence each.
        usual_unit: what files of this program mostly have, where they do not state the unit.
    """

    names: tuple[str, ...]
    xyz: FloatArray
    fps: float
    unit: str = ""
    up: str = "z"
    start: float = 0.0
    notices: tuple[str, ...] = ()
    usual_unit: str = ""


@dataclass(frozen=True, eq=False)
class PointsOfFile:
    """Points of a file, metres, Z up.

    Attributes:
        points: positions only, so covariance is NaN and there are no cameras.
        start: seconds of the recording at which the first frame is.
        notices: what was assumed or left out in reading, one sentence each.
    """

    points: Points3D
    start: float = 0.0
    notices: tuple[str, ...] = ()


def points_of_file(
    path: Path, found: Trajectories, kind: str, unit: str | None = None, up: str | None = None, fps: float | None = None
) -> PointsOfFile:
    """Points in metres, Z up.

    Args:
        path: for messages.
        found: what the file holds; its coordinates are overwritten.
        kind: name of the landmark set, where the labels are not those of BODY23 in its order.
        unit: of lengths, overriding the file.
        up: y or z, overriding the file.
        fps: frames per second, overriding the file.

    Raises:
        FormatError: there is no frame rate, a coordinate is beyond any room, or a person has no person's size; the
            message has the likely unit.
    """
    rate = fps or found.fps
    if np.isnan(rate):
        raise FormatError(f"{path}: does not state its frames per second", remedy="fps_unstated")
    if not (0 < rate < np.inf and np.isfinite(found.start)):
        raise FormatError(f"{path}: states {rate:g} frames per second from {found.start:g} s on; the file is damaged, "
                          "export it again")  # fmt: skip
    names, notices = unique_names(found.names)
    word, assumed = (unit, []) if unit else stated_unit(found)
    notices += assumed
    metres = METRES_OF_UNIT[check_unit(path, word or "m", "the unit")]
    turn = UP_PERMUTATION[check_up(up or found.up)]
    notices += take_out_zeros(found.names, found.xyz, metres * rate)
    xyz = in_world(found.xyz, metres, turn)
    notices += _check_size(path, names, xyz, metres, unit is not None)
    landmarks = BODY23 if names == BODY23.names else LandmarkSet(kind, names, ())
    t, j = xyz.shape[:2]
    points = Points3D(
        landmarks=landmarks,
        points_world=xyz,
        covariance_world=np.broadcast_to(np.float64(np.nan), (t, j, 3, 3)),
        residual_px=np.empty((0, t, j)),
        inlier=np.empty((0, t, j), dtype=np.bool_),
        fps=rate,
    )
    return PointsOfFile(points, found.start, (*found.notices, *notices))


def stated_unit(found: Trajectories) -> tuple[str, list[str]]:
    """The unit by the file or its program, "" where neither tells, and a sentence where the program decided."""
    if found.unit or not found.usual_unit:
        return found.unit, []
    return found.usual_unit, [f"the file does not state its unit: {UNIT_NAMES[found.usual_unit]} were assumed"]


def unique_names(names: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
    """Names that are there once: the second of twins gets `_2` and so on; and a sentence about them, if any."""
    taken, out, renamed = set(names), [], []
    seen: set[str] = set()
    for name in names:
        unique, k = name, 2
        if name in seen:
            while unique in taken:
                unique, k = f"{name}_{k}", k + 1
            taken.add(unique)
            renamed.append(f"{unique} for the next {name}")
        seen.add(name)
        out.append(unique)
    said = [f"names that appear more than once were made unique: {_some(renamed)}"] if renamed else []
    return tuple(out), said


def _some(words: Sequence[str]) -> str:
    more = len(words) - _NAMED
    return ", ".join(words[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def take_out_zeros(names: Sequence[str], xyz: FloatArray, per_frame: float) -> list[str]:
    """Samples of exactly 0, 0, 0 become gaps where the point is elsewhere in other frames, as many programs write them.

    Where a point comes to the origin and leaves it at the speed of a movement it was there: many figures start there.

    Args:
        names: (K,) for the sentence.
        xyz: (T, K, 3) overwritten.
        per_frame: metres a second, of a movement by one unit in one frame.

    Returns:
        A sentence about what was taken out, if anything.
    """
    count = 0
    of: list[str] = []
    zero = _chunked(xyz, lambda part: np.asarray((part == 0).all(axis=-1)))
    for k in np.nonzero(zero.any(axis=0) & ~zero.all(axis=0))[0].tolist():
        known = np.isfinite(xyz[:, k]).all(axis=-1)
        if not (known & ~zero[:, k]).any():
            continue
        # First frame of each run of zeros, and the frame after it.
        edges = np.flatnonzero(np.diff(np.concatenate([[0], zero[:, k].astype(np.int8), [0]])))
        for first, last in edges.reshape(-1, 2):
            beside = [xyz[t, k] for t in (first - 1, last) if 0 <= t < len(xyz)]
            if all(np.linalg.norm(p) * per_frame <= _THROUGH_ORIGIN for p in beside):
                continue
            xyz[first:last, k] = np.nan
            count += int(last - first)
            of += [names[k]] if names[k] not in of else []
    said = [f"{count} positions of exactly 0, 0, 0 were taken as missing ({_some(of)})"] if count else []
    still = [names[k] for k in np.nonzero(zero.all(axis=0))[0].tolist()] if len(xyz) > 1 else []
    return said + ([f"in all frames at exactly 0, 0, 0: {_some(still)}"] if still else [])


def in_world(xyz: FloatArray, metres: float, turn: Sequence[int]) -> FloatArray:
    """Coordinates (T, K, 3) of a file in metres, Z up, NaN where one is none; `xyz` is overwritten."""
    for at in range(0, len(xyz), _CHUNK):
        part = xyz[at : at + _CHUNK]
        part[~np.isfinite(part).all(axis=-1)] = np.nan
        part[:] = part[..., list(turn)] * metres
    return xyz


def _chunked(xyz: FloatArray, test: Callable[[FloatArray], BoolArray]) -> BoolArray:
    """(T, K) by a test of frames (N, K, 3), a part of the frames at a time."""
    parts = [test(xyz[at : at + _CHUNK]) for at in range(0, len(xyz), _CHUNK)]
    return np.concatenate(parts) if parts else np.zeros(xyz.shape[:2], dtype=np.bool_)


def check_reach(path: Path, names: Sequence[str], points: FloatArray, metres: float | None) -> None:
    """Check that no coordinate (T, K, 3), metres, is beyond any room.

    Args:
        path: for the message.
        names: (K,) for the message.
        points: the coordinates.
        metres: how long a unit of the file was taken to be; None where a wrong unit is not refused here.

    Raises:
        FormatError: one is, with its point and frame; or all are, with the likely unit.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        far = _chunked(points, lambda part: np.asarray((np.abs(part) > FARTHEST).any(axis=-1)))
        if not far.any():
            return
        size = np.abs(points[:: max(1, len(points) // 1000)]).max(axis=-1)
        usual = float(np.median(size[np.isfinite(size)])) if np.isfinite(size).any() else 0.0
        t, k = (int(i[0]) for i in np.nonzero(far))
        most = max(float(np.nanmax(np.abs(points[:, j]))) for j in np.nonzero(far.any(axis=0))[0])
    if most <= _OUTLIER * usual:
        if metres is None:
            return
        likely = min(METRES_OF_UNIT, key=lambda u: abs(np.log(usual / metres * METRES_OF_UNIT[u] / _USUAL)))
        message = f"{path}: its points lie {usual:,.4g} m from the origin"
        if METRES_OF_UNIT[likely] != metres:
            raise FormatError(f"{message}; the file's numbers are likely {UNIT_NAMES[likely]}",
                              remedy="unit_of_points", unit=likely)  # fmt: skip
        raise FormatError(f"{message}; no room is so large")
    count = f" and {far.sum() - 1} more" if far.sum() > 1 else ""
    raise FormatError(
        f"{path}: {names[k]!r} is {np.nanmax(np.abs(points[t, k])):.3g} m from the origin in frame {t + 1} of "
        f"{len(points)}{count}; the file is damaged, export it again"
    )


def _check_size(path: Path, names: tuple[str, ...], xyz: FloatArray, metres: float, stated: bool) -> list[str]:
    """Sentences about a person of an unusual size, whose unit a user insists on (`stated`).

    Raises:
        FormatError: a person has no person's size, or a coordinate is beyond any room.
    """
    others = {u: m / metres for u, m in METRES_OF_UNIT.items() if m != metres}
    found = implausible_stature(names, xyz, others)
    notices = []
    if found is not None and found[0] > 0:  # all at one place: zeros in all frames, which are noted as such
        tall, unit, absurd = found
        message = f"the person would be {tall:,.4g} m tall"
        likely = f"; the file's numbers are likely {UNIT_NAMES[unit]}" if unit else ""
        if unit and absurd and not stated:
            raise FormatError(f"{path}: {message}{likely}", remedy="unit_of_points", unit=unit)
        notices.append(message + likely)
    check_reach(path, names, xyz, metres)
    return notices
