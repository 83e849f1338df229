"""anny's bodies as the marker solver represents them: fewer joints, T-pose at rest, markers carried by joints.

A *role* is a joint of `geometry.skeleton.body.BODY`; in addition there is the roll of a forearm, which rotates the
wrist's markers as pronation does. A joint's axes are the world's in the T-pose: limbs are rotated into it so that arms
point sideways, legs down, and elbow and knee bend about one axis.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import roles_of
from muybridge.train.synthesis.motions.rig import SkinnedBody, between, forward, turn, unit

# Per joint: the bone at whose origin it is, and the bone that rotates with it ("*" is the side).
_BONES = {
    "hips": ("root", "root"), "spine": ("spine04", "spine03"), "chest": ("spine02", "spine01"),
    "neck": ("neck01", "neck02"), "head": ("head", "head"),
    "clavicle": ("clavicle.*", "clavicle.*"), "upper_arm": ("upperarm01.*", "upperarm01.*"),
    "forearm": ("lowerarm01.*", "lowerarm01.*"), "forearm_roll": ("lowerarm01.*", "lowerarm02.*"),
    "hand": ("wrist.*", "wrist.*"), "thigh": ("upperleg01.*", "upperleg01.*"),
    "shin": ("lowerleg01.*", "lowerleg01.*"), "foot": ("foot.*", "foot.*"), "toe": ("toe2-1.*", "foot.*"),
}  # fmt: skip


def _tree() -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and parents: BODY's, and a roll joint before each hand."""
    names: list[str] = []
    above: list[str] = []
    for name, parent in zip(BODY.joint_names, BODY.parents, strict=True):
        if name.endswith("hand"):
            names.append(name.replace("hand", "forearm_roll"))
            above.append(BODY.joint_names[parent])
            above.append(names[-1])
        else:
            above.append(BODY.joint_names[parent] if parent >= 0 else "")
        names.append(name)
    return tuple(names), tuple(names.index(p) if p else -1 for p in above)


NAMES, PARENTS = _tree()
# Indices of the joints of BODY.
BODY_JOINTS = np.array([NAMES.index(n) for n in BODY.joint_names])


@dataclass(frozen=True)
class Rig:
    """One body.

    Attributes:
        origin, turner: (J,) bones that give each joint's position and rotation.
        align: (J, 3, 3) rotations from anny's rest pose into the T-pose.
        offsets: (J, 3) metres from the parent, T-pose.
    """

    origin: IndexArray
    turner: IndexArray
    align: FloatArray
    offsets: FloatArray


def bones_of(bones: tuple[str, ...]) -> tuple[IndexArray, IndexArray]:
    """The bones that give every joint's position and rotation, indices into anny's bones."""
    found = []
    for name in NAMES:
        side = {"left": "L", "right": "R"}.get(name.split("_")[0], "")
        pair = _BONES[name.split("_", 1)[1] if side else name]
        found.append([bones.index(b.replace("*", side)) for b in pair])
    origin, turner = np.array(found, np.intp).T
    return origin, turner


