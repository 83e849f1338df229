"""OpenSim's coordinates: joint angles over time, under the names and signs of the Rajagopal 2016 full-body model.

Angles are about OpenSim's axes (X forward, Y up, Z to the right) in its order Z, X, Y: flexion, adduction, rotation.
All zero is upright with the arms at the sides. Ground is that of our TRC files, so that both may be loaded together. A
motion whose joints are of no known role becomes three angles per joint, `<joint>_rz`, `_rx`, `_ry`, from its own rest
pose.

What is lost: bone lengths (scale the model with the TRC); the division of the trunk's bend between its joints; neck,
head and collar bones, which the model does not have; slight angles out of the hinges of knee and elbow.

Source: A. Rajagopal and others, "Full-body musculoskeletal model for muscle-driven simulation of human gait", IEEE
Transactions on Biomedical Engineering 63, 2016.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, matrix_from_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import roles_of
from muybridge.geometry.skeleton.skeleton import Skeleton, require_one_rigid_tree
from muybridge.motion.formats.points.trc import WORLD_AXIS_OF_TRC
from muybridge.motion.formats.skeletal.euler import smooth_euler

GROUND_FROM_WORLD = np.eye(3)[list(WORLD_AXIS_OF_TRC)]
# A body's own axes: ours at rest face -Y with the left at +X; OpenSim's face +X with the right at +Z.
BODY_FROM_REST = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
# The middle of the model's hips in its pelvis, and half their distance.
_HIPS_IN_PELVIS, _HALF_HIPS = np.array([-0.056276, -0.07849, 0.0]), 0.07726
_NEEDED = ("hips", *(f"{s}_{p}" for s in ("left", "right") for p in ("thigh", "shin", "foot", "upper_arm", "forearm")))
# joint: (its parent in the model, coordinates about Z, X, Y and their signs on the right side, and on the left)
_JOINTS: dict[str, tuple[str, tuple[str, str, str], tuple[int, int, int], tuple[int, int, int]]] = {
    "thigh": ("hips", ("hip_flexion", "hip_adduction", "hip_rotation"), (1, 1, 1), (1, -1, -1)),
    "shin": ("thigh", ("knee_angle", "", ""), (-1, 1, 1), (-1, 1, 1)),
    "foot": ("shin", ("ankle_angle", "subtalar_angle", ""), (1, 1, 1), (1, -1, 1)),
    "upper_arm": ("torso", ("arm_flex", "arm_add", "arm_rot"), (1, 1, 1), (1, -1, -1)),
    "forearm": ("upper_arm", ("elbow_flex", "", "pro_sup"), (1, 1, 1), (1, 1, -1)),
}
_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
_LUMBAR = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
_PLACE = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
# Names of the model's coordinates that a motion of ours is written to and read from.
MODEL_COORDINATES = frozenset(
    (
        *_PELVIS,
        *_LUMBAR,
        *_PLACE,
        *(f"{n}_{s}" for _, names, _, _ in _JOINTS.values() for n in names if n for s in "rl"),
    )
)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Generalised coordinates over time.

    Attributes:
        names: (N,)
        times: (T,) seconds.
        values: (T, N): metres for translations, radians for angles if the file has its angles in degrees; as they
            stand in the file otherwise.
    """

    names: tuple[str, ...]
    times: FloatArray
    values: FloatArray


