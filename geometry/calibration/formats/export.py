"""Cameras written in other programs' formats; what a format cannot carry is refused, never dropped."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, get_args
from xml.sax.saxutils import quoteattr

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError, OutputError
from muybridge.files import replacing
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import ADJUSTABLE_MODELS, term_map
from muybridge.geometry.calibration.formats.native import native_text
from muybridge.geometry.calibration.formats.optitrack import optitrack_text
from muybridge.geometry.calibration.formats.vicon import vicon_text
from muybridge.geometry.cameras.camera import Camera, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import log_so3, quat_from_matrix

ExportFormat = Literal[
    "muybridge", "anipose", "freemocap", "pose2sim", "caliscope", "opencv", "easymocap", "qualisys", "vicon",
    "optitrack", "colmap",
]  # fmt: skip
EXPORT_FORMATS: tuple[ExportFormat, ...] = get_args(ExportFormat)
"""Names of the formats that `export_calibration` writes."""


def export_calibration(cameras: CameraGroup, path: Path, how: ExportFormat) -> list[Path]:
    """Write cameras in a format; `read_calibration` reads every one of them back.

    Args:
        cameras: C cameras.
        path: the file; for `easymocap` and `colmap`, which are several files, their folder.
        how: one of `EXPORT_FORMATS`.

    Returns:
        The files that were written.

    Raises:
        CalibrationError: a camera whose lens the format cannot carry (it is named).
        OutputError: a file cannot be written.
    """
    path = Path(path)
    files = exported(cameras, path, how)
    if how in _SEVERAL:
        try:
            path.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: is no folder and cannot be made ({error.strerror})") from None
    if not next(iter(files)).parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; choose one that exists")
    for file, text in files.items():
        with replacing(file) as partial:
            partial.write_text(text, encoding="utf-8", newline="\n")
    return list(files)


def exported(cameras: CameraGroup, path: Path, how: ExportFormat) -> dict[Path, str]:
    """The files that `export_calibration` writes, and their texts.

    Raises:
        CalibrationError: a camera whose lens the format cannot carry (it is named).
    """
    try:
        if how in _SEVERAL:
            return {path / name: text for name, text in _SEVERAL[how](cameras).items()}
        return {path: _FILES[how](cameras)}
    except ValueError as error:
        raise CalibrationError(
            f"{path}: {error}; write it as muybridge (which keeps everything), or calibrate with a simpler lens"
        ) from None


def _terms(camera: Camera) -> FloatArray:
    """(12,) fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV; ValueError where there are none."""
    if camera.model not in ADJUSTABLE_MODELS:
        raise ValueError(f"camera {camera.name}: the format has no {camera.model} lens")
    return np.asarray(term_map(camera.model) @ np.array(camera.params))


def _distortion(camera: Camera, most: int = 8, fisheye: bool = True) -> list[float]:
    """OpenCV's coefficients, as few as hold them; ValueError where the format has no room for them."""
    terms = _terms(camera)
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


