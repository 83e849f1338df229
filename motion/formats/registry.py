"""All formats by suffix: one function that reads any of them, one that writes any of them.

A file holds points or a motion. A motion can be written as points (its joints' places, by forward kinematics); points
become a motion only by fitting a body, which is `muybridge solve`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.write import read_gltf, write_glb
from muybridge.motion.formats.points.c3d import read_c3d_take, write_c3d
from muybridge.motion.formats.points.common import METRES_OF_UNIT, check_fps
from muybridge.motion.formats.points.csv import read_csv_from, write_csv
from muybridge.motion.formats.points.npz import read_npz, write_npz
from muybridge.motion.formats.points.parquet import read_parquet_from, write_parquet
from muybridge.motion.formats.points.trc import read_trc_from, write_trc
from muybridge.motion.formats.skeletal.asf_amc import CMU_FPS, read_amc, write_amc
from muybridge.motion.formats.skeletal.bone_meshes import rest_positions
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from muybridge.motion.formats.skeletal.mot import write_mot
from muybridge.motion.formats.skeletal.usd import write_usda
from muybridge.motion.take import Take

METRES_OF_LENGTH = METRES_OF_UNIT | {"cmu": 0.0254 / 0.45}
# Units a figure is tall, and what a unit then is; between these nothing is guessed.
_TALL = ((0.4, 3.0, "m"), (20.0, 40.0, "cmu"), (100.0, 300.0, "cm"), (1000.0, 3000.0, "mm"))


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not say, or says wrongly.

    Attributes:
        units: of lengths: m, cm, mm, in; for BVH also cmu (0.0254 / 0.45 m).
        up: y or z, of points.
        fps: frames a second; MuybridgeError unless above zero.
        asf: the skeleton of an AMC.
    """

    units: str | None = None
    up: str | None = None
    fps: float | None = None
    asf: Path | None = None

    def __post_init__(self) -> None:
        check_fps(self.fps)


_READ: dict[str, Callable[[Path, ReadOptions], Take]] = {
    ".trc": lambda p, o: _timed(read_trc_from(p, o.units, o.up or "y", o.fps), o),
    ".c3d": lambda p, o: _read_c3d(p, o),
    ".csv": lambda p, o: _timed(read_csv_from(p, o.fps, o.units, o.up or "z"), o),
    ".tsv": lambda p, o: _timed(read_csv_from(p, o.fps, o.units, o.up or "z"), o),
    ".parquet": lambda p, o: _timed(read_parquet_from(p, o.fps, o.units, o.up), o),
    ".npz": lambda p, o: Take(points=read_npz(p, o.fps, o.units, o.up or "z")),
    ".bvh": lambda p, o: _read_bvh(p, o),
    ".amc": lambda p, o: Take(motion=read_amc(p, o.asf, o.fps or CMU_FPS)),
    ".glb": lambda p, o: Take(motion=read_gltf(p)),
    ".gltf": lambda p, o: Take(motion=read_gltf(p)),
    ".fbx": lambda p, o: _read_fbx(p),
}
_OPTIONS_OF_POINTS = ("units", "up", "fps")
_OPTIONS_OF_MOTION = {".bvh": ("units", "fps"), ".amc": ("asf", "fps")}
_POINTS = (".trc", ".c3d", ".csv", ".tsv", ".parquet", ".npz")
_WRITE_POINTS: dict[str, Callable[[Path, Points3D], object]] = {
    ".trc": write_trc,
    ".c3d": write_c3d,
    ".csv": write_csv,
    ".parquet": write_parquet,
    ".npz": write_npz,
}
_WRITE_MOTION: dict[str, Callable[[Path, Motion], object]] = {
    ".bvh": write_bvh,
    ".amc": write_amc,
    ".glb": write_glb,
    ".mot": write_mot,
    ".usda": write_usda,
    ".fbx": write_fbx,
}


def readable() -> tuple[str, ...]:
    """Suffixes that can be read."""
    return tuple(_READ)


def writable() -> tuple[str, ...]:
    """Suffixes that can be written."""
    return (*_WRITE_POINTS, *_WRITE_MOTION)


def can_use(path: Path, option: str) -> bool:
    """Whether an option of ReadOptions means anything for a file of this suffix."""
    suffix = path.suffix.lower()
    return option in (_OPTIONS_OF_POINTS if suffix in _POINTS else _OPTIONS_OF_MOTION.get(suffix, ("fps",)))


