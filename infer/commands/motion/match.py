"""The commands `match build`, `match play` and `match walk`: a figure that is steered by motion matching."""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.files import replacing
from muybridge.infer.pipelines.characters.matching import BuildRequest, build_from_files, walk_of
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.viewer.match_page import PageOptions, render_match_page
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.registry import check_writable, write_file
from muybridge.motion.graphs.paths import read_corners
from muybridge.motion.matching import (
    FeatureOptions,
    MatchDatabase,
    Steered,
    SteerOptions,
    Stick,
    read_database,
    write_database,
)
from muybridge.motion.matching import Path as GoalPath
from muybridge.motion.matching.files import SUFFIX
from muybridge.motion.take import Take
from muybridge.wording import counted

COMMON_OPTIONS = {
    "build": ("out", "fps", "mirror", "ignore", "take_clip", "map", "overwrite"),
    "play": ("out", "fps", "overwrite"),
    "walk": ("out", "path", "seconds", "speed", "turn_deg", "plant", "overwrite"),
}


def build(
    takes: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="TAKE...")],
    /,
    *,
    out: Path,
    fps: float | None = None,
    mirror: bool = False,
    ignore: tuple[str, ...] = (),
    take_clip: str | None = None,
    map: Path | None = None,
    features: FeatureOptions = FeatureOptions(),  # noqa: B008
    overwrite: bool = False,
) -> int:
    """Make a database of takes for motion matching.

    The takes are of one skeleton, and each goes on for longer than the longest horizon. The more directions, speeds,
    starts and stops they hold, the better a figure can be steered with them.

    Examples:
        muybridge match build takes/ --out walks.match
        muybridge match build walk.bvh run.bvh --mirror --ignore run:0-1.5 --out walks.match

    Args:
        takes: files of motion, folders of them, session folders.
        out: .match file to write.
        fps: frames per second of the database (default: those of the first take).
        mirror: add every take with left and right exchanged.
        ignore: parts of takes that are not played, as TAKE:FROM-TO in seconds.
        take_clip: name or number (from 0) of the animation to take, of takes that hold several.
        map: TOML file that says which joint is which part of the body (`muybridge retarget --suggest` writes one).
        features: what is compared, and how much it counts.
        overwrite: replace OUT if it exists.
    """
    check_fps(fps)
    if out.suffix.lower() != SUFFIX:
        raise MuybridgeError(f"{out}: a database has the suffix {SUFFIX}; choose such a name")
    check_replaceable([out], overwrite, takes, make_folders=False)
    progress = Progress()
    with Progress() as shown, shown.task("takes", len(takes)) as task:
        built = build_from_files(BuildRequest(takes, fps, mirror, ignore, take_clip, map), features,
                                 lambda _: task.advance(1))  # fmt: skip
    for notice in built.notices:
        progress.notice(notice)
    write_database(out, built.database)
    print(f"{out}: has {describe(built.database)}; {out.stat().st_size / 1e6:.1f} MB")
    return 0


def play(
    database: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATABASE")],
    /,
    *,
    out: Path | None = None,
    fps: float = 30.0,
    overwrite: bool = False,
) -> int:
    """Write a web page in which a figure is steered by keys, by touch or along a path that is drawn.

    The page is one HTML file that needs no network: it holds the database and the search.

    Examples:
        muybridge match play walks.match
        muybridge match play walks.match --out page.html

    Args:
        database: .match file.
        out: page to write (default: beside the database, with its name and .html).
        fps: frames per second of what the page holds, at most; between them it interpolates.
        overwrite: replace the page's file if muybridge did not write it.
    """
    check_fps(fps)
    page = database.with_suffix(".html") if out is None else out
    check_replaceable([page], overwrite, [database], make_folders=False)
    read = read_database(database)
    text = render_match_page(read, database.stem, PageOptions(fps=fps))
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(f"{database}: {describe(read)}")
    print(f"{page}: {page.stat().st_size / 1e6:.1f} MB")
    return 0


def walk(
    database: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATABASE")],
    /,
    *,
    out: Path,
    path: Path | None = None,
    seconds: float | None = None,
    speed: float = 1.2,
    turn_deg: float = 0.0,
    plant: bool = False,
    steer: SteerOptions = SteerOptions(),  # noqa: B008
    overwrite: bool = False,
) -> int:
    """Let a figure walk along a path, or on and on, by motion matching.

    Examples:
        muybridge match walk walks.match --path path.csv --out walk.bvh
        muybridge match walk walks.match --seconds 20 --speed 1.2 --turn-deg 15 --out walk.glb

    Args:
        database: .match file.
        out: file of motion to write, in any format.
        path: CSV of the points of a path over the ground, in columns x and y in metres.
        seconds: after which it ends (default with a path: when it arrives; else 20).
        speed: metres per second.
        turn_deg: degrees per second that it turns to the left, without a path.
        plant: plant feet afterwards.
        steer: how it is steered.
        overwrite: replace OUT if it exists.
    """
    _check_numbers(seconds, speed, turn_deg)
    check_writable(out)
    if path is not None and turn_deg:
        raise FormatError("a figure on a path turns as the path does", remedy="option_unused", option="turn-deg")
    check_replaceable([out], overwrite, [database, *([path] if path is not None else [])], make_folders=False)
    read = read_database(database)
    start = time.perf_counter()
    if path is not None:
        goal = GoalPath(read_corners(path), speed)
        done = walk_of(read, goal, seconds, steer, plant)
        away = goal.distance(done.places)
        told = f", {away.mean() * 100:.0f} cm from the path ({away.max() * 100:.0f} cm at most)"
        if not done.arrived:
            Progress().notice(f"{out.name}: the figure has not reached the end of the path after "
                              f"{(len(done.motion) - 1) / read.fps:.1f} s")  # fmt: skip
    else:
        done = walk_of(read, Stick(lambda t: _round(t, speed, turn_deg)), seconds or 20.0, steer, plant)
        told = ""
    taken = time.perf_counter() - start
    write_file(out, Take(motion=done.motion))
    print(f"{out}: has {_contents(done)}{told}; {taken:.1f} s")
    return 0


def _check_numbers(seconds: float | None, speed: float, turn_deg: float) -> None:
    if seconds is not None and not 0 < seconds < np.inf:
        raise MuybridgeError(f"the seconds must be above zero, not {seconds:g}")
    if not 0 <= speed < np.inf:
        raise MuybridgeError(f"the speed must be zero or more, not {speed:g} m/s")
    if not np.isfinite(turn_deg):
        raise MuybridgeError(f"the turn must be a number of degrees per second, not {turn_deg:g}")


def _round(seconds: float, speed: float, turn_deg: float) -> FloatArray:
    """(2,) the velocity of a figure that walks a circle, metres per second."""
    yaw = np.radians(turn_deg) * seconds
    return np.array([speed * np.cos(yaw), speed * np.sin(yaw)])


def describe(database: MatchDatabase) -> str:
    """What a database holds."""
    return (
        f"{counted(len(database.names), 'clip')}, {counted(len(database), 'frame')} at {database.fps:g} fps "
        f"({len(database) / database.fps:.0f} s), {int(database.searchable.sum())} of which can be found"
    )


def _contents(done: Steered) -> str:
    motion = done.motion
    seconds = max((len(motion) - 1) / motion.fps, 1e-9)
    way = float(np.linalg.norm(np.diff(done.places, axis=0), axis=1).sum())
    return (
        f"{counted(len(motion), 'frame')} at {motion.fps:.6g} fps, {way:.1f} m at {way / seconds:.2f} m/s, "
        f"{counted(len(done.jumps), 'transition')} in {done.searches} searches"
    )
