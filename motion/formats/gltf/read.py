"""Reading a skeleton and its animation from a glTF 2.0 file, whichever program wrote it.

Other programs' joints have axes of their own at rest, are below nodes that rotate and scale everything, slide against
their parents, and have keys at any times. The result has even frames; the joints' own axes are in `Skeleton.axes`.
"""

from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.clip_choice import Clip
from muybridge.motion.formats.gltf.clips import clip_names_of
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.rig import Frame, Rig, humanoid_joints, read_clip, read_rig, rest_turns
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.joint_frames import motion_from_frames
from muybridge.motion.take import Take


def read_gltf(path: Path, clip: Clip = None) -> Motion:
    """Read a file's skeleton and one of its animations into metres, Z up.

    Args:
        path: a `.glb` or `.gltf` file, or a `.vrm` or `.vrma`, which are glTF.
        clip: name or number (from 0) of the animation; None is the first. Without any animation the motion is one
            frame of the nodes without animation.

    Returns:
        A Motion at the frame rate of the keys (30 where there are fewer than two). Its rest pose is the skin's.

    Raises:
        FormatError: malformed, no skeleton, or no such clip (the message lists those there are).
    """
    motion = read_gltf_take(path, clip).motion
    assert motion is not None
    return motion


def read_gltf_take(path: Path, clip: Clip = None) -> Take:
    """As `read_gltf`, with notices of what was chosen and left out."""
    with parsing(path, FormatError, "a glTF 2.0 file", "export_gltf"):
        return _read(Document(Path(path)), clip)


def clip_names(path: Path) -> tuple[str, ...]:
    """The names of a file's animations, in its order.

    Raises:
        FormatError: malformed.
    """
    with parsing(path, FormatError, "a glTF 2.0 file", "export_gltf"):
        return clip_names_of(Document(Path(path)))


def _read(document: Document, clip: Clip) -> Take:
    rig = read_rig(document)
    frames, fps, chosen = read_clip(rig, clip)
    notices = (*rig.choice.notices, *rig.uneven(frames), *chosen)
    return Take(motion=_motion(rig, frames, fps), notices=notices, humanoid=humanoid_joints(rig))


def _motion(rig: Rig, frames: dict[int, Frame], fps: float) -> Motion:
    order, parents, still = rig.choice.order, rig.parents, rig.still
    tips, shifts = np.full((len(order), 3), np.nan), np.full((len(order), 3), np.nan)
    for i, n in enumerate(order):
        tip, up = rig.nodes[n].tip, rig.nodes[n].parent
        if tip is not None and i not in parents:
            tips[i] = still[n].turn[0].T @ still[n].linear[0] @ tip
        if parents[i] >= 0:
            shifts[i] = still[up].turn[0].T @ (still[n].place[0] - still[up].place[0])
        else:
            shifts[i] = still[n].place[0] @ BVH_FROM_WORLD
    count = max(len(f.place) for f in frames.values())
    return motion_from_frames(
        [rig.nodes[n].name for n in order], parents,
        BVH_FROM_WORLD.T @ np.stack([np.broadcast_to(frames[n].turn, (count, 3, 3)) for n in order], axis=1),
        np.stack([np.broadcast_to(frames[n].place, (count, 3)) for n in order], axis=1) @ BVH_FROM_WORLD,
        BVH_FROM_WORLD.T @ rest_turns(rig), tips, fps, BVH_FROM_WORLD.T, shifts,
    )  # fmt: skip
