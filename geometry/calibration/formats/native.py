"""Muybridge's own calibration file: readable TOML with a version number; floats are stored exactly.

```toml
muybridge_calibration = 1

[[cameras]]
name = "cam01"
model = "OPENCV"
width = 1088
height = 1920
params = [1681.2, 1681.1, 532.9, 948.1, -0.046, 0.14, 0.0006, 0.0007]
cam_from_world = [
    [0.55, 0.80, 0.21, 0.32],
    [0.43, -0.06, -0.90, 0.96],
    [-0.71, 0.59, -0.38, 2.89],
]
```
"""

from __future__ import annotations

from typing import Any

import tomli_w

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    make_camera,
    make_group,
    numbers,
    parse_toml,
    pixel_count,
    table_with,
)
from muybridge.geometry.cameras import _pycolmap as pycolmap
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

VERSION = 1
_FIELDS = ("name", "model", "width", "height", "params", "cam_from_world")
_HEADER = """\
# Cameras of a motion capture. Metres; world with Z up; camera axes x right, y down, z forward.
# Pixel (0, 0) is the centre of the top-left pixel. cam_from_world = rotation | translation.
"""


def read_native(text: str) -> Calibration:
    """Read the cameras of our own TOML.

    Raises:
        Malformed: what is wrong, with line or camera and field.
    """
    data = parse_toml(text)
    version = data.get("muybridge_calibration")
    if version != VERSION or isinstance(version, bool):
        raise Malformed(
            f"muybridge_calibration is {version!r}; this release reads version {VERSION}: "
            "write the file again, or upgrade muybridge"
        )
    tables = data.get("cameras")
    if not isinstance(tables, list) or not tables:
        raise Malformed("it has no [[cameras]]")
    return Calibration(make_group([_camera(k, t) for k, t in enumerate(tables, start=1)]), "Muybridge TOML")


def _camera(position: int, table: Any) -> Camera:
    if not isinstance(table, dict):
        raise Malformed(f"camera {position} is not a table: write [[cameras]] before each")
    name = table.get("name")
    label = f"camera {name}" if isinstance(name, str) and name else f"camera {position}"
    with about(label):
        table_with(table, _FIELDS)
        unknown = [field for field in table if field not in _FIELDS]
        if unknown:
            raise Malformed(f"unknown field {', '.join(unknown)}; valid: {', '.join(_FIELDS)}")
        if not isinstance(name, str) or not isinstance(table["model"], str):
            raise Malformed("name and model must be strings")
        size = pixel_count(table["width"], "width"), pixel_count(table["height"], "height")
        params = tuple(numbers(table["params"], "params").tolist())
        pose = numbers(table["cam_from_world"], "cam_from_world", (12,)).reshape(3, 4)
        return make_camera(name, (table["model"], params), size, pose)


def native_text(cameras: CameraGroup) -> str:
    """The cameras as our own TOML. Floats have the shortest form that reads back to the same bits.

    Arrays are formatted here and not by `tomli_w`, which writes one number per line and no comments.
    """
    blocks = [_HEADER + tomli_w.dumps({"muybridge_calibration": VERSION})]
    for camera in cameras:
        order = pycolmap.Camera.create_from_model_name(0, camera.model, 1.0, 1, 1).params_info
        rows = "".join(f"    [{_floats(row)}],\n" for row in camera.cam_from_world.tolist())
        scalars = {"name": camera.name, "model": camera.model, "width": camera.width, "height": camera.height}
        blocks.append(
            f"[[cameras]]\n{tomli_w.dumps(scalars)}"
            f"params = [{_floats(camera.params)}]  # {order}\n"
            f"cam_from_world = [\n{rows}]\n"
        )
    return "\n".join(blocks)


def _floats(values: Any) -> str:
    return ", ".join(repr(float(v)) for v in values)
