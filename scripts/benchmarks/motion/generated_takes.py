"""Generated motion with true contacts, as it is and with the noise of our own captures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, matrix_from_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.feet import feet_of_motion

if TYPE_CHECKING:
    from muybridge.train.synthesis.motions.rig import SkinnedBody

FPS = 60.0
SECONDS = 5.0
# Lying and crawling feet rest on the floor, and the scripts of these motions do not say when.
UNKNOWN = ("crawl", "lie", "get_up", "floor_sit", "handstand", "cartwheel", "plank", "somersault")
_FLAT_M = 0.008  # a heel stands where the foot does and it is no higher than this over where it is in a flat foot
# Noise of the joints' angles, degrees, and of the root, metres, that gives the feet 7 to 8 mm an axis, as in the demo.
_NOISE_DEG = {"thigh": 0.4, "shin": 0.4, "foot": 1.5}
_NOISE_ROOT_M = 0.004


@dataclass(frozen=True, eq=False)
class TrueTake:
    """A generated take.

    Attributes:
        motion: of all bones of the body.
        roles: joint of each role.
        contact: (T, 2, 2) whether heel and ball of the left and right foot stand.
        striking: (T, 2) whether only the heel of a foot touches the floor, before the foot is flat.
        kind: of motion.
    """

    motion: Motion
    roles: dict[str, int]
    contact: BoolArray
    striking: BoolArray
    kind: str


def generated_takes(count: int, seed: int, bodies: int = 8, seconds: float = SECONDS) -> list[TrueTake]:
    """Takes of several bodies, of all motions whose contacts are known, by their shares."""
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.motions.rig import turn
    from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionSampler

    body = BodyModel(seed)
    rng = np.random.default_rng(seed)
    kinds = [k for k in MOTIONS if k not in UNKNOWN]
    share = np.array([MOTIONS[k] for k in kinds])
    people = [body.skeleton(p) for p in body.sample_phenotypes(bodies)]
    takes = []
    for k in range(count):
        person = people[k % bodies]
        clip = MotionSampler(person, rng).sample(seconds, FPS, str(rng.choice(kinds, p=share / share.sum())))
        quat = continuous_quat(quat_from_matrix(turn(clip.rotvec)))
        motion = Motion(person.joints, clip.fps, clip.root, quat)
        heel = _heel_heights(motion, person)
        low = heel < _FLAT_M
        speed = np.abs(np.gradient(heel, axis=0)) * clip.fps
        ball = clip.contacts
        takes.append(TrueTake(motion, person.roles, np.stack([ball & low, ball], -1), ~ball & low & (speed < 0.1),
                              clip.kind))  # fmt: skip
    return takes


def _heel_heights(motion: Motion, person: SkinnedBody) -> FloatArray:
    """(T, 2) metres of the heels over where they are in a flat foot: of the body at rest."""
    places = feet_of_motion(motion, person.roles).places[:, :, 0, 2]
    return places - person.at("toe2-1.L")[2]


def noisy(take: TrueTake, seed: int, size: float = 1.0) -> Motion:
    """The take's motion with noise of the spectrum that our captures have."""
    rng, motion = np.random.default_rng(seed), take.motion
    turns = matrix_from_quat(motion.quat_wxyz)
    for part, degrees in _NOISE_DEG.items():
        for side in ("left", "right"):
            j = take.roles[f"{side}_{part}"]
            shake = slow_noise((len(motion), 3), motion.fps, rng) * np.radians(degrees) * size
            turns[:, j] = turns[:, j] @ exp_so3(shake)
    root = motion.root_positions_world + slow_noise((len(motion), 3), motion.fps, rng) * _NOISE_ROOT_M * size
    return replace(motion, root_positions_world=root, quat_wxyz=continuous_quat(quat_from_matrix(turns)))


def slow_noise(shape: tuple[int, ...], fps: float, rng: np.random.Generator) -> FloatArray:
    """Noise (T, ...) of unit standard deviation with the correlations over time of the demo's errors: 0.9 after 40 ms,
    0.4 after 160 ms, none after 0.4 s."""
    out = np.zeros(shape)
    for share, seconds in ((0.8, 0.12), (0.2, 0.04)):
        s = seconds * fps
        white = gaussian_filter1d(rng.normal(size=shape), s, axis=0, mode="wrap")
        out += np.sqrt(share * 2 * s * np.sqrt(np.pi)) * white
    return out
