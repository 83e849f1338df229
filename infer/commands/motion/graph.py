"""The commands `graph build`, `graph walk` and `graph show`: graphs of takes, walks in them, pictures of them."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MuybridgeError
from muybridge.infer.pipelines.characters import graphs
from muybridge.infer.pipelines.characters.graph_pictures import check_picture, draw_graph, draw_walk
from muybridge.infer.pipelines.characters.takes import takes_of
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.registry import check_writable, write_file
from muybridge.motion.graphs.files import load_graph, save_graph
from muybridge.motion.graphs.graph import GraphOptions
from muybridge.motion.graphs.minima import blocks_of
from muybridge.motion.graphs.paths import read_floor_path
from muybridge.motion.take import Take

COMMON_OPTIONS = {
    "build": ("out", "labels", "threshold", "window", "fps", "overwrite"),
    "walk": ("path", "seconds", "actions", "seed", "plant", "picture", "overwrite"),
    "show": ("out", "overwrite"),
}


def build(
    takes: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="TAKE...")],
    /,
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    labels: tuple[str, ...] = (),
    threshold: float | None = None,
    window: float = GraphOptions.window,
    fps: float | None = None,
    clip: str | None = None,
    overwrite: bool = False,
) -> int:
    """Build a motion graph: find where takes can be joined without a jolt.

    Takes are files of motion, folders of them, and session or results folders. All are brought to the frame rate of
    the first one, and what moves another body is put onto its skeleton.

    Examples:
        muybridge graph build walk1.bvh walk2.bvh run.bvh --out walks.graph
        muybridge graph build takes/ -o walks.graph --threshold 0.08

    Args:
        takes: files of motion, folders of them, session folders.
        out: graph to write, with the suffix .graph.
        labels: what is done in each take, in order (default: the name of its file without the number at its end).
        threshold: metres between two windows of frames up to which they may be joined (default: chosen).
        window: seconds over which takes are compared and blended.
        fps: frames per second of the graph (default: those of the first take).
        clip: name or number (from 0) of the animation, of takes that hold several (default: the first).
        overwrite: replace a file that is no graph.
    """
    if out.suffix.lower() != ".graph":
        raise MuybridgeError(f"{out}: a motion graph has the suffix .graph", remedy="other_name")
    check_fps(fps)
    _check_above_zero("--threshold", threshold)
    _check_above_zero("--window", window)
    found = takes_of(takes, clip)
    progress = Progress()
    for notice in found.notices:
        progress.notice(notice)
    check_replaceable([out], overwrite, found.files, make_folders=False)
    with Progress() as shown, shown.task("reading", len(found.files)) as task:
        clips = graphs.read_clips(found.files, clip, labels, fps, task.advance)
    for notice in clips.notices:
        progress.notice(notice)
    frames = sum(len(m) for m in clips.motions)
    with Progress() as shown, shown.task("comparing frames", blocks_of(frames)) as task:
        built = graphs.build(clips, GraphOptions(window=window, threshold=threshold), task.advance)
    save_graph(out, built.graph)
    print("\n".join(graphs.describe(built, clips.names)))
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    return 0


def walk(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="GRAPH OUT")],
    /,
    path: Path | None = None,
    seconds: float | None = None,
    actions: tuple[str, ...] = (),
    seed: int = 0,
    plant: bool = False,
    picture: Path | None = None,
    overwrite: bool = False,
) -> int:
    """Make a new motion by walking in a motion graph.

    It follows a path on the floor, does what a list of actions says, or goes on for as long as you like. The path is a
    CSV with the columns x and y in metres; the walk begins where it begins.

    Examples:
        muybridge graph walk walks.graph --path path.csv out.bvh
        muybridge graph walk walks.graph out.glb --seconds 60 --actions walk run walk

    Args:
        files: the graph, and the file of motion to write.
        path: CSV of the path to follow.
        seconds: how long the walk is, without a path (default: 60).
        actions: labels of takes, each for an equal part of the path or of the time.
        seed: of the random choices, without a path.
        plant: plant the feet.
        picture: file for a picture of the walk from above, .png, .svg, .webp or .html.
        overwrite: replace files that are there.
    """
    source, target, actions = _graph_and_out(files, actions)
    if path is not None and seconds is not None:
        raise MuybridgeError("a walk is as long as its path; give --path or --seconds")
    check_writable(target)
    outputs = [target, *([picture] if picture is not None else [])]
    if picture is not None:
        check_picture(picture)
    read = [source, *([path] if path is not None else [])]
    for file in read:
        if not file.is_file():
            raise MuybridgeError(f"{file}: no such file; give an existing one")
    check_replaceable(outputs, overwrite, read, make_folders=False)
    wanted = read_floor_path(path) if path is not None else None
    graph = load_graph(source)
    with Progress() as shown, shown.task("walking", len(wanted.places) if wanted is not None else 1) as task:
        walked = graphs.walk(graph, wanted, seconds, actions, seed, plant, task.advance)
    for notice in walked.notices:
        print(notice)
    write_file(target, Take(motion=walked.motion))
    text = graphs.describe_walk(graph, walked, wanted)
    if picture is not None:
        draw_walk(picture, walked.trail, wanted, text)
    print(f"{target}: {text}")
    return 0


def show(
    graph: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="GRAPH")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
) -> int:
    """Draw a motion graph: the distances of its frames, and its transitions.

    Examples:
        muybridge graph show walks.graph
        muybridge graph show walks.graph --out walks.png

    Args:
        graph: file of the graph.
        out: picture to write, .png, .svg, .webp or .html (default: beside the graph, with its name and .html).
        overwrite: replace a file that muybridge did not write.
    """
    if not graph.is_file():
        raise MuybridgeError(f"{graph}: no such file; give an existing one")
    target = graph.with_suffix(".html") if out is None else out
    check_picture(target)
    check_replaceable([target], overwrite, [graph], make_folders=False)
    loaded = load_graph(graph)
    draw_graph(target, loaded)
    for line in graphs.clip_lines(loaded):
        print(line)
    print(graphs.summary(loaded))
    print(target)
    return 0


def _graph_and_out(files: tuple[Path, ...], actions: tuple[str, ...]) -> tuple[Path, Path, tuple[str, ...]]:
    """The graph, the file to write, and the actions: the last of them is the file where it stands behind them."""
    if len(files) == 1 and actions and Path(actions[-1]).suffix:
        files, actions = (*files, Path(actions[-1])), actions[:-1]
    if len(files) != 2:
        raise MuybridgeError("write GRAPH OUT: a graph and the file to write, such as `walks.graph out.bvh`")
    return files[0], files[1], actions


def _check_above_zero(option: str, value: float | None) -> None:
    if value is not None and not 0 < value < float("inf"):
        raise MuybridgeError(f"{option} must be above zero, not {value:g}")
