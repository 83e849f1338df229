"""Where heels and balls of the feet are, of a skeleton in motion or of labelled points."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.roles import find_motion_roles, find_roles
from muybridge.geometry.roles.standing import body_axes_at_rest, standing_pose
from muybridge.geometry.skeleton.aliases import map_body, map_surface
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton

FEET = ("left", "right")
PARTS = ("heel", "ball")
USUAL_LEG_M = 0.85  # hip to ankle of an adult, whom all lengths of the options fit
_HEEL_BEHIND = 0.2  # of the way from the ankle to the ball, over the ground, that the heel is behind the ankle
_BALL = ("big_toe", "small_toe", "toe", "metatarsal_1", "metatarsal_5")  # points that stand for it
_STILL = 1e-3  # of a toe's quaternions, between frames
_FOOT_OF_LEG = 0.15  # ankle to ball of a foot without a ball, as a share of the leg


@dataclass(frozen=True)
class Leg:
    """One leg of a skeleton.

    Attributes:
        thigh, shin, foot: joints at hip, knee and ankle.
        toe: joint at the ball; -1 where there is none.
        heel: (3,) metres from the ankle to the heel, in the foot's axes.
        ball: (3,) metres from the ankle to the ball.
        ahead: (3,) unit, where the knee points, in the thigh's axes.
    """

    thigh: int
    shin: int
    foot: int
    toe: int
    heel: FloatArray
    ball: FloatArray
    ahead: FloatArray = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))


@dataclass(frozen=True, eq=False)
class FootPoints:
    """Heels and balls over time.

    Attributes:
        places: (T, 2, 2, 3) metres of the left and the right foot's heel and ball; NaN where unknown.
        sigma: (T, 2, 2) metres, standard deviation a coordinate; NaN where unknown.
        fps: frames per second.
        size: of the body against an adult's.
    """

    places: FloatArray
    sigma: FloatArray
    fps: float
    size: float


def find_legs(
    skeleton: Skeleton, roles: Mapping[str, int] | None = None, motion: Motion | None = None
) -> tuple[Leg, Leg]:
    """The left and the right leg.

    The heel is put as low as the ball at rest, behind the ankle; a foot without a joint at the ball gets one from the
    end of its bone, else of usual length. Toes that never bend make the foot one piece, which rolls over their tips:
    these then are its ball.

    Args:
        skeleton: whose soles are level at rest, whatever axis is up and wherever it faces.
        roles: role -> joint; None finds them.
        motion: which shows whether toes bend (without one, the limits do), and how the body stands where the rest pose
            does not.

    Raises:
        ValueError: a thigh, shin or foot is not known, or a shin is not below its thigh.
    """
    if roles is None:
        roles = (find_roles(skeleton) if motion is None else find_motion_roles(motion)).roles
    legs = []
    for side in FEET:
        chain = [roles.get(f"{side}_{part}", -1) for part in ("thigh", "shin", "foot")]
        for part, joint in zip(("thigh", "shin", "foot"), chain, strict=True):
            if joint < 0:
                raise ValueError(f"no joint is known to be {side}_{part}; the joints are {', '.join(skeleton.names)}")
        thigh, shin, foot = chain
        # A foot may hang elsewhere, on a control bone.
        if not skeleton.is_ancestor[thigh, shin] or thigh == shin or skeleton.is_ancestor[foot, shin]:
            names = ", ".join(skeleton.names[j] for j in chain)
            raise ValueError(f"the joints of the {side} leg ({names}) do not hang on one another")
        legs.append((chain, roles.get(f"{side}_toe", -1)))
    body = _body_from_joints(skeleton, roles, motion)
    return _leg(skeleton, *legs[0], body, motion), _leg(skeleton, *legs[1], body, motion)


def _leg(skeleton: Skeleton, chain: list[int], toe: int, body: FloatArray, motion: Motion | None) -> Leg:
    """A leg of known joints; `body` (J, 3, 3) as `_body_from_joints` gives it."""
    of_foot = body[chain[2]]
    ball = _ball(skeleton, chain, toe, of_foot)
    heel = -_HEEL_BEHIND * ball * [1, 1, 0] + ball * [0, 0, 1]
    tip = np.asarray(skeleton.tips[toe]) if toe >= 0 else np.full(3, np.nan)
    if np.isfinite(tip).all() and not _bends(skeleton, toe, motion):
        ball = ball + body[toe] @ tip
    ahead = body[chain[0]].T @ [0.0, -1.0, 0.0]
    return Leg(chain[0], chain[1], chain[2], toe, of_foot.T @ heel, of_foot.T @ ball, ahead)


def _body_from_joints(skeleton: Skeleton, roles: Mapping[str, int], motion: Motion | None) -> FloatArray:
    """(J, 3, 3) the axes of a body that stands (left, back, up) from each joint's own; the identity without arms, by
    which the axes of a body are known."""
    if not all(f"{side}_upper_arm" in roles for side in FEET):
        return np.tile(np.eye(3), (len(skeleton), 1, 1))
    places, turns = standing_pose(skeleton, roles, motion)
    return np.asarray(body_axes_at_rest(places, roles).T @ turns)


def _bends(skeleton: Skeleton, toe: int, motion: Motion | None) -> bool:
    """Whether a toe bends at its joint."""
    if motion is None or len(motion) < 2:
        return bool((skeleton.lower[toe] < skeleton.upper[toe]).any())
    return bool(np.abs(motion.quat_wxyz[:, toe] - motion.quat_wxyz[0, toe]).max() > _STILL)


def _ball(skeleton: Skeleton, chain: list[int], toe: int, body: FloatArray) -> FloatArray:
    """(3,) metres from the ankle to the ball at rest, in the body's axes; `body` (3, 3) turns the foot's into them."""
    foot = chain[-1]
    if toe >= 0 and skeleton.is_ancestor[foot, toe]:
        return np.asarray(body @ (skeleton.rest_positions[toe] - skeleton.rest_positions[foot]))
    tip = np.asarray(body @ skeleton.tips[foot])
    if np.isfinite(tip).all() and np.linalg.norm(tip[:2]) > 0:
        return tip
    size = _FOOT_OF_LEG * _length(skeleton, chain)
    return np.array([0.0, -size, -0.5 * size])


def _length(skeleton: Skeleton, chain: list[int]) -> float:
    places = skeleton.rest_positions[chain]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def leg_length(skeleton: Skeleton, legs: tuple[Leg, Leg]) -> float:
    """Metres from hip to ankle along thigh and shin, the mean of both legs."""
    return float(np.mean([_length(skeleton, [leg.thigh, leg.shin, leg.foot]) for leg in legs]))


def feet_of_motion(motion: Motion, roles: Mapping[str, int] | None = None) -> FootPoints:
    """Heels and balls of a skeleton; ValueError as `find_legs`."""
    legs = find_legs(motion.skeleton, roles, motion)
    world = motion.forward()
    places = np.stack([points_of_foot(world[:, leg.foot, :3, 3], world[:, leg.foot, :3, :3], leg) for leg in legs], 1)
    size = leg_length(motion.skeleton, legs) / USUAL_LEG_M
    return FootPoints(places, np.full(places.shape[:-1], np.nan), motion.fps, size)


def points_of_foot(ankle: FloatArray, turns: FloatArray, leg: Leg) -> FloatArray:
    """(T, 2, 3) metres of heel and ball, of an ankle (T, 3) and a foot's orientation (T, 3, 3)."""
    return np.stack([ankle + turns @ leg.heel, ankle + turns @ leg.ball], 1)


