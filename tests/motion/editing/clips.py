"""Made-up clips for the tests of edits: a walk on skeletons of many kinds."""

from dataclasses import replace

import numpy as np

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, log_so3, matrix_from_quat, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.take import points_of_motion

FPS = 60.0
PERIOD = 66  # frames of a stride


def walk(frames: int = 200) -> Motion:
    """Somebody who walks along -Y, a little to one side and slower and slower, so that no two strides are alike."""
    skeleton = BODY.skeleton(prior_shape(1.74))
    t = np.arange(frames)
    phase, drift = 2 * np.pi * t / PERIOD, t / frames
    vectors = np.zeros((frames, len(skeleton), 3))
    vectors[:, 0, 2] = 0.1 * np.sin(phase) + 0.15 * drift
    vectors[:, skeleton.index("spine"), 0] = 0.05 + 0.02 * np.cos(2 * phase)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = sign * np.sin(phase)
        vectors[:, skeleton.index(f"{side}_upper_arm"), 1] = sign * 1.3
        vectors[:, skeleton.index(f"{side}_upper_arm"), 0] = -0.3 * swing
        vectors[:, skeleton.index(f"{side}_thigh"), 0] = (0.5 - 0.05 * drift) * swing - 0.2
        vectors[:, skeleton.index(f"{side}_shin"), 0] = 0.4 + 0.3 * swing + 0.05 * drift
    x, z = 0.3 + 0.02 * np.sin(phase), 0.95 + 0.02 * np.cos(2 * phase)
    root = np.stack([x, -1.2 * t / FPS + 0.1 * drift**2, z], axis=1)
    return Motion(skeleton, FPS, root, continuous_quat(quat_from_matrix(exp_so3(vectors))))


def uneven() -> Motion:
    """The walk on a skeleton whose left arm hangs at rest, and whose other bones differ by some millimetres."""
    motion = walk()
    skeleton = motion.skeleton
    offsets = skeleton.offsets + np.random.default_rng(1).normal(0, 0.003, skeleton.offsets.shape)
    offsets[0] = 0.0
    down = exp_so3(np.array([0.0, 0.8, 0.0]))
    arm = skeleton.index("left_upper_arm")
    below = skeleton.is_ancestor[arm] & (np.arange(len(skeleton)) != arm)
    offsets[below] = offsets[below] @ down.T
    return replace(motion, skeleton=replace(skeleton, offsets=offsets))


def own_axes() -> Motion:
    """The walk on joints with axes of their own."""
    motion = walk()
    axes = exp_so3(np.random.default_rng(2).normal(0, 1, (len(motion.skeleton), 3)))
    return replace(motion, skeleton=replace(motion.skeleton, axes=axes))


def with_root_bone() -> Motion:
    """The walk of hips that slide on a bone at the origin which does not move; one hand slides too."""
    motion = walk()
    old = motion.skeleton
    skeleton = Skeleton(
        names=("armature", *old.names),
        parents=(-1, *(p + 1 for p in old.parents)),
        offsets=np.concatenate([np.zeros((1, 3)), [[0.0, 0.0, 0.9]], old.offsets[1:]]),
        tips=np.concatenate([np.full((1, 3), np.nan), old.tips]),
        twist_axis=(2, *old.twist_axis),
        lower=np.concatenate([np.full((1, 3), -np.inf), old.lower]),
        upper=np.concatenate([np.full((1, 3), np.inf), old.upper]),
        sliding=(1, hand := 1 + old.index("left_hand")),
    )
    t = np.arange(len(motion))[:, None]
    hand_slides = skeleton.offsets[hand] + 0.02 * np.sin(t / 9.0) * np.array([1.0, 0.5, 0.2])
    quat = np.concatenate([np.tile([1.0, 0, 0, 0], (len(motion), 1, 1)), motion.quat_wxyz], axis=1)
    slides = np.stack([motion.root_positions_world, hand_slides], axis=1)
    return Motion(skeleton, FPS, np.zeros((len(motion), 3)), quat, slides)


def two_roots() -> Motion:
    """The walk with a ball beside it, which has no parent."""
    motion = walk()
    old = motion.skeleton
    skeleton = Skeleton(
        names=(*old.names, "ball"),
        parents=(*old.parents, -1),
        offsets=np.concatenate([old.offsets, [[1.0, 0.0, 0.0]]]),
        tips=np.concatenate([old.tips, np.full((1, 3), np.nan)]),
        twist_axis=(*old.twist_axis, 2),
        lower=np.concatenate([old.lower, np.full((1, 3), -np.inf)]),
        upper=np.concatenate([old.upper, np.full((1, 3), np.inf)]),
        sliding=(len(old),),
    )
    t = np.arange(len(motion)) / FPS
    ball = np.stack([1 + 0.5 * t, np.cos(t), 1 + 0.5 * np.sin(2 * t)], axis=1)[:, None]
    spin = quat_from_matrix(exp_so3(np.stack([t, 0.5 * t, 0 * t], axis=1)))[:, None]
    return Motion(skeleton, FPS, motion.root_positions_world, np.concatenate([motion.quat_wxyz, spin], axis=1), ball)


CLIPS = {
    "body": walk,
    "uneven": uneven,
    "own_axes": own_axes,
    "with_root_bone": with_root_bone,
    "two_roots": two_roots,
}


def points(frames: int = 60) -> Points3D:
    """The joints of the walk as points, some of them missing."""
    out = points_of_motion(walk(frames))
    places = out.points_world.copy()
    places[10:14, 3] = np.nan
    places[0, 5:9] = np.nan
    covariance = np.tile(np.diag([1e-6, 4e-6, 9e-6]), (*places.shape[:2], 1, 1))
    return replace(out, points_world=places, covariance_world=covariance)


def turned_by(a: Motion, b: Motion) -> float:
    """Radians, the largest angle between the joints' rotations of two motions."""
    matrices = np.swapaxes(matrix_from_quat(a.quat_wxyz), -1, -2) @ matrix_from_quat(b.quat_wxyz)
    skew = matrices - np.swapaxes(matrices, -1, -2)  # exact for small angles, unlike the arc cosine of the trace
    near = np.linalg.norm(skew, axis=(-1, -2)) / np.sqrt(8)
    return float(np.maximum(near, np.linalg.norm(log_so3(matrices), axis=-1) * (near > 0.1)).max())


def moved_by(a: Motion, b: Motion) -> float:
    """Metres, the largest difference of the joints' places of two motions."""
    return float(np.abs(a.joint_positions_world() - b.joint_positions_world()).max())
