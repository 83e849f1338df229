"""The command `convert`: one format of points or motion into another."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import OutputError

Units = Literal["m", "cm", "mm", "in", "cmu"]
Up = Literal["y", "z"]


def convert(
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FROM")],
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TO")],
    /,
    units: Units | None = None,
    up: Up | None = None,
    fps: float | None = None,
    asf: Path | None = None,
    to_units: Literal["m", "cm"] = "m",
    overwrite: bool = False,
) -> int:
    """Points or motion from one file format into another, by their suffixes.

    Points: .trc .c3d .csv .parquet .npz. Motion: .bvh .amc .glb .usda .mot; read also from .gltf. A motion is
    written as points by the places of its joints. Points have no joints that turn: `muybridge solve` fits a body.

    Args:
        source: what to read.
        target: what to write.
        units: unit of lengths in FROM, where the file does not say or says it wrongly; cmu is 0.0254 / 0.45 m.
        up: which axis is up in FROM, where the file does not say (points only).
        fps: frames a second of FROM, where the file does not say or says it wrongly.
        asf: the skeleton of an .amc file (default: the .asf beside it that has its name).
        to_units: unit of lengths in a BVH that is written; every other format has its own.
        overwrite: replace TO if it is there.
    """
    from muybridge.motion.formats.registry import ReadOptions, check_writable, read_file, write_file

    check_writable(target)
    if target.exists() and (target.resolve() == source.resolve() or not overwrite):
        same = target.resolve() == source.resolve()
        raise OutputError(f"{target} is {'the file to be read' if same else 'there already'}: choose another name"
                          f"{'' if same else ', or give --overwrite'}")  # fmt: skip
    take = read_file(source, ReadOptions(units, up, fps, asf))
    for notice in take.notices:
        print(f"note: {notice}", file=sys.stderr)
    write_file(target, take, to_units)
    points = take.positions
    count = f"{len(points.landmarks)} {'joints' if take.motion is not None else 'points'}"
    print(f"{target}: {len(points.points_world)} frames at {points.fps:.6g} fps, {count}")
    return 0
