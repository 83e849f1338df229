"""One table of joint roles, the names that common skeletons give them, and ranges of motion by role.

A *role* is what a joint is in a body (`left_shin` turns the lower leg about the knee); a *profile* is one program's or
format's set of names for the roles. Sides are written once, for the left.

Sources of the names: CMU BVH: the conversion by B. Hahne (cgspeed, 2008); ASF: the CMU motion capture database; BVH:
Biovision's own files; Mixamo: its FBX downloads; HumanIK: Autodesk MotionBuilder, "Character definition"; UE5: the
mannequin of Epic Games; VRM: vrm-specification 1.0, "humanoid"; SMPL-H: J. Romero, D. Tzionas, M. J. Black, "Embodied
hands", 2017; OpenSim: the bodies of A. Rajagopal and others, 2016, and of gait2392; KayKit and Quaternius: their free
characters; Poser, DAZ: figures of Smith Micro and of DAZ (Genesis to Genesis 8); Rigify: Blender's metarig; Biped:
Autodesk 3ds Max; Character Creator: Reallusion; VRoid: Pixiv; Synty: their Unity packs; Xsens: MVN; Kinect: Microsoft's
SDK 2; MMD: MikuMikuDance; Khronos: CesiumMan and RiggedFigure of its glTF samples.

Sources of the ranges: as in `muybridge.geometry.skeleton.body` (American Academy of Orthopaedic Surgeons, Joint Motion,
1965; I. A. Kapandji, The Physiology of the Joints), and of the same: forearm, pronation and supination 80; wrist,
flexion 80, extension 70, radial deviation 20, ulnar 30; knee, rotation 30 inward and 40 outward when bent; toes,
extension 70, flexion 40; fingers, MCP -45 to 90, PIP 0 to 100, DIP 0 to 90.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.skeleton import Skeleton

FINGERS = ("thumb", "index", "middle", "ring", "little")
_TRUNK = ("hips", "spine", "chest", "upper_chest", "neck", "head")
_LIMBS = ("clavicle", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")
_FINGER_JOINTS = tuple(f"{finger}_{k}" for finger in FINGERS for k in (1, 2, 3))
ROLES: tuple[str, ...] = _TRUNK + tuple(
    f"{side}_{name}" for side in ("left", "right") for name in _LIMBS + _FINGER_JOINTS
)


def _table(trunk: Sequence[str], limbs: Sequence[str], fingers: Sequence[str] = ()) -> dict[str, str]:
    """Names in the order of the roles above; an empty name is a joint that the profile does not have."""
    out = {role: name for role, name in zip(_TRUNK, trunk, strict=True) if name}
    sided = [*limbs, *(fingers or [""] * len(_FINGER_JOINTS))]
    for role, name in zip(_LIMBS + _FINGER_JOINTS, sided, strict=True):
        if name:
            out[f"left_{role}"] = name
            out[f"right_{role}"] = _right_of(name)
    return out


_MARKS = (("Left", "Right"), ("left", "right"), ("_l", "_r"), ("_L", "_R"), (".l", ".r"), (".L", ".R"), ("左", "右"))


def _right_of(name: str) -> str:
    for left, right in ((" L ", " R "), ("_L_", "_R_")):
        if left in name:
            return name.replace(left, right)
    for left, right in _MARKS:
        if name.startswith(left) or name.endswith(left):
            return name.replace(left, right, 1) if name.startswith(left) else name[: -len(left)] + right
    return {"l": "r", "L": "R"}[name[0]] + name[1:]


def _hand(pattern: str, words: Sequence[str], joints: Sequence[str] = ("1", "2", "3")) -> list[str]:
    return [pattern.format(word, joint) for word in words for joint in joints]


_HUMANIK_LIMBS = ("LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftUpLeg", "LeftLeg", "LeftFoot",
                  "LeftToeBase")  # fmt: skip
_HUMANIK_TRUNK = ("Hips", "Spine", "Spine1", "Spine2", "Neck", "Head")
_HUMANIK_FINGERS = _hand("LeftHand{}{}", ("Thumb", "Index", "Middle", "Ring", "Pinky"))
_VRM_FINGERS = ["leftThumbMetacarpal", "leftThumbProximal", "leftThumbDistal"] + _hand(
    "left{}{}", ("Index", "Middle", "Ring", "Little"), ("Proximal", "Intermediate", "Distal")
)

# profile: role -> name
PROFILES: dict[str, dict[str, str]] = {
    "muybridge": {role: role for role in ROLES},
    "cmu_bvh": _table(("Hips", "LowerBack", "Spine", "Spine1", "Neck", "Head"), _HUMANIK_LIMBS)
    | {"left_middle_1": "LFingers", "right_middle_1": "RFingers"},
    "asf": _table(("root", "lowerback", "upperback", "thorax", "lowerneck", "head"),
                  ("lclavicle", "lhumerus", "lradius", "lhand", "lfemur", "ltibia", "lfoot", "ltoes")),
    "bvh": _table(("Hips", "Chest", "Chest2", "Chest3", "Neck", "Head"),
                  ("LeftCollar", "LeftShoulder", "LeftElbow", "LeftWrist", "LeftHip", "LeftKnee", "LeftAnkle",
                   "LeftToe")),
    "mixamo": {role: "mixamorig:" + name
               for role, name in _table(_HUMANIK_TRUNK, _HUMANIK_LIMBS, _HUMANIK_FINGERS).items()},
    "humanik": _table(_HUMANIK_TRUNK, _HUMANIK_LIMBS, _HUMANIK_FINGERS),
    "bandai": _table(("Hips", "Spine", "Chest", "", "Neck", "Head"),
                     ("Shoulder_L", "UpperArm_L", "LowerArm_L", "Hand_L", "UpperLeg_L", "LowerLeg_L", "Foot_L",
                      "Toes_L")),
    "ue5": _table(("pelvis", "spine_01", "spine_03", "spine_05", "neck_01", "head"),
                  ("clavicle_l", "upperarm_l", "lowerarm_l", "hand_l", "thigh_l", "calf_l", "foot_l", "ball_l"),
                  [f"{finger}_0{k}_l" for finger in ("thumb", "index", "middle", "ring", "pinky") for k in (1, 2, 3)]),
    "vrm": _table(("hips", "spine", "chest", "upperChest", "neck", "head"),
                  ("leftShoulder", "leftUpperArm", "leftLowerArm", "leftHand", "leftUpperLeg", "leftLowerLeg",
                   "leftFoot", "leftToes"), _VRM_FINGERS),
    "smpl_h": _table(("pelvis", "spine1", "spine2", "spine3", "neck", "head"),
                     ("left_collar", "left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee",
                      "left_ankle", "left_foot"),
                     _hand("left_{}{}", ("thumb", "index", "middle", "ring", "pinky"))),
    "opensim": _table(("pelvis", "", "torso", "", "", ""),
                      ("", "humerus_l", "ulna_l", "hand_l", "femur_l", "tibia_l", "calcn_l", "toes_l")),
    "kaykit": _table(("hips", "spine", "chest", "", "", "head"),
                     ("", "upperarm.l", "lowerarm.l", "hand.l", "upperleg.l", "lowerleg.l", "foot.l", "toes.l")),
    "quaternius": _table(("Hips", "Abdomen", "Torso", "", "Neck", "Head"),
                         ("Shoulder.L", "UpperArm.L", "LowerArm.L", "Fist.L", "UpperLeg.L", "LowerLeg.L", "Foot.L",
                          "")),
    "poser": _table(("hip", "abdomen", "chest", "", "neck", "head"),
                    ("lCollar", "lShldr", "lForeArm", "lHand", "lThigh", "lShin", "lFoot", "lToe"),
                    _hand("l{}{}", ("Thumb", "Index", "Mid", "Ring", "Pinky"))),
    "daz": _table(("hip", "abdomenLower", "chestLower", "chestUpper", "neckLower", "head"),
                  ("lCollar", "lShldrBend", "lForearmBend", "lHand", "lThighBend", "lShin", "lFoot", "lToe"),
                  _hand("l{}{}", ("Thumb", "Index", "Mid", "Ring", "Pinky"))),
    "rigify": _table(("spine", "spine.001", "spine.002", "spine.003", "spine.004", "spine.006"),
                     ("shoulder.L", "upper_arm.L", "forearm.L", "hand.L", "thigh.L", "shin.L", "foot.L", "toe.L"),
                     _hand("{}.0{}.L", ("thumb", "f_index", "f_middle", "f_ring", "f_pinky"))),
    "biped": _table(("Bip01 Pelvis", "Bip01 Spine", "Bip01 Spine1", "Bip01 Spine2", "Bip01 Neck", "Bip01 Head"),
                    [f"Bip01 L {part}" for part in ("Clavicle", "UpperArm", "Forearm", "Hand", "Thigh", "Calf", "Foot",
                                                    "Toe0")],
                    _hand("Bip01 L Finger{}{}", "01234", ("", "1", "2"))),
    "character_creator": _table(
        [f"CC_Base_{part}" for part in ("Hip", "Waist", "Spine01", "Spine02", "NeckTwist01", "Head")],
        [f"CC_Base_L_{part}" for part in ("Clavicle", "Upperarm", "Forearm", "Hand", "Thigh", "Calf", "Foot",
                                          "ToeBase")],
        _hand("CC_Base_L_{}{}", ("Thumb", "Index", "Mid", "Ring", "Pinky"))),
    "vroid": _table(
        [f"J_Bip_C_{part}" for part in ("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")],
        [f"J_Bip_L_{part}" for part in ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot",
                                        "ToeBase")],
        _hand("J_Bip_L_{}{}", ("Thumb", "Index", "Middle", "Ring", "Little"))),
    "synty": _table(("Hips", "Spine_01", "Spine_02", "Spine_03", "Neck", "Head"),
                    ("Clavicle_L", "Shoulder_L", "Elbow_L", "Hand_L", "UpperLeg_L", "LowerLeg_L", "Ankle_L", "Ball_L")),
    "xsens": _table(("Pelvis", "L5", "T12", "T8", "Neck", "Head"),
                    ("LeftShoulder", "LeftUpperArm", "LeftForeArm", "LeftHand", "LeftUpperLeg", "LeftLowerLeg",
                     "LeftFoot", "LeftToe")),
    "kinect": _table(("SpineBase", "SpineMid", "SpineShoulder", "", "Neck", "Head"),
                     ("", "ShoulderLeft", "ElbowLeft", "WristLeft", "HipLeft", "KneeLeft", "AnkleLeft", "FootLeft")),
    "mmd": _table(("下半身", "上半身", "上半身2", "", "首", "頭"),
                  ("左肩", "左腕", "左ひじ", "左手首", "左足", "左ひざ", "左足首", "左つま先")),
    "khronos": {"hips": "torso_joint_1", "spine": "torso_joint_2", "chest": "torso_joint_3", "neck": "neck_joint_1",
                "head": "neck_joint_2"}
    | {f"{side.lower()}_{part}": name.format(side[0]) for side in ("Left", "Right")
       for part, name in (("upper_arm", "arm_joint_{}_1"), ("forearm", "arm_joint_{}_2"), ("hand", "arm_joint_{}_3"),
                          ("thigh", "leg_joint_{}_1"), ("shin", "leg_joint_{}_2"), ("foot", "leg_joint_{}_3"),
                          ("toe", "leg_joint_{}_5"))},
    "cesium_man": {"hips": "Skeleton_torso_joint_1", "spine": "Skeleton_torso_joint_2", "chest": "torso_joint_3",
                   "neck": "Skeleton_neck_joint_1", "head": "Skeleton_neck_joint_2",
                   "left_upper_arm": "Skeleton_arm_joint_L__4_", "left_forearm": "Skeleton_arm_joint_L__3_",
                   "left_hand": "Skeleton_arm_joint_L__2_", "right_upper_arm": "Skeleton_arm_joint_R",
                   "right_forearm": "Skeleton_arm_joint_R__2_", "right_hand": "Skeleton_arm_joint_R__3_"}
    | {f"{side.lower()}_{part}": f"leg_joint_{side[0]}_{k}" for side in ("Left", "Right")
       for part, k in (("thigh", 1), ("shin", 2), ("foot", 3), ("toe", 5))},
}  # fmt: skip

# Joints besides the roles: the role whose range they share, or "" for those that never move.
EXTRAS: dict[str, dict[str, str]] = {
    "cmu_bvh": {"LHipJoint": "", "RHipJoint": "", "Neck1": "neck", "LeftFingerBase": "", "RightFingerBase": "",
                "LThumb": "left_thumb_1", "RThumb": "right_thumb_1"},
    "asf": {"lhipjoint": "", "rhipjoint": "", "upperneck": "neck", "lwrist": "left_hand", "rwrist": "right_hand",
            "lfingers": "left_middle_1", "rfingers": "right_middle_1", "lthumb": "left_thumb_1",
            "rthumb": "right_thumb_1"},
    "bvh": {"Chest4": "chest"},
    "humanik": {"LeftToe": "left_toe", "RightToe": "right_toe", "Spine3": "upper_chest", "Neck1": "neck"},
    "bandai": {"joint_Root": ""},
    "ue5": {"spine_02": "spine", "spine_04": "chest", "neck_02": "neck"},
    "opensim": {"talus_l": "left_foot", "talus_r": "right_foot", "radius_l": "left_forearm",
                "radius_r": "right_forearm"},
    "kaykit": {"root": "", "wrist.l": "left_hand", "wrist.r": "right_hand"},
    "daz": {"pelvis": "hips", "abdomenUpper": "spine", "neckUpper": "neck"},
    "character_creator": {"CC_Base_Pelvis": "hips", "CC_Base_NeckTwist02": "neck"},
    "rigify": {"spine.005": "neck"},
    "xsens": {"L3": "spine"},
}  # fmt: skip


def detect_profile(names: Sequence[str]) -> str | None:
    """The profile that knows most of the names, None if none knows hips and both thighs."""
    best, score = None, 0
    for profile in PROFILES:
        roles = roles_of(names, profile)
        if not {"hips", "left_thigh", "right_thigh"} <= set(roles):
            continue
        known = len(roles) + len(_found(names, list(EXTRAS.get(profile, ()))))
        if known > score:
            best, score = profile, known
    return best


def roles_of(names: Sequence[str], profile: str | None = None) -> dict[str, int]:
    """Role -> index in `names`. Case and namespaces (`rig:Hips`, `Character1_Hips`) do not matter.

    Args:
        names: of joints.
        profile: a key of PROFILES; None detects it.

    Raises:
        ValueError: an unknown profile.
    """
    if profile is None:
        profile = detect_profile(names)
        if profile is None:
            return {}
    if profile not in PROFILES:
        raise ValueError(f"unknown profile {profile!r}: choose one of {', '.join(PROFILES)}")
    table = PROFILES[profile]
    found = _found(names, list(table.values()))
    return {role: found[name] for role, name in table.items() if name in found}


def _found(names: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """Wanted name -> index of the first of `names` that is it, but for case and namespace."""
    plain = [_plain(n) for n in names]
    out = {}
    for name in wanted:
        if (key := _plain(name)) in plain:
            out[name] = plain.index(key)
    return out


_SEPARATORS = str.maketrans("", "", " _.-")


@lru_cache(maxsize=4096)
def _plain(name: str) -> str:
    name = name.rsplit(":", 1)[-1].rsplit("|", 1)[-1]
    for prefix in ("mixamorig_", "Character1_", "mixamorig", "DEF-", "ORG-", "ValveBiped.", "Bip001", "Bip01"):
        name = name.removeprefix(prefix)
    # Exporters turn dots and spaces into underscores, or drop them.
    return name.translate(_SEPARATORS).lower()


def rename(skeleton: Skeleton, to: str, profile: str | None = None) -> Skeleton:
    """The same skeleton with another profile's names; joints without a name there keep theirs."""
    names = list(skeleton.names)
    if to not in PROFILES:
        raise ValueError(f"unknown profile {to!r}: choose one of {', '.join(PROFILES)}")
    for role, index in roles_of(skeleton.names, profile).items():
        names[index] = PROFILES[to].get(role, names[index])
    return replace(skeleton, names=tuple(names))


