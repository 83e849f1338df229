"""A character from a glTF file: VRM, and any other."""

from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.character import Character
from muybridge.motion.character.gltf_meshes import read_materials, read_meshes
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.gltf.clips import clip_names_of
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.rig import Rig, humanoid_joints, read_clip, read_rig, rest_turns
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.joint_frames import motion_of_skeleton, skeleton_at_rest


def read_gltf_character(path: Path, clip: Clip) -> Character:
    """A character from a glTF file; called within `parsing`."""
    document = Document(path)
    rig = read_rig(document)
    order, parents = rig.choice.order, rig.parents
    frames, fps, chosen = read_clip(rig, clip)
    rest = rest_turns(rig)
    in_scene = _rest_places(rig, rest)
    places = in_scene @ BVH_FROM_WORLD
    tips = np.full((len(order), 3), np.nan)
    for i, n in enumerate(order):
        tip = rig.nodes[n].tip
        if tip is not None and i not in parents:
            tips[i] = BVH_FROM_WORLD.T @ rest_linear(rig)[i] @ tip
    skeleton = skeleton_at_rest([rig.nodes[n].name for n in order], parents, BVH_FROM_WORLD.T @ rest, places, tips,
                                BVH_FROM_WORLD.T)  # fmt: skip
    count = max(len(f.place) for f in frames.values())
    motion = motion_of_skeleton(
        skeleton,
        BVH_FROM_WORLD.T @ np.stack([np.broadcast_to(frames[n].turn, (count, 3, 3)) for n in order], axis=1),
        np.stack([np.broadcast_to(frames[n].place, (count, 3)) for n in order], axis=1) @ BVH_FROM_WORLD, fps,
        BVH_FROM_WORLD.T,
    )  # fmt: skip
    meshes, left_out = read_meshes(rig, rest_linear(rig), in_scene)
    return Character(
        path, skeleton, places[0], motion, tuple(meshes), read_materials(document), clip_names_of(document),
        humanoid_joints(rig),
        (*rig.choice.notices, *rig.uneven(frames), *chosen, *left_out), rig,
    )  # fmt: skip


def rest_linear(rig: Rig) -> FloatArray:
    """(J, 3, 3) scene from joint at rest, with the scales of the nodes."""
    still = np.stack([rig.still[n].linear[0] for n in rig.choice.order])
    turns = np.stack([rig.still[n].turn[0] for n in rig.choice.order])
    return np.asarray(rest_turns(rig) @ np.swapaxes(turns, 1, 2) @ still)


def _rest_places(rig: Rig, rest: FloatArray) -> FloatArray:
    """(J, 3) the joints in the scene at rest: as bound, else as below their parents."""
    out = np.zeros((len(rest), 3))
    for i, (n, parent) in enumerate(zip(rig.choice.order, rig.parents, strict=True)):
        still = rig.still[n]
        if n in rig.bound:
            out[i] = rig.bound[n][:3, 3]
        elif parent < 0:
            out[i] = still.place[0]
        else:
            up = rig.still[rig.nodes[n].parent]
            out[i] = out[parent] + rest[parent] @ up.turn[0].T @ (still.place[0] - up.place[0])
    return out
