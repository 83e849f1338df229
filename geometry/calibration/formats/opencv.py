"""Cameras in OpenCV's YAML and XML (`cv2.FileStorage`).

OpenCV defines no keys. A camera is a map with these keys, in any one of the spellings:

| what | keys |
| --- | --- |
| camera matrix, 3x3 | camera_matrix, cameraMatrix, K, intrinsic_matrix, M |
| distortion | distortion_coefficients, distCoeffs, dist_coeffs, distortion, dist, D |
| image size | image_width and image_height; or image_size, imageSize, size as [width, height] |
| rotation, a vector or 3x3 | rotation, R, rvec, rotation_vector, rotation_matrix |
| translation | translation, T, t, tvec, translation_vector |
| both at once | extrinsic_parameters, extrinsic_matrix, cam_from_world (3x4 or 4x4) |
| fisheye lens | fisheye (0 or 1), or distortion_model: fisheye / equidistant |
| name | camera_name, name (else the key of the map) |
| unit of the translation | unit: m, cm, mm, in (at the top of the file) |

Rotation and translation map world to camera, as `solvePnP` and `calibrateCamera` return them. A file contains one
camera at its top level; or one map per camera, under the cameras' names; or a sequence `cameras` of maps. Several files
of one camera each make a rig.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    check_nesting,
    guessed_size,
    guessed_sizes_note,
    in_metres,
    left_out_note,
    lens_distortion,
    lens_matrix,
    make_camera,
    make_group,
    number,
    numbers,
    opencv_lens,
    pixel_count,
    pose_from,
    rotation_from,
)
from muybridge.geometry.calibration.formats.opencv_xml import NO_SIZE, is_xml, parse_opencv_xml
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

_MATRIX = ("camera_matrix", "cameraMatrix", "K", "intrinsic_matrix", "M")
_DISTORTION = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "distortion", "dist", "D")
_SIZE = ("image_size", "imageSize", "size")
_ROTATION = ("rotation", "R", "rvec", "rotation_vector", "rotation_matrix")
_TRANSLATION = ("translation", "T", "t", "tvec", "translation_vector")
_EXTRINSIC = ("extrinsic_parameters", "extrinsic_matrix", "cam_from_world")
_NAME = ("camera_name", "name")
MATRIX_KEYS = _MATRIX
"""Spellings of the key that identifies a camera."""

_MAX_DEPTH = 8


def read_opencv_yaml(text: str, file_stem: str) -> Calibration:
    """Read the cameras of an OpenCV YAML file.

    Args:
        text: the file's content; the `%YAML` line may be missing.
        file_stem: name of a single camera that has none in the file.

    Raises:
        Malformed: what is wrong, with line or camera and field.
    """
    data = parse_opencv(text)
    name = "OpenCV XML" if is_xml(text) else "OpenCV YAML"
    return _calibration(_cameras_in(data, file_stem), data.get("unit"), name)


def read_opencv_files(texts: Mapping[str, str]) -> Calibration:
    """Cameras of several OpenCV YAML or XML files, by the files' stems.

    Raises:
        Malformed: as `read_opencv_yaml`, with the file's stem; files whose units differ.
    """
    found, units = [], {}
    for stem, text in texts.items():
        try:
            data = parse_opencv(text)
            found += _cameras_in(data, stem)
        except Malformed as error:
            raise Malformed(f"{stem}: {error}") from None
        units[data.get("unit")] = stem
    if len(units) > 1:
        raise Malformed(f"the units of {' and '.join(units.values())} differ: state the same in all files")
    name = "OpenCV XML" if all(map(is_xml, texts.values())) else "OpenCV YAML"
    return _calibration(found, next(iter(units)), name)


def is_one_camera(text: str) -> bool:
    """Whether a file is of one camera, at its top level."""
    try:
        return _is_camera(parse_opencv(text))
    except Malformed:
        return False


def _cameras_in(data: dict[str, Any], file_stem: str) -> list[tuple[str, dict[str, Any]]]:
    """The cameras of a file by name, unparsed."""
    found: list[tuple[str, dict[str, Any]]] = []
    if _is_camera(data):
        found = [(_label(data, file_stem), data)]
    elif isinstance(data.get("cameras"), list):
        for position, item in enumerate(data["cameras"], start=1):
            if not isinstance(item, dict) or not _is_camera(item):
                raise Malformed(f"item {position} of cameras has no camera matrix ({', '.join(_MATRIX)})")
            found.append((_label(item, f"cam{position:02d}"), item))
    else:
        nested = data["cameras"] if isinstance(data.get("cameras"), dict) else data
        found = [(_label(v, k), v) for k, v in nested.items() if isinstance(v, dict) and _is_camera(v)]
    if not found:
        raise Malformed(f"no camera in it: none of the keys {', '.join(_MATRIX)} at its top or one level below")
    return found


def _calibration(found: Sequence[tuple[str, dict[str, Any]]], unit: str | None, kind: str) -> Calibration:
    no_pose = tuple(name for name, item in found if not _has_pose(item))
    posed = [(name, item) for name, item in found if name not in no_pose]
    if no_pose and len(posed) < 2:
        raise Malformed(
            f"no pose for {', '.join(no_pose)}: each camera needs a rotation ({', '.join(_ROTATION)}) and a "
            f"translation ({', '.join(_TRANSLATION)})"
        )
    cameras: list[Camera] = []
    for name, item in posed:
        with about(f"camera {name}"):
            cameras.append(_camera(name, item))
    group, notes = in_metres(make_group(cameras), unit, "unit: cm, at the top level of the file")
    guessed = frozenset(name for name, item in posed if not _has_size(item))
    notes = (*notes, *guessed_sizes_note([c for c in group if c.name in guessed]), *left_out_note(no_pose))
    return Calibration(group, kind, notes, no_pose, guessed)


def _camera(name: str, item: dict[str, Any]) -> Camera:
    matrix = array_of(item, _MATRIX)
    distortion = array_of(item, _DISTORTION) if _key(item, _DISTORTION) else np.zeros(0)
    if matrix.size != 9:
        raise Malformed(f"{_key(item, _MATRIX)} has {matrix.size} numbers, not 9")
    lens = opencv_lens(matrix, distortion, _is_fisheye(item))
    if _key(item, _EXTRINSIC):
        extrinsic = array_of(item, _EXTRINSIC)
        if extrinsic.size not in (12, 16):
            raise Malformed(f"{_key(item, _EXTRINSIC)} has {extrinsic.size} numbers, not 12 (3x4) or 16 (4x4)")
        rows = extrinsic[:12].reshape(3, 4)
        rotation, translation = rotation_from(rows[:, :3].ravel(), "the rotation"), rows[:, 3]
    else:
        values, translation = array_of(item, _ROTATION), array_of(item, _TRANSLATION)
        if values.size not in (3, 9) or translation.size != 3:
            raise Malformed("the rotation must have 3 or 9 numbers and the translation 3")
        rotation = rotation_from(values, str(_key(item, _ROTATION)))
    size = guessed_size(lens[1][2:4]) if not _has_size(item) else _size(item)
    return make_camera(name, lens, size, pose_from(rotation, translation))


def _has_size(item: dict[str, Any]) -> bool:
    """Whether a file has the image's size; only OpenPose's have none by design."""
    return not item.get(NO_SIZE, False)


def _size(item: dict[str, Any]) -> tuple[int, int]:
    if "image_width" in item and "image_height" in item:
        return pixel_count(item["image_width"], "image_width"), pixel_count(item["image_height"], "image_height")
    key = _key(item, _SIZE)
    if key is None:
        raise Malformed("the image size is missing: image_width and image_height, or image_size")
    size = array_of(item, _SIZE)
    if size.size != 2:
        raise Malformed(f"{key} has {size.size} numbers, not 2")
    width, height = size.tolist()
    return pixel_count(width, f"the width in {key}"), pixel_count(height, f"the height in {key}")


def _is_fisheye(item: dict[str, Any]) -> bool:
    if str(item.get("distortion_model", "")).lower() in ("fisheye", "equidistant", "kannala_brandt"):
        return True
    flag = item.get("fisheye", item.get("fisheye_model", 0))
    return str(flag).lower() == "true" or (not isinstance(flag, str) and number(flag, "fisheye") != 0)


def _is_camera(item: dict[str, Any]) -> bool:
    return any(key in item for key in _MATRIX)


def _has_pose(item: dict[str, Any]) -> bool:
    pair = any(key in item for key in _ROTATION) and any(key in item for key in _TRANSLATION)
    return pair or any(key in item for key in _EXTRINSIC)


def _label(item: dict[str, Any], default: str) -> str:
    key = _key(item, _NAME)
    return str(item[key]) if key and str(item[key]).strip() else default


def _key(item: dict[str, Any], spellings: tuple[str, ...]) -> str | None:
    """The spelling that is used; two at once are an error, since it is undefined which one counts."""
    present = [key for key in spellings if key in item]
    if len(present) > 1:
        raise Malformed(f"{' and '.join(present)} are both given and mean the same: keep one")
    return present[0] if present else None


def array_of(item: dict[str, Any], spellings: tuple[str, ...]) -> FloatArray:
    """A flattened matrix, given as OpenCV's rows, cols and data or as a plain list."""
    key = _key(item, spellings)
    if key is None:
        raise Malformed(f"missing: {', '.join(spellings)}")
    value = item[key]
    if isinstance(value, dict):
        data = numbers(value.get("data", []), f"data of {key}")
        if "sizes" in value:  # an array with more or fewer than two dimensions
            return data
        rows, cols = (
            number(value.get("rows", -1), f"rows of {key}"),
            number(value.get("cols", -1), f"cols of {key}"),
        )
        if rows * cols != data.size:
            raise Malformed(f"{key} says {rows:g} x {cols:g} and has {data.size} numbers")
        return data
    return numbers(value, key)