def rig_of(bones: tuple[str, ...], rest: FloatArray) -> Rig:
    """The rig of a body with anny's bones at `rest` (bones, 3) metres."""
    origin, turner = bones_of(bones)
    at = rest[origin]
    align = np.tile(np.eye(3), (len(NAMES), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):

        def place(part: str, side: str = side) -> int:
            return NAMES.index(f"{side}_{part}")

        shoulder, elbow, wrist = (at[place(p)] for p in ("upper_arm", "forearm", "hand"))
        hinge = np.cross(elbow - shoulder, wrist - elbow)
        arm, axis = np.array([sign, 0, 0]), np.array([0, 0, -sign])
        align[place("upper_arm")] = _rotation_onto(elbow - shoulder, hinge, arm, axis)
        for part in ("forearm", "forearm_roll", "hand"):
            align[place(part)] = _rotation_onto(wrist - elbow, hinge, arm, axis)
        hip, knee, ankle = (at[place(p)] for p in ("thigh", "shin", "foot"))
        x, down = np.array([1.0, 0, 0]), np.array([0, 0, -1.0])
        align[place("thigh")] = _rotation_onto(knee - hip, x, down, x)
        align[place("shin")] = _rotation_onto(ankle - knee, x, down, x)
    offsets = np.zeros((len(NAMES), 3))
    for j, parent in enumerate(PARENTS[1:], 1):
        offsets[j] = align[parent] @ (at[j] - at[parent])
    return Rig(origin, turner, align, offsets)


def _rotation_onto(first: FloatArray, second: FloatArray, first_to: FloatArray, second_to: FloatArray) -> FloatArray:
    """The rotation that takes one direction to another, and a second one as near as possible to its target."""
    return _frame(first_to, second_to) @ _frame(first, second).T


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    x = unit(first)
    y = unit(second - (second @ x) * x)
    return np.stack([x, y, np.cross(x, y)], -1)


def joints_of(rig: Rig, body: SkinnedBody, rotvec: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World orientations (T, J, 3, 3) and positions (T, J, 3) of the joints for a motion of `body`."""
    rotations, origins = forward(body, turn(rotvec), root)
    return rotations[:, rig.turner] @ np.swapaxes(rig.align, -1, -2), origins[:, rig.origin]


def follow(body: SkinnedBody, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """A recorded motion retargeted to one of anny's bodies: rotation vectors (T, bones, 3), `local-ref`, and root
    positions (T, 3).

    Bones point as in the recording; the bend of the back is distributed over its five bones, that of the neck over its
    four, and pronation goes to the forearm. The root's height is scaled with the length of the legs.

    Args:
        body: the body.
        motion: of a skeleton whose names and rest pose (T-pose, facing -Y) are known.

    Raises:
        ValueError: required joints are missing.
    """
    skeleton, roles = motion.skeleton, roles_of(motion.skeleton.names)
    needed = ("hips", "chest", "head", *(f"{s}_{p}" for s in ("left", "right")
              for p in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")))  # fmt: skip
    if missing := [n for n in needed if n not in roles]:
        raise ValueError(f"the motion's skeleton has no {', '.join(missing)}")
    poses = motion.forward()
    rig = rig_of(body.bones, body.rest)
    rotations = np.tile(np.eye(3), (len(poses), len(body.bones), 1, 1))
    world = {"root": poses[:, roles["hips"], :3, :3]}
    top = next(roles[r] for r in ("upper_chest", "chest") if r in roles)
    _interpolate(world, ("spine05", "spine04", "spine03", "spine02", "spine01"), world["root"], poses[:, top, :3, :3])
    _interpolate(world, ("neck01", "neck02", "neck03", "head"), world["spine01"], poses[:, roles["head"], :3, :3])
    rest = skeleton.rest_positions
    for side, letter in (("left", "L"), ("right", "R")):
        rest_rotation = _rest_rotations(skeleton, roles, rest, motion, side)
        for part in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot"):
            bone = _BONES[part][1].replace("*", letter)
            align = rig.align[NAMES.index(f"{side}_{part}")]
            world[bone] = poses[:, roles[f"{side}_{part}"], :3, :3] @ rest_rotation[part] @ align
        forearm, hand = world[f"lowerarm01.{letter}"], world[f"wrist.{letter}"]
        axis = unit(body.at(f"wrist.{letter}") - body.at(f"lowerarm01.{letter}"))
        world[f"lowerarm02.{letter}"] = forearm @ _twist(np.swapaxes(forearm, -1, -2) @ hand, axis)
    for i, bone in enumerate(body.bones):
        parent = body.parents[i]
        if bone in world:
            above = rotations[:, parent] if parent >= 0 else np.eye(3)
            rotations[:, i] = world[bone]
            world[bone] = np.swapaxes(np.broadcast_to(above, rotations[:, i].shape), -1, -2) @ rotations[:, i]
        else:
            rotations[:, i] = rotations[:, parent]
    local = np.tile(np.eye(3), (len(poses), len(body.bones), 1, 1))
    for bone, value in world.items():
        local[:, body.bones.index(bone)] = value
    hips = poses[..., :3, 3][:, [roles["left_thigh"], roles["right_thigh"]]].mean(1)
    leg = sum(float(np.linalg.norm(skeleton.offsets[roles[f"left_{p}"]])) for p in ("shin", "foot"))
    ours = float(np.linalg.norm(rig.offsets[NAMES.index("left_shin")]) + np.linalg.norm(
        rig.offsets[NAMES.index("left_foot")]))  # fmt: skip
    shape = local.shape[:2]
    return Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(*shape, 3), hips * ours / leg


def _interpolate(world: dict[str, FloatArray], bones: tuple[str, ...], start: FloatArray, end: FloatArray) -> None:
    """Orientations between two, in equal steps."""
    step = Rotation.from_matrix(np.swapaxes(start, -1, -2) @ end).as_rotvec()
    for k, bone in enumerate(bones, 1):
        world[bone] = start @ Rotation.from_rotvec(step * k / len(bones)).as_matrix()


def _rest_rotations(
    skeleton: object, roles: dict[str, int], rest: FloatArray, motion: Motion, side: str
) -> dict[str, FloatArray]:
    """Rotations of the recording's rest pose relative to the T-pose, by part: bone directions and the axis of the
    elbow."""
    sign = 1.0 if side == "left" else -1.0

    def bone(a: str, b: str) -> FloatArray:
        return unit(rest[roles[f"{side}_{b}"]] - rest[roles[f"{side}_{a}"]])

    out = {}
    elbow = Rotation.from_quat(motion.quat_wxyz[:, roles[f"{side}_forearm"]][:, [1, 2, 3, 0]]).as_rotvec()
    axis = np.linalg.svd(elbow, full_matrices=False)[2][0]
    spread = float(np.sqrt(np.mean(elbow**2)))
    axis = axis * -sign * np.sign(axis[2]) if spread > 0.05 and abs(axis[2]) > 0.3 else np.array([0, 0, -sign])
    arm = np.array([sign, 0.0, 0.0])
    out["upper_arm"] = _rotation_onto(arm, np.array([0, 0, -sign]), bone("upper_arm", "forearm"), axis)
    out["forearm"] = out["hand"] = _rotation_onto(arm, np.array([0, 0, -sign]), bone("forearm", "hand"), axis)
    down = np.array([0, 0, -1.0])
    out["thigh"] = turn(between(down, bone("thigh", "shin"))[None])[0]
    # A foot's axes are rotated like the shin's: a recording's rest pose may have the legs apart.
    out["shin"] = out["foot"] = turn(between(down, bone("shin", "foot"))[None])[0]
    return out


def _twist(rotations: FloatArray, axis: FloatArray) -> FloatArray:
    """The rotation of `rotations` (T, 3, 3) about `axis` (3,)."""
    quat = Rotation.from_matrix(rotations).as_quat()
    along = quat[:, :3] @ axis
    angle = 2 * np.arctan2(along, quat[:, 3])
    return np.asarray(Rotation.from_rotvec(angle[:, None] * axis).as_matrix())
