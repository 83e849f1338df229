"""A robot's motion as a table, as arrays, and as the pickle that users of GMR load.

All hold the root link's frame in the world (metres, Z up, floor at 0) and the joints in the order of the robot's file.
"""

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from muybridge.errors import OutputError
from muybridge.files import replacing
from muybridge.motion.robots.retarget import RobotMotion

_ROOT = ("root_x", "root_y", "root_z", "root_qw", "root_qx", "root_qy", "root_qz")


def write_robot_csv(path: Path, motion: RobotMotion) -> None:
    """A line a frame: time in seconds, the root's position and quaternion wxyz, the joints by name."""
    names = ["time", *_ROOT, *(joint.name.replace(",", "_") for joint in motion.robot.joints)]
    times = np.arange(len(motion)) / motion.fps
    rows = np.column_stack([times, motion.root, motion.quat_wxyz, motion.joints])
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(names) + "\n")
        # Nine digits after the point: no rounding leaves a limit by more than a nanoradian.
        np.savetxt(file, rows, fmt="%.9f", delimiter=",", newline="\n")


def write_robot_npz(path: Path, motion: RobotMotion) -> None:
    """Arrays `fps`, `joint_names` (J,), `root_pos` (T, 3), `root_quat_wxyz` (T, 4), `joint_pos` (T, J), `robot`."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file, fps=np.float64(motion.fps), joint_names=np.array([joint.name for joint in motion.robot.joints]),
            root_pos=motion.root, root_quat_wxyz=motion.quat_wxyz, joint_pos=motion.joints,
            robot=np.array(motion.robot.name),
        )  # fmt: skip


def write_robot_pickle(path: Path, motion: RobotMotion) -> None:
    """The dictionary that GMR's scripts save: `fps`, `root_pos` (T, 3), `root_rot` (T, 4) xyzw, `dof_pos` (T, J),
    `local_body_pos` and `link_body_list`, which are None."""
    content = {
        "fps": float(motion.fps),
        "root_pos": np.asarray(motion.root),
        "root_rot": np.roll(motion.quat_wxyz, -1, axis=-1),
        "dof_pos": np.asarray(motion.joints),
        "local_body_pos": None,
        "link_body_list": None,
    }
    with replacing(path) as temporary, temporary.open("wb") as file:
        pickle.dump(content, file, protocol=4)


ROBOT_OUTPUTS: dict[str, Callable[[Path, RobotMotion], None]] = {
    ".csv": write_robot_csv,
    ".npz": write_robot_npz,
    ".pkl": write_robot_pickle,
}


def check_robot_output(path: Path) -> None:
    """Refuse a file whose suffix is of no format.

    Raises:
        OutputError: with the suffixes that are.
    """
    if path.suffix.lower() not in ROBOT_OUTPUTS:
        raise OutputError(f"{path}: a robot's motion is written as {', '.join(ROBOT_OUTPUTS)}", remedy="other_name")


def write_robot_motion(path: Path, motion: RobotMotion) -> None:
    """Write a robot's motion in the format of the suffix.

    Raises:
        OutputError: the suffix is of no format, or the file cannot be written.
    """
    check_robot_output(path)
    ROBOT_OUTPUTS[path.suffix.lower()](path, motion)