def feet_of_points(points: Points3D) -> FootPoints:
    """Heels and balls of labelled points: landmarks of heels and toes, or markers on them.

    Raises:
        ValueError: a heel or the toes of a foot are not among them.
    """
    at, names = map_body(points.landmarks.names), points.landmarks.names
    places = np.full((len(points.points_world), 2, 2, 3), np.nan)
    variance = np.full(places.shape[:-1], np.nan)
    skin = map_surface(points.landmarks.names) if "left_heel" not in at or "left_big_toe" not in at else {}
    at = {**skin, **at}
    for k, side in enumerate(FEET):
        toes = [at[n] for n in (f"{side}_{part}" for part in _BALL) if n in at]
        if f"{side}_heel" not in at or not toes:
            raise ValueError(f"no point is known to be the {side} {'toe' if f'{side}_heel' in at else 'heel'}; "
                             f"the points are {', '.join(names)}")  # fmt: skip
        for p, columns in enumerate(([at[f"{side}_heel"]], toes)):
            places[:, k, p] = points.points_world[:, columns].mean(1)
            spread = np.trace(points.covariance_world[:, columns], axis1=-2, axis2=-1) / 3
            variance[:, k, p] = spread.mean(1) / len(columns)
    return FootPoints(places, np.sqrt(variance), points.fps, _size(points, at))


def _size(points: Points3D, at: Mapping[str, int]) -> float:
    """The body's size by its legs; 1 where hips or knees are not known."""
    lengths = []
    for side in FEET:
        chain = [at.get(f"{side}_{part}", -1) for part in ("hip", "knee", "ankle")]
        if min(chain) >= 0:
            places = points.points_world[:, chain]
            lengths.append(np.nanmedian(np.linalg.norm(np.diff(places, axis=1), axis=-1).sum(1)))
    found = float(np.nanmean(lengths)) / USUAL_LEG_M if lengths and np.isfinite(lengths).any() else 1.0
    return found if found > 0 else 1.0
