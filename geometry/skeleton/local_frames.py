"""A skeleton and its motion as animation files store them: each joint's frame in its parent's, both in own axes."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton


def own_axes(skeleton: Skeleton, world_from_file: FloatArray | None = None) -> FloatArray:
    """(J, 3, 3) world from joint at rest.

    Args:
        skeleton: any.
        world_from_file: (3, 3) the axes of the file, which joints without axes of their own have; None: the world's.
    """
    if skeleton.axes is not None:
        return skeleton.axes
    return np.tile(np.eye(3) if world_from_file is None else world_from_file, (len(skeleton), 1, 1))


def rest_frames(skeleton: Skeleton, world_from_file: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Rotations (J, 3, 3) parent from joint, and translations (J, 3) metres in the parent's axes, at rest.

    Args:
        skeleton: any; a root's parent is the file, with the first root at its origin.
        world_from_file: (3, 3) the axes of the file; None: the world's.
    """
    own = own_axes(skeleton, world_from_file)
    to_parent = _to_parent(skeleton, own, world_from_file)
    return np.asarray(to_parent @ own), np.asarray((to_parent @ skeleton.offsets[..., None])[..., 0])


def motion_frames(motion: Motion, world_from_file: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, J, 3, 3) parent from joint, and translations (T, J, 3) metres in the parent's axes, over time.

    Args:
        motion: any; a root's parent is the file.
        world_from_file: (3, 3) the axes of the file; None: the world's.
    """
    skeleton = motion.skeleton
    own = own_axes(skeleton, world_from_file)
    to_parent = _to_parent(skeleton, own, world_from_file)
    places = np.tile(skeleton.offsets, (len(motion), 1, 1))
    places[:, 0] = motion.root_positions_world
    if motion.translations is not None:
        places[:, list(skeleton.sliding)] = motion.translations
    rotations = to_parent @ matrix_from_quat(motion.quat_wxyz) @ own
    return np.asarray(rotations), np.asarray((to_parent @ places[..., None])[..., 0])


def _to_parent(skeleton: Skeleton, own: FloatArray, world_from_file: FloatArray | None) -> FloatArray:
    """(J, 3, 3) each parent's own axes from the world at rest."""
    top = np.eye(3) if world_from_file is None else world_from_file
    above = np.stack([top if p < 0 else own[p] for p in skeleton.parents])
    return np.asarray(np.swapaxes(above, 1, 2))
