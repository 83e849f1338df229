"""OpenSim's storage files, `.mot` and `.sto`, read as a motion or as points.

A table of joint angles moves a skeleton of usual proportions, since the file has no lengths of bones. A table of
vectors (`DataType=Vec3`) holds markers in ground, Y up. Such files also hold forces, states and results of analyses,
which are named and refused.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.motion.formats.points.world import Trajectories, points_of_file
from muybridge.motion.formats.skeletal.mot import StorageTable, coordinates_in, open_table, rows_of
from muybridge.motion.formats.skeletal.opensim import MODEL_COORDINATES, Coordinates, motion_of
from muybridge.motion.take import Take

_STATURE = 1.75
_UNEVEN = 1e-3  # share of a step by which steps of time may differ
# Of gait2354 and gait2392 knees bend to negative angles: by so much they do in no other model.
_BENT_BACK = np.radians(-30.0)
# What the columns of other tables look like, and what these hold.
_CONTENTS = (
    (r"/(value|speed|activation|fiber_length)$|\.(activation|fiber_length)$|_u$", "states of a simulation"),
    (r"(force|grf|torque|moment|cop|[_.]|\d)_?[vpm][xyz]$|_(force|moment|torque)$|^[fm][xyz]\d*$", "forces"),
    (r"marker_error|squared_error", "marker errors of inverse kinematics"),
    (r"_O?[XYZ]$|^state_\d+$", "positions or velocities of bodies"),
    (r"_(r[zxy]|t[xyz])$", "angles of a skeleton that the file does not describe"),
)


def read_storage(path: Path) -> Take:
    """Read joint angles or markers into metres, Z up.

    Args:
        path: a `.mot` or `.sto` file.

    Returns:
        A take of points, from a table of vectors. Otherwise of a motion of a skeleton 1.75 m tall, from coordinates
        under the names of OpenSim's gait and full-body models; with notices of what was assumed and left out.

    Raises:
        FormatError: malformed, or a table of something else, which the message names.
    """
    path = Path(path)
    with parsing(path, FormatError, "an OpenSim storage file"):
        table = open_table(path)
        if table.facts.get("datatype", "double") == "vec3":
            return _points(table)
        known = [n for n in table.names if n in MODEL_COORDINATES]
        if not any(n.startswith(("hip_flexion", "knee_angle", "arm_flex")) for n in known):
            raise FormatError(f"{path}: {_content(table)}; joint angles under OpenSim's names (hip_flexion_r, ...) and "
                              "markers (DataType=Vec3) are read")  # fmt: skip
        return _motion(table, coordinates_in(table))


def _content(table: StorageTable) -> str:
    """What the table holds, by its columns."""
    for pattern, what in _CONTENTS:
        matching = sum(bool(re.search(pattern, name)) for name in table.names)
        if 2 * matching >= len(table.names):
            return f"holds {what}"
    listed = ", ".join(table.names[:5]) + (", ..." if len(table.names) > 5 else "")
    return f"holds no joint angles of a known model but {listed[:200]}"


def _motion(table: StorageTable, found: Coordinates) -> Take:
    notices = [f"{table.path.name}: it has no lengths of bones; those of a person of {_STATURE:g} m are taken"]
    left = [n for n in found.names if n not in MODEL_COORDINATES]
    if left:
        notices.append(f"{table.path.name}: {', '.join(left[:8])}{', ...' if len(left) > 8 else ''} left out")
    knees = [i for i, n in enumerate(found.names) if n in ("knee_angle_r", "knee_angle_l")]
    values = found.values.copy()
    if knees and values[:, knees].min() < _BENT_BACK and values[:, knees].max() < -_BENT_BACK:
        values[:, knees] *= -1
        notices.append(f"{table.path.name}: knees bend to negative angles, as in gait2392, and are read so")
    _check_even(table, found.times)
    motion = motion_of(replace(found, values=values), BODY.skeleton(prior_shape(_STATURE)))
    return Take(motion=motion, notices=tuple(notices), start=float(found.times[0]))


def _check_even(table: StorageTable, times: FloatArray) -> float:
    """Frames per second; FormatError where the times are not even."""
    steps = np.diff(times)
    if not len(steps):
        raise FormatError(f"{table.path}: has a single row, so no frame rate; export a whole movement")
    if np.ptp(steps) > _UNEVEN * steps.mean():
        raise FormatError(f"{table.path}: its times are not even (steps of {steps.min():.4g} to {steps.max():.4g} s); "
                          "resample it before")  # fmt: skip
    return float(1 / steps.mean())


def _points(table: StorageTable) -> Take:
    rows = rows_of(table, 3)
    fps, xyz = _check_even(table, rows[:, 0]), rows[:, 1:].reshape(len(rows), -1, 3)
    unit = table.facts.get("units", "m")
    found = points_of_file(table.path, Trajectories(table.names, xyz, fps, unit, "y", float(rows[0, 0])), "sto")
    return Take(points=found.points, start=found.start, notices=found.notices)
