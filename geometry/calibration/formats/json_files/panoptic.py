"""CMU Panoptic's `calibration_*.json`: a list `cameras` with name, resolution, K, distCoef, R and t.

R and t map world to camera, in centimetres; the world's Y axis points down and is rotated to Z up.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    make_camera,
    make_group,
    numbers,
    opencv_lens,
    parse_json,
    pixel_count,
    pose_from,
    rotation_from,
    table_with,
)
from muybridge.geometry.cameras.camera import Camera

_M_PER_CM = 0.01
_FIELDS = ("resolution", "K", "R", "t")
# From a world with Z up to Panoptic's: x = x, y = -z, z = y.
_PANOPTIC_FROM_ZUP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def read_panoptic(text: str) -> Calibration:
    """Read the cameras.

    Raises:
        Malformed: what is wrong, with camera and field.
    """
    data = parse_json(text)
    tables = data.get("cameras") if isinstance(data, dict) else None
    if not isinstance(tables, list) or not tables:
        raise Malformed("it has no list `cameras`")
    cameras = []
    for position, table in enumerate(tables, start=1):
        name = str(table.get("name", f"cam{position:02d}")) if isinstance(table, dict) else f"cam{position:02d}"
        with about(f"camera {name}"):
            cameras.append(_camera(name, table))
    return Calibration(make_group(cameras), "Panoptic JSON")


def _camera(name: str, table: Any) -> Camera:
    table = table_with(table, _FIELDS)
    width, height = numbers(table["resolution"], "resolution", (2,)).tolist()
    lens = opencv_lens(numbers(table["K"], "K", (9,)), numbers(table.get("distCoef", []), "distCoef"), fisheye=False)
    rotation = rotation_from(numbers(table["R"], "R", (9,)), "R") @ _PANOPTIC_FROM_ZUP
    size = pixel_count(width, "the width in resolution"), pixel_count(height, "the height in resolution")
    return make_camera(name, lens, size, pose_from(rotation, numbers(table["t"], "t", (3,)) * _M_PER_CM))
