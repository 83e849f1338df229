"""Takes put onto robots: limits, penetration, sliding, jerk and speed, against a solve of one frame after the other.

The other solve is mink's (https://github.com/kevinzakka/mink) where it and MuJoCo are installed: the same points and
orientations with the same weights, joint limits, no collisions, each frame from the one before, up to ten steps.

    python -m scripts.benchmarks.motion.robots ROBOT.xml [--takes 12] [--motions FILE...]
"""

import argparse
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat, quat_from_matrix
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.registry import ReadOptions, read_file
from muybridge.motion.robots import RobotTake, SolveOptions, read_robot, retarget_to_robot
from muybridge.motion.robots.retarget import points_of
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.solver import RobotPose, solve_robot
from muybridge.motion.robots.targets import find_sole

# Of the other solve: steps a frame, damping (ten times GMR's: it jumps less), metres or radians of a last step.
STEPS, DAMPING, DONE = 10, 5.0, 1e-3
POINT, TURN = 1 / 0.02**2, 1 / 0.1**2  # largest weights while both are compared


def jerk(free: FloatArray, fps: float) -> float:
    """Root mean square of the third derivative of joint angles."""
    return float(np.sqrt(((np.diff(free, 3, axis=0) * fps**3) ** 2).mean()))


def tracking(robot: Robot, take: RobotTake, pose: RobotPose) -> float:
    """Metres, mean distance of the points from their targets."""
    turns, places = robot.forward(pose.root, pose.turn, robot.all_joints(pose.free))
    return float(np.linalg.norm(points_of(take.targets, turns, places) - take.targets.places, axis=-1).mean())


def pose_of(take: RobotTake) -> RobotPose:
    """A take's pose as the solver has it."""
    motion = take.motion
    return RobotPose(motion.root, matrix_from_quat(motion.quat_wxyz), motion.joints[:, list(motion.robot.free)])


def solve_with_mink(robot: Robot, take: RobotTake, start: RobotPose) -> RobotPose:
    """The same targets, one frame after the other."""
    import mink
    import mujoco

    text = re.sub(r"<geom[^>]*mesh=[^>]*/>", "", robot.path.read_text(), flags=re.S)
    spec = mujoco.MjSpec.from_string(re.sub(r"<asset>.*?</asset>", "", text, flags=re.S))
    targets = take.targets
    for name, link, place in zip(targets.names, targets.links, targets.points, strict=True):
        spec.body(robot.links[link]).add_site(name=f"target_{name}", pos=place)
    model = spec.compile()
    configuration = mink.Configuration(model)
    q = configuration.q.copy()
    q[:3], q[3:7], q[7:] = start.root[0], quat_from_matrix(start.turn[:1])[0], start.free[0]
    configuration.update(q)
    points = [mink.FrameTask(f"target_{name}", "site", 1.0, 0.0) for name in targets.names]
    faces = [mink.FrameTask(robot.links[link], "body", 0.0, 1.0) for link in targets.turned]
    limits = [mink.ConfigurationLimit(model)]
    out = []
    for t in range(len(targets.places)):
        for k, task in enumerate(points):
            task.set_position_cost(np.sqrt(targets.weights[t, k]))
            task.set_target(mink.SE3.from_translation(targets.places[t, k]))
        for k, task in enumerate(faces):
            task.set_orientation_cost(np.sqrt(targets.turn_weights[t, k]))
            turn = mink.SO3.from_matrix(targets.turns[t, k])
            task.set_target(mink.SE3.from_rotation(turn))
        for _ in range(STEPS):
            step = mink.solve_ik(configuration, [*points, *faces], 1.0, "daqp", DAMPING, limits=limits)
            configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < DONE:
                break
        out.append(configuration.q.copy())
    q = np.array(out)
    return RobotPose(q[:, :3], matrix_from_quat(q[:, 3:7]), q[:, 7:])