def _matrix_of(camera: Camera) -> FloatArray:
    fx, fy, cx, cy = _terms(camera)[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _list(values: Sequence[float] | FloatArray) -> str:
    return "[" + ", ".join(repr(float(v)) for v in np.asarray(values).ravel()) + "]"


def _rig_toml(cameras: CameraGroup, table: str, unit: str) -> str:
    """Tables of Anipose, FreeMoCap, Pose2Sim and Caliscope: `table` with the camera's number put in."""
    scale = {"m": 1.0, "mm": 1000.0}[unit]
    blocks = []
    for k, camera in enumerate(cameras):
        rows = ", ".join(_list(row) for row in _matrix_of(camera))
        blocks.append(
            f"[{table.format(k)}]\nname = {json.dumps(camera.name, ensure_ascii=False)}\n"
            + (f"cam_id = {k}\n" if table.startswith("cameras.") else "")
            + f"size = [{camera.width}, {camera.height}]\nmatrix = [{rows}]\n"
            f"distortions = {_list(_distortion(camera))}\nrotation = {_list(log_so3(camera.rotation))}\n"
            f"translation = {_list(camera.translation * scale)}\n"
            f"fisheye = {'true' if 'FISHEYE' in camera.model else 'false'}\n"
        )
    return "\n".join([*blocks, f'[metadata]\nadjusted = false\nerror = 0.0\nunit = "{unit}"\n'])


def _yaml_matrix(name: str, values: FloatArray, indent: str = "") -> str:
    table = np.atleast_2d(values)
    data = ", ".join(repr(float(v)) for v in table.ravel())
    return (
        f"{indent}{name}: !!opencv-matrix\n{indent}   rows: {table.shape[0]}\n{indent}   cols: {table.shape[1]}\n"
        f"{indent}   dt: d\n{indent}   data: [ {data} ]\n"
    )


def _opencv(cameras: CameraGroup) -> str:
    rows = ["%YAML:1.0\n---\ncameras:\n"]
    for camera in cameras:
        fisheye = "FISHEYE" in camera.model
        rows.append(f"   -\n      camera_name: {json.dumps(camera.name, ensure_ascii=False)}\n")
        rows.append(f"      image_width: {camera.width}\n      image_height: {camera.height}\n")
        rows.append(f"      fisheye: {int(fisheye)}\n")
        rows.append(_yaml_matrix("camera_matrix", _matrix_of(camera), "      "))
        rows.append(_yaml_matrix("distortion_coefficients", np.array(_distortion(camera)), "      "))
        rows.append(_yaml_matrix("rotation_matrix", camera.rotation, "      "))
        rows.append(_yaml_matrix("translation_vector", camera.translation[:, None], "      "))
    return "".join(rows)


def _easymocap(cameras: CameraGroup) -> dict[str, str]:
    for camera in cameras:
        if not camera.name.replace("_", "").replace("-", "").isalnum() or not camera.name.isascii():
            raise ValueError(f"camera {camera.name}: EasyMocap's names are letters, digits, - and _")
    names = "%YAML:1.0\n---\nnames:\n" + "".join(f'  - "{c.name}"\n' for c in cameras)
    intri, extri = [names], [names]
    for camera in cameras:
        bent = np.array(_distortion(camera, most=5, fisheye=False))
        intri += [_yaml_matrix(f"K_{camera.name}", _matrix_of(camera)), _yaml_matrix(f"dist_{camera.name}", bent)]
        intri += [f"H_{camera.name}: {camera.height}\nW_{camera.name}: {camera.width}\n"]
        extri += [_yaml_matrix(f"R_{camera.name}", log_so3(camera.rotation)[:, None])]
        extri += [_yaml_matrix(f"Rot_{camera.name}", camera.rotation)]
        extri += [_yaml_matrix(f"T_{camera.name}", camera.translation[:, None])]
    return {"intri.yml": "".join(intri), "extri.yml": "".join(extri)}


def _qualisys(cameras: CameraGroup) -> str:
    rows = ['<?xml version="1.0" encoding="UTF-8"?>', '<calibration source="muybridge">', "<cameras>"]
    for camera in cameras:
        k1, k2, p1, p2, k3 = (*_distortion(camera, most=5, fisheye=False), 0.0)[:5]
        (fx, _, cx), (_, fy, cy), _ = _matrix_of(camera).tolist()
        turn = np.diag([1.0, -1.0, -1.0]) @ camera.rotation
        x, y, z = (repr(float(v)) for v in camera.center_world * 1000)
        lens = {
            "focalLengthU": 64 * fx, "focalLengthV": 64 * fy, "centerPointU": 64 * cx, "centerPointV": 64 * cy,
            "skew": 0.0, "radialDistortion1": k1, "radialDistortion2": k2, "radialDistortion3": k3,
            "tangentalDistortion1": p1, "tangentalDistortion2": p2,
        }  # fmt: skip
        window = f'left="0" top="0" right="{camera.width - 1}" bottom="{camera.height - 1}"'
        turned = " ".join(f'r{i + 1}{j + 1}="{float(turn[i, j])!r}"' for i in range(3) for j in range(3))
        rows += [
            f'<camera active="1" calibrated="true" serial={quoteattr(camera.name)} model="video" viewrotation="0">',
            f"<fov_video {window}/>",
            f'<transform x="{x}" y="{y}" z="{z}" {turned}/>',
            "<intrinsic " + " ".join(f'{k}="{float(v)!r}"' for k, v in lens.items()) + "/>",
            "</camera>",
        ]
    return "\n".join([*rows, "</cameras>", "</calibration>", ""])


def _optitrack(cameras: CameraGroup) -> str:
    terms = []
    for camera in cameras:
        bent = (*_distortion(camera, most=5, fisheye=False), 0.0)[:5]
        terms.append(np.array([*_terms(camera)[:4], *bent]))
    return optitrack_text(cameras, terms)


def _colmap(cameras: CameraGroup) -> dict[str, str]:
    lenses, images = [], []
    for k, camera in enumerate(cameras, start=1):
        if any(c.isspace() for c in camera.name):
            raise ValueError(f"camera {camera.name}: COLMAP's names have no spaces")
        params = " ".join(repr(float(p)) for p in colmap_camera(camera).params)
        lenses.append(f"{k} {camera.model} {camera.width} {camera.height} {params}\n")
        pose = " ".join(repr(float(v)) for v in (*quat_from_matrix(camera.rotation), *camera.translation))
        images.append(f"{k} {pose} {k} {camera.name}\n\n")
    return {"cameras.txt": "".join(lenses), "images.txt": "".join(images), "points3D.txt": ""}


_FILES: dict[str, Callable[[CameraGroup], str]] = {
    "muybridge": native_text,
    "anipose": lambda cameras: _rig_toml(cameras, "cam_{}", "m"),
    "freemocap": lambda cameras: _rig_toml(cameras, "cam_{}", "mm"),
    "pose2sim": lambda cameras: _rig_toml(cameras, "cam_{}", "m"),
    "caliscope": lambda cameras: _rig_toml(cameras, "cameras.{}", "m"),
    "opencv": _opencv,
    "qualisys": _qualisys,
    "vicon": vicon_text,
    "optitrack": _optitrack,
}
_SEVERAL: dict[str, Callable[[CameraGroup], dict[str, str]]] = {"easymocap": _easymocap, "colmap": _colmap}
