"""Human3.6M's cameras in JSON: `intrinsics` by camera, and `extrinsics` by subject and camera.

A lens has `calibration_matrix` (3x3) and `distortion` (k1, k2, p1, p2, k3); a pose `R` (3x3) and `t` (world to camera,
millimetres). The cameras were moved between subjects, so that a file has poses of each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from muybridge.geometry.calibration.formats.common import (
    Calibration,
    Malformed,
    about,
    guessed_size,
    guessed_sizes_note,
    left_out_note,
    make_camera,
    make_group,
    numbers,
    opencv_lens,
    parse_json,
    pose_from,
    rotation_from,
)
from muybridge.geometry.cameras.camera import Camera

_M_PER_MM = 0.001


def read_human36m(text: str, path: Path) -> Calibration:
    """Read the cameras of one subject: the one that the file's name or one of its folders has, else the first.

    Raises:
        Malformed: what is wrong, with camera and field.
    """
    data = parse_json(text)
    lenses, subjects = (data.get(key) if isinstance(data, dict) else None for key in ("intrinsics", "extrinsics"))
    if not isinstance(lenses, dict) or not isinstance(subjects, dict) or not lenses or not subjects:
        raise Malformed("it needs the maps intrinsics (by camera) and extrinsics (by subject and camera)")
    subject, notes = _subject(tuple(subjects), path)
    poses = subjects[subject]
    if not isinstance(poses, dict):
        raise Malformed(f"extrinsics of {subject} is no map of cameras")
    no_pose = tuple(name for name in lenses if name not in poses)
    cameras = []
    for name in (n for n in lenses if n in poses):
        with about(f"camera {name}"):
            cameras.append(_camera(name, lenses[name], poses[name]))
    group = make_group(cameras)
    notes = (*notes, *guessed_sizes_note(list(group)), *left_out_note(no_pose))
    return Calibration(group, "Human3.6M JSON", notes, no_pose, frozenset(group.names))


def _subject(names: tuple[str, ...], path: Path) -> tuple[str, tuple[str, ...]]:
    if len(names) == 1:
        return names[0], ()
    words = {path.stem, *path.resolve().parent.parts}
    named = [n for n in names if n in words]
    subject = named[0] if len(named) == 1 else names[0]
    others = ", ".join(n for n in names if n != subject)
    return subject, (
        f"the cameras of subject {subject} were read, not those of {others}; name the folder or the file after the "
        "subject whose videos these are",
    )


def _camera(name: str, lens: Any, pose: Any) -> Camera:
    if not isinstance(lens, dict) or not isinstance(pose, dict):
        raise Malformed("its intrinsics or extrinsics are no map")
    missing = [k for k, table in (("calibration_matrix", lens), ("R", pose), ("t", pose)) if k not in table]
    if missing:
        raise Malformed(f"{', '.join(missing)} missing")
    matrix = numbers(lens["calibration_matrix"], "calibration_matrix", (9,))
    found = opencv_lens(matrix, numbers(lens.get("distortion", []), "distortion"), fisheye=False)
    rotation = rotation_from(numbers(pose["R"], "R", (9,)), "R")
    moved = numbers(pose["t"], "t", (3,)) * _M_PER_MM
    return make_camera(name, found, guessed_size(found[1][2:4]), pose_from(rotation, moved))
