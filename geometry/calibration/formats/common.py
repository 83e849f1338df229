"""Shared parsing of calibration formats: checks of values, OpenCV's lens terms, units and axes."""

from __future__ import annotations

import json
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import ADJUSTABLE_MODELS, term_map
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup


class Malformed(ValueError):
    """An error inside a file; the caller, who knows the file's name, converts it to a CalibrationError."""


@dataclass(frozen=True)
class Calibration:
    """The content of a calibration file.

    Attributes:
        cameras: the cameras, in the file's order.
        format: name of the file's format, e.g. ``"Qualisys"``.
        notes: sentences for the user: assumptions, and what was left out.
        no_pose: names of cameras that were left out because the file contains no pose of them.
        guessed_sizes: names of cameras whose image size is not in the file and was guessed from the principal point,
            which is up to a tenth of the image away from its centre.
    """

    cameras: CameraGroup
    format: str
    notes: tuple[str, ...] = ()
    no_pose: tuple[str, ...] = ()
    guessed_sizes: frozenset[str] = frozenset()


def left_out_note(no_pose: Sequence[str]) -> tuple[str, ...]:
    """A note on cameras without a pose."""
    return (f"left out, as they have no pose: {', '.join(no_pose)}",) if no_pose else ()


ARBITRARY_SCALE = (
    "COLMAP's scale and axes are arbitrary unless the model was aligned (colmap model_aligner): "
    "check that it is in metres with Z up"
)
"""A note on rigs from structure from motion."""

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Metres per unit that a file may state."""

# Cameras of one room are never farther apart than this, metres; those of a rig in millimetres are.
_WIDEST_RIG_M = 100.0
# Qualisys prints six decimals, hand-typed files have four; a larger deviation from a rotation is an error.
_ROTATION_TOLERANCE = 5e-3
# Brackets of a calibration are nested 4 deep at most; parsers that recurse end the process at some ten thousand.
_DEEPEST, _MOST_BRACKETS, _WIDEST_INDENT = 64, 20_000, 1000
# What no camera of a room has: sides in px, focal length and offset of the principal point over the longer side, terms
# of distortion, metres from the origin.
_SIDES_PX = (2, 100_000)
_FOCALS = (0.01, 1000.0)
_FARTHEST_PRINCIPAL, _LARGEST_TERM, _FARTHEST_M = 10.0, 1e6, 1000.0
# Skew below this share of the focal length is less than a pixel everywhere; lenses have none.
_SKEW_TOLERANCE = 1e-3


def number(value: Any, what: str) -> float:
    """`value` as a finite float; strings that contain a number are accepted (older Caliscope files have them)."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise Malformed(f"{what} is {_brief(value)}, not a number")
    try:
        result = float(value)
    except (ValueError, OverflowError):
        raise Malformed(f"{what} is {_brief(value)}, not a number") from None
    if not np.isfinite(result):
        raise Malformed(f"{what} is {_brief(value)}, not a finite number")
    return result


def numbers(value: Any, what: str, counts: Sequence[int] = ()) -> FloatArray:
    """A nested list of numbers, flattened.

    Args:
        value: the value in the file.
        what: its name, for messages.
        counts: valid numbers of elements; any if empty.
    """
    flat: list[float] = []
    pending = [value]
    while pending:
        item = pending.pop()
        if isinstance(item, list | tuple):
            pending.extend(reversed(item))
        else:
            flat.append(number(item, what))
    if not isinstance(value, list | tuple) or (counts and len(flat) not in counts):
        wanted = " or ".join(str(c) for c in counts)
        raise Malformed(f"{what} must be a list of {wanted + ' ' if wanted else ''}numbers, not {_brief(value)}")
    return np.array(flat, dtype=np.float64)


def pixel_count(value: Any, what: str) -> int:
    """`value` as a positive whole number of pixels (written 1088 or 1088.0)."""
    count = number(value, what)
    if count != round(count) or not 0 < count <= 1_000_000:
        raise Malformed(f"{what} is {count:g}, not a positive whole number of pixels")
    return int(count)


