"""The TOML calibrations of Pose2Sim, Anipose (also FreeMoCap's) and Caliscope.

A camera's table has the same content in all of them: `size`, `matrix`, `distortions` (OpenCV's order), `rotation` (a
rotation vector, or a matrix by rows in some Caliscope files), `translation` (both `cam_from_world`) and `fisheye`. They
differ in the position of the tables and in the names of the cameras:

- Pose2Sim, Anipose: tables at the top level; the camera's name is in `name`, else that of the table.
- Caliscope: tables in `cameras`, named after `cam_id` (older files: `port`): ``cam_0`` or ``port_0``, like its videos.
"""

from __future__ import annotations

from typing import Any

import tomli_w

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    in_metres,
    left_out_note,
    lens_distortion,
    lens_matrix,
    make_camera,
    make_group,
    numbers,
    opencv_lens,
    parse_toml,
    pixel_count,
    pose_from,
    rotation_from,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import log_so3

_MISSING: tuple[Any, ...] = (None, "null", "None", [])


def read_rig_toml(text: str) -> Calibration:
    """Read the cameras of a Pose2Sim, Anipose or Caliscope TOML.

    The unit of the translations is `unit` in the table `metadata`, if there is one (m, cm, mm, in), otherwise see
    `in_metres`. Cameras that Caliscope ignores are left out, and those without a pose if two others have one; notes
    report this.

    Raises:
        Malformed: what is wrong, with line or camera and field.
    """
    data = parse_toml(text)
    caliscope = isinstance(data.get("cameras"), dict)
    tables = data["cameras"] if caliscope else data
    cameras: list[Camera] = []
    left_out: list[str] = []
    no_pose: list[str] = []
    for key, table in tables.items():
        if not isinstance(table, dict) or not (caliscope or "matrix" in table):
            continue
        name = _name(key, table, caliscope)
        if table.get("ignore") is True:
            left_out.append(name)
        elif table.get("rotation") in _MISSING or table.get("translation") in _MISSING:
            no_pose.append(name)
        else:
            with about(f"camera {name}"):
                cameras.append(_camera(name, table))
    if no_pose and len(cameras) < 2:
        raise Malformed(
            f"no pose (rotation and translation) for {', '.join(no_pose)}: finish the calibration of the extrinsics"
        )
    if not cameras:
        raise Malformed("it holds no camera table (with size, matrix, distortions, rotation, translation)")
    metadata = data.get("metadata")
    unit = metadata.get("unit") if isinstance(metadata, dict) else None
    group, notes = in_metres(make_group(cameras), unit, 'unit = "cm" in [metadata]')
    if left_out:
        notes = (*notes, f"left out, marked to be ignored: {', '.join(left_out)}")
    name = "Caliscope TOML" if caliscope else "Pose2Sim/Anipose TOML"
    return Calibration(group, name, (*notes, *left_out_note(no_pose)), tuple(no_pose))


def _name(key: str, table: dict[str, Any], caliscope: bool) -> str:
    if isinstance(table.get("name"), str) and table["name"].strip():
        return str(table["name"]).strip()
    if not caliscope:
        return key
    for field, prefix in (("cam_id", "cam_"), ("port", "port_")):
        if isinstance(table.get(field), int):
            return f"{prefix}{table[field]}"
    return f"cam_{key}" if key.isdigit() else key


def _camera(name: str, table: dict[str, Any]) -> Camera:
    for field in ("size", "matrix"):
        if table.get(field) in _MISSING:
            raise Malformed(f"{field} is missing")
    width, height = numbers(table["size"], "size", (2,))
    size = pixel_count(float(width), "the width in size"), pixel_count(float(height), "the height in size")
    fisheye = table.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise Malformed("fisheye must be true or false")
    distortions = table.get("distortions")
    lens = opencv_lens(
        numbers(table["matrix"], "matrix", (9,)),
        numbers([] if distortions in _MISSING else distortions, "distortions"),
        fisheye,
    )
    rotation = rotation_from(numbers(table["rotation"], "rotation", (3, 9)), "rotation")
    translation = numbers(table["translation"], "translation", (3,))
    return make_camera(name, lens, size, pose_from(rotation, translation))


def rig_toml_text(cameras: CameraGroup, program: str) -> str:
    """The cameras in the TOML of `anipose`, `freemocap` (millimetres), `pose2sim` or `caliscope`.

    Raises:
        ValueError: a lens that OpenCV's terms cannot express.
    """
    caliscope, unit = program == "caliscope", "mm" if program == "freemocap" else "m"
    tables: dict[str, Any] = {}
    for k, camera in enumerate(cameras):
        tables[str(k) if caliscope else f"cam_{k}"] = {
            "name": camera.name,
            **({"cam_id": k} if caliscope else {}),
            "size": [camera.width, camera.height],
            "matrix": lens_matrix(camera).tolist(),
            "distortions": lens_distortion(camera),
            "rotation": log_so3(camera.rotation).tolist(),
            "translation": (camera.translation * (1000.0 if unit == "mm" else 1.0)).tolist(),
            "fisheye": "FISHEYE" in camera.model,
        }
    metadata = {"adjusted": False, "error": 0.0, "unit": unit}
    return tomli_w.dumps({**({"cameras": tables} if caliscope else tables), "metadata": metadata})
