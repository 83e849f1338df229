"""COLMAP models: the files `cameras` and `images`, as text or binary.

Every registered image becomes a camera: lens from `cameras`, pose and name from `images`. The files are not read by
pycolmap's `Reconstruction`, whose binary reader does not return from some truncated files; the two files are simple,
and points, rigs and frames are not needed. The layout is documented by COLMAP under "Output format".
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.formats.common import (
    ARBITRARY_SCALE,
    Calibration,
    Malformed,
    make_group,
    pose_from,
)
from muybridge.geometry.cameras import _pycolmap as pycolmap
from muybridge.geometry.cameras.camera import CAMERA_MODELS, Camera, camera_from_colmap, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import quat_from_matrix

_FILES = ("cameras", "images", "points3D", "rigs", "frames")
_IMAGE_SUFFIXES = frozenset(".jpg .jpeg .png .tif .tiff .bmp .gif .webp .ppm .pgm .exr".split())


@dataclass(frozen=True)
class _Image:
    image_id: int
    name: str
    camera_id: int
    cam_from_world: FloatArray


def is_colmap_file(path: Path) -> bool:
    """Whether the name is that of a file of a COLMAP model (binary files have no other mark)."""
    return path.suffix in (".bin", ".txt") and path.stem in _FILES


def colmap_files(folder: Path) -> tuple[Path, Path] | None:
    """The files `cameras` and `images` of the model in a folder (binary is preferred to text), or None."""
    for suffix in (".bin", ".txt"):
        pair = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if pair[0].is_file() and pair[1].is_file():
            return pair
    return None


def read_colmap(cameras_path: Path, images_path: Path) -> Calibration:
    """Read the cameras of a COLMAP model.

    Cameras are in the order of their images' numbers. A camera's name is its image's file name without the suffix of an
    image; where those repeat (cam01/0.png, cam02/0.png), the folder's name; where those repeat too, the whole path
    without suffix, with _ for /.

    Raises:
        Malformed: what is wrong, with file and line or record.
        OSError: a file cannot be read.
    """
    binary = cameras_path.suffix == ".bin"
    read_lenses, read_images = (_binary_lenses, _binary_images) if binary else (_text_lenses, _text_images)
    try:
        lenses = read_lenses(cameras_path.read_bytes())
    except Malformed as error:
        raise Malformed(f"{cameras_path.name}: {error}") from None
    try:
        images = sorted(read_images(images_path.read_bytes()), key=lambda image: image.image_id)
        if not images:
            raise Malformed("it holds no registered image")
        cameras = [
            _camera(name, image, lenses)
            for name, image in zip(_camera_names([i.name for i in images]), images, strict=True)
        ]
    except Malformed as error:
        raise Malformed(f"{images_path.name}: {error}") from None
    return Calibration(make_group(cameras), "COLMAP model", (ARBITRARY_SCALE,))


def _camera(name: str, image: _Image, lenses: dict[int, Any]) -> Camera:
    if image.camera_id not in lenses:
        raise Malformed(f"image {image.name} has camera {image.camera_id}, which the cameras file has not")
    try:
        return camera_from_colmap(name, lenses[image.camera_id], image.cam_from_world)
    except ValueError as error:
        raise Malformed(f"image {image.name}, camera {image.camera_id}: {error}") from None


def _camera_names(image_names: Sequence[str]) -> list[str]:
    paths = [PurePosixPath(name.replace("\\", "/")) for name in image_names]
    stems = [p.stem if p.suffix.lower() in _IMAGE_SUFFIXES else p.name for p in paths]
    for names in (stems, [p.parent.name for p in paths]):
        if len(set(names)) == len(names) and all(names):
            return names
    return [str(p.parent / stem).replace("/", "_") for p, stem in zip(paths, stems, strict=True)]


def _lens(model: str, width: int, height: int, params: Sequence[float]) -> Any:
    """A pycolmap camera with valid values."""
    if model not in CAMERA_MODELS:
        raise Malformed(f"camera model {model[:40]} is not supported; supported: {', '.join(CAMERA_MODELS)}")
    if not (0 < width <= 1_000_000 and 0 < height <= 1_000_000):
        raise Malformed(f"image size {width}x{height} is not possible")
    if not np.isfinite(params).all():
        raise Malformed("a lens parameter is not a finite number")
    lens = pycolmap.Camera(model=model, width=width, height=height, params=list(params))
    if not lens.verify_params():
        raise Malformed(f"model {model} with {len(params)} parameters; it has {lens.params_info}")
    return lens


def _pose(quat_wxyz: Sequence[float], translation: Sequence[float]) -> FloatArray:
    quat, moved = np.array(quat_wxyz, dtype=np.float64), np.array(translation, dtype=np.float64)
    if not np.isfinite(quat).all() or not np.isfinite(moved).all():
        raise Malformed("the pose is not finite")
    if np.abs(quat).max() > 2 or abs(float(np.linalg.norm(quat)) - 1.0) > 1e-3:
        raise Malformed("the rotation is not a unit quaternion")
    xyzw = quat[[1, 2, 3, 0]] / np.linalg.norm(quat)
    return pose_from(np.asarray(pycolmap.Rotation3d(xyzw).matrix()), moved)


def colmap_texts(cameras: CameraGroup) -> dict[str, str]:
    """The text files of a COLMAP model without points.

    Raises:
        ValueError: a name with spaces, which COLMAP's text files cannot hold.
    """
    lenses, images = [], []
    for k, camera in enumerate(cameras, start=1):
        if any(c.isspace() for c in camera.name):
            raise ValueError(f"camera {camera.name}: COLMAP's names have no spaces")
        params = " ".join(repr(float(p)) for p in colmap_camera(camera).params)
        lenses.append(f"{k} {camera.model} {camera.width} {camera.height} {params}\n")
        pose = " ".join(repr(float(v)) for v in (*quat_from_matrix(camera.rotation), *camera.translation))
        images.append(f"{k} {pose} {k} {camera.name}\n\n")
    return {"cameras.txt": "".join(lenses), "images.txt": "".join(images), "points3D.txt": ""}


# --- text -------------------------------------------------------------------------------------------------


def _lines(data: bytes) -> list[str]:
    try:
        return data.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise Malformed(f"it is not a text file (byte {error.start} is no UTF-8)") from None


def _text_lenses(data: bytes) -> dict[int, Any]:
    lenses: dict[int, Any] = {}
    for number, line in enumerate(_lines(data), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            camera_id, width, height = int(words[0]), int(words[2]), int(words[3])
            params = [float(word) for word in words[4:]]
        except (ValueError, IndexError):
            raise Malformed(f"line {number} is not CAMERA_ID MODEL WIDTH HEIGHT PARAMS") from None
        try:
            lenses[camera_id] = _lens(words[1], width, height, params)
        except Malformed as error:
            raise Malformed(f"line {number}: {error}") from None
    if not lenses:
        raise Malformed("it holds no camera")
    return lenses


def _text_images(data: bytes) -> list[_Image]:
    images: list[_Image] = []
    points_next = False
    for number, line in enumerate(_lines(data), start=1):
        if points_next:  # the second line of an image, which may be empty
            points_next = False
            continue
        words = line.split(maxsplit=9)
        if not words or words[0].startswith("#"):
            continue
        try:
            image_id = int(words[0])
            values = [float(word) for word in words[1:8]]
            camera_id, name = int(words[8]), words[9].strip()
        except (ValueError, IndexError):
            raise Malformed(f"line {number} is not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME") from None
        try:
            images.append(_Image(image_id, name, camera_id, _pose(values[:4], values[4:])))
        except Malformed as error:
            raise Malformed(f"line {number}, image {name}: {error}") from None
        points_next = True
    return images


# --- binary -----------------------------------------------------------------------------------------------


class _Reader:
    """Reads little-endian values from a byte string and detects its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, layout: str) -> tuple[Any, ...]:
        size = struct.calcsize("<" + layout)
        if self._at + size > len(self._data):
            raise Malformed(f"it ends at byte {len(self._data)} in the middle of a record: copy it again")
        values = struct.unpack_from("<" + layout, self._data, self._at)
        self._at += size
        return values

    def text(self) -> str:
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise Malformed(f"it ends at byte {len(self._data)} in the middle of a name: copy it again")
        raw, self._at = self._data[self._at : end], end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            raise Malformed(f"a name at byte {end - len(raw)} is no UTF-8") from None

    def skip(self, size: int) -> None:
        if size > len(self._data) - self._at:
            raise Malformed(f"it ends at byte {len(self._data)} in the middle of a record: copy it again")
        self._at += size

    def check_end(self) -> None:
        if self._at != len(self._data):
            raise Malformed(f"{len(self._data) - self._at} bytes are left after the last record")


