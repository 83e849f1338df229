"""A character from an FBX file, and the motion of a clip that is written back to it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.character.fbx_meshes import read_material, read_meshes, standing_models
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.fbx.append import model_tracks, write_fbx_clip
from muybridge.motion.formats.fbx.read import FbxRig, even_times, forward, read_rig, rest_turns
from muybridge.motion.formats.fbx.scene import read_scene
from muybridge.motion.formats.fbx.text import read_fbx_document
from muybridge.motion.formats.skeletal.joint_frames import motion_of_skeleton, skeleton_at_rest

Frames = tuple[dict[int, FloatArray], dict[int, FloatArray], dict[int, float]]


@dataclass
class FbxSource:
    """What writing needs of a file: its bytes, its joints, and its models without animation and at rest."""

    data: bytes
    rig: FbxRig
    still: Frames
    rest: FloatArray


def read_fbx_character(path: Path, clip: Clip) -> Character:
    """A character from an FBX file; called within `parsing`."""

    def error(problem: str, remedy: str = "export_fbx") -> FormatError:
        return FormatError(f"{path}: {problem}", remedy=remedy)

    scene = read_scene(read_fbx_document(path), error, clip)
    rig = read_rig(path, scene, clip, error)
    fps, times = even_times(scene, rig.order, error)
    still = forward(rig, np.zeros(1), error, still=True)
    turns, places, _ = forward(rig, times, error)
    joints, rest = rig.joints, rest_turns(rig)
    at_rest = _rest_places(rig, still, rest)
    tips = np.full((len(joints), 3), np.nan)
    for n, end in rig.tips.items():
        shift = scene.metres * still[2][n] * scene.models[end].vectors["Lcl Translation"]
        tips[joints.index(n)] = scene.axes @ rest[n] @ shift
    own = np.stack([rest[n] for n in joints])
    skeleton = skeleton_at_rest([scene.models[n].name for n in joints], rig.parents, scene.axes @ own,
                                scene.metres * at_rest @ scene.axes.T, tips, scene.axes)  # fmt: skip
    motion = motion_of_skeleton(
        skeleton, scene.axes @ np.stack([turns[n] for n in joints], axis=1),
        scene.metres * np.stack([places[n] for n in joints], axis=1) @ scene.axes.T, fps, scene.axes,
    )  # fmt: skip
    sizes = np.array([still[2][n] for n in joints])
    linear = scene.metres * sizes[:, None, None] * (scene.axes @ own)
    meshes, materials, left = read_meshes(rig, linear, scene.metres * at_rest @ scene.axes.T, standing_models(scene))
    notices = [f"{path.name}: {left} meshes hang on no joint and stay as they are"] if left else []
    return Character(
        path, skeleton, scene.metres * scene.axes @ at_rest[0], motion, tuple(meshes),
        tuple(read_material(scene, number, path.parent) for number in materials), scene.clips, {},
        (*rig.notices, *notices), FbxSource(path.read_bytes(), rig, still, own),
    )  # fmt: skip


def _rest_places(rig: FbxRig, still: Frames, rest: dict[int, FloatArray]) -> FloatArray:
    """(J, 3) the joints in the scene at rest: as bound, else as below their parents; in the file's unit."""
    out: dict[int, FloatArray] = {}
    for n in rig.joints:
        up = rig.scene.models[n].parent
        if n in rig.scene.bound and np.isfinite(rig.scene.bound[n]).all():
            out[n] = rig.scene.bound[n][:3, 3]
        elif up in out:
            out[n] = out[up] + rest[up] @ still[0][up][0].T @ (still[1][n][0] - still[1][up][0])
        else:
            out[n] = still[1][n][0]
    return np.stack([out[n] for n in rig.joints])


def write_fbx_character_clip(source: FbxSource, motion: Motion, path: Path, name: str) -> tuple[str, ...]:
    """Write the file of a character again with one more clip; `motion` is of its skeleton."""
    scene = source.rig.scene
    turns, places = motion.skeleton.forward(
        motion.root_positions_world, matrix_from_quat(motion.quat_wxyz), motion.translations
    )
    in_file = scene.axes.T @ turns @ scene.axes @ source.rest
    tracks = model_tracks(source.rig, source.still, in_file, places @ scene.axes / scene.metres)
    write_fbx_clip(source.rig, source.data, tracks, motion.fps, path, name)
    return ()