def coordinates_of(motion: Motion) -> Coordinates:
    """A motion's coordinates: the model's where the joints' roles are known, else three angles per joint.

    Raises:
        ValueError: the motion has several roots, or joints that slide.
    """
    require_one_rigid_tree(motion.skeleton, "a table of joint angles")
    times = np.arange(len(motion)) / motion.fps
    roles = roles_of(motion.skeleton.names)
    if not all(r in roles for r in _NEEDED):
        return _plain_coordinates(motion, times)
    turns = _standing(motion, roles)
    names: list[str] = []
    columns: list[FloatArray] = []

    def add(wanted: tuple[str, ...], matrices: FloatArray, signs: tuple[int, int, int] = (1, 1, 1)) -> None:
        angles = smooth_euler(np.roll(quat_from_matrix(matrices), -1, -1)[:, None], "ZXY")[:, 0] * signs
        for k, name in enumerate(wanted):
            if name:
                # A whole turn more or less is the same pose; the first frame is within half a turn.
                turn = 2 * np.pi * np.round(angles[0, k] / (2 * np.pi)) if len(angles) else 0.0
                names.append(name)
                columns.append(angles[:, k] - turn)

    add(_PELVIS, turns["hips"])
    middle, scale = _hips(motion.skeleton, roles)
    hips_world = matrix_from_quat(motion.quat_wxyz[:, 0]) @ middle + motion.root_positions_world
    pelvis = hips_world @ GROUND_FROM_WORLD.T - turns["hips"] @ (_HIPS_IN_PELVIS * scale)
    names += _PLACE
    columns += list(pelvis.T)
    add(_LUMBAR, _between(turns["hips"], turns["torso"]))
    for side, suffix in (("right", "_r"), ("left", "_l")):
        for part, (parent, wanted, right, left) in _JOINTS.items():
            above = turns[parent] if parent in ("hips", "torso") else turns[f"{side}_{parent}"]
            signs = right if side == "right" else left
            add(tuple(f"{n}{suffix}" if n else "" for n in wanted), _between(above, turns[f"{side}_{part}"]), signs)
    return Coordinates(tuple(names), times, np.stack(columns, axis=1))


def _between(above: FloatArray, below: FloatArray) -> FloatArray:
    return np.asarray(np.swapaxes(above, -1, -2) @ below)


def _hips(skeleton: Skeleton, roles: Mapping[str, int]) -> tuple[FloatArray, float]:
    """The middle of the hips from the root at rest, (3,) metres, and how wide they are against the model's."""
    rest = skeleton.rest_positions
    left, right = rest[roles["left_thigh"]], rest[roles["right_thigh"]]
    return np.asarray((left + right) / 2), float(np.linalg.norm(left - right)) / 2 / _HALF_HIPS


def _zero_from_rest(skeleton: Skeleton, roles: Mapping[str, int]) -> dict[str, FloatArray]:
    """For each limb the rotation (3, 3) that takes the model's upright pose, arms down, to the rest pose."""
    out = {}
    for role, j in roles.items():
        part = role.partition("_")[2]
        if part in ("thigh", "shin", "upper_arm", "forearm"):
            children = [k for k, p in enumerate(skeleton.parents) if p == j and skeleton.bone_lengths[k] > 1e-6]
            bone = skeleton.offsets[children[0]] if children else skeleton.tips[j]
            if "arm" in part:
                side = 1.0 if role.startswith("left") else -1.0
                raised = scipy.spatial.transform.Rotation.from_rotvec([0.0, -side * np.pi / 2, 0.0]).as_matrix()
                out[role] = _swing(np.array([side, 0.0, 0.0]), bone) @ raised
            else:
                out[role] = _swing(np.array([0.0, 0.0, -1.0]), bone)
    return out


def _swing(usual: FloatArray, bone: FloatArray) -> FloatArray:
    """The smallest rotation from one direction to the other."""
    length = float(np.linalg.norm(bone))
    if not length > 1e-6:
        return np.eye(3)
    axis = np.cross(usual, bone / length)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return np.asarray(
        scipy.spatial.transform.Rotation.from_rotvec(axis / sine * np.arctan2(sine, usual @ bone / length)).as_matrix()
    )


def _standing(motion: Motion, roles: Mapping[str, int]) -> dict[str, FloatArray]:
    """Orientations (T, 3, 3) of the model's bodies in ground, by the role of the joint that turns them."""
    skeleton = motion.skeleton
    world, _ = skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))
    zero = _zero_from_rest(skeleton, roles)
    torso = next((r for r in ("upper_chest", "chest", "spine") if r in roles), "hips")
    wanted = {r: roles[r] for r in _NEEDED} | {"torso": roles[torso]}
    return {
        role: GROUND_FROM_WORLD @ world[:, j] @ zero.get(role, np.eye(3)) @ BODY_FROM_REST.T
        for role, j in wanted.items()
    }


