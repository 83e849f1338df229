"""Robots of any format that is known, by suffix."""

from collections.abc import Callable
from pathlib import Path

from muybridge.errors import FormatError, parsing
from muybridge.motion.robots.mjcf import read_mjcf
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.urdf import read_urdf

ROBOT_FORMATS: dict[str, tuple[str, Callable[[Path], Robot]]] = {
    ".xml": ("an MJCF", read_mjcf),
    ".mjcf": ("an MJCF", read_mjcf),
    ".urdf": ("a URDF", read_urdf),
}


def is_robot(path: Path) -> bool:
    """Whether a file's name is that of a robot's description."""
    return path.suffix.lower() in ROBOT_FORMATS


def read_robot(path: Path) -> Robot:
    """Read a robot: .xml or .mjcf (MJCF), .urdf.

    Raises:
        FormatError: the file is none of these, or a robot without joints; the message names the file.
    """
    path = Path(path)
    if not is_robot(path):
        raise FormatError(f"{path}: a robot is described by one of {', '.join(ROBOT_FORMATS)}")
    what, reader = ROBOT_FORMATS[path.suffix.lower()]
    with parsing(path, FormatError, what):
        robot = reader(path)
        robot.limits  # noqa: B018 - joints that follow themselves are found here
    if not robot.free:
        raise FormatError(f"{path}: the robot has no joint that moves")
    return robot
