"""Skeletons of many makers' habits, built by number, with the truth of their roles."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.geometry.skeleton.skeleton import Skeleton


@dataclass
class Builder:
    """Joints that are added one by one; places are in the T-pose, Z up, facing -Y."""

    names: list[str] = field(default_factory=list)
    parents: list[str] = field(default_factory=list)
    places: list[np.ndarray] = field(default_factory=list)
    roles: dict[str, str] = field(default_factory=dict)

    def add(self, name, parent, place, role=None):
        self.names.append(name)
        self.parents.append(parent)
        self.places.append(np.asarray(place, float))
        if role:
            self.roles[role] = name
        return name

    def at(self, name):
        return self.places[self.names.index(name)]

    def build(self, turn=None, scale=1.0, rng=None):
        """The skeleton with scrambled names, and role -> index."""
        order = _order(self.names, self.parents, rng)
        index = {name: k for k, name in enumerate(order)}
        parents = tuple(index.get(self.parents[self.names.index(n)], -1) for n in order)
        places = np.array([self.at(n) for n in order]) * scale
        places = places if turn is None else places @ turn.as_matrix().T
        count = len(order)
        offsets = np.array([places[k] - places[p] if p >= 0 else np.zeros(3) for k, p in enumerate(parents)])
        names = rng.permutation(count) if rng is not None else range(count)
        wide = np.full((count, 3), np.pi)
        skeleton = Skeleton(tuple(f"b{n}" for n in names), parents, offsets, np.full((count, 3), np.nan),
                            (0,) * count, -wide, wide)  # fmt: skip
        return skeleton, {role: index[name] for role, name in self.roles.items()}


def _order(names, parents, rng):
    """Parents first; of the joints that could come next one at random."""
    out, left = [], list(range(len(names)))
    while left:
        free = [k for k in left if parents[k] not in names or parents[k] in out]
        k = free[0] if rng is None else free[int(rng.integers(len(free)))]
        out.append(names[k])
        left.remove(k)
    return out


HABITS = {
    "plain": {},
    "mixamo": {"fingers": 5, "ends": True, "spine": 3},
    "unreal": {"root": True, "fingers": 5, "spine": 5, "neck": 2, "twist": "beside", "control": True},
    "blender": {"twist": "within", "spine": 4, "root": True, "breasts": True},
    "cartoon": {"legs": 0.45, "head": 2.5, "arms": 0.7, "fingers": 3, "hair": 6},
    "giant_hands": {"arms": 1.4, "fingers": 4, "hand": 2.0, "legs": 0.8},
    "no_clavicles": {"clavicles": False, "neck": 0, "spine": 1, "root": True, "toes": False, "slots": True},
    "no_toes_thumbs": {"toes": False, "fingers": 5},
    "quaternius": {"root": True, "apart_feet": True, "clavicles": True, "fingers": 2, "ends": True, "spine": 2},
    "hip_joints": {"hip_joints": True, "spine": 3, "fingers": 0},
    "skirt": {"skirt": 8, "hair": 4, "fingers": 5, "ends": True, "eyes": True},
    "tail_ears": {"tail": 5, "ears": True, "fingers": 4, "root": True},
    "mmd": {"split_pelvis": True, "fingers": 5, "twist": "within", "eyes": True, "hair": 8},
    "metacarpals": {"fingers": 5, "metacarpals": True, "spine": 4, "neck": 2, "face": 12},
    "wings": {"wings": True, "fingers": 4},
    "mitten": {"fingers": 1, "spine": 2, "ends": True},
}  # fmt: skip


def human(rng, pose="t", legs=1.0, arms=1.0, head=1.0, hand=1.0, spine=3, neck=1, clavicles=True, toes=True, fingers=0,
          root=False, ends=False, twist="", control=False, hair=0, skirt=0, tail=0, ears=False, eyes=False, slots=False,
          breasts=False, apart_feet=False, hip_joints=False, split_pelvis=False, metacarpals=False, face=0,
          wings=False):  # fmt: skip
    """A Builder of a body about as tall as a person; options are what makers add or leave out."""
    b = Builder()
    noise = lambda s=0.01: rng.normal(0, s, 3) * [0, 1, 1]  # noqa: E731
    hip = 0.95 * legs
    top = ""
    if root:
        top = b.add("root", "", (0, 0, 0))
    if split_pelvis:
        top = b.add("centre", top, (0, 0, hip))
    pelvis = b.add("hips", top, (0, 0, hip - 0.02 * split_pelvis), "hips")
    last = top if split_pelvis else pelvis
    chest_z = hip + 0.42
    for k in range(spine):
        last = b.add(
            f"spine{k}",
            last,
            np.array([0, 0, hip + (chest_z - hip) * (k + 0.4) / spine]) + noise(),
            "" if k else "spine",
        )
    chest = last if spine else pelvis
    neck_z = hip + 0.5
    for k in range(neck):
        last = b.add(f"neck{k}", last, (0, 0.01, neck_z + 0.06 * k))
    skull = b.add("head", last, (0, 0, neck_z + 0.1), "head")
    if ends:
        b.add("head_end", skull, (0, 0, neck_z + 0.1 + 0.2 * head))
    for s, side in ((1, "left"), (-1, "right")):
        mirrored = np.array([s, 1, 1])
        _leg(b, side, mirrored, hip, rng, pelvis, toes, twist, ends, apart_feet, hip_joints, root)
        _arm(b, side, mirrored, chest, hip, arms, hand, clavicles, fingers, metacarpals, twist, ends, slots)
        if eyes:
            b.add(f"{side}_eye", skull, mirrored * (0.03, -0.08, neck_z + 0.16))
        if ears:
            ear = b.add(f"{side}_ear", skull, mirrored * (0.1, 0, neck_z + 0.25))
            b.add(f"{side}_ear2", ear, mirrored * (0.12, 0, neck_z + 0.55))
        if breasts:
            b.add(f"{side}_breast", chest, mirrored * (0.08, -0.12, hip + 0.35))
        if wings:
            wing = b.add(f"{side}_wing", chest, mirrored * (0.05, 0.15, hip + 0.4))
            wing = b.add(f"{side}_wing2", wing, mirrored * (0.5, 0.4, hip + 0.8))
            b.add(f"{side}_wing3", wing, mirrored * (0.9, 0.5, hip + 0.5))
        if control:
            b.add(f"{side}_foot_ik", top, mirrored * (0.1, 0.03, 0.08))
            b.add(f"{side}_hand_ik", top, mirrored * (0.7, 0, hip + 0.45))
        for k in range(face // 2):
            b.add(
                f"{side}_face{k}", skull, mirrored * (rng.uniform(0.01, 0.07), -0.08, neck_z + rng.uniform(0.08, 0.2))
            )
        for k in range(hair // 2):
            lock = b.add(f"{side}_hair{k}", skull, mirrored * (0.05 + 0.02 * k, 0.08, neck_z + 0.25))
            for n in range(1, 4):
                lock = b.add(f"{side}_hair{k}_{n}", lock, mirrored * (0.06 + 0.02 * k, 0.12, neck_z + 0.25 - 0.13 * n))
        for k in range(skirt // 2):
            angle = np.pi * (k + 0.5) / (skirt // 2)
            way = np.array([np.sin(angle), -np.cos(angle), 0])
            cloth = b.add(f"{side}_skirt{k}", pelvis, mirrored * (0.12 * way + [0, 0, hip - 0.05]))
            for n in range(1, 4):
                cloth = b.add(f"{side}_skirt{k}_{n}", cloth,
                              mirrored * ((0.12 + 0.03 * n) * way + [0, 0, hip - 0.05 - 0.15 * n]))  # fmt: skip
    for k in range(tail):
        pelvis_tail = pelvis if not k else f"tail{k - 1}"
        b.add(f"tail{k}", pelvis_tail, (0, 0.1 + 0.15 * k, hip + 0.02 * k))
    return b


def _leg(b, side, mirrored, hip, rng, pelvis, toes, twist, ends, apart_feet, hip_joints, root):
    parent = pelvis
    knee, ankle = hip * 0.53, 0.09
    if hip_joints:
        parent = b.add(f"{side}_buttock", pelvis, mirrored * (0.03, 0, hip - 0.01))
    parent = b.add(f"{side}_thigh", parent, mirrored * (0.09, 0, hip - 0.04), f"{side}_thigh")
    if twist == "beside":
        b.add(f"{side}_thigh_twist", parent, mirrored * (0.09, 0, (hip + knee) / 2))
    if twist == "within":
        parent = b.add(f"{side}_thigh_twist", parent, mirrored * (0.09, -0.005, (hip + knee) / 2))
    parent = b.add(f"{side}_shin", parent, mirrored * (0.09, -0.01, knee), f"{side}_shin")
    if twist == "within":
        parent = b.add(f"{side}_shin_twist", parent, mirrored * (0.09, 0.005, (knee + ankle) / 2))
    if apart_feet:
        b.add(f"{side}_shin_end", parent, mirrored * (0.09, 0.02, ankle))
        parent = "root"
    foot = b.add(f"{side}_foot", parent, mirrored * (0.09, 0.02, ankle), f"{side}_foot")
    if toes or apart_feet:
        ball = b.add(f"{side}_toe", foot, mirrored * (0.1, -0.11, 0.02))
        if ends:
            b.add(f"{side}_toe_end", ball, mirrored * (0.1, -0.18, 0.02))


def _arm(b, side, mirrored, chest, hip, arms, hand, clavicles, fingers, metacarpals, twist, ends, slots):
    z, y = hip + 0.45, 0.02
    shoulder, elbow, wrist = 0.18, 0.18 + 0.28 * arms, 0.18 + 0.53 * arms
    parent = chest
    if clavicles:
        parent = b.add(f"{side}_clavicle", chest, mirrored * (0.02, 0, z - 0.02))
    parent = b.add(f"{side}_upper_arm", parent, mirrored * (shoulder, y, z), f"{side}_upper_arm")
    if twist == "beside":
        b.add(f"{side}_arm_twist", parent, mirrored * ((shoulder + elbow) / 2, y, z))
    if twist == "within":
        parent = b.add(f"{side}_arm_twist", parent, mirrored * ((shoulder + elbow) / 2, y, z))
    parent = b.add(f"{side}_forearm", parent, mirrored * (elbow, y + 0.01, z), f"{side}_forearm")
    if twist == "beside":
        b.add(f"{side}_forearm_twist", parent, mirrored * ((elbow + wrist) / 2, y, z))
    if twist == "within":
        parent = b.add(f"{side}_forearm_twist", parent, mirrored * ((elbow + wrist) / 2, y, z))
    palm = b.add(f"{side}_hand", parent, mirrored * (wrist, y, z), f"{side}_hand")
    if slots:
        b.add(f"{side}_slot", palm, mirrored * (wrist + 0.08, y, z - 0.04))
    first = wrist + 0.08 * hand
    if fingers > 1 or (fingers and ends):
        for k in range(fingers):
            _finger(b, side, mirrored, palm, k, fingers, (wrist, first, y, z), hand, metacarpals, ends)
    elif ends:
        b.add(f"{side}_hand_end", palm, mirrored * (first, y, z))


def _finger(b, side, mirrored, palm, k, fingers, place, hand, metacarpals, ends):
    wrist, first, y, z = place
    thumb = k == 0 and fingers > 1
    across = y - 0.03 * hand + 0.02 * hand * (k - 1) if not thumb else y - 0.03
    start = wrist + 0.02 if thumb else first
    parent = palm
    if metacarpals and not thumb:
        parent = b.add(f"{side}_metacarpal{k}", parent, mirrored * (wrist + 0.02, y + (across - y) / 2, z))
    for n in range(3):
        bent = 0.02 * thumb
        at = np.array([start + 0.03 * hand * n, across - bent * n, z - bent * (n + 1)])
        parent = b.add(f"{side}_finger{k}_{n}", parent, mirrored * at)
    if ends:
        at = np.array([start + 0.085 * hand, across - (0.05 if thumb else 0), z - (0.07 if thumb else 0)])
        b.add(f"{side}_finger{k}_end", parent, mirrored * at)


def lower_arms(b, angle_deg):
    """Turns both arms down by an angle about the shoulders, fingers and all."""
    for s, side in ((1, "left"), (-1, "right")):
        pivot = b.at(f"{side}_upper_arm").copy()
        turn = Rotation.from_euler("y", s * angle_deg, degrees=True).as_matrix()
        moved = {f"{side}_upper_arm"}
        for k, (name, parent) in enumerate(zip(b.names, b.parents, strict=True)):
            if parent in moved or name in moved:
                moved.add(name)
                b.places[k] = pivot + turn @ (b.places[k] - pivot)
    return b


def four_legged(rng):
    """A Builder of an animal on four legs."""
    b = Builder()
    top = b.add("root", "", (0, 0, 0))
    hips = b.add("hips", top, (0, 0.4, 0.6))
    last = hips
    for k in range(3):
        last = b.add(f"spine{k}", last, (0, 0.2 - 0.2 * k, 0.62 + rng.normal(0, 0.02)))
    neck = b.add("neck", last, (0, -0.35, 0.75))
    skull = b.add("head", neck, (0, -0.5, 0.9))
    b.add("nose", skull, (0, -0.7, 0.85))
    b.add("tail1", b.add("tail0", hips, (0, 0.5, 0.6)), (0, 0.8, 0.5))
    for s, side in ((1, "left"), (-1, "right")):
        for parent, end, y in ((hips, "hind", 0.4), (last, "front", -0.25)):
            for k, (dy, z) in enumerate(((0, 0.55), (-0.05, 0.32), (0.05, 0.1), (-0.02, 0.02))):
                parent = b.add(f"{side}_{end}{k}", parent, (s * 0.12, y + dy, z))
    return b