# Ranges in degrees about x, y, z of the T-pose, for the left side, of what `BODY` locks or does not have; a joint of
# another skeleton has its hinge axis where its maker put it, so hinges get some room about their other axes.
_ROOM: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "upper_chest": ((-25, 50), (-25, 25), (-28, 28)),
    "left_clavicle": ((-30, 30), (-45, 20), (-35, 35)),
    "left_forearm": ((-90, 90), (-25, 25), (-155, 10)),
    "left_hand": ((-90, 90), (-80, 85), (-40, 45)),
    "left_shin": ((-10, 160), (-25, 25), (-40, 40)),
    "left_toe": ((-75, 45), (-15, 15), (-15, 15)),
    "left_thumb_1": ((-60, 60), (-60, 60), (-60, 60)),
    "left_thumb_2": ((-20, 20), (-60, 60), (-60, 60)),
    "left_thumb_3": ((-10, 10), (-85, 85), (-85, 85)),
}
_FINGER = {
    "1": ((-10, 10), (-45, 95), (-25, 25)),
    "2": ((-5, 5), (-5, 110), (-5, 5)),
    "3": ((-5, 5), (-5, 90), (-5, 5)),
}
_TWIST = {"upper_arm": 0, "forearm": 0, "hand": 0, "clavicle": 0, "foot": 1, "toe": 1}