def parse_opencv(text: str) -> dict[str, Any]:
    """Parse a YAML or XML file of `cv2.FileStorage` to dicts, lists, strings and floats; raises `Malformed`."""
    return parse_opencv_xml(text) if is_xml(text) else parse_yaml(text)


def parse_yaml(text: str) -> dict[str, Any]:
    """Parse a file to dicts, lists, strings and floats."""
    if not text.startswith("%YAML"):
        body = text if text.lstrip().startswith("---") else "---\n" + text
        text = "%YAML:1.0\n" + body
    check_nesting(text)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        if not storage.isOpened():
            raise Malformed("broken YAML")
        root = _plain(storage.root(), 0)
    except (cv2.error, SystemError) as error:
        # The binding wraps OpenCV's exception in a SystemError; its cause holds "input(line): reason".
        cause = error.__cause__ if isinstance(error, SystemError) and error.__cause__ else error
        reason = str(cause).strip().splitlines()[0].split("error: ")[-1]
        raise Malformed(f"broken YAML: {reason}") from None
    except UnicodeDecodeError:
        raise Malformed("broken YAML: text that is no UTF-8") from None
    if not isinstance(root, dict):
        raise Malformed("the YAML has no keys at its top level")
    return root


def _plain(node: Any, depth: int) -> Any:
    """A `cv2.FileNode` as plain Python."""
    if depth > _MAX_DEPTH:
        raise Malformed("broken YAML: nested too deeply")
    if node.isMap():
        return {key: _plain(node.getNode(key), depth + 1) for key in node.keys()}
    if node.isSeq():
        return [_plain(node.at(k), depth + 1) for k in range(node.size())]
    if node.isInt() or node.isReal():
        return float(node.real())
    return str(node.string()) if node.isString() else None


