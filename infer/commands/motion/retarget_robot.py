"""The command `retarget` onto a humanoid robot: what its links mean, and the files of its joints."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics._numba import is_compiled
from muybridge.geometry.roles import load_role_map
from muybridge.infer.commands.motion.role_maps import write_map
from muybridge.infer.commands.remedies import print_error
from muybridge.infer.pipelines.characters.retarget import read_take
from muybridge.infer.pipelines.characters.takes import take_names, takes_of
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.each import try_each
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.editing.resampling import resample
from muybridge.motion.robots._solver_kernel import assemble
from muybridge.motion.robots.link_roles import find_link_roles
from muybridge.motion.robots.read import read_robot
from muybridge.motion.robots.retarget import RobotOptions, RobotTake, retarget_to_robot
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.write import ROBOT_OUTPUTS, check_robot_output, write_robot_motion
from muybridge.wording import counted


@dataclass(frozen=True)
class RobotRequest:
    """What is put onto a robot, and where it is written.

    Attributes:
        takes: files of motion, folders of them, session folders.
        to: the robot's file.
        out: file to write, of the format of its suffix; None for all formats, named after robot and take.
        role_map: TOML file of the robot's links.
        suggest: write such a file and stop.
        take_map: TOML file of the takes' joints.
        take_clip: of takes that hold several.
        fps: frames per second of what is written; None for the take's.
        overwrite: replace files that are there.
    """

    takes: Sequence[Path]
    to: Path
    out: Path | None = None
    role_map: Path | None = None
    suggest: bool = False
    take_map: Path | None = None
    take_clip: str | None = None
    fps: float | None = None
    overwrite: bool = False


def run_retarget_robot(request: RobotRequest) -> int:
    """Put takes onto a robot and print what was done.

    Returns:
        The exit code: 0; 2 where one of several takes failed, and 1 where that was a bug.

    Raises:
        MuybridgeError: a file cannot be read, the robot is no humanoid, no take is named.
    """
    robot = read_robot(request.to)
    chosen = load_role_map(request.role_map) if request.role_map is not None else None
    try:
        parts = find_link_roles(robot, chosen)
    except MuybridgeError as error:
        raise (error if request.role_map is None else error.about(str(request.role_map))) from None
    progress = Progress()
    for notice in robot.notices:
        progress.notice(f"{request.to.name}: {notice}")
    print(f"{request.to.name}: {len(robot.joints)} joints, legs and arms found by {parts.how}")
    if request.suggest:
        path = request.out or Path(f"{request.to.stem}.map.toml")
        return write_map(path, suggest_link_map(robot, parts.table(robot)), request.to, request.overwrite)
    takes = takes_of(request.takes, request.take_clip)
    files = takes.files
    for notice in takes.notices:
        progress.notice(notice)
    outputs = dict(zip(files, robot_outputs(request.out, request.to, files), strict=True))
    written = [path for paths in outputs.values() for path in paths]
    check_replaceable(written, request.overwrite, [request.to, *files], make_folders=False)
    if not is_compiled(assemble):
        progress.say("compiling numerical kernels (first run only), which takes about a minute")

    def put(file: Path) -> None:
        with Progress() as shown:
            take = _place(file, robot, chosen, request, shown)
        for path in outputs[file]:
            write_robot_motion(path, take.motion)
        print("\n".join([describe(file, take), *map(str, outputs[file])]), flush=True)

    tried = try_each(files, put, print_error)
    tried.report_failures("takes")
    return tried.exit_code


def suggest_link_map(robot: Robot, table: dict[str, str]) -> str:
    """The text of a map of a robot's links."""
    lines = [f"# Which link of {robot.path.name} is which part of the body; all its links stand at the end."]
    lines += [f'{role} = "{name}"' for role, name in table.items()]
    return "\n".join([*lines, "", *(f"# {name}" for name in robot.links), ""])


def robot_outputs(out: Path | None, to: Path, takes: Sequence[Path]) -> list[list[Path]]:
    """The files that are written for each take.

    Raises:
        OutputError: `out` is of no format of a robot's motion.
        MuybridgeError: two takes have one name.
    """
    if out is not None:
        check_robot_output(out)
        if len(takes) == 1:
            return [[out]]
    names = take_names(takes)
    if len(set(names)) != len(names):
        raise MuybridgeError(
            "two takes have the same name and the same folder's name; put them onto the robot one by one"
        )
    if out is not None:
        return [[out.with_name(f"{out.stem}_{name}{out.suffix}")] for name in names]
    return [[Path(f"{to.stem}_{name}{suffix}") for suffix in ROBOT_OUTPUTS] for name in names]


def describe(file: Path, take: RobotTake) -> str:
    """One line on a take."""
    quality = take.quality
    frames = counted(len(take.motion), "frame")
    return (
        f"{file.stem}: {frames} at {take.motion.fps:g} fps, path scaled by {take.targets.scale:.3g}, "
        f"{quality.tracking_m * 1e3:.0f} mm from the targets, feet slide in {quality.sliding:.1%} of contact, "
        f"links inside each other by over 10 mm in {counted(quality.inside_frames, 'frame')}"
    )


def _place(
    file: Path, robot: Robot, chosen: dict[str, str] | None, request: RobotRequest, progress: Progress
) -> RobotTake:
    motion, roles, notices = read_take(file, request.take_clip, request.take_map)
    if request.fps and abs(request.fps - motion.fps) > 1e-6 * request.fps and len(motion) > 1:
        notices.append(f"{file.name}: resampled from {motion.fps:g} to {request.fps:g} frames per second, as asked")
        motion = resample(motion, request.fps)
    for notice in (*notices, *(f"{file.name}: {note}" for note in roles.notes)):
        progress.notice(notice)
    with progress.task(f"{file.name} on {robot.name}", len(motion)) as task:
        return retarget_to_robot(motion, roles.roles, robot, RobotOptions(), chosen, task.advance)
