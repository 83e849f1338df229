"""OpenCV's XML (`cv2.FileStorage`) as plain Python, and OpenPose's cameras in it.

The XML has the same content as OpenCV's YAML, with the root `opencv_storage`. OpenPose writes one file per camera,
named after its serial number, with the keys `CameraMatrix` (3x4, world to camera, metres), `Intrinsics` (3x3) and
`Distortion` (8 terms), without the image size.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

from muybridge.geometry.calibration.formats.common import Malformed, parse_xml

NO_SIZE = " no size"
"""Key of a camera whose file has no image size by design; no key of a file has spaces."""
_OPENPOSE = {"CameraMatrix": "cam_from_world", "Intrinsics": "camera_matrix", "Distortion": "distortion_coefficients"}
_MAX_DEPTH = 8


def is_xml(text: str) -> bool:
    """Whether a text is XML rather than YAML."""
    return text.lstrip().startswith("<")


def parse_opencv_xml(text: str) -> dict[str, Any]:
    """Parse a file to dicts, lists, strings and floats, with the keys that OpenCV's YAML has.

    Raises:
        Malformed: broken XML, or no map at its top.
    """
    root = parse_xml(text)
    data = {element.tag: _plain(element, 0) for element in root}
    if not data:
        raise Malformed("the XML has no keys at its top level")
    if "Intrinsics" in data and "CameraMatrix" in data:
        data = {_OPENPOSE.get(key, key): value for key, value in data.items()}
        data[NO_SIZE] = not any(key in data for key in ("image_width", "image_size", "imageSize", "size"))
    return data


def _plain(element: ET.Element, depth: int) -> Any:
    if depth > _MAX_DEPTH:
        raise Malformed("broken XML: nested too deeply")
    if element.get("type_id") in ("opencv-matrix", "opencv-nd-matrix"):
        data = {child.tag: _values((child.text or "").split()) for child in element}
        whole = {key: v[0] if key in ("rows", "cols") and len(v) == 1 else v for key, v in data.items()}
        return {key: value for key, value in whole.items() if key != "dt"}
    if len(element):
        if all(child.tag == "_" for child in element):
            return [_plain(child, depth + 1) for child in element]
        return {child.tag: _plain(child, depth + 1) for child in element}
    text = (element.text or "").strip()
    if text.startswith('"') and text.endswith('"') and len(text) > 1:
        return text[1:-1]
    values = _values(text.split())
    if values and all(isinstance(v, float) for v in values):
        return values[0] if len(values) == 1 else values
    return text or None


def _values(words: list[str]) -> list[float | str]:
    """Words as numbers where they are some."""
    out: list[float | str] = []
    for word in words:
        try:
            out.append(float(word))
        except ValueError:
            out.append(word)
    return out
