"""Markers on a person of plain anatomy: joint centres, hinges' axes and skin are known exactly.

The statistical bodies of the other takes have joints where a rigger put them, which may be centimetres from a living
person's. Here the hip is where Harrington's regression has it, knees and elbows are hinges whose axes stand at right
angles to the bone above, the forearm deviates outward, the shank is twisted; markers lie as Plug-in Gait asks, except
for an examiner's errors, and move over the bones as skin does (A. Cappozzo and others, Clinical Biomechanics 11, 1996:
centimetres on the thigh, and less turning than the bone's about its length).
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT, SURFACE
from muybridge.geometry.skeleton.joint_centres import hip_in_pelvis


@dataclass(frozen=True)
class AnatomicalPerson:
    """A build, metres and radians.

    Attributes:
        stature: its lengths are shares of it. breadth: factor on the widths of joints and pelvis.
        carrying: by which the straight forearm deviates outward. torsion: of the shank.
        examiner: standard deviation of where markers are placed. skin: factor on the skin's motion.
        knee, elbow: least and greatest flexion.
    """

    stature: float = 1.75
    breadth: float = 1.0
    carrying: float = 0.21
    torsion: float = 0.35
    examiner: float = 0.004
    skin: float = 1.0
    knee: tuple[float, float] = (0.09, 1.05)
    elbow: tuple[float, float] = (0.35, 0.65)


@dataclass(frozen=True, eq=False)
class AnatomicalTake:
    """Markers and truth: points (T, M, 3) of Plug-in Gait in its order, centres (T, 3) by joint of BODY, metres."""

    points: FloatArray
    centres: dict[str, FloatArray]
    fps: float

    @property
    def index(self) -> dict[str, int]:
        """Marker of SURFACE -> its column."""
        return {SURFACE.names[k]: i for i, k in enumerate(PLUG_IN_GAIT.surface_indices)}


def anatomical_take(
    person: AnatomicalPerson, rng: np.random.Generator, frames: int = 120, fps: float = 60.0
) -> AnatomicalTake:
    """A walk of `frames` frames; the person faces -y."""
    phase: FloatArray = np.asarray(2 * np.pi / fps * np.arange(frames), dtype=np.float64)  # a stride a second
    s = person.stature
    pelvis = _turns(0.08 + 0.03 * np.sin(2 * phase), 0.05 * np.sin(phase), 0.08 * np.cos(phase))
    root = np.stack([0.02 * np.sin(phase), -1.2 * phase / (2 * np.pi), 0.53 * s + 0.02 * np.sin(2 * phase)], -1)
    trunk = pelvis @ _turns(np.full(frames, 0.03), -0.05 * np.sin(phase), -0.16 * np.cos(phase))
    body = _Body(person, rng, root)
    width, depth = 0.137 * s * person.breadth, 0.09 * s
    for side, sign in (("left", 1.0), ("right", -1.0)):
        mirror = np.array([sign, 1.0, 1.0])
        forward, out, up = hip_in_pelvis("harrington", width, depth)
        body.place(
            pelvis,
            root,
            {f"{side}_asis": [width / 2, -depth / 2, 0.0], f"{side}_psis": [0.027 * s, depth / 2, 0.0]},
            mirror,
            0.004 * np.sin(phase),
        )
        body.leg(side, mirror, pelvis, root + pelvis @ (mirror * [out, -depth / 2 - forward, up]), phase)
        body.arm(side, mirror, trunk, root + trunk @ (mirror * [0.105 * s, 0.02 * s, 0.25 * s]), phase)
        body.place(
            trunk,
            root,
            {
                f"{side}_front_head": [0.042 * s, -0.05 * s, 0.43 * s],
                f"{side}_back_head": [0.04 * s, 0.05 * s, 0.435 * s],
            },
            mirror,
            0 * phase,
        )
    body.place(
        trunk,
        root,
        {
            "c7": [0, 0.05 * s, 0.30 * s],
            "t10": [0, 0.08 * s, 0.15 * s],
            "sternal_notch": [0, -0.045 * s, 0.265 * s],
            "xiphoid": [0, -0.075 * s, 0.17 * s],
            "right_scapula": [-0.05 * s, 0.08 * s, 0.23 * s],
        },
        np.ones(3),
        0 * phase,
    )
    points = np.stack([body.markers[SURFACE.names[k]] for k in PLUG_IN_GAIT.surface_indices], 1)
    return AnatomicalTake(points + rng.normal(0, 0.0005, points.shape), body.centres, fps)


class _Body:
    """Markers and centres as they are put together."""

    def __init__(self, person: AnatomicalPerson, rng: np.random.Generator, root: FloatArray) -> None:
        self.person, self.rng, self.root = person, rng, root
        self.markers: dict[str, FloatArray] = {}
        self.centres: dict[str, FloatArray] = {}

    def place(
        self,
        turns: FloatArray,
        at: FloatArray,
        local: dict[str, list[float]],
        mirror: FloatArray,
        slide: FloatArray,
        roll: FloatArray | None = None,
    ) -> None:
        """Markers on a bone: skin slides along it by `slide` (T,) metres and turns about it by `roll` (T,) radians."""
        about = np.eye(3) if roll is None else _turns(0 * roll, 0 * roll, self.person.skin * roll)
        for name, where in local.items():
            jitter = self.rng.normal(0, self.person.examiner, 3) * [0.25, 1, 1]
            on = (about @ (mirror * (np.array(where) + jitter))) + self.person.skin * slide[:, None] * [0, 0, 1]
            self.markers[name] = at + (turns @ on[..., None])[..., 0]

    def leg(self, side: str, mirror: FloatArray, pelvis: FloatArray, hip: FloatArray, phase: FloatArray) -> None:
        """Thigh, shank and foot; the left side's angles, mirrored by `mirror`."""
        who, s, sign = self.person, self.person.stature, mirror[0]
        phase = phase + (0 if sign > 0 else np.pi)
        low, high = who.knee
        flexion = low + (high - low) * (0.5 - 0.5 * np.cos(phase)) ** 2
        roll = 0.10 * np.sin(phase + 1)
        thigh = pelvis @ _turns(-0.15 - 0.35 * np.cos(phase), sign * 0.06 * np.sin(phase), sign * roll)
        shank = thigh @ _turns(flexion, -sign * np.full(len(phase), 0.04), 0 * phase)
        foot = shank @ _turns(0.15 * np.sin(phase), 0 * phase, -sign * np.full(len(phase), 0.15))
        knee = hip + thigh @ [0, 0, -0.232 * s]
        ankle = knee + shank @ [0, 0, -0.235 * s]
        wide = who.breadth * np.sqrt(s / 1.75)
        beside, below = 0.007 + 0.055 * wide, 0.007 + 0.036 * wide
        slide = 0.007 * s * np.sin(phase)
        wand = {f"{side}_{'thigh_distal' if sign > 0 else 'thigh_proximal'}": [0.04 * s, 0.0, -0.14 * s]}
        self.place(thigh, hip, wand, mirror, slide, -0.3 * sign * roll)
        self.place(thigh, knee, {f"{side}_knee_lateral": [beside, 0.0, 0.0]}, mirror, 0.4 * slide)
        twist = _turns(0 * phase, 0 * phase, sign * np.full(len(phase), who.torsion))
        axis = shank @ twist
        shanks = {f"{side}_{'shank_distal' if sign > 0 else 'shank_proximal'}": [0.035 * s, 0.01 * s, -0.10 * s]}
        self.place(axis, knee, shanks, mirror, 0.5 * slide)
        self.place(axis, ankle, {f"{side}_malleolus_lateral": [below, 0.0, 0.0]}, mirror, 0.2 * slide)
        self.place(
            foot,
            ankle,
            {f"{side}_heel": [0.0, 0.035 * s, -0.02 * s], f"{side}_toe": [0.0, -0.09 * s, -0.025 * s]},
            mirror,
            0 * phase,
        )
        self.centres |= {f"{side}_thigh": hip, f"{side}_shin": knee, f"{side}_foot": ankle}

    def arm(self, side: str, mirror: FloatArray, trunk: FloatArray, shoulder: FloatArray, phase: FloatArray) -> None:
        """Upper arm, forearm and hand."""
        who, s, sign = self.person, self.person.stature, mirror[0]
        phase = phase + (np.pi if sign > 0 else 0)
        low, high = who.elbow
        flexion = low + (high - low) * (0.5 - 0.5 * np.cos(phase))
        roll = 0.15 * np.sin(phase)
        arm = trunk @ _turns(-0.1 + 0.3 * np.cos(phase), -sign * np.full(len(phase), 0.12), sign * roll)
        fore = arm @ _turns(-flexion, -sign * np.full(len(phase), who.carrying), 0 * phase)
        elbow = shoulder + arm @ [0, 0, -0.172 * s]
        wrist = elbow + fore @ [0, 0, -0.150 * s]
        wide = who.breadth * np.sqrt(s / 1.75)
        names = ("upper_arm_proximal", "forearm_distal") if sign > 0 else ("upper_arm_distal", "forearm_proximal")
        self.place(trunk, shoulder, {f"{side}_acromion": [0.0, 0.0, 0.035 * s]}, mirror, 0.005 * np.sin(phase))
        self.place(
            arm,
            shoulder,
            {f"{side}_{names[0]}": [0.03 * s, 0.012 * s, -0.09 * s]},
            mirror,
            0 * phase,
            -0.4 * sign * roll,
        )
        self.place(
            arm, elbow, {f"{side}_elbow_lateral": [0.007 + 0.036 * wide, 0.0, 0.0]}, mirror, 0.004 * np.sin(phase)
        )
        # Half way to the palm backward: the thumb is in front.
        palm = fore @ _turns(0 * phase, 0 * phase, sign * np.full(len(phase), -0.8))
        self.place(palm, elbow, {f"{side}_{names[1]}": [0.025 * s, 0.0, -0.06 * s]}, mirror, 0 * phase)
        self.place(
            palm,
            wrist,
            {
                f"{side}_radial_styloid": [0.02 * s, 0.0, 0.0],
                f"{side}_ulnar_styloid": [-0.02 * s, 0.0, 0.0],
                f"{side}_metacarpal_2": [0.012 * s, 0.01 * s, -0.05 * s],
            },
            mirror,
            0 * phase,
        )
        self.centres |= {f"{side}_upper_arm": shoulder, f"{side}_forearm": elbow, f"{side}_hand": wrist}


def _turns(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """(T, 3, 3) rotations about x, then the turned y, then the turned z."""
    one, none = np.ones_like(x), np.zeros_like(x)
    about_x = np.array([[one, none, none], [none, np.cos(x), -np.sin(x)], [none, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), none, np.sin(y)], [none, one, none], [-np.sin(y), none, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), none], [np.sin(z), np.cos(z), none], [none, none, one]])
    a, b, c = (np.moveaxis(m, -1, 0) for m in (about_x, about_y, about_z))
    return np.asarray(a @ b @ c)
