"""Vicon's camera calibration (`.xcp`, an XML text of Nexus, Shogun and Tracker).

Per `<Camera>`, as Vicon writes it: `DEVICEID`, `SENSOR_SIZE` (width and height) and `PIXEL_ASPECT_RATIO`; in its first
`<KeyFrame>` `POSITION` (the centre, mm), `ORIENTATION` (quaternion x y z w, world to camera, OpenCV axes),
`FOCAL_LENGTH` and `PRINCIPAL_POINT` (px), `VICON_RADIAL2` ("ViconRadial2", two numbers of a centre, then three
coefficients) or `VICON_RADIAL` (two coefficients).

The coefficients correct a raw pixel: its distance from the principal point is multiplied by 1 + a r^2 + b r^4 + c r^6,
with r in pixels; OpenCV's distort a corrected one, so they are fitted anew. Coefficients that are impossibly large for
pixels are read as OpenCV's, for files written by other programs.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.sax.saxutils import quoteattr

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    make_camera,
    make_group,
    number,
    parse_xml,
    pixel_count,
    pose_from,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import matrix_from_quat, quat_from_matrix

_ABSURD = 2.0  # largest factor on a corner's distance from the centre
_CARRIED_PX = 0.3


def read_vicon(text: str) -> Calibration:
    """Read the cameras of an `.xcp` file, named by their `DEVICEID`.

    If there are video cameras among them, only those are kept, which a note reports.

    Raises:
        Malformed: what is wrong, with camera and attribute.
    """
    elements = list(parse_xml(text).iter("Camera"))
    videos = [e for e in elements if "video" in (e.get("TYPE", "") + e.get("DISPLAY_TYPE", "")).lower()]
    chosen, cameras, not_calibrated, read_as_opencv = videos or elements, [], [], False
    for position, element in enumerate(chosen, start=1):
        name = (element.get("DEVICEID") or element.get("NAME") or "").strip()
        if not name:
            raise Malformed(f"camera {position} has no DEVICEID")
        frame = element.find("KeyFrames/KeyFrame")
        if frame is None:
            not_calibrated.append(name)
            continue
        with about(f"camera {name}"):
            camera, taken = _camera(name, element, frame)
        cameras.append(camera)
        read_as_opencv |= taken
    if not cameras:
        raise Malformed("no <Camera> has a <KeyFrame>: the system was not calibrated")
    notes = []
    if len(chosen) < len(elements):
        notes.append(f"{len(elements) - len(chosen)} cameras that are no video cameras were left out")
    if not_calibrated:
        notes.append(f"left out, not calibrated: {', '.join(not_calibrated)}")
    if read_as_opencv:
        notes.append("the radial coefficients are too large for Vicon's, which refer to pixels: read as OpenCV's")
    return Calibration(make_group(cameras), "Vicon", tuple(notes))


def _camera(name: str, element: ET.Element, frame: ET.Element) -> tuple[Camera, bool]:
    """The camera, and whether its radial coefficients were read as OpenCV's."""
    width, height = (pixel_count(float(v), "SENSOR_SIZE") for v in _numbers(element, "SENSOR_SIZE", (2,)))
    aspect = float(_numbers(element, "PIXEL_ASPECT_RATIO", (1,))[0]) if element.get("PIXEL_ASPECT_RATIO") else 1.0
    focal = float(_numbers(frame, "FOCAL_LENGTH", (1,))[0])
    center_px = _numbers(frame, "PRINCIPAL_POINT", (2,))
    quat = _numbers(frame, "ORIENTATION", (4,))
    if not 0.99 < np.linalg.norm(quat) < 1.01:
        raise Malformed("ORIENTATION is no unit quaternion (x y z w)")
    if focal <= 0 or not 0.1 < aspect < 10:
        raise Malformed("FOCAL_LENGTH and PIXEL_ASPECT_RATIO must be positive")
    rotation = matrix_from_quat((quat / np.linalg.norm(quat))[[3, 0, 1, 2]])
    translation = -rotation @ _numbers(frame, "POSITION", (3,)) / 1000.0
    terms = _radial(frame)
    far = float(np.hypot(max(center_px[0], width - center_px[0]), max(center_px[1], height - center_px[1]) * aspect))
    growth = 1 + np.polynomial.polynomial.polyval(np.linspace(0, far, 20) ** 2, [0.0, *terms])
    taken = bool(growth.min() < 1 / _ABSURD or growth.max() > _ABSURD)
    k1, k2, k3 = terms if taken else _opencv_radial(terms, focal, far)
    lens = (focal, focal / aspect, *center_px, k1, k2, 0.0, 0.0)
    model = ("OPENCV", lens) if k3 == 0 else ("FULL_OPENCV", (*lens, k3, 0.0, 0.0, 0.0))
    return make_camera(name, model, (width, height), pose_from(rotation, translation)), taken


