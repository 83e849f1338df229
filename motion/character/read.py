"""Reading characters of all formats."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.motion.character.character import Character
from muybridge.motion.character.fbx_character import read_fbx_character
from muybridge.motion.character.gltf_character import read_gltf_character
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.registry import ReadOptions, can_use, read_file
from muybridge.motion.formats.skeletal.bvh import metres_per_unit_of, read_bvh
from muybridge.motion.formats.skeletal.rigid import check_room

_KINDS = (("a glTF 2.0 file", "export_gltf"), ("an FBX", "resave_fbx"))
_GLTF = (".glb", ".gltf", ".vrm", ".vrma")


@dataclass(frozen=True)
class BvhSource:
    """What writing needs of a BVH: its text, and the metres that a unit is."""

    text: str
    metres: float


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
    readers[".fbx"] = read_fbx_character
    reader = readers.get(path.suffix.lower())
    if reader is None or not path.is_file():
        return _of_motion(path, clip)
    with parsing(path, FormatError, *_KINDS[reader is read_fbx_character]):
        character = reader(path, clip)
        _check(character)
        return character


def _check(character: Character) -> None:
    """FormatError where a joint is beyond any room, or a mesh holds numbers that are not finite."""
    check_room(character.path, character.motion)
    for mesh in character.meshes:
        arrays = (mesh.positions, mesh.weights, mesh.bind, mesh.normals, mesh.uvs, *(m.offsets for m in mesh.morphs))
        if not all(np.isfinite(a).all() for a in arrays if a is not None):
            raise FormatError(f"{character.path}: the mesh {mesh.name!r} holds numbers that are not finite")


def _of_motion(path: Path, clip: Clip) -> Character:
    take = read_file(path, ReadOptions(clip=clip if can_use(path, "clip") else None))
    if take.motion is None:
        raise FormatError(f"{path}: holds points, no skeleton", remedy="fit_points")
    skeleton, source = take.motion.skeleton, None
    if path.suffix.lower() == ".bvh":
        source = BvhSource(path.read_bytes().decode("utf-8-sig"), metres_per_unit_of(path, read_bvh(path))[0])
    skeleton = replace(skeleton, sliding=tuple(j for j in skeleton.sliding if skeleton.parents[j] < 0))
    return Character(path, skeleton, np.zeros(3), take.motion, notices=take.notices, source=source)
