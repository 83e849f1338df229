"""OptiTrack Motive's camera calibration: `.mcal` (XML), or a CSV table of the same attributes with one row per camera.

Per camera, as Motive writes it: `Serial`, `ImagerPixelWidth`, `ImagerPixelHeight`; lens `LensCenterX`, `LensCenterY`,
`HorizontalFocalLength`, `VerticalFocalLength` (px), `k1`, `k2`, `k3`, `TangentialX`, `TangentialY`; pose `X`, `Y`, `Z`
(the centre, metres, Y up) and `OrientMatrix0..8` (by rows, camera to world, camera axes right, up, backwards).

The world is rotated to Z up: (x, y, z) becomes (x, -z, y).
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    five_terms,
    lens_terms,
    make_camera,
    make_group,
    number,
    opencv_lens,
    parse_xml,
    pixel_count,
    pose_from,
    rotation_from,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

_LENS = ("LensCenterX", "LensCenterY", "HorizontalFocalLength", "VerticalFocalLength")
_BENT = ("k1", "k2", "TangentialX", "TangentialY", "k3")
_TURN = tuple(f"OrientMatrix{k}" for k in range(9))
_COLUMNS = ("Serial", "ImagerPixelWidth", "ImagerPixelHeight", *_LENS, *_BENT, "X", "Y", "Z", *_TURN)
_FLIP = np.diag([1.0, -1.0, -1.0])  # between the axes right, up, backwards and right, down, forwards
_ZUP_FROM_YUP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def read_optitrack(text: str) -> Calibration:
    """Read the cameras of an `.mcal` file or of a CSV table.

    Raises:
        Malformed: what is wrong, with camera and column or attribute.
    """
    return _cameras(_xml_rows(text) if text.lstrip().startswith("<") else _csv_rows(text))


def _csv_rows(text: str) -> list[dict[str, str]]:
    try:
        rows = list(csv.DictReader(io.StringIO(text.lstrip("\ufeff")), skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise Malformed(f"broken CSV: {error}") from None
    return [{(k or "").strip(): v for k, v in row.items() if isinstance(v, str)} for row in rows]


def _xml_rows(text: str) -> list[dict[str, str]]:
    rows = []
    for element in parse_xml(text).iter("Camera"):
        row: dict[str, str] = dict(element.attrib)
        for child in element.iter():
            if child.tag in ("Attributes", "IntrinsicStandardCameraModel", "Extrinsic"):
                row |= child.attrib
        rows.append(row)
    return rows


def _cameras(rows: list[dict[str, str]]) -> Calibration:
    if not rows:
        raise Malformed("it holds no camera")
    turns, others = [], []
    for position, row in enumerate(rows, start=1):
        name = (row.get("Serial") or "").strip()
        if not name:
            raise Malformed(f"camera {position} has no Serial")
        with about(f"camera {name}"):
            turns.append(rotation_from(np.array([_value(row, k) for k in _TURN]), "OrientMatrix0..8"))
            others.append((name, *_lens(row), np.array([_value(row, k) for k in "XYZ"])))
    centers = np.stack([o[-1] for o in others])
    notes = ["Motive's world has Y up: it was rotated to Z up", "Motive's lens terms were read as OpenCV's"]
    world_from_cams = np.stack(turns)
    if _meet(world_from_cams.transpose(0, 2, 1), centers) < 0.5 * _meet(world_from_cams, centers):
        world_from_cams = world_from_cams.transpose(0, 2, 1)
        notes.append("the orientations were read by columns, since only then the cameras look at a common point")
    cameras: list[Camera] = []
    for (name, lens, size, center), turn in zip(others, world_from_cams, strict=True):
        rotation = _FLIP @ turn.T @ _ZUP_FROM_YUP.T
        cameras.append(make_camera(name, lens, size, pose_from(rotation, -rotation @ _ZUP_FROM_YUP @ center)))
    return Calibration(make_group(cameras), "OptiTrack", tuple(notes))


def _lens(row: Mapping[str, str]) -> tuple[tuple[str, tuple[float, ...]], tuple[int, int]]:
    cx, cy, fx, fy = (_value(row, k) for k in _LENS)
    size = pixel_count(_value(row, "ImagerPixelWidth"), "ImagerPixelWidth"), pixel_count(
        _value(row, "ImagerPixelHeight"), "ImagerPixelHeight"
    )  # fmt: skip
    terms = np.array([number(row[k], k) if (row.get(k) or "").strip() else 0.0 for k in _BENT])
    return opencv_lens(np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]), terms, fisheye=False), size


def _value(row: Mapping[str, str], key: str) -> float:
    if not (row.get(key) or "").strip():
        raise Malformed(f"{key} is missing")
    return number(row[key], key)


def _meet(world_from_cams: FloatArray, centers: FloatArray) -> float:
    """Mean distance between the cameras' viewing axes and their common point; 0 for one camera."""
    axes = -world_from_cams[:, :, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    middle = np.linalg.lstsq(across.sum(0), np.einsum("cij,cj->i", across, centers), rcond=1e-9)[0]
    missed = np.linalg.norm(np.einsum("cij,cj->ci", across, middle - centers), axis=1)
    behind = ((middle - centers) * axes).sum(axis=1) < 0
    return float(np.mean(missed + behind * np.linalg.norm(middle - centers, axis=1)))


def optitrack_text(cameras: CameraGroup) -> str:
    """The cameras as a CSV table.

    Raises:
        ValueError: a lens with more than five distortion terms.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for camera in cameras:
        terms = five_terms(camera)
        fx, fy, cx, cy = lens_terms(camera)[:4]
        rotation = (_FLIP @ camera.rotation @ _ZUP_FROM_YUP).T
        center = _ZUP_FROM_YUP.T @ camera.center_world
        values = itertools.chain((cx, cy, fx, fy), terms, center, rotation.ravel())
        writer.writerow([camera.name, camera.width, camera.height, *(repr(float(v)) for v in values)])
    return out.getvalue()