def rotation_from(values: FloatArray, what: str) -> FloatArray:
    """(3, 3) rotation from 3 numbers (a rotation vector) or 9 (a matrix by rows, rounding removed)."""
    if values.size == 3:
        return np.asarray(cv2.Rodrigues(values.reshape(3, 1))[0], dtype=np.float64)
    matrix = values.reshape(3, 3)
    if np.abs(matrix).max() > 2 or np.abs(matrix @ matrix.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        raise Malformed(f"{what} is not a rotation matrix: its rows are not orthonormal")
    if np.linalg.det(matrix) < 0:
        raise Malformed(f"{what} is not a rotation matrix: it mirrors (determinant -1)")
    u, _, vt = np.linalg.svd(matrix)
    nearest: FloatArray = np.asarray(u @ vt, dtype=np.float64)
    # A matrix that is exact up to rounding is kept as it is, so that files of full precision keep their bits.
    return matrix.copy() if np.abs(nearest - matrix).max() < 1e-14 else nearest


def pose_from(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """(3, 4) pose from a rotation and a translation."""
    return np.column_stack([rotation, translation.reshape(3)])


def opencv_lens(matrix: FloatArray, distortion: FloatArray, fisheye: bool) -> tuple[str, tuple[float, ...]]:
    """The lens model and parameters of OpenCV's camera matrix and distortion coefficients.

    Args:
        matrix: (9,) camera matrix by rows.
        distortion: up to 4 coefficients k1..k4 if `fisheye`; else 0, 1, 2, 4, 5, 8, 12 or 14, in OpenCV's
            order k1, k2, p1, p2, k3, k4, k5, k6, s1..s4, tx, ty, of which those after k6 must be zero.
    """
    fx, skew, cx, a, fy, cy, b, c, one = matrix.tolist()
    if (a, b, c, one) != (0.0, 0.0, 0.0, 1.0) or fx <= 0 or fy <= 0:
        raise Malformed("the camera matrix is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0")
    if abs(skew) > _SKEW_TOLERANCE * fx:
        raise Malformed(f"the camera matrix has a skew of {skew:g}, which no supported lens model has")
    terms = distortion.tolist()
    if fisheye:
        if len(terms) > 4 and any(terms[4:]):
            raise Malformed(f"a fisheye lens has 4 distortion coefficients, not {len(terms)}")
        return "OPENCV_FISHEYE", (fx, fy, cx, cy, *(terms + [0.0] * 4)[:4])
    if len(terms) not in (0, 1, 2, 4, 5, 8, 12, 14):
        raise Malformed(f"{len(terms)} distortion coefficients; valid: 0, 1, 2, 4, 5, 8, 12 or 14")
    if any(terms[8:]):
        raise Malformed("thin-prism or tilted-sensor distortion is not supported: calibrate with 4, 5 or 8 terms")
    k1, k2, p1, p2, k3, k4, k5, k6 = (terms + [0.0] * 8)[:8]
    if any((k3, k4, k5, k6)):
        return "FULL_OPENCV", (fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6)
    return "OPENCV", (fx, fy, cx, cy, k1, k2, p1, p2)


def lens_terms(camera: Camera) -> FloatArray:
    """(12,) fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.

    Raises:
        ValueError: the lens model cannot be written in these terms.
    """
    if camera.model not in ADJUSTABLE_MODELS:
        raise ValueError(f"camera {camera.name}: the format has no {camera.model} lens")
    return np.asarray(term_map(camera.model) @ np.array(camera.params))


def lens_matrix(camera: Camera) -> FloatArray:
    """(3, 3) camera matrix; ValueError as `lens_terms`."""
    fx, fy, cx, cy = lens_terms(camera)[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def lens_distortion(camera: Camera, most: int = 8, fisheye: bool = True) -> list[float]:
    """OpenCV's distortion coefficients, as few as suffice.

    Args:
        camera: the camera.
        most: number of coefficients that the format has.
        fisheye: whether the format has fisheye lenses.

    Raises:
        ValueError: the format cannot store the lens.
    """
    terms = lens_terms(camera)
    if "FISHEYE" in camera.model:
        if not fisheye:
            raise ValueError(f"camera {camera.name}: the format has no fisheye lens")
        return [float(terms[k]) for k in (4, 5, 8, 9)]
    values = [float(v) for v in terms[4:]]
    while len(values) > 5 and values[-1] == 0.0:
        values.pop()
    values = values if len(values) <= 5 else [float(v) for v in terms[4:]]
    if len(values) > most:
        raise ValueError(f"camera {camera.name}: the format has {most} distortion terms, a {camera.model} lens more")
    return values


def five_terms(camera: Camera) -> tuple[float, float, float, float, float]:
    """k1, k2, p1, p2, k3 of a lens without fisheye distortion; ValueError as `lens_distortion`."""
    k1, k2, p1, p2, k3 = (*lens_distortion(camera, most=5, fisheye=False), 0.0)[:5]
    return k1, k2, p1, p2, k3


def parse_xml(text: str) -> ET.Element:
    """Parse an XML text; raises `Malformed`."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise Malformed("the XML declares entities, which a calibration never needs")
    try:
        return ET.fromstring(re.sub(r"\A\s*<\?xml[^>]*\?>", "", text))
    except (ET.ParseError, ValueError) as error:
        raise Malformed(f"broken XML, {error}; the file seems damaged or cut off: export it again") from None


def check_nesting(text: str) -> None:
    """Refuse texts whose nesting would overflow the stack of a parser that recurses, as `cv2.FileStorage` does.

    Raises:
        Malformed: the text is nested too deeply.
    """
    # Depth is counted with and without what stands in quotes, so that neither quotes nor brackets in names matter.
    for body in (text, re.sub(r'"[^"\n]*"|\'[^\'\n]*\'', "", text)):
        depth = count = 0
        for bracket in re.finditer(r"[\[{}\]]", body):
            opens = bracket[0] in "[{"
            depth, count = max(depth + (1 if opens else -1), 0), count + opens
            if depth > _DEEPEST or count > _MOST_BRACKETS:
                raise Malformed("nested too deeply; the file is damaged")
    if re.search(rf"^ {{{_WIDEST_INDENT}}}|(?:- ){{{_DEEPEST}}}", text, re.M):
        raise Malformed("nested too deeply; the file is damaged")


def parse_json(text: str) -> Any:
    """Parse a JSON text; raises `Malformed`."""
    return _parsed(json.loads, text, "JSON")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text; raises `Malformed` with line and column."""
    table: dict[str, Any] = _parsed(tomllib.loads, text, "TOML")
    return table


def _parsed(loads: Callable[[str], Any], text: str, kind: str) -> Any:
    try:
        return loads(text)
    except RecursionError:
        raise Malformed(f"broken {kind}: nested too deeply") from None
    except ValueError as error:
        raise Malformed(f"broken {kind}: {error}") from None


@contextmanager
def about(what: str) -> Iterator[None]:
    """Let errors of reading begin with what they are about, such as `camera 3`."""
    try:
        yield
    except Malformed as error:
        raise Malformed(f"{what}: {error}") from None


def table_with(value: Any, fields: Sequence[str]) -> dict[str, Any]:
    """A map that has these fields.

    Raises:
        Malformed: it is no map, or which fields are missing.
    """
    if not isinstance(value, dict):
        raise Malformed("it is no map")
    missing = [field for field in fields if field not in value]
    if missing:
        raise Malformed(f"{', '.join(missing)} missing")
    return value


def check_plausible(cameras: CameraGroup) -> None:
    """Refuse values that no camera of a room has; the same for all formats.

    Raises:
        Malformed: which camera, and what is wrong with it.
    """
    for camera in cameras:
        long_side = max(camera.width, camera.height)
        low, high = _SIDES_PX
        if not low <= min(camera.width, camera.height) <= long_side <= high:
            raise Malformed(
                f"camera {camera.name}: an image of {camera.width} x {camera.height} px; sides have {low} to {high} px"
            )
        matrix = camera.camera_matrix
        for focal in (matrix[0, 0], matrix[1, 1]):
            if not _FOCALS[0] * long_side <= focal <= _FOCALS[1] * long_side:
                raise Malformed(
                    f"camera {camera.name}: a focal length of {focal:g} px with an image of {camera.width} x "
                    f"{camera.height} px; no lens has that"
                )
        offset = np.abs(matrix[:2, 2] - [camera.width / 2, camera.height / 2]).max()
        if offset > _FARTHEST_PRINCIPAL * long_side or max(map(abs, camera.params)) > max(
            _LARGEST_TERM, 2 * _FOCALS[1] * long_side
        ):
            raise Malformed(f"camera {camera.name}: no lens has a principal point or distortion that large")
        away = float(np.linalg.norm(camera.center_world))
        if not away <= _FARTHEST_M:
            raise Malformed(
                f"camera {camera.name}: {away:.3g} m from the origin, which is beyond any room; positions are in metres"
            )


def guessed_size(principal: Sequence[float]) -> tuple[int, int]:
    """The (width, height) px of an image whose principal point (px) is in its middle."""
    width, height = (max(1, round(2 * min(max(c, 0.0), 1e6) + 1)) for c in principal)
    return width, height


def guessed_sizes_note(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """A note on cameras whose image sizes were guessed."""
    if not cameras:
        return ()
    sizes = ", ".join(f"{c.name} {c.width}x{c.height}" for c in cameras)
    return (f"image sizes are not in it: by the principal points they are about {sizes}",)


def make_camera(name: str, lens: tuple[str, tuple[float, ...]], size: tuple[int, int], pose: FloatArray) -> Camera:
    """A `Camera`; its ValueErrors are converted to `Malformed`."""
    try:
        return Camera(name, lens[0], size[0], size[1], lens[1], pose)
    except ValueError as error:
        raise Malformed(str(error)) from None


def make_group(cameras: Sequence[Camera]) -> CameraGroup:
    """A `CameraGroup`; its ValueErrors are converted to `Malformed`."""
    try:
        return CameraGroup(tuple(cameras))
    except ValueError as error:
        raise Malformed(str(error)) from None


def in_metres(cameras: CameraGroup, unit: str | None, where: str) -> tuple[CameraGroup, tuple[str, ...]]:
    """Convert cameras whose translations are in `unit` to metres.

    Args:
        cameras: the cameras in the file.
        unit: one of `UNITS_M`, or None if the file states none. Then metres are assumed, unless the cameras would be
            more than 100 m apart: then millimetres, which is reported in a note.
        where: how the user can state the unit, for the note.
    """
    notes: tuple[str, ...] = ()
    if unit is not None and unit not in UNITS_M:
        raise Malformed(f"unit {_brief(unit)} is unknown; valid: {', '.join(UNITS_M)}")
    if unit is None:
        span = _span(cameras)
        unit = "m" if span <= _WIDEST_RIG_M else "mm"
        if unit == "mm":
            notes = (
                f"the cameras are up to {span:.0f} units apart, so the translations were taken as "
                f"millimetres ({span / 1000:.2f} m); if that is wrong, state the unit: {where}",
            )
    scale = UNITS_M[unit]
    if scale == 1.0:
        return cameras, notes
    poses = [pose_from(c.rotation, c.translation * scale) for c in cameras]
    return CameraGroup(tuple(c.posed(pose) for c, pose in zip(cameras, poses, strict=True))), notes


def far_apart_note(cameras: CameraGroup, what: str) -> tuple[str, ...]:
    """A note where cameras are more than 100 m apart, which suggests that the user's values are not in metres.

    Args:
        cameras: cameras computed from the user's values as metres.
        what: the values that must be in metres, for the note.
    """
    span = _span(cameras)
    if span <= _WIDEST_RIG_M:
        return ()
    return (f"note: the cameras are up to {span:.0f} m apart: {what} must be in metres; are they in millimetres?",)


def _span(cameras: CameraGroup) -> float:
    """Largest distance between two cameras."""
    centers = cameras.centers_world
    return float(np.linalg.norm(centers[:, None] - centers[None], axis=-1).max())


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
