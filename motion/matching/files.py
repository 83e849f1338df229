"""`.match` files: a database of motion matching, as NumPy's `.npz`."""

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.root_path import GroundPath
from muybridge.motion.matching.database import MatchDatabase
from muybridge.motion.matching.features import FeatureOptions
from muybridge.npz import LIMIT, load_npz

SUFFIX = ".match"
_KIND, _VERSION = "muybridge match", 1
_WHAT = "a .match"
_ARRAYS = ("header", "offsets", "tips", "lower", "upper", "starts", "root_positions_world", "quat_wxyz", "places",
           "yaw", "features", "ignored")  # fmt: skip


def write_database(path: Path, database: MatchDatabase) -> None:
    """Write a `.match` file: rotations and features in single precision, places in double.

    Raises:
        OutputError: it cannot be written.
    """
    motion, skeleton = database.motion, database.motion.skeleton
    header = {
        "kind": _KIND,
        "version": _VERSION,
        "fps": motion.fps,
        "clips": list(database.names),
        "joints": list(skeleton.names),
        "parents": list(skeleton.parents),
        "twist_axis": list(skeleton.twist_axis),
        "sliding": list(skeleton.sliding),
        "roles": dict(database.roles),
        "options": asdict(database.options),
    }
    arrays: dict[str, NDArray[Any]] = {
        "header": np.frombuffer(json.dumps(header).encode(), np.uint8),
        "offsets": skeleton.offsets,
        "tips": skeleton.tips,
        "lower": skeleton.lower,
        "upper": skeleton.upper,
        "starts": database.starts.astype(np.int64),
        "root_positions_world": motion.root_positions_world,
        "quat_wxyz": motion.quat_wxyz.astype(np.float32),
        "places": database.path.places,
        "yaw": database.path.yaw,
        "features": database.features.astype(np.float32),
        "ignored": database.ignored,
    }
    if skeleton.axes is not None:
        arrays["axes"] = skeleton.axes
    if motion.translations is not None:
        arrays["translations"] = motion.translations
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_database(path: Path) -> MatchDatabase:
    """Read a `.match` file.

    Raises:
        FormatError: it cannot be read, is damaged, is no `.match` file or one of a later version.
    """
    path = Path(path)
    arrays = load_npz(path, what=_WHAT, limit=min(LIMIT, 2**31))
    with parsing(path, FormatError, _WHAT):
        missing = [name for name in _ARRAYS if name not in arrays]
        if missing:
            raise FormatError(f"{path}: no .match file: it has no array {missing[0]!r}")
        header = json.loads(bytes(arrays["header"]))
        if header.get("kind") != _KIND:
            raise FormatError(f"{path}: no .match file by what it says of itself")
        if header["version"] != _VERSION:
            raise FormatError(f"{path}: is of version {header['version']}, and {_VERSION} can be read; build it again")
        database = _database(header, arrays)
        _check(path, database)
    return database


def _database(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> MatchDatabase:
    skeleton = Skeleton(
        tuple(header["joints"]), tuple(header["parents"]), arrays["offsets"], arrays["tips"],
        tuple(header["twist_axis"]), arrays["lower"], arrays["upper"], arrays.get("axes"), tuple(header["sliding"]),
    )  # fmt: skip
    known = {f.name for f in fields(FeatureOptions)}
    options = {name: value for name, value in header["options"].items() if name in known}
    options["horizons"] = tuple(options["horizons"])
    quat = arrays["quat_wxyz"].astype(np.float64)
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    motion = Motion(skeleton, float(header["fps"]), arrays["root_positions_world"], continuous_quat(quat),
                    arrays.get("translations"))  # fmt: skip
    path = GroundPath(arrays["places"], arrays["yaw"])
    roles = {str(role): int(joint) for role, joint in header["roles"].items()}
    return MatchDatabase(
        motion, tuple(header["clips"]), arrays["starts"].astype(np.intp), path, arrays["features"].astype(np.float64),
        arrays["ignored"], roles, FeatureOptions(**options),
    )  # fmt: skip


def _check(path: Path, database: MatchDatabase) -> None:
    """Refuse what does not fit together, or is not finite."""
    count, motion = len(database), database.motion
    shapes = {
        "features": (database.features.shape, (count, database.options.width)),
        "places": (database.path.places.shape, (count, 2)),
        "yaw": (database.path.yaw.shape, (count,)),
        "ignored": (database.ignored.shape, (count,)),
        "starts": (database.starts.shape, (len(database.names) + 1,)),
    }
    for name, (shape, wanted) in shapes.items():
        if shape != wanted:
            raise FormatError(f"{path}: the array {name!r} has the shape {shape}, and {wanted} is needed")
    if database.ignored.dtype != np.bool_:
        raise FormatError(f"{path}: the array 'ignored' is not of true and false")
    edges = database.starts
    if not count or edges[0] != 0 or edges[-1] != count or (np.diff(edges) <= 0).any():
        raise FormatError(f"{path}: its clips do not fill its {count} frames")
    if not 0 < motion.fps < np.inf:
        raise FormatError(f"{path}: has a frame rate of {motion.fps:g}; it must be above zero")
    values = [motion.root_positions_world, motion.quat_wxyz, database.features, database.path.places, database.path.yaw,
              motion.skeleton.offsets]  # fmt: skip
    values += [] if motion.translations is None else [motion.translations]
    if not all(np.isfinite(v).all() for v in values):
        raise FormatError(f"{path}: holds values that are not numbers (NaN)")
    if any(not 0 <= joint < len(motion.skeleton) for joint in database.roles.values()):
        raise FormatError(f"{path}: gives a role to a joint that does not exist")
    if not database.searchable.any():
        raise FormatError(f"{path}: holds no frame that may be found")
