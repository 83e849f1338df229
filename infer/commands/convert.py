"""The command `convert`: points or motion from one file format to another."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.infer.pipelines.convert import Filter, FilterChoice, filter_take, read_files, written_files
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.formats.registry import ReadOptions, check_writable, write_file
from muybridge.wording import counted

Units = Literal["m", "dm", "cm", "mm", "in", "cmu"]
Up = Literal["y", "z"]


def convert(
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FROM")],
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TO")],
    /,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = None,
    asf: Path | None = None,
    clip: str | None = None,
    to_units: Literal["m", "cm"] = "m",
    fill_gaps: float = 0.0,
    smooth: Filter | None = None,
    cutoff: float | None = None,
    overwrite: bool = False,
) -> int:
    """Convert points or motion between file formats, which the suffixes name.

    Points: .trc, .c3d, .csv, .parquet, .npz, and to read .tsv, .txt. Motion: .bvh, .amc, .glb, .fbx, .mot, to read
    .gltf, .vrm, .vrma, .sto, and to write .usda. A motion is written to a format of points as the positions of its
    joints. Points have no joint rotations: `muybridge solve` fits a body to them.

    Example:
        muybridge convert results/motion.bvh results/motion.fbx

    Args:
        source: file to read.
        target: file to write.
        units: unit of lengths in FROM, where the file does not say or says it wrongly; cmu is 0.0254 / 0.45 m.
        up: the axis that is up in FROM, where the file does not say (points only). An option that FROM's format cannot
            use is refused.
        fps: frames per second of FROM, where the file does not say or says it wrongly.
        asf: skeleton of an .amc file (default: the .asf beside it with the same name).
        clip: name or number (from 0) of the animation, of a file that holds several (default: the first).
        to_units: unit of lengths in a BVH file that is written; every other format has its own.
        fill_gaps: fill gaps of points of at most this many seconds.
        smooth: filter over time, of points, or of a motion's rotations; without it, nothing is filtered.
        cutoff: Hz, of `--smooth butterworth` (default: found by residual analysis).
        overwrite: replace TO if it exists, and the .asf that goes with an .amc.
    """
    check_writable(target)
    check_replaceable(written_files(target), overwrite, read_files(source, asf))
    take = read_for_command(source, ReadOptions(units, up, fps, asf, clip))
    take, notes = filter_take(take, FilterChoice(fill_gaps, smooth, cutoff))
    progress = Progress()
    for notice in (*take.notices, *notes):
        progress.notice(notice)
    write_file(target, take, to_units)
    points = take.positions
    count = f"{len(points.landmarks)} {'joints' if take.motion is not None else 'points'}"
    print(f"{target}: {counted(len(points.points_world), 'frame')} at {points.fps:.6g} fps, {count}")
    return 0
