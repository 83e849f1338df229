"""The body that is fitted to landmarks: joints, ranges of motion, proportions, where landmarks sit.

Everything that differs between people is one vector, the *shape*: left-right symmetric lengths in metres, of
which every joint's offset and every landmark's place on its bone is a linear function. Its prior is stature
times published proportions.

Sources: segment proportions of stature: D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th
edition, figure 4.1 (after Drillis and Contini 1966). Ranges of motion: American Academy of Orthopaedic
Surgeons (AAOS), Joint Motion, 1965, and for the spine I. A. Kapandji, The Physiology of the Joints, volume
3; both are for ordinary people and passive sitting or lying, so they are widened where athletes and
dancers go further.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.skeleton.skeleton import Skeleton

# name: (share of stature, standard deviation as a share of stature)
SHAPE_PRIOR: dict[str, tuple[float, float]] = {
    "trunk": (0.288, 0.025),  # mid-hip to mid-shoulder: Winter's .818 - .530
    "hip_half": (0.055, 0.012),  # hip joint centres, not Winter's .191 / 2 of the trochanters
    "shoulder_half": (0.110, 0.015),  # shoulder joint centres; the acromia are at .129
    "upper_arm": (0.186, 0.012),
    "forearm": (0.146, 0.010),
    "hand": (0.108, 0.010),
    "thigh": (0.245, 0.015),
    "shin": (0.246, 0.015),
    "neck": (0.058, 0.008),  # base of the neck to the skull's joint
    "head": (0.110, 0.010),  # from there to the crown: to .936 is the eye, 1.0 the crown
    # Landmarks on the head, from its joint (between the ears' height and the jaw's)
    "nose_forward": (0.065, 0.012), "nose_up": (0.020, 0.015),
    "eye_side": (0.018, 0.003), "eye_forward": (0.050, 0.012), "eye_up": (0.040, 0.015),
    "ear_side": (0.043, 0.006), "ear_forward": (0.000, 0.012), "ear_up": (0.028, 0.015),
    # Landmarks on the foot, from the ankle; Winter has the ankle .039 above the sole, the foot .152 long
    "heel_side": (0.000, 0.006), "heel_back": (0.030, 0.010), "heel_down": (0.030, 0.010),
    "big_toe_in": (0.010, 0.008), "big_toe_forward": (0.105, 0.014), "big_toe_down": (0.032, 0.010),
    "small_toe_out": (0.024, 0.008), "small_toe_forward": (0.090, 0.014), "small_toe_down": (0.033, 0.010),
}  # fmt: skip
STATURE_M, STATURE_SD_M = 1.70, 0.25
SHAPE_NAMES = tuple(SHAPE_PRIOR)

# A length along an axis: +x is the side of the joint's own half (left: +x, right: -x), +y back, +z up.
_Offset = Mapping[str, tuple[tuple[str, float], ...]]


@dataclass(frozen=True)
class _Joint:
    """One joint, given for the left side where it has two.

    `limits_deg`, `rest_deg` and `spread_deg` are about x, y, z of the rest pose: range of motion, and the
    mean and standard deviation of the weak prior that holds what the landmarks do not determine.
    """

    parent: str
    offset: _Offset
    twist_axis: str
    limits_deg: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    rest_deg: tuple[float, float, float]
    spread_deg: tuple[float, float, float]
    tip: _Offset | None = None


_LOCKED = (0.0, 0.0)

# Signs, for the left side: trunk and head bend forward about +x. The arm of the T-pose points to +x: it goes
# down about +y, forward about -z, and turns inward about +x. The leg points down: it goes forward about
# -x, away from the other about -y; the knee bends about +x; the toes rise about -x.
_JOINTS: dict[str, _Joint] = {
    "hips": _Joint("", {}, "z", ((-np.inf, np.inf),) * 3, (0, 0, 0), (0, 0, 0)),
    # Thoracolumbar spine: AAOS flexion 80, lateral 35, rotation 45; Kapandji extension 60 lumbar and thoracic
    # together, flexion 105. Halved between two joints.
    "spine": _Joint("hips", {"z": (("trunk", 0.25),)}, "z",
                    ((-25, 50), (-25, 25), (-28, 28)), (0, 0, 0), (14, 9, 9)),
    "chest": _Joint("spine", {"z": (("trunk", 0.30),)}, "z",
                    ((-25, 50), (-25, 25), (-28, 28)), (0, 0, 0), (14, 9, 9)),
    # Cervical spine: AAOS flexion and extension 45, lateral 45, rotation 60; Kapandji rotation 80 to 90.
    "neck": _Joint("chest", {"z": (("trunk", 0.50),)}, "z",
                   ((-40, 40), (-25, 25), (-45, 45)), (0, 0, 0), (20, 10, 20)),
    "head": _Joint("neck", {"z": (("neck", 1.0),)}, "z",
                   ((-35, 30), (-25, 25), (-45, 45)), (0, 0, 0), (15, 10, 20), {"z": (("head", 1.0),)}),
    # Shoulder girdle: Kapandji elevation 30 to 60 over all, protraction and retraction 15 each; AAOS the
    # like.
    "left_clavicle": _Joint("chest", {"x": (("shoulder_half", 0.15),), "z": (("trunk", 0.45),)}, "x",
                            (_LOCKED, (-40, 15), (-30, 25)), (0, 0, 0), (5, 8, 8)),
    # Shoulder: AAOS flexion and abduction 180, extension 60, rotation 70 inward and 90 outward. From the
    # T-pose: 95 up, 115 down and across; horizontal flexion 135, extension 50.
    "left_upper_arm": _Joint("left_clavicle", {"x": (("shoulder_half", 0.85),)}, "x",
                             ((-130, 110), (-95, 115), (-140, 55)), (0, 60, 0), (45, 60, 60)),
    # Elbow: AAOS 0 to 150; the forearm's roll is not seen by any landmark.
    "left_forearm": _Joint("left_upper_arm", {"x": (("upper_arm", 1.0),)}, "x",
                           (_LOCKED, _LOCKED, (-155, 5)), (0, 0, -30), (5, 5, 60)),
    "left_hand": _Joint("left_forearm", {"x": (("forearm", 1.0),)}, "x",
                        (_LOCKED, _LOCKED, _LOCKED), (0, 0, 0), (5, 5, 5), {"x": (("hand", 1.0),)}),
    # Hip: AAOS flexion 120, extension 30, abduction 45, adduction 30, rotation 45; dancers exceed all of
    # them.
    "left_thigh": _Joint("hips", {"x": (("hip_half", 1.0),)}, "z",
                         ((-140, 40), (-75, 40), (-55, 55)), (-10, 0, 0), (50, 20, 15)),
    # Knee: AAOS 0 to 135; Kapandji 160 passively, hyperextension of 5 to 10.
    "left_shin": _Joint("left_thigh", {"z": (("thigh", -1.0),)}, "z",
                        ((-5, 160), _LOCKED, _LOCKED), (15, 0, 0), (50, 5, 5)),
    # Ankle and subtalar joint: AAOS dorsiflexion 20 (30 loaded), plantarflexion 50 (dancers 70), inversion
    # 35, eversion 15 to 20; Kapandji abduction and adduction 35 to 45 in all.
    "left_foot": _Joint("left_shin", {"z": (("shin", -1.0),)}, "y",
                        ((-35, 65), (-35, 35), (-30, 30)), (0, 0, 0), (20, 10, 10)),
    "left_toe": _Joint("left_foot", {"y": (("big_toe_forward", -0.65),), "z": (("big_toe_down", -1.0),)}, "y",
                       (_LOCKED, _LOCKED, _LOCKED), (0, 0, 0), (5, 5, 5), 
                       {"y": (("big_toe_forward", -0.35),)}),
}  # fmt: skip

# landmark (left side where it has two): (joint, offset)
_LANDMARKS: dict[str, tuple[str, _Offset]] = {
    "nose": ("head", {"y": (("nose_forward", -1.0),), "z": (("nose_up", 1.0),)}),
    "left_eye": ("head", {"x": (("eye_side", 1.0),), "y": (("eye_forward", -1.0),), "z": (("eye_up", 1.0),)}),
    "left_ear": ("head", {"x": (("ear_side", 1.0),), "y": (("ear_forward", -1.0),), "z": (("ear_up", 1.0),)}),
    "left_shoulder": ("left_upper_arm", {}),
    "left_elbow": ("left_forearm", {}),
    "left_wrist": ("left_hand", {}),
    "left_hip": ("left_thigh", {}),
    "left_knee": ("left_shin", {}),
    "left_ankle": ("left_foot", {}),
    "left_heel": ("left_foot", {
        "x": (("heel_side", 1.0),), "y": (("heel_back", 1.0),), "z": (("heel_down", -1.0),)}),
    "left_big_toe": ("left_foot", {
        "x": (("big_toe_in", -1.0),), "y": (("big_toe_forward", -1.0),), "z": (("big_toe_down", -1.0),)}),
    "left_small_toe": ("left_foot", {
        "x": (("small_toe_out", 1.0),), "y": (("small_toe_forward", -1.0),),
        "z": (("small_toe_down", -1.0),)}),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class BodyModel:
    """The joints and landmarks of a body whose shape is still open.

    Attributes:
        joint_names: (J,) parents before children.
        parents: (J,)
        twist_axis: (J,)
        lower, upper: (J, 3) radians.
        rest, spread: (J, 3) radians: mean and standard deviation of the weak prior on each angle.
        joint_basis: (J, 3, S) metres of offset per metre of shape parameter.
        tip_basis: (J, 3, S); NaN where a joint has children.
        landmark_names: (L,)
        landmark_joints: (L,) index of the joint that a landmark moves with.
        landmark_basis: (L, 3, S)
    """

    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    twist_axis: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray
    rest: FloatArray
    spread: FloatArray
    joint_basis: FloatArray
    tip_basis: FloatArray
    landmark_names: tuple[str, ...]
    landmark_joints: IndexArray
    landmark_basis: FloatArray

    def skeleton(self, shape: FloatArray) -> Skeleton:
        """The skeleton of a person with this shape, (S,) metres."""
        return Skeleton(
            names=self.joint_names,
            parents=self.parents,
            offsets=self.joint_basis @ shape,
            tips=self.tip_basis @ shape,
            twist_axis=self.twist_axis,
            lower=self.lower,
            upper=self.upper,
        )

    def landmark_offsets(self, shape: FloatArray) -> FloatArray:
        """(L, 3) metres, each in the axes of the joint that it moves with."""
        return np.asarray(self.landmark_basis @ shape)


@dataclass(frozen=True, eq=False)
class Body:
    """A person: a skeleton with its lengths, and the landmarks on it.

    Attributes:
        skeleton: joints and constant bones.
        landmark_names: (L,)
        landmark_joints: (L,) index of the joint that carries each landmark.
        landmark_offsets: (L, 3) metres in that joint's axes.
        stature_m: estimated height, metres.
    """

    skeleton: Skeleton
    landmark_names: tuple[str, ...]
    landmark_joints: IndexArray
    landmark_offsets: FloatArray
    stature_m: float


def prior_shape(stature_m: float) -> FloatArray:
    """(S,) metres: published proportions of a person of that stature, in the order of SHAPE_NAMES."""
    return np.array([ratio for ratio, _ in SHAPE_PRIOR.values()]) * stature_m


def _basis(offset: _Offset, side: float) -> FloatArray:
    out = np.zeros((3, len(SHAPE_NAMES)))
    for axis, terms in offset.items():
        for name, factor in terms:
            out["xyz".index(axis), SHAPE_NAMES.index(name)] += factor * (side if axis == "x" else 1.0)
    return out


def _sides(name: str) -> list[tuple[str, float]]:
    return [(name, 1.0), ("right_" + name[5:], -1.0)] if name.startswith("left_") else [(name, 1.0)]


def _other_side(name: str, side: float) -> str:
    return "right_" + name[5:] if side < 0 and name.startswith("left_") else name


def _build() -> BodyModel:
    joints = [(n, side, _JOINTS[name]) for name in _JOINTS for n, side in _sides(name)]
    names = tuple(n for n, _, _ in joints)
    parents = [_other_side(joint.parent, side) for _, side, joint in joints]
    landmarks = [(n, side, *_LANDMARKS[name]) for name in _LANDMARKS for n, side in _sides(name)]
    # A mirror at x = 0 turns the signs of angles about y and z.
    signs = np.array([(1.0, side, side) for _, side, _ in joints])
    limits = np.sort(np.radians([joint.limits_deg for _, _, joint in joints]) * signs[..., None], axis=-1)
    no_tip = np.full((3, len(SHAPE_NAMES)), np.nan)
    return BodyModel(
        joint_names=names,
        parents=tuple(names.index(p) if p else -1 for p in parents),
        twist_axis=tuple("xyz".index(joint.twist_axis) for _, _, joint in joints),
        lower=limits[..., 0],
        upper=limits[..., 1],
        rest=np.radians([joint.rest_deg for _, _, joint in joints]) * signs,
        spread=np.radians([joint.spread_deg for _, _, joint in joints]),
        joint_basis=np.stack([_basis(joint.offset, side) for _, side, joint in joints]),
        tip_basis=np.stack([no_tip if j.tip is None else _basis(j.tip, side) for _, side, j in joints]),
        landmark_names=tuple(n for n, _, _, _ in landmarks),
        landmark_joints=np.array(
            [names.index(_other_side(joint, side)) for _, side, joint, _ in landmarks], dtype=np.intp
        ),
        landmark_basis=np.stack([_basis(offset, side) for _, side, _, offset in landmarks]),
    )


BODY = _build()
for _array in (a for a in vars(BODY).values() if isinstance(a, np.ndarray)):
    _array.setflags(write=False)  # shared by every skeleton that is made of it