def _radial(frame: ET.Element) -> FloatArray:
    """(3,) coefficients of r^2, r^4, r^6."""
    for key, first in (("VICON_RADIAL2", 3), ("VICON_RADIAL", 0)):
        words = (frame.get(key) or "").split()
        if words:
            values = [number(w, key) for w in words[first:]][:3]
            return np.array([*values, 0.0, 0.0, 0.0][:3])
    return np.zeros(3)


def _opencv_radial(terms: FloatArray, focal: float, far: float) -> FloatArray:
    """OpenCV's k1, k2, k3 that undo a correction of raw pixels up to `far` px from the centre."""
    if not terms.any():
        return np.zeros(3)
    raw = np.linspace(0, far, 200)[1:]
    straight = raw * (1 + np.polynomial.polynomial.polyval(raw**2, [0.0, *terms])) / focal
    design = np.stack([straight**3, straight**5, straight**7], axis=1)
    return np.asarray(np.linalg.lstsq(design, raw / focal - straight, rcond=None)[0])


def _numbers(element: ET.Element, key: str, counts: tuple[int, ...]) -> FloatArray:
    text = element.get(key)
    if text is None:
        raise Malformed(f"<{element.tag}> has no {key}")
    values = [number(word, key) for word in text.split()]
    if len(values) not in counts:
        raise Malformed(f"{key} must be {counts[0]} numbers, not {len(values)}")
    return np.array(values)


def vicon_text(cameras: CameraGroup) -> str:
    """The cameras as an `.xcp`.

    Raises:
        ValueError: a lens that Vicon's radial correction cannot express within 0.3 px.
    """
    rows = ['<?xml version="1.0" encoding="UTF-8"?>', "<Cameras>"]
    for k, camera in enumerate(cameras, start=1):
        focal, aspect = camera.camera_matrix[0, 0], camera.camera_matrix[0, 0] / camera.camera_matrix[1, 1]
        center = camera.camera_matrix[:2, 2]
        w, x, y, z = (float(v) for v in quat_from_matrix(camera.rotation))
        radial = " ".join(repr(float(v)) for v in [*center, *_vicon_radial(camera)])
        at = " ".join(repr(float(v)) for v in camera.center_world * 1000)
        rows += [
            f'  <Camera DEVICEID={quoteattr(camera.name)} NAME={quoteattr(camera.name)} USERID="{k}" '
            f'SENSOR_SIZE="{camera.width} {camera.height}" PIXEL_ASPECT_RATIO="{float(aspect)!r}" SKEW="0" '
            'TYPE="Video" DISPLAY_TYPE="Video">',
            f'    <KeyFrames><KeyFrame FRAME="0" FOCAL_LENGTH="{float(focal)!r}" PRINCIPAL_POINT="{float(center[0])!r} '
            f'{float(center[1])!r}" POSITION="{at}" ORIENTATION="{x!r} {y!r} {z!r} {w!r}" IMAGE_ERROR="0" '
            f'WORLD_ERROR="0" VICON_RADIAL2="ViconRadial2 {radial}"/></KeyFrames>',
            "  </Camera>",
        ]
    return "\n".join([*rows, "</Cameras>", ""])


def _vicon_radial(camera: Camera) -> FloatArray:
    """(3,) coefficients of the correction of raw pixels; ValueError where they are not sufficient."""
    across = np.linspace(0, 1, 15)
    px = np.stack(np.meshgrid(across * (camera.width - 1), across * (camera.height - 1)), axis=-1).reshape(-1, 2)
    matrix = camera.camera_matrix
    raw = (px - matrix[:2, 2]) * [1.0, matrix[0, 0] / matrix[1, 1]]
    straight = camera.unproject(px) * matrix[0, 0]
    known = np.isfinite(straight).all(-1)
    r2 = (raw**2).sum(-1) / camera.width**2  # scaled for conditioning
    design = (raw[..., None] * np.stack([r2, r2**2, r2**3], axis=-1)[:, None])[known].reshape(-1, 3)
    wanted = (straight - raw)[known].ravel()
    found = np.linalg.lstsq(design, wanted, rcond=None)[0]
    if not known.all() or np.abs(design @ found - wanted).max() > _CARRIED_PX:
        raise ValueError(f"camera {camera.name}: its {camera.model} lens is more than Vicon's radial terms can hold")
    return np.asarray(found / camera.width ** np.array([2.0, 4.0, 6.0]))