def yaml_matrix(name: str, values: FloatArray, indent: str = "") -> str:
    """A matrix under a key, in the format of `cv2.FileStorage`."""
    table = np.atleast_2d(values)
    data = ", ".join(repr(float(v)) for v in table.ravel())
    return (
        f"{indent}{name}: !!opencv-matrix\n{indent}   rows: {table.shape[0]}\n{indent}   cols: {table.shape[1]}\n"
        f"{indent}   dt: d\n{indent}   data: [ {data} ]\n"
    )


def opencv_text(cameras: CameraGroup) -> str:
    """The cameras as a sequence in OpenCV's YAML.

    Raises:
        ValueError: a lens that OpenCV's terms cannot express.
    """
    rows = ["%YAML:1.0\n---\ncameras:\n"]
    for camera in cameras:
        fisheye = "FISHEYE" in camera.model
        rows.append(f"   -\n      camera_name: {json.dumps(camera.name, ensure_ascii=False)}\n")
        rows.append(f"      image_width: {camera.width}\n      image_height: {camera.height}\n")
        rows.append(f"      fisheye: {int(fisheye)}\n")
        rows.append(yaml_matrix("camera_matrix", lens_matrix(camera), "      "))
        rows.append(yaml_matrix("distortion_coefficients", np.array(lens_distortion(camera)), "      "))
        rows.append(yaml_matrix("rotation_matrix", camera.rotation, "      "))
        rows.append(yaml_matrix("translation_vector", camera.translation[:, None], "      "))
    return "".join(rows)
