"""Reading characters of all formats."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.motion.character.character import Character
from muybridge.motion.character.gltf_character import read_gltf_character
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.registry import ReadOptions, can_use, read_file

_GLTF = (".glb", ".gltf", ".vrm", ".vrma")


def read_character(path: Path, clip: Clip = None) -> Character:
    """Read the character of a file: its skeleton in the pose that its meshes are bound in, its meshes and one clip.

    A file of motion alone is a character without meshes.

    Args:
        path: `.glb`, `.gltf`, `.vrm`, `.vrma`, `.fbx`, or any other file of motion.
        clip: name or number (from 0) of the animation to read; None is the first.

    Raises:
        FormatError: malformed, no skeleton, or no such clip (the message lists those there are).
    """
    path = Path(path)
    readers: dict[str, Callable[[Path, Clip], Character]] = dict.fromkeys(_GLTF, read_gltf_character)
    reader = readers.get(path.suffix.lower())
    if reader is None or not path.is_file():
        return _of_motion(path, clip)
    with parsing(path, FormatError, "a file of a character", "export_gltf"):
        return reader(path, clip)


def _of_motion(path: Path, clip: Clip) -> Character:
    take = read_file(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
    if take.motion is None:
        raise FormatError(f"{path}: holds points, no skeleton", remedy="fit_points")
    motion = take.motion
    return Character(path, motion.skeleton, np.zeros(3), motion, notices=take.notices)
