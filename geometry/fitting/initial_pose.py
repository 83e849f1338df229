"""A first pose in closed form: the trunk from hips and shoulders, each limb from the plane it spans.

What it is given has no gaps in time; a landmark that was never seen is NaN throughout, and the joints that
would follow from it keep the prior's angle.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import (
    exp_so3,
    kabsch,
    log_so3,
    matrix_from_swing_twist,
    swing_twist_from_matrix,
)
from muybridge.geometry.skeleton.body import BodyModel


def start_pose(
    model: BodyModel, shape: FloatArray, points_world: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Root position, root rotation and joint angles of every frame.

    Args:
        model: the body.
        shape: (S,) metres.
        points_world: (T, L, 3) metres in the order of `model.landmark_names`.

    Returns:
        (T, 3) metres, (T, 3, 3) world from root, (T, J, 3) swing and twist angles within the joints' limits.
    """
    landmark = {name: points_world[:, i] for i, name in enumerate(model.landmark_names)}
    t_count = len(points_world)
    angles = np.tile(np.clip(model.rest, model.lower, model.upper), (t_count, 1, 1))
    angles[:, 0] = 0.0
    skeleton = model.skeleton(shape)
    joint = skeleton.names.index

    def put(name: str, parent_world: FloatArray, world: FloatArray) -> FloatArray:
        """Set a joint as near to the orientation `world` as its limits allow; returns its orientation in the world."""
        j = joint(name)
        local = np.swapaxes(parent_world, -1, -2) @ world
        angle = np.clip(swing_twist_from_matrix(local, skeleton.twist_axis[j]), model.lower[j], model.upper[j])
        known = np.all(np.isfinite(angle), axis=-1)
        angles[known, j] = angle[known]
        return np.asarray(parent_world @ matrix_from_swing_twist(angles[:, j], skeleton.twist_axis[j]))

    hips_world, shoulders_world, middle = _trunk(landmark)
    root_rotation = hips_world
    bend = exp_so3(0.5 * log_so3(np.swapaxes(hips_world, -1, -2) @ shoulders_world))
    spine_world = put("spine", hips_world, hips_world @ bend)
    chest_world = put("chest", spine_world, spine_world @ bend)
    head_world = _rigid(model, shape, "head", landmark, ("nose", "ear", "eye"), chest_world)
    if head_world is not None:
        nod = exp_so3(0.5 * log_so3(np.swapaxes(chest_world, -1, -2) @ head_world))
        put("head", put("neck", chest_world, chest_world @ nod), head_world)
    for side, sign in (("left_", 1.0), ("right_", -1.0)):
        clavicle_world = put(side + "clavicle", chest_world, chest_world)
        upper, fore = _limb(landmark, side, ("shoulder", "elbow", "wrist"), clavicle_world, 0, sign)
        if upper is not None:
            arm_world = put(side + "upper_arm", clavicle_world, upper)
            put(side + "forearm", arm_world, arm_world if fore is None else fore)
        upper, lower = _limb(landmark, side, ("hip", "knee", "ankle"), hips_world, 2, -1.0)
        if upper is not None:
            thigh_world = put(side + "thigh", hips_world, upper)
            shin_world = put(side + "shin", thigh_world, thigh_world if lower is None else lower)
            foot = _rigid(model, shape, side + "foot", landmark, ("ankle", "heel", "toe"), shin_world)
            if foot is not None:
                put(side + "foot", shin_world, foot)
    return middle, root_rotation, angles


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def _across(vectors: FloatArray, axis: FloatArray) -> FloatArray:
    """The components of `vectors` at right angles to the unit vectors `axis`."""
    return np.asarray(vectors - np.sum(vectors * axis, axis=-1, keepdims=True) * axis)


def _frame(axis_index: int, axis: FloatArray, back: FloatArray) -> FloatArray:
    """(T, 3, 3) rotations with `axis` as x or z and y as near to `back` as possible."""
    y = _unit(_across(back, axis))
    if axis_index == 0:
        return np.stack([axis, y, np.cross(axis, y)], axis=-1)
    return np.stack([np.cross(y, axis), y, axis], axis=-1)


