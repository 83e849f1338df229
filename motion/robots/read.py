"""Robots of any format that is known, by suffix."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.motion.robots.mjcf import read_mjcf
from muybridge.motion.robots.mjcf_frames import parse_xml
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.urdf import read_urdf

ROBOT_FORMATS: dict[str, tuple[str, Callable[[Path], Robot]]] = {
    ".xml": ("an MJCF", read_mjcf),
    ".mjcf": ("an MJCF", read_mjcf),
    ".urdf": ("a URDF", read_urdf),
    ".xacro": ("a URDF", read_urdf),
}
# Between the outermost joints of any humanoid robot, toys and giants among them.
SIZES_M = (0.02, 30.0)


def is_robot(path: Path) -> bool:
    """Whether a file's name is that of a robot's description."""
    return path.suffix.lower() in ROBOT_FORMATS


def read_robot(path: Path) -> Robot:
    """Read a robot: .xml or .mjcf (MJCF), .urdf, or .xacro without macros.

    Raises:
        FormatError: the file is none of these, a robot without joints, or one of a size that no robot has; the
            message names the file.
    """
    path = Path(path)
    if not is_robot(path):
        raise FormatError(f"{path}: a robot is described by one of {', '.join(ROBOT_FORMATS)}")
    what, reader = ROBOT_FORMATS[path.suffix.lower()]
    with parsing(path, FormatError, what):
        # Simulators take a URDF from a file named .xml too.
        robot = (read_urdf if parse_xml(path).tag == "robot" else reader)(path)
        robot.limits  # noqa: B018 - joints that follow themselves are found here
    if not robot.free:
        raise FormatError(f"{path}: the robot has no joint that moves")
    size = float(np.ptp(robot.at_rest()[1], axis=0).max())
    if not SIZES_M[0] <= size <= SIZES_M[1]:
        unit = "; its lengths seem to be millimetres" if SIZES_M[0] <= size / 1000 <= SIZES_M[1] else ""
        raise FormatError(f"{path}: the robot is {size:.3g} m large; lengths of {what} are metres{unit}",
                          remedy="scale_robot")  # fmt: skip
    return robot