def role_limits(role: str) -> tuple[FloatArray, FloatArray, int]:
    """(3,) lower and (3,) upper in radians about x, y, z of the T-pose, and the twist axis.

    Raises:
        ValueError: unknown role.
    """
    if role not in ROLES:
        raise ValueError(f"unknown role {role!r}: choose one of {', '.join(ROLES)}")
    left = "left" + role[5:] if role.startswith("right_") else role
    part = left.removeprefix("left_")
    twist = _TWIST.get(part, 0 if part in _FINGER_JOINTS else 2)
    if left in _ROOM:
        limits = np.radians(_ROOM[left])
    elif part in _FINGER_JOINTS:
        limits = np.radians(_FINGER[part[-1]])
    else:
        j = BODY.joint_names.index(left)
        limits = np.stack([BODY.lower[j], BODY.upper[j]], axis=1)
    if role.startswith("right_"):
        limits = np.stack([limits[0], -limits[1, ::-1], -limits[2, ::-1]])
    return limits[:, 0], limits[:, 1], twist


def with_limits(skeleton: Skeleton, profile: str | None = None) -> Skeleton:
    """The skeleton with ranges of motion by role, shifted by how far its rest pose is from the T-pose.

    Joints of no known role get wide ranges (150 degrees of swing, 90 of twist); those that never move are locked.

    Args:
        skeleton: rest pose near a T- or A-pose, Z up, facing -Y.
        profile: a key of PROFILES; None detects it.
    """
    profile = profile or detect_profile(skeleton.names)
    by_joint = {index: role for role, index in roles_of(skeleton.names, profile).items()}
    extras = EXTRAS.get(profile or "", {})
    by_joint |= {index: extras[name] for name, index in _found(skeleton.names, list(extras)).items()}
    lower, upper = np.full((len(skeleton), 3), -np.radians(150)), np.full((len(skeleton), 3), np.radians(150))
    twist = list(skeleton.twist_axis)
    roots = list(skeleton.roots)
    lower[roots], upper[roots] = -np.inf, np.inf
    lean = _lean(skeleton, by_joint)
    for j in range(1, len(skeleton)):
        if j in roots:
            continue
        role = by_joint.get(j)
        if role is None:
            lower[j, twist[j]], upper[j, twist[j]] = -np.pi / 2, np.pi / 2
        elif not role:
            lower[j] = upper[j] = 0.0
        else:
            low, high, twist[j] = role_limits(role)
            shift = lean[j] - lean[skeleton.parents[j]]
            lower[j], upper[j] = low - shift, high - shift
    return replace(skeleton, lower=lower, upper=upper, twist_axis=tuple(twist))


def _lean(skeleton: Skeleton, by_joint: dict[int, str]) -> FloatArray:
    """(J, 3) radians: the swing from where the T-pose has a limb's bone to where the rest pose has it."""
    out = np.zeros((len(skeleton), 3))
    for j in range(1, len(skeleton)):
        if skeleton.parents[j] < 0:
            continue
        out[j] = out[skeleton.parents[j]]
        role = by_joint.get(j, "")
        part = role.split("_", 1)[-1]
        children = [c for c, parent in enumerate(skeleton.parents) if parent == j and skeleton.bone_lengths[c] > 1e-6]
        if part not in ("upper_arm", "forearm", "thigh", "shin") or len(children) != 1:
            continue
        sign = -1.0 if role.startswith("right_") else 1.0
        usual = np.array([sign, 0, 0]) if "arm" in part else np.array([0, 0, -1.0])
        bone = skeleton.offsets[children[0]] / skeleton.bone_lengths[children[0]]
        axis = np.cross(usual, bone)
        sine = float(np.linalg.norm(axis))
        out[j] = axis / sine * np.arctan2(sine, usual @ bone) if sine > 1e-9 else 0.0
    return out
