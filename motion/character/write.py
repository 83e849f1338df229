"""Writing a character's file again with one more clip."""

from pathlib import Path

import numpy as np

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.character.fbx_character import FbxSource, write_fbx_character_clip
from muybridge.motion.character.gltf_character import rest_linear
from muybridge.motion.character.read import BvhSource
from muybridge.motion.formats.fbx.container import MAGIC
from muybridge.motion.formats.gltf.append import node_tracks, write_gltf_clip
from muybridge.motion.formats.gltf.rig import Rig
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.bvh_append import write_bvh_motion


def write_character_clip(
    character: Character, motion: Motion, path: Path, name: str, alone: bool = False
) -> tuple[str, ...]:
    """Write a character's file again with one more clip, and nothing else changed.

    A BVH holds one motion, so there the clip takes its place; the hierarchy stays to the letter.

    Args:
        character: as read.
        motion: its joints and their parents are the character's; any of them may slide. At least one frame.
        path: the file to write, of the format of the character's; not the character's own.
        name: of the clip, which no other clip of the file has.
        alone: whether it takes the place of the clips of a glTF file, as in a VRM animation, of which players show the
            first one.

    Returns:
        What else had to change, or could not be kept, one sentence each.

    Raises:
        FormatError: the motion is of another skeleton, is empty or holds numbers that are not finite, the name is
            taken, or the format cannot hold the clip.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    _check(character, motion, path, name, alone)
    rig = character.source
    if isinstance(rig, Rig):
        turns, places = motion.skeleton.forward(
            motion.root_positions_world, matrix_from_quat(motion.quat_wxyz), motion.translations
        )
        in_scene = BVH_FROM_WORLD @ turns @ BVH_FROM_WORLD.T
        tracks = node_tracks(rig, rest_linear(rig), in_scene, places @ BVH_FROM_WORLD.T)
        return write_gltf_clip(rig, tracks, motion.fps, path, name, alone)
    if isinstance(rig, FbxSource):
        return write_fbx_character_clip(rig, motion, path, name)
    if isinstance(rig, BvhSource):
        return write_bvh_motion(character.path, rig.text, rig.metres, motion, path)
    raise AssertionError("checked before")


def check_takes_clips(character: Character) -> None:
    """Check that a clip can be written into the character's file.

    Raises:
        FormatError: it cannot.
    """
    source, path = character.source, character.path
    if isinstance(source, FbxSource) and not source.data.startswith(MAGIC):
        raise FormatError(f"{path} is FBX as text, which gets no clip", remedy="resave_fbx")
    if not isinstance(source, Rig | FbxSource | BvhSource):
        raise FormatError(f"{path}: {path.suffix} cannot hold one more clip; valid are .glb, .gltf, .vrm, .vrma, .fbx "
                          "and .bvh")  # fmt: skip


def _check(character: Character, motion: Motion, path: Path, name: str, alone: bool) -> None:
    check_takes_clips(character)
    own, given = character.skeleton, motion.skeleton
    if path.suffix.lower() != character.path.suffix.lower():
        raise FormatError(f"{path}: a clip for {character.path.name} is written to a {character.path.suffix.lower()}")
    if path.resolve() == character.path.resolve() or path.exists() and path.samefile(character.path):
        raise FormatError(f"{path}: is the character's own file, which stays as it is", remedy="other_name")
    if given.names != own.names or given.parents != own.parents:
        other = next((n for n in given.names if n not in own.names), given.names[0])
        raise FormatError(f"{path}: the motion is of another skeleton ({len(given)} joints, such as {other!r}) than "
                          f"{character.path.name} ({len(own)} joints, such as {own.names[0]!r})")  # fmt: skip
    if not len(motion):
        raise FormatError(f"{path}: the motion has no frames; a clip needs at least one")
    if not name or name in character.clips and not alone:
        taken = f"{character.path.name} has a clip {name!r} already" if name else "a clip needs a name"
        raise FormatError(f"{path}: {taken}", remedy="other_name")
    bad = np.asarray(~np.isfinite(motion.quat_wxyz).all(axis=-1))
    bad[:, 0] |= ~np.isfinite(motion.root_positions_world).all(axis=-1)
    if motion.translations is not None:
        bad[:, list(given.sliding)] |= ~np.isfinite(motion.translations).all(axis=-1)
    if bad.any():
        t, j = np.argwhere(bad)[0]
        raise FormatError(f"{path}: the motion of {given.names[j]!r} is not finite in frame {t + 1}")
