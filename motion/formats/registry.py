"""All formats by suffix: one function that reads any of them, one that writes any of them.

A file holds points or a motion. A motion can be written as points (the positions of its joints, by forward kinematics);
points become a motion only by fitting a body. A format is one row of `FORMATS`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.read import read_gltf_take
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.points.c3d import read_c3d_take, write_c3d
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.points.csv import read_csv_from, write_csv
from muybridge.motion.formats.points.npz import read_npz_from, write_npz
from muybridge.motion.formats.points.parquet import read_parquet_from, write_parquet
from muybridge.motion.formats.points.trc import read_trc_from, write_trc
from muybridge.motion.formats.points.world import PointsOfFile
from muybridge.motion.formats.skeletal.amc import CMU_FPS, read_amc, write_amc
from muybridge.motion.formats.skeletal.bvh import read_bvh_take, write_bvh
from muybridge.motion.formats.skeletal.mot import write_mot
from muybridge.motion.formats.skeletal.rigid import check_room
from muybridge.motion.formats.skeletal.storage import read_storage
from muybridge.motion.formats.skeletal.usd import write_usda
from muybridge.motion.take import Take

BvhUnits = Literal["m", "cm"]


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not state, or states wrongly.

    Attributes:
        units: of lengths: m, cm, mm, in; for BVH also cmu (0.0254 / 0.45 m).
        up: y or z, of points.
        fps: frames per second; MuybridgeError unless above zero.
        asf: the skeleton of an AMC.
        clip: name or number of the animation, of a file that holds several; None is the first.
        limit: bytes that the arrays of an NPZ may take; None for the limits of `muybridge.npz.load_npz`.
    """

    units: str | None = None
    up: str | None = None
    fps: float | None = None
    asf: Path | None = None
    clip: Clip = None
    limit: int | None = None

    def __post_init__(self) -> None:
        check_fps(self.fps)


@dataclass(frozen=True)
class Format:
    """One format of files.

    Attributes:
        suffix: in small letters, with its dot.
        options: names of ReadOptions that its files leave open.
        read: from a path; None where it is written only.
        write_points: to a path; None where it holds no points or is read only.
        write_motion: to a path, with the units of a BVH; None where it holds no motion or is read only.
        holds_motion: whether files that are read may hold a motion.
    """

    suffix: str
    options: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Take] | None = None
    write_points: Callable[[Path, Points3D], object] | None = None
    write_motion: Callable[[Path, Motion, BvhUnits], object] | None = None
    holds_motion: bool = False


def _timed(read: PointsOfFile, options: ReadOptions) -> Take:
    """Points and when they begin, which their file states wrongly where it states the frame rate wrongly."""
    return Take(points=read.points, start=read.start if options.fps is None else 0.0, notices=read.notices)


def _read_c3d(path: Path, options: ReadOptions) -> Take:
    take = read_c3d_take(path, options.units, options.up, options.fps)
    return Take(points=take.points, c3d=take, start=(take.first_frame - 1) / take.points.fps,
                notices=take.notices)  # fmt: skip


def _read_table(path: Path, options: ReadOptions) -> Take:
    return _timed(read_csv_from(path, options.fps, options.units, options.up), options)


def _read_fbx(path: Path, options: ReadOptions) -> Take:
    motion, notices = read_fbx(path, options.clip)
    return Take(motion=motion, notices=notices)


def _read_gltf(path: Path, options: ReadOptions) -> Take:
    return read_gltf_take(path, options.clip)