def check_writable(path: Path) -> None:
    """FormatError where the suffix is of no format that can be written."""
    suffix = path.suffix.lower()
    if suffix not in writable():
        hint = "; write .glb" if suffix == ".gltf" else ""
        raise FormatError(f"{path}: {suffix or 'a name without suffix'} cannot be written: choose one of "
                          f"{', '.join(writable())}{hint}")  # fmt: skip


def read_file(path: Path, options: ReadOptions | None = None) -> Take:
    """Read a file of any format we know.

    Raises:
        FormatError: malformed, or of no format that can be read.
    """
    path, options = Path(path), options or ReadOptions()
    suffix = path.suffix.lower()
    if suffix == ".asf":
        raise FormatError(f"{path}: is a skeleton without motion; name the .amc file that goes with it")
    if suffix not in _READ:
        raise FormatError(f"{path}: cannot be read by its suffix {suffix!r}: known are {', '.join(_READ)}")
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing one")
    for name, value in vars(options).items():
        if value is not None and not can_use(path, name):
            raise FormatError(f"{path}: --{name} {value} is nothing that {suffix} leaves open: leave it out")
    take = _READ[suffix](path, options)
    if take.motion is not None and options.fps is not None:
        take = replace(take, motion=replace(take.motion, fps=options.fps))
    if not np.isfinite(take.positions.points_world).any():
        raise FormatError(f"{path}: every point of it is missing; there is nothing to work with")
    return take


def write_file(path: Path, take: Take, bvh_units: Literal["m", "cm"] = "m") -> None:
    """Write a take to a file of any format we know.

    Args:
        path: its suffix says the format.
        take: points or a motion.
        bvh_units: what one unit is, in a BVH.

    Raises:
        FormatError: the suffix is of no such format, or the take has no motion and the format needs one.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    check_writable(path)
    suffix = path.suffix.lower()
    if suffix in _WRITE_POINTS:
        if suffix == ".c3d" and take.c3d is not None and take.points is not None:
            write_c3d(path, replace(take.c3d, points=take.points))
        else:
            _WRITE_POINTS[suffix](path, take.positions)
    elif take.motion is None:
        raise FormatError(
            f"{path}: points have no joints that turn, which {suffix} holds; fit a body to them with "
            "`muybridge solve POINTS --out FOLDER`, which writes it"
        )
    elif suffix == ".bvh":
        write_bvh(path, take.motion, bvh_units)
    else:
        _WRITE_MOTION[suffix](path, take.motion)


def _read_c3d(path: Path, options: ReadOptions) -> Take:
    take = read_c3d_take(path, options.units, options.up, options.fps)
    return Take(points=take.points, c3d=take, start=(take.first_frame - 1) / take.points.fps)


def _timed(read: tuple[Points3D, float], options: ReadOptions) -> Take:
    """Points and when they begin, which their file says wrongly where it says the frame rate wrongly."""
    return Take(points=read[0], start=read[1] if options.fps is None else 0.0)


def _read_fbx(path: Path) -> Take:
    motion, notices = read_fbx(path)
    return Take(motion=motion, notices=notices)


def _read_bvh(path: Path, options: ReadOptions) -> Take:
    if options.units is not None:
        if options.units not in METRES_OF_LENGTH:
            raise FormatError(f"{path}: {options.units!r} is no unit; valid are {', '.join(METRES_OF_LENGTH)}")
        return Take(motion=read_bvh(path, METRES_OF_LENGTH[options.units]))
    motion = read_bvh(path)
    rest = rest_positions(motion.skeleton)
    ends = np.concatenate([rest, (rest + motion.skeleton.tips)[np.isfinite(motion.skeleton.tips).all(axis=1)]])
    tall = float(np.ptp(ends, axis=0).max())
    for low, high, unit in _TALL:
        if low <= tall <= high:
            if unit == "m":
                return Take(motion=motion)
            metres = METRES_OF_LENGTH[unit]
            said = (f"{path.name}: its figure is {tall:.4g} units tall, so a unit is taken to be {metres:.4g} m; "
                    "--units says otherwise")  # fmt: skip
            return Take(motion=read_bvh(path, metres), notices=(said,))
    if len(motion.skeleton) < 8:  # no figure of a person: nothing to go by
        return Take(motion=motion)
    raise FormatError(
        f"{path}: its figure is {tall:.4g} units tall, and BVH does not say what a unit is; say it with --units, one "
        f"of {', '.join(METRES_OF_LENGTH)}"
    )
