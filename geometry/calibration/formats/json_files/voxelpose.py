"""The JSON of VoxelPose for Shelf, Campus and its own recordings: a map of cameras by number.

A camera has `R` (3x3, world to camera), `T` (the camera's **position**, in the file's unit, mostly millimetres), `fx`,
`fy`, `cx`, `cy`, radial terms `k` (k1, k2, k3) and tangential terms `p` (p1, p2). The image size is not in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    guessed_size,
    guessed_sizes_note,
    in_metres,
    make_camera,
    make_group,
    number,
    numbers,
    opencv_lens,
    parse_json,
    pixel_count,
    pose_from,
    rotation_from,
    table_with,
)
from muybridge.geometry.cameras.camera import Camera

_FIELDS = ("R", "T", "fx", "fy", "cx", "cy")


def read_voxelpose(text: str) -> Calibration:
    """Read the cameras; they are named ``cam`` and their number, or as in the file where that is a name.

    Raises:
        Malformed: what is wrong, with camera and field.
    """
    data = parse_json(text)
    tables = data if isinstance(data, dict) else {}
    found = {key: value for key, value in tables.items() if isinstance(value, dict) and "R" in value}
    if not found:
        raise Malformed(f"it has no map of cameras with {', '.join(_FIELDS)}")
    cameras: list[Camera] = []
    guessed: list[str] = []
    for key, table in found.items():
        name = f"cam{key}" if key.isdigit() else key
        with about(f"camera {name}"):
            cameras.append(_camera(name, table))
        if "width" not in table or "height" not in table:
            guessed.append(name)
    group, notes = in_metres(make_group(cameras), None, "divide T by 1000 in the file")
    notes = (*notes, *guessed_sizes_note([c for c in group if c.name in guessed]))
    return Calibration(group, "VoxelPose JSON", notes, guessed_sizes=frozenset(guessed))


def _camera(name: str, table: dict[str, Any]) -> Camera:
    table = table_with(table, _FIELDS)
    fx, fy, cx, cy = (number(table[field], field) for field in _FIELDS[2:])
    radial = numbers(table.get("k", [0.0] * 3), "k", (2, 3)).tolist()
    tangential = numbers(table.get("p", [0.0] * 2), "p", (2,)).tolist()
    matrix = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    lens = opencv_lens(matrix, np.array([*radial[:2], *tangential, *radial[2:]]), fisheye=False)
    rotation = rotation_from(numbers(table["R"], "R", (9,)), "R")
    center = numbers(table["T"], "T", (3,))
    size = guessed_size((cx, cy))
    if "width" in table and "height" in table:
        size = pixel_count(table["width"], "width"), pixel_count(table["height"], "height")
    return make_camera(name, lens, size, pose_from(rotation, -rotation @ center))
