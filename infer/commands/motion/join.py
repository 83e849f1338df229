"""The command `join`: files of motion one behind the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.infer.commands.convert import Units
from muybridge.infer.pipelines.characters.blending import Made, Material, check_files, join_files, read_material
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.blending import JoinOptions
from muybridge.motion.editing.channels import duration
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.registry import ReadOptions, write_file

COMMON_OPTIONS = {"join": ("out", "how", "seconds", "at", "overwrite")}


@dataclass(frozen=True)
class Making:
    """From where one motion is made of several, and where it is written.

    Attributes:
        out: file to write, in any format of motion.
        fps: frames per second of OUT (default: those of the first file).
        units: unit of lengths, of files that do not say or say it wrongly; cmu is 0.0254 / 0.45 m.
        clip: name or number (from 0) of the animation, of files that hold several (default: the first).
        to_units: unit of lengths in a BVH file that is written; every other format has its own.
        overwrite: replace OUT if it exists.
    """

    out: Path
    fps: float | None = None
    units: Units | None = None
    clip: str | None = None
    to_units: Literal["m", "cm"] = "m"
    overwrite: bool = False

    def read(self, files: Sequence[Path], what: str, progress: Progress) -> Material:
        """What the files hold, once it is sure that OUT can be written.

        Raises:
            MuybridgeError: see `check_files` and `read_material`.
        """
        check_fps(self.fps)
        check_files(files, self.out, self.overwrite, what)
        material = read_material(files, ReadOptions(units=self.units, clip=self.clip), self.fps)
        for notice in material.notices:
            progress.notice(notice)
        return material

    def write(self, made: Made, progress: Progress) -> int:
        """Write the motion and print what was done; the exit code."""
        for notice in made.notices:
            progress.notice(notice)
        print("\n".join(made.told))
        write_file(self.out, made.take, self.to_units)
        motion = made.take.motion
        assert motion is not None
        print(f"{self.out}: has {len(motion)} frames at {motion.fps:.6g} fps ({duration(motion):.3f} s)")
        return 0


def join(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE...")],
    /,
    *,
    options: Annotated[Making, tyro.conf.arg(name="")],
    how: Literal["inertial", "crossfade", "quadratic", "align"] = "inertial",
    seconds: float | None = None,
    at: tuple[float, ...] = (),
    overlap: float = 1.0,
    frames: int = 10,
    plant: bool = True,
) -> int:
    """Join motions of one skeleton, each to the next one where they are most alike.

    The next motion is turned and moved over the ground until it goes on where the one before is left. Feet that stand
    there stay where they are.

    Examples:
        muybridge join walk.bvh turn.bvh --out both.bvh
        muybridge join walk.bvh run.bvh stop.bvh --out all.glb --how crossfade --seconds 0.3

    Args:
        files: files of motion in their order, in any formats, of one skeleton.
        options: what is read and written.
        how: `inertial` lets the difference die away behind the join; `crossfade` fades over about it; `quadratic` fits
            a parabola about it; `align` leaves the jump.
        seconds: that the transition lasts (default: of `inertial` the shortest one that is no more violent than the
            motions, from 0.2 to 1; of `crossfade` 0.4).
        at: of each join two times, in seconds: when the one motion is left, and when the next one is entered (default:
            where they are most alike).
        overlap: seconds at the end of a motion and at the beginning of the next one in which that place is looked for.
        frames: on either side of the join, of `quadratic`; 5 to 20.
        plant: hold feet still about the join while they stand.
    """
    transition = JoinOptions(how, seconds, frames, overlap, plant=plant)
    progress = Progress()
    material = options.read(files, "a join", progress)
    return options.write(join_files(material, transition, at), progress)