_POINTS = ("units", "up", "fps")
_SCENE = ("fps", "clip")
FORMATS: dict[str, Format] = {f.suffix: f for f in (
    Format(".trc", _POINTS, lambda p, o: _timed(read_trc_from(p, o.units, o.up, o.fps), o), write_trc),
    Format(".c3d", _POINTS, _read_c3d, write_c3d),
    Format(".csv", _POINTS, _read_table, write_csv),
    Format(".tsv", _POINTS, _read_table),
    Format(".txt", _POINTS, _read_table),
    Format(".parquet", _POINTS, lambda p, o: _timed(read_parquet_from(p, o.fps, o.units, o.up), o), write_parquet),
    Format(".npz", (*_POINTS, "limit"),
           lambda p, o: _timed(read_npz_from(p, o.fps, o.units, o.up or "z", o.limit), o), write_npz),
    Format(".bvh", ("units", "fps"), lambda p, o: read_bvh_take(p, o.units), write_motion=write_bvh,
           holds_motion=True),
    Format(".amc", ("asf", "fps"), lambda p, o: Take(motion=read_amc(p, o.asf, o.fps or CMU_FPS)),
           write_motion=lambda p, m, _: write_amc(p, m), holds_motion=True),
    Format(".glb", _SCENE, _read_gltf, write_motion=lambda p, m, _: write_glb(p, m), holds_motion=True),
    Format(".gltf", _SCENE, _read_gltf, holds_motion=True),
    Format(".vrm", _SCENE, _read_gltf, holds_motion=True),
    Format(".vrma", _SCENE, _read_gltf, holds_motion=True),
    Format(".fbx", _SCENE, _read_fbx, write_motion=lambda p, m, _: write_fbx(p, m), holds_motion=True),
    Format(".mot", (), lambda p, o: read_storage(p), write_motion=lambda p, m, _: write_mot(p, m),
           holds_motion=True),
    Format(".sto", (), lambda p, o: read_storage(p), holds_motion=True),
    Format(".usda", (), write_motion=lambda p, m, _: write_usda(p, m)),
)}  # fmt: skip


def readable() -> tuple[str, ...]:
    """Suffixes that can be read."""
    return tuple(s for s, f in FORMATS.items() if f.read is not None)


def motion_formats() -> tuple[str, ...]:
    """Suffixes of files that can be read and may hold a motion."""
    return tuple(s for s, f in FORMATS.items() if f.read is not None and f.holds_motion)


def writable() -> tuple[str, ...]:
    """Suffixes that can be written: points, then motion."""
    points = tuple(s for s, f in FORMATS.items() if f.write_points is not None)
    return (*points, *(s for s, f in FORMATS.items() if f.write_motion is not None))


def can_use(path: Path, option: str) -> bool:
    """Whether an option of ReadOptions means anything for a file of this suffix."""
    known = FORMATS.get(path.suffix.lower())
    return option in (known.options if known is not None else ("fps",))


def check_writable(path: Path) -> None:
    """FormatError where the suffix is of no format that can be written."""
    suffix = path.suffix.lower()
    if suffix not in writable():
        hint = "; write .glb" if suffix in (".gltf", ".vrm", ".vrma") else ""
        raise FormatError(f"{path}: {suffix or 'a name without suffix'} cannot be written: choose one of "
                          f"{', '.join(writable())}{hint}")  # fmt: skip


def read_file(path: Path, options: ReadOptions | None = None) -> Take:
    """Read a file of any known format.

    Raises:
        FormatError: malformed, or of no format that can be read.
    """
    path, options = Path(path), options or ReadOptions()
    suffix = path.suffix.lower()
    if suffix == ".asf":
        raise FormatError(f"{path}: is a skeleton without motion; name the .amc file that goes with it")
    if suffix not in readable():
        raise FormatError(f"{path}: cannot be read by its suffix {suffix!r}: known are {', '.join(readable())}")
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing one")
    for name, value in vars(options).items():
        if value is not None and not can_use(path, name):
            raise FormatError(f"{path}: {name}={value} does not apply to {suffix} files", remedy="option_unused",
                              option=name)  # fmt: skip
    read = FORMATS[suffix].read
    assert read is not None
    take = read(path, options)
    if take.motion is not None and options.fps is not None:
        take = replace(take, motion=replace(take.motion, fps=options.fps))
    if take.motion is not None:
        check_room(path, take.motion)
    if not np.isfinite(take.positions.points_world).any():
        raise FormatError(f"{path}: every point of it is missing; there is nothing to work with")
    return take


def write_file(path: Path, take: Take, bvh_units: BvhUnits = "m") -> None:
    """Write a take to a file of any known format.

    Args:
        path: its suffix states the format.
        take: points or a motion.
        bvh_units: what one unit is, in a BVH.

    Raises:
        FormatError: the suffix is of no such format, the take has no motion and the format needs one, or the format
            cannot hold the motion.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    check_writable(path)
    suffix = path.suffix.lower()
    chosen = FORMATS[suffix]
    if chosen.write_points is not None:
        if suffix == ".c3d" and take.c3d is not None and take.points is not None:
            write_c3d(path, replace(take.c3d, points=take.points))
        else:
            chosen.write_points(path, take.positions)
    elif take.motion is None:
        raise FormatError(f"{path}: points have no joint rotations, which {suffix} holds", remedy="fit_points")
    elif suffix == ".glb":
        write_glb(path, take.motion, take.keys)
    else:
        assert chosen.write_motion is not None
        chosen.write_motion(path, take.motion, bvh_units)
