"""Qualisys Track Manager's camera calibration (`.qca.txt`, an XML text).

Per camera, as Qualisys writes it:

- `intrinsic`: focal lengths and centre in 1/64 of a sensor pixel; `radialDistortion1..3` and `tangentalDistortion1..2`
  are OpenCV's k1, k2, k3, p1, p2 without conversion.
- `transform`: x, y, z is the camera's centre in millimetres; r11..r33 is the rotation into axes with y up and z
  backwards, so that `cam_from_world = diag(1, -1, -1) [r_ij]`.
- `fov_video`: the window of the sensor that the video shows (last pixel included).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.sax.saxutils import quoteattr

import numpy as np

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    five_terms,
    lens_matrix,
    make_camera,
    make_group,
    number,
    numbers,
    opencv_lens,
    parse_xml,
    pixel_count,
    pose_from,
    rotation_from,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

_SUBPIXELS = 64.0
_OPENCV_FROM_QUALISYS = np.diag([1.0, -1.0, -1.0])


def read_qualisys(text: str) -> Calibration:
    """Read the cameras of a `.qca.txt` file, named by their serial numbers.

    Cameras that Qualisys marks as inactive or not calibrated are left out, which a note reports.

    Raises:
        Malformed: what is wrong, with line or camera and field.
    """
    root = parse_xml(text)
    cameras: list[Camera] = []
    left_out: list[str] = []
    for position, element in enumerate(root.iter("camera"), start=1):
        name = (element.get("serial") or "").strip()
        if not name:
            raise Malformed(f"camera {position} has no serial attribute")
        if element.get("active") == "0" or element.get("calibrated") == "false":
            left_out.append(name)
            continue
        with about(f"camera {name}"):
            cameras.append(_camera(name, element))
    if not cameras:
        raise Malformed("no <camera> is active and calibrated")
    notes = (f"left out, not active or not calibrated: {', '.join(left_out)}",) if left_out else ()
    return Calibration(make_group(cameras), "Qualisys", notes)


def _camera(name: str, element: ET.Element) -> Camera:
    window = _child(element, "fov_video")
    left, top = (_value(window, key) for key in ("left", "top"))
    width = pixel_count(_value(window, "right") - left + 1, "the width of fov_video")
    height = pixel_count(_value(window, "bottom") - top + 1, "the height of fov_video")

    lens = _child(element, "intrinsic")
    units_u = _units_per_pixel(element, lens, "U", ("left", "right"))
    units_v = _units_per_pixel(element, lens, "V", ("top", "bottom"))
    matrix = [
        [_value(lens, "focalLengthU") / units_u, _value(lens, "skew", 0.0) / units_u,
         _value(lens, "centerPointU") / units_u - left],
        [0.0, _value(lens, "focalLengthV") / units_v, _value(lens, "centerPointV") / units_v - top],
        [0.0, 0.0, 1.0],
    ]  # fmt: skip
    k1, k2, k3 = (_value(lens, f"radialDistortion{i}", 0.0) for i in (1, 2, 3))
    p1, p2 = (_value(lens, f"tangentalDistortion{i}", 0.0) for i in (1, 2))
    model = opencv_lens(numbers(matrix, "intrinsic"), np.array([k1, k2, p1, p2, k3]), fisheye=False)

    transform = _child(element, "transform")
    rows = np.array([_value(transform, f"r{i}{j}") for i in (1, 2, 3) for j in (1, 2, 3)])
    center_world = np.array([_value(transform, axis) for axis in "xyz"]) / 1000.0
    rotation = _OPENCV_FROM_QUALISYS @ rotation_from(rows, "transform r11..r33")
    return make_camera(name, model, (width, height), pose_from(rotation, -rotation @ center_world))


def _units_per_pixel(camera: ET.Element, lens: ET.Element, axis: str, ends: tuple[str, str]) -> float:
    """Lens units per video pixel: 64, or more where the video is a reduced image of the sensor."""
    whole = camera.find("fov_video_max")
    if whole is None or lens.get(f"sensorMax{axis}") is None:
        return _SUBPIXELS
    first, last = (_value(whole, end) for end in ends)
    sensor = _value(lens, f"sensorMax{axis}") - _value(lens, f"sensorMin{axis}", 0.0)
    if last <= first or sensor <= 0:
        return _SUBPIXELS
    # The sensor's extent is given as 64 * (n - 1) or 64 * n - 1, so small differences are ignored.
    units = sensor / (last - first)
    return _SUBPIXELS if abs(units / _SUBPIXELS - 1.0) < 0.02 else units


def _child(element: ET.Element, tag: str) -> ET.Element:
    child = element.find(tag)
    if child is None:
        raise Malformed(f"<{tag}> is missing")
    return child


def _value(element: ET.Element, key: str, default: float | None = None) -> float:
    text = element.get(key)
    if text is None:
        if default is None:
            raise Malformed(f"<{element.tag}> has no {key}")
        return default
    return number(text, f"{key} of <{element.tag}>")


def qualisys_text(cameras: CameraGroup) -> str:
    """The cameras as a `.qca.txt`.

    Raises:
        ValueError: a lens with more than five distortion terms.
    """
    rows = ['<?xml version="1.0" encoding="UTF-8"?>', '<calibration source="muybridge">', "<cameras>"]
    for camera in cameras:
        k1, k2, p1, p2, k3 = five_terms(camera)
        (fx, _, cx), (_, fy, cy), _ = lens_matrix(camera).tolist()
        rotation = _OPENCV_FROM_QUALISYS @ camera.rotation
        x, y, z = (repr(float(v)) for v in camera.center_world * 1000)
        lens = {
            "focalLengthU": 64 * fx, "focalLengthV": 64 * fy, "centerPointU": 64 * cx, "centerPointV": 64 * cy,
            "skew": 0.0, "radialDistortion1": k1, "radialDistortion2": k2, "radialDistortion3": k3,
            "tangentalDistortion1": p1, "tangentalDistortion2": p2,
        }  # fmt: skip
        window = f'left="0" top="0" right="{camera.width - 1}" bottom="{camera.height - 1}"'
        elements = " ".join(f'r{i + 1}{j + 1}="{float(rotation[i, j])!r}"' for i in range(3) for j in range(3))
        rows += [
            f'<camera active="1" calibrated="true" serial={quoteattr(camera.name)} model="video" viewrotation="0">',
            f"<fov_video {window}/>",
            f'<transform x="{x}" y="{y}" z="{z}" {elements}/>',
            "<intrinsic " + " ".join(f'{k}="{float(v)!r}"' for k, v in lens.items()) + "/>",
            "</camera>",
        ]
    return "\n".join([*rows, "</cameras>", "</calibration>", ""])
