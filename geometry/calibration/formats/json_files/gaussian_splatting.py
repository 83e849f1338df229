"""`cameras.json` of 3D Gaussian splatting: a list of images with position, rotation, focal lengths and size.

`position` is the camera's centre and `rotation` (3x3) camera to world, both in the world of the COLMAP model from which
the scene was made. The principal point is the image's middle, and images are undistorted.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

from muybridge.geometry.calibration.formats.common import (
    ARBITRARY_SCALE,
    Calibration,
    Malformed,
    about,
    make_camera,
    make_group,
    number,
    numbers,
    parse_json,
    pixel_count,
    pose_from,
    rotation_from,
    table_with,
)
from muybridge.geometry.cameras.camera import Camera

_FIELDS = ("width", "height", "position", "rotation", "fx", "fy")


def read_gaussian_splatting(text: str) -> Calibration:
    """Read the cameras, named after their images.

    Raises:
        Malformed: what is wrong, with image and field.
    """
    data = parse_json(text)
    if not isinstance(data, list) or not data:
        raise Malformed("it is no list of images")
    cameras = []
    for position, table in enumerate(data):
        name = str(table.get("img_name", position)) if isinstance(table, dict) else str(position)
        with about(f"image {name}"):
            cameras.append(_camera(PurePosixPath(name.replace("\\", "/")).stem or name, table))
    return Calibration(make_group(cameras), "Gaussian splatting JSON", (ARBITRARY_SCALE,))


def _camera(name: str, table: Any) -> Camera:
    table = table_with(table, _FIELDS)
    width, height = (pixel_count(table[field], field) for field in _FIELDS[:2])
    fx, fy = (number(table[field], field) for field in _FIELDS[4:])
    rotation = rotation_from(numbers(table["rotation"], "rotation", (9,)), "rotation").T
    center = numbers(table["position"], "position", (3,))
    lens = "PINHOLE", (fx, fy, (width - 1) / 2, (height - 1) / 2)
    return make_camera(name, lens, (width, height), pose_from(rotation, -rotation @ center))
