"""EasyMocap's calibration: `intri.yml` (K_NAME, dist_NAME) and `extri.yml` (R_NAME or Rot_NAME, T_NAME) side by side.

Both contain the sequence `names`. R is a rotation vector, Rot a matrix; they map world to camera, in metres. Newer
files contain the image size (`H_NAME`, `W_NAME`); without it, it is guessed as twice the principal point, which is
noted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    five_terms,
    guessed_size,
    guessed_sizes_note,
    in_metres,
    left_out_note,
    lens_matrix,
    make_camera,
    make_group,
    number,
    opencv_lens,
    pixel_count,
    pose_from,
    rotation_from,
)
from muybridge.geometry.calibration.formats.opencv import array_of, parse_yaml, yaml_matrix
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import log_so3

_PAIR = ("intri", "extri")
_OTHER_NAMES = " names of the other file"  # no key of a file has spaces


def easymocap_sibling(path: Path) -> Path | None:
    """The other file of the pair, if the name is that of one (`intri.yml`, `my_extri.yaml`)."""
    for one, other in (_PAIR, _PAIR[::-1]):
        if one in path.stem:
            return path.with_name(path.stem.replace(one, other) + path.suffix)
    return None


def read_easymocap(text: str, path: Path) -> Calibration:
    """Read the cameras of a pair of files, one of which is given.

    Raises:
        Malformed: what is wrong, with camera and key; also if the other file is missing.
    """
    data = parse_yaml(text)
    sibling = easymocap_sibling(path)
    if sibling is not None and sibling.is_file():
        try:
            other = parse_yaml(sibling.read_text(encoding="utf-8-sig"))
        except (Malformed, UnicodeDecodeError) as error:
            raise Malformed(f"{sibling.name}: {error}") from None
        others = other.get("names")
        data = {**other, **data, _OTHER_NAMES: others if isinstance(others, list) else []}
    names = data.get("names")
    if not isinstance(names, list) or not names:
        raise Malformed("it has no sequence `names` of cameras")
    lacks = [k for k in ("K_", "T_") if not any(key.startswith(k) for key in data)]
    if lacks:
        missing = _PAIR[0] if lacks[0] == "K_" else _PAIR[1]
        raise Malformed(f"{missing}.yml is missing beside it: of EasyMocap, intri.yml and extri.yml are needed")
    cameras: list[Camera] = []
    guessed: set[str] = set()
    every = [_name(n) for n in dict.fromkeys(_names_in(data, names))]
    no_pose = tuple(n for n in every if not _has_pose(data, n))
    if no_pose and len(every) - len(no_pose) < 2:
        raise Malformed(f"no pose (R_NAME or Rot_NAME, and T_NAME) for {', '.join(no_pose)}")
    for name in (n for n in every if n not in no_pose):
        with about(f"camera {name}"):
            lens = opencv_lens(_matrix(data, f"K_{name}", (9,)), _distortion(data, name), fisheye=False)
            size = _size(data, name)
            if size is None:
                size = guessed_size(lens[1][2:4])
                guessed.add(name)
            turn = f"Rot_{name}" if f"Rot_{name}" in data else f"R_{name}"
            rotation = rotation_from(_matrix(data, turn, (3, 9)), turn)
            pose = pose_from(rotation, _matrix(data, f"T_{name}", (3,)))
            cameras.append(make_camera(name, lens, size, pose))
    group, notes = in_metres(make_group(cameras), None, "convert it, EasyMocap is in metres")
    notes = (*notes, *guessed_sizes_note([c for c in group if c.name in guessed]), *left_out_note(no_pose))
    return Calibration(group, "EasyMocap", notes, no_pose, guessed_sizes=frozenset(guessed))


def _names_in(data: dict[str, Any], names: list[Any]) -> list[Any]:
    """The cameras of both files: each has its own sequence, and more may have a lens than a pose."""
    return [*names, *(n for n in data.get(_OTHER_NAMES, ()) if n not in names)]


def _has_pose(data: dict[str, Any], name: str) -> bool:
    return f"T_{name}" in data and (f"R_{name}" in data or f"Rot_{name}" in data)


def _name(value: Any) -> str:
    if isinstance(value, float):  # a name that YAML parses as a number
        return f"{value:g}"
    if not isinstance(value, str) or not value:
        raise Malformed("a name in `names` is no text")
    return value


def _matrix(data: dict[str, Any], key: str, counts: tuple[int, ...]) -> FloatArray:
    if key not in data:
        raise Malformed(f"{key} is missing")
    values = array_of(data, (key,)).ravel()
    if values.size not in counts:
        raise Malformed(f"{key} must have {' or '.join(map(str, counts))} numbers, not {values.size}")
    return values


def _distortion(data: dict[str, Any], name: str) -> FloatArray:
    for key in (f"dist_{name}", f"D_{name}"):
        if key in data:
            return array_of(data, (key,)).ravel()
    return np.zeros(0)


def _size(data: dict[str, Any], name: str) -> tuple[int, int] | None:
    width, height = data.get(f"W_{name}"), data.get(f"H_{name}")
    if width is None or height is None:
        return None
    sizes = pixel_count(number(width, f"W_{name}"), f"W_{name}"), pixel_count(number(height, f"H_{name}"), f"H_{name}")
    return None if min(sizes) < 2 else sizes


def easymocap_texts(cameras: CameraGroup) -> dict[str, str]:
    """The texts of `intri.yml` and `extri.yml`.

    Raises:
        ValueError: a lens with more than five distortion terms, or a name that EasyMocap cannot use.
    """
    for camera in cameras:
        if not camera.name.replace("_", "").replace("-", "").isalnum() or not camera.name.isascii():
            raise ValueError(f"camera {camera.name}: EasyMocap's names are letters, digits, - and _")
    names = "%YAML:1.0\n---\nnames:\n" + "".join(f'  - "{c.name}"\n' for c in cameras)
    intri, extri = [names], [names]
    for camera in cameras:
        intri += [yaml_matrix(f"K_{camera.name}", lens_matrix(camera))]
        intri += [yaml_matrix(f"dist_{camera.name}", np.array(five_terms(camera)))]
        intri += [f"H_{camera.name}: {camera.height}\nW_{camera.name}: {camera.width}\n"]
        extri += [yaml_matrix(f"R_{camera.name}", log_so3(camera.rotation)[:, None])]
        extri += [yaml_matrix(f"Rot_{camera.name}", camera.rotation)]
        extri += [yaml_matrix(f"T_{camera.name}", camera.translation[:, None])]
    return {"intri.yml": "".join(intri), "extri.yml": "".join(extri)}