def alike(take: RobotTake) -> RobotTake:
    """The take with weights that both solves can use: feet that stand pull no harder than others."""
    targets = take.targets
    weights, turns = np.minimum(targets.weights, POINT), np.minimum(targets.turn_weights, TURN)
    return replace(take, targets=replace(targets, weights=weights, turn_weights=turns))


def at_equal_tracking(robot: Robot, take: RobotTake, wanted: float) -> tuple[float, float]:
    """Jerk, and metres to the targets: of the smoothest solve that is no farther than wanted, else of the nearest."""
    feet = [take.parts.limbs[f"{side}_leg"] for side in ("left", "right")]
    soles = tuple((limb.end, find_sole(robot, limb, take.parts.axes)) for limb in feet)
    fps, found = take.motion.fps, (np.inf, np.inf)
    for smoothing in (25.0, 40.0, 70.0, 120.0, 200.0, 400.0, 800.0, 1600.0, 3200.0):
        options = SolveOptions(smoothing=smoothing, iterations=20)
        pose = solve_robot(robot, take.targets, take.capsules, soles, fps, options)
        one = (jerk(pose.free, fps), tracking(robot, take, pose))
        found = one if one[1] < found[1] else found
        if one[1] <= wanted:
            break
    return found


def takes_of(count: int, seed: int, files: list[Path]) -> list[tuple[str, Motion, dict[str, int]]]:
    """Generated takes as captured, with noise, and motions of files."""
    out = []
    if count:
        from scripts.benchmarks.motion.generated_takes import generated_takes, noisy

        for k, take in enumerate(generated_takes(count, seed, bodies=4, seconds=4.0)):
            out.append((take.kind, noisy(take, k), take.roles))
    for path in files:
        motion = read_file(path, ReadOptions()).motion
        assert motion is not None, path
        out.append((path.name, motion, find_roles(motion.skeleton).roles))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", type=Path)
    parser.add_argument("--takes", type=int, default=12)
    parser.add_argument("--skip", type=int, default=0, help="generated takes to leave out")
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--motions", type=Path, nargs="*", default=[])
    parser.add_argument("--mink", action="store_true", help="compare with mink, on an MJCF")
    args = parser.parse_args()
    robot = read_robot(args.robot)
    head = "| take | frames | frames/s | to targets mm | limits | inside 10 mm | sliding | under floor mm | jerk |"
    print(head + (" mink: to targets mm | jerk | jerk at its error | ratio |" if args.mink else ""), flush=True)
    ratios, frames, seconds = [], 0, 0.0
    for name, motion, roles in takes_of(args.takes, args.seed, args.motions)[args.skip :]:
        start = time.process_time()
        take = retarget_to_robot(motion, roles, robot)
        spent = time.process_time() - start
        if not frames:  # compiled now
            start = time.process_time()
            take = retarget_to_robot(motion, roles, robot)
            spent = time.process_time() - start
        frames, seconds = frames + len(motion), seconds + spent
        q = take.quality
        cells = (name, len(motion), f"{len(motion) / spent:.0f}", f"{q.tracking_m * 1e3:.1f}", q.beyond_limits,
                 q.inside_frames, f"{q.sliding:.1%}", f"{q.under_floor_m * 1e3:.1f}", f"{q.jerk:.0f}")  # fmt: skip
        line = f"| {' | '.join(map(str, cells))} |"
        if args.mink:
            same = alike(take)
            other = solve_with_mink(robot, same, pose_of(take))
            error, rough = tracking(robot, same, other), jerk(other.free, motion.fps)
            smooth, reached = at_equal_tracking(robot, same, error)
            ratios.append(smooth / rough)
            line += f" {error * 1e3:.1f} | {rough:.0f} | {smooth:.0f} ({reached * 1e3:.1f} mm) | {ratios[-1]:.2f} |"
        print(line, flush=True)
    print(f"{frames / seconds:.0f} frames/s")
    if ratios:
        print(f"jerk at equal error: median ratio {np.median(ratios):.2f}, worst {max(ratios):.2f}")


if __name__ == "__main__":
    main()
