"""A person's motion on a humanoid robot, and how well it holds what it should."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.find import ContactOptions
from muybridge.motion.retargeting.grounding import find_ground
from muybridge.motion.retargeting.rig import make_rig, pose_rig
from muybridge.motion.robots.capsules import Capsules, find_capsules
from muybridge.motion.robots.link_roles import SIDES, LinkRoles, find_link_roles
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.solver import RobotPose, SolveOptions, solve_robot
from muybridge.motion.robots.targets import RobotSole, Targets, find_sole, make_targets

SLIDING_M_S = 0.01  # over which a foot in contact slides
PENETRATION_M = 0.01


@dataclass(frozen=True)
class RobotOptions:
    """How a take is put onto a robot.

    Attributes:
        contacts: how contacts are found in the take.
        solve: how the robot is solved.
    """

    contacts: ContactOptions = field(default_factory=ContactOptions)
    solve: SolveOptions = field(default_factory=SolveOptions)


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """A robot over time.

    Attributes:
        robot: whose joints these are.
        fps: frames per second.
        root: (T, 3) metres, the root link's frame in the world, Z up, floor at 0.
        quat_wxyz: (T, 4) world from root link, without sign flips.
        joints: (T, J) radians or metres, in the file's own order.
    """

    robot: Robot
    fps: float
    root: FloatArray
    quat_wxyz: FloatArray
    joints: FloatArray

    def __len__(self) -> int:
        return len(self.root)


@dataclass(frozen=True, eq=False)
class RobotTake:
    """A take on a robot.

    Attributes:
        motion: of the robot.
        parts: of the robot, as they were found.
        targets: that it was solved for.
        capsules: of its links.
        contact: (T, 2, 2) of heel and ball, left and right.
        quality: measures of it.
    """

    motion: RobotMotion
    parts: LinkRoles
    targets: Targets
    capsules: Capsules
    contact: BoolArray
    quality: "RobotQuality"


@dataclass(frozen=True)
class RobotQuality:
    """What a robot's motion holds.

    Attributes:
        tracking_m: metres, mean distance of the points from where they should be.
        beyond_limits: joint values outside their limits, or faster than they may be.
        inside_frames: frames in which links are more than 10 mm inside each other.
        deepest_m: metres, the farthest that links are inside each other.
        sliding: share of the frames of contact in which heel or ball move faster than 1 cm/s over the floor.
        under_floor_m: metres, the farthest that a sole is under the floor.
        jerk: radians per second cubed, root mean square over joints.
    """

    tracking_m: float
    beyond_limits: int
    inside_frames: int
    deepest_m: float
    sliding: float
    under_floor_m: float
    jerk: float


def retarget_to_robot(
    motion: Motion, roles: Mapping[str, int], robot: Robot, options: RobotOptions | None = None,
    map: Mapping[str, str] | None = None, progress: Callable[[int], None] | None = None,
) -> RobotTake:  # fmt: skip
    """Put a motion onto a humanoid robot.

    Args:
        motion: Z up, of at least one frame; units may be any.
        roles: role -> joint of its skeleton, the core roles at least (`muybridge.geometry.roles.find_roles`).
        robot: `muybridge.motion.robots.read_robot`.
        options: how.
        map: role -> link of the robot, where they cannot be found (`find_link_roles`).
        progress: called with the number of frames that are done.

    Raises:
        MuybridgeError: the robot's legs and arms are not found.
        ValueError: no frames.
    """
    options = options or RobotOptions()
    if not len(motion):
        raise ValueError("a motion without frames cannot be put onto a robot")
    parts = find_link_roles(robot, map)
    capsules = find_capsules(robot)
    feet = [parts.limbs[f"{side}_leg"] for side in SIDES]
    left, right = (find_sole(robot, limb, parts.axes) for limb in feet)
    rig = make_rig(motion.skeleton, roles, motion=motion)
    posed = pose_rig(rig, motion)
    ground = find_ground(rig, posed, motion.fps, options.contacts)
    targets = make_targets(robot, parts, (left, right), rig, posed, ground, motion.fps)
    soles = ((feet[0].end, left), (feet[1].end, right))
    pose = solve_robot(robot, targets, capsules, soles, motion.fps, options.solve, progress)
    moved = RobotMotion(
        robot, motion.fps, pose.root, continuous_quat(quat_from_matrix(pose.turn)), robot.all_joints(pose.free)
    )
    contact = ground.contacts.contact
    quality = measure(robot, pose, targets, capsules, soles, motion.fps)
    return RobotTake(moved, parts, targets, capsules, contact, quality)


def measure(
    robot: Robot, pose: RobotPose, targets: Targets, capsules: Capsules, soles: tuple[tuple[int, RobotSole], ...],
    fps: float,
) -> RobotQuality:  # fmt: skip
    """How well a robot's motion does what it should."""
    turns, places = robot.forward(pose.root, pose.turn, robot.all_joints(pose.free))
    points = points_of(targets, turns, places)
    lower, upper, speed = robot.limits
    broken = int(((pose.free < lower - 1e-9) | (pose.free > upper + 1e-9)).sum())
    broken += int((np.abs(np.diff(pose.free, axis=0)) * fps > speed * (1 + 1e-9)).sum())
    gaps = capsules.distances(turns, places)
    deepest = -gaps.min(axis=1) if gaps.shape[1] else np.zeros(len(pose))
    feet = [targets.names.index(f"{side}_{part}") for side in SIDES for part in ("heel", "ball")]
    rest_turns, rest_places = robot.at_rest()
    low = 0.0
    for link, sole in soles:
        own = (sole.corners - rest_places[link]) @ rest_turns[link]
        low = min(low, float(((turns[:, link] @ own.T)[:, 2] + places[:, link, 2:]).min()))
    third = np.diff(pose.free, 3, axis=0) * fps**3
    return RobotQuality(
        float(np.linalg.norm(points - targets.places, axis=-1).mean()), broken, int((deepest > PENETRATION_M).sum()),
        float(max(deepest.max(), 0.0)), sliding_share(points[:, feet], targets.contact.reshape(-1, 4), fps), -low,
        float(np.sqrt((third**2).mean())) if len(third) else 0.0,
    )  # fmt: skip


def points_of(targets: Targets, turns: FloatArray, places: FloatArray) -> FloatArray:
    """(T, P, 3) metres: the robot's points that have targets, from its links' (T, L, 3, 3) and (T, L, 3)."""
    return np.asarray(places[:, targets.links] + (turns[:, targets.links] @ targets.points[..., None])[..., 0])


def sliding_share(points: FloatArray, contact: BoolArray, fps: float) -> float:
    """Share of the frames of contact (T, K) after which a point (T, K, 3), which stays in contact, moves too fast."""
    stays = contact[1:] & contact[:-1]
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * fps
    return float((speed[stays] > SLIDING_M_S).mean()) if stays.any() else 0.0