def _binary_lenses(data: bytes) -> dict[int, Any]:
    reader = _Reader(data)
    (count,) = reader.take("Q")
    known = {int(value): name for name, value in pycolmap.CameraModelId.__members__.items()}
    lenses: dict[int, Any] = {}
    for record in range(1, count + 1):
        camera_id, model_id, width, height = reader.take("IiQQ")
        model = known.get(model_id, f"number {model_id}")
        try:
            if model not in CAMERA_MODELS:
                raise Malformed(f"camera model {model} is not supported")
            n_params = len(pycolmap.Camera.create_from_model_name(0, model, 1.0, 1, 1).params)
            lenses[camera_id] = _lens(model, width, height, reader.take(f"{n_params}d"))
        except Malformed as error:
            raise Malformed(f"record {record}: {error}") from None
    reader.check_end()
    if not lenses:
        raise Malformed("it holds no camera")
    return lenses


def _binary_images(data: bytes) -> list[_Image]:
    reader = _Reader(data)
    (count,) = reader.take("Q")
    images: list[_Image] = []
    for record in range(1, count + 1):
        try:
            values = reader.take("I7dI")
            name = reader.text()
            (points,) = reader.take("Q")
            reader.skip(24 * points)  # x, y, point id
            images.append(_Image(values[0], name, values[8], _pose(values[1:5], values[5:8])))
        except Malformed as error:
            raise Malformed(f"record {record}: {error}") from None
    reader.check_end()
    return images