def _trunk(landmark: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """World from hips, world from shoulders, and the middle of the hips; hips or shoulders may be unknown."""
    known = {k: landmark[f"left_{k}"] + landmark[f"right_{k}"] for k in ("hip", "shoulder")}
    line = {k: landmark[f"left_{k}"] - landmark[f"right_{k}"] for k in ("hip", "shoulder")}
    has = {k: bool(np.isfinite(v).all()) for k, v in known.items()}
    if has["hip"] and has["shoulder"]:
        up = _unit(known["shoulder"] - known["hip"])
        # Shoulders turn the hips a little as well: a short hip line is the noisier one.
        across_hips = _unit(_across(line["hip"], up)) + 0.5 * _unit(_across(line["shoulder"], up))
        across = {"hip": across_hips, "shoulder": line["shoulder"]}
    else:
        one = "hip" if has["hip"] else "shoulder"
        up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), line[one].shape)
        across = {"hip": line[one], "shoulder": line[one]}
    frames = {}
    for key, vector in across.items():
        x = _unit(_across(vector, up))
        frames[key] = np.stack([x, np.cross(up, x), up], axis=-1)
    middle = 0.5 * known["hip"] if has["hip"] else 0.5 * known["shoulder"] - 0.5 * up
    return frames["hip"], frames["shoulder"], middle


def _limb(
    landmark: dict[str, FloatArray],
    side: str,
    names: tuple[str, str, str],
    parent: FloatArray,
    axis_index: int,
    sign: float,
) -> tuple[FloatArray | None, FloatArray | None]:
    """World rotations of a limb's two bones, from the plane that they span.

    The plane of a nearly straight limb is noise, so the parent's own back direction takes over there. The
    sense is that of elbow and knee: an elbow's forearm bends to the front of the arm, a knee's shin to the
    back.
    """
    start, middle, end = (landmark[side + name] for name in names)
    if not np.isfinite(start).all() or not np.isfinite(middle).all():
        return None, None
    bone = _unit(middle - start)
    axis = sign * bone
    # The parent's y carried along by the smallest turn of the bone: what an arm or leg without roll has.
    y = parent[..., 1]
    half = _unit(sign * parent[..., axis_index] + bone + 1e-6 * y)
    carried = y - 2 * np.sum(half * y, axis=-1, keepdims=True) * half
    if not np.isfinite(end).all():
        return _frame(axis_index, axis, carried), None
    lower = _unit(end - middle)
    bends_to_back = -1.0 if axis_index == 0 else 1.0
    straight = 0.2
    upper_frame = _frame(axis_index, axis, bends_to_back * _across(lower, bone) + straight * carried)
    # The second bone turns about the hinge: z of the upper arm, x of the thigh.
    hinge_index = 2 - axis_index
    axis = sign * lower
    hinge = _unit(_across(upper_frame[..., hinge_index], axis))
    x, z = (axis, hinge) if axis_index == 0 else (hinge, axis)
    return upper_frame, np.stack([x, np.cross(z, x), z], axis=-1)


def _rigid(
    model: BodyModel,
    shape: FloatArray,
    joint: str,
    landmark: dict[str, FloatArray],
    words: tuple[str, ...],
    start: FloatArray,
) -> FloatArray | None:
    """World rotation of a bone that carries several landmarks, or None where fewer than three were ever
    seen.
    """
    carried = model.landmark_joints == model.joint_names.index(joint)
    chosen = [
        i
        for i, name in enumerate(model.landmark_names)
        if carried[i] and name.endswith(words) and np.isfinite(landmark[name]).all()
    ]
    if len(chosen) < 3:
        return None
    source = model.landmark_offsets(shape)[chosen]
    target = np.stack([landmark[model.landmark_names[i]] for i in chosen], axis=1)
    source = source - source.mean(axis=0)
    target = target - target.mean(axis=1, keepdims=True)
    # A little of where the bone's parent points, for what a flat set of noisy points leaves open.
    helper = 0.05 * np.eye(3)
    source = np.broadcast_to(np.concatenate([source, helper]), (len(target), len(chosen) + 3, 3))
    target = np.concatenate([target, 0.05 * np.swapaxes(start, -1, -2)], axis=1)
    weights = np.broadcast_to(np.r_[np.ones(len(chosen)), np.full(3, 0.3)], source.shape[:2])
    return kabsch(source, target, weights)
