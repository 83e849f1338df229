"""Two made-up styles of one body: arms that hang while it bends its trunk, and elbows held out while it stands."""

import numpy as np

from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.style import Style, examples_of, learn_style

SKELETON = BODY.skeleton(prior_shape(1.74))
ROLES = {name: j for j, name in enumerate(SKELETON.names)}
ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")


def take(elbows_deg: float, frames: int = 240, seed: int = 0, stature: float = 1.74) -> Motion:
    """A take in which hands go to and fro and the trunk sways; the upper arms are turned out by some degrees.

    The turn of an upper arm about its length decides where its elbow is, which a goal for the hand leaves open.
    """
    skeleton = BODY.skeleton(prior_shape(stature))
    rng, t = np.random.default_rng(seed), np.arange(frames)
    angles = np.zeros((frames, len(skeleton), 3))

    def wave(size: float) -> np.ndarray:
        return size * np.sin(2 * np.pi * (t / rng.uniform(50, 120) + rng.uniform()))

    for side, sign in (("left", 1), ("right", -1)):
        arm, forearm = skeleton.index(f"{side}_upper_arm"), skeleton.index(f"{side}_forearm")
        angles[:, arm, 0] = np.radians(elbows_deg) + wave(0.1)
        angles[:, arm, 1] = sign * (0.9 + wave(0.3))
        angles[:, arm, 2] = sign * (-0.5 + wave(0.3))
        angles[:, forearm, 2] = sign * (-1.0 + wave(0.5))
        thigh, shin = skeleton.index(f"{side}_thigh"), skeleton.index(f"{side}_shin")
        bend = 0.3 + wave(0.2)
        angles[:, thigh, 0], angles[:, shin, 0] = -bend, 2 * bend
        angles[:, skeleton.index(f"{side}_foot"), 0] = -bend
    angles[:, skeleton.index("spine"), 0] = 0.1 + wave(0.1)
    angles[:, skeleton.index("chest"), 2] = wave(0.15)
    quat = continuous_quat(quat_from_matrix(skeleton.rotations_from_angles(angles)))
    return Motion(skeleton, 60.0, np.tile([0.3, -0.2, 0.9], (frames, 1)), quat)


def learned(elbows_deg: float, seed: int = 0) -> Style:
    """The style of two such takes."""
    one, two = (examples_of(f"take {s}", take(elbows_deg, seed=s), roles=ROLES) for s in (seed, seed + 1))
    return learn_style(one.merged(two), ROLES)