def _plain_coordinates(motion: Motion, times: FloatArray) -> Coordinates:
    matrices = BODY_FROM_REST @ matrix_from_quat(motion.quat_wxyz) @ BODY_FROM_REST.T
    matrices[:, 0] = GROUND_FROM_WORLD @ matrix_from_quat(motion.quat_wxyz[:, 0]) @ BODY_FROM_REST.T
    angles = smooth_euler(np.roll(quat_from_matrix(matrices), -1, -1), "ZXY")
    root = motion.skeleton.names[0]
    names = [f"{root}_t{axis}" for axis in "xyz"]
    names += [f"{n}_r{axis}" for n in motion.skeleton.names for axis in "zxy"]
    place = motion.root_positions_world @ GROUND_FROM_WORLD.T
    values = np.concatenate([place, angles.reshape(len(angles), -1)], axis=1)
    return Coordinates(tuple("_".join(n.split()) for n in names), times, values)


def motion_of(coordinates: Coordinates, skeleton: Skeleton) -> Motion:
    """A skeleton moved by the model's coordinates; joints without coordinates stay at rest.

    Args:
        coordinates: under the model's names; one that is missing is zero.
        skeleton: joints of known roles; the trunk's whole bend is given to its lowest joint.

    Raises:
        ValueError: the skeleton lacks a role that is needed, or the times are not even.
    """
    roles = roles_of(skeleton.names)
    missing = [r for r in _NEEDED if r not in roles]
    steps = np.diff(coordinates.times)
    if missing or len(steps) and np.ptp(steps) > 1e-3 * steps.mean():
        raise ValueError(f"the skeleton lacks {', '.join(missing)}" if missing else "the times are not even")
    at = {n: coordinates.values[:, i] for i, n in enumerate(coordinates.names)}
    nothing = np.zeros(len(coordinates.times))

    def turned(names: tuple[str, ...], signs: tuple[int, int, int] = (1, 1, 1)) -> FloatArray:
        angles = np.stack([at.get(n, nothing) for n in names], axis=1) * signs
        return np.asarray(scipy.spatial.transform.Rotation.from_euler("ZXY", angles).as_matrix())

    zero = _zero_from_rest(skeleton, roles)
    ground = {"hips": turned(_PELVIS)}
    ground["torso"] = ground["hips"] @ turned(_LUMBAR)
    for side, suffix in (("right", "_r"), ("left", "_l")):
        for part, (parent, names, right, left) in _JOINTS.items():
            above = ground[parent] if parent in ("hips", "torso") else ground[f"{side}_{parent}"]
            here = tuple(f"{n}{suffix}" if n else "" for n in names)
            ground[f"{side}_{part}"] = above @ turned(here, right if side == "right" else left)
    lowest = next((r for r in ("spine", "chest", "upper_chest") if r in roles), None)
    world: dict[int, FloatArray] = {}
    for role, turns in ground.items():
        bone = roles.get(lowest or "" if role == "torso" else role)
        if bone is not None:
            world[bone] = GROUND_FROM_WORLD.T @ turns @ BODY_FROM_REST @ zero.get(role, np.eye(3)).T
    local = np.tile(np.eye(3), (len(nothing), len(skeleton), 1, 1))
    for j, above_j in enumerate(skeleton.parents):
        if above_j < 0:
            local[:, j] = world[j]
        else:
            world.setdefault(j, world[above_j])
            local[:, j] = np.swapaxes(world[above_j], 1, 2) @ world[j]
    pelvis = np.stack([at.get(n, nothing) for n in _PLACE], axis=1)
    middle, scale = _hips(skeleton, roles)
    root = (pelvis + ground["hips"] @ (_HIPS_IN_PELVIS * scale)) @ GROUND_FROM_WORLD - world[0] @ middle
    fps = 1.0 / float(steps.mean()) if len(steps) else 100.0
    return Motion(skeleton, fps, root, continuous_quat(quat_from_matrix(local)))
