"""The command `convert`: one format of points or motion into another."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from muybridge.errors import MuybridgeError

Units = Literal["m", "cm", "mm", "in", "cmu"]
Up = Literal["y", "z"]
Filter = Literal["kalman", "butterworth", "savgol", "gcv_spline", "one_euro", "gaussian", "median", "loess"]


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
    """Points or motion from one file format into another, by their suffixes.

    Points: .trc .c3d .csv .parquet .npz; read also from .tsv. Motion: .bvh .amc .glb .fbx; read also from .gltf,
    .vrm and .vrma; written also as .usda and .mot. A motion is written as points by the positions of its joints. Points
    have no joints that turn: `muybridge solve` fits a body.

    Args:
        source: what to read.
        target: what to write.
        units: unit of lengths in FROM, where the file does not say or says it wrongly; cmu is 0.0254 / 0.45 m.
        up: which axis is up in FROM, where the file does not say (points only). An option that FROM's format has no
            use for is refused.
        fps: frames a second of FROM, where the file does not say or says it wrongly.
        asf: the skeleton of an .amc file (default: the .asf beside it that has its name).
        clip: name or number (from 0) of the animation, of a file that holds several (default: the first).
        to_units: unit of lengths in a BVH that is written; every other format has its own.
        fill_gaps: fill gaps of points that are at most so many seconds long.
        smooth: filter over time, of points, or of a motion's rotations; none by default.
        cutoff: Hz, of `--smooth butterworth` (default: found by residual analysis).
        overwrite: replace TO if it is there, and the .asf that goes with an .amc.
    """
    from muybridge.motion.formats.registry import ReadOptions, check_writable, read_file, write_file

    check_writable(target)
    _check_free(source, asf, target, overwrite)
    take = read_file(source, ReadOptions(units, up, fps, asf, clip))
    take, told = _smoothed(take, fill_gaps, smooth, cutoff)
    for notice in (*take.notices, *told):
        print(f"note: {notice}", file=sys.stderr)
    write_file(target, take, to_units)
    points = take.positions
    count = f"{len(points.landmarks)} {'joints' if take.motion is not None else 'points'}"
    print(f"{target}: {len(points.points_world)} frames at {points.fps:.6g} fps, {count}")
    return 0


def _check_free(source: Path, asf: Path | None, target: Path, overwrite: bool) -> None:
    """OutputError where the target, or the skeleton that goes with it, would replace what is there."""
    from muybridge.files import check_free
    from muybridge.motion.formats.skeletal.asf import find_asf

    read = [source]
    if source.suffix.lower() == ".amc" and source.is_file():
        read.append(asf or find_asf(source))
    for path in (target, *([target.with_suffix(".asf")] if target.suffix.lower() == ".amc" else [])):
        check_free(path, overwrite, read)


def _smoothed(take: Any, fill: float, method: Filter | None, cutoff: float | None) -> tuple[Any, list[str]]:
    """The take with gaps filled and filtered over time as asked for, and what was done.

    Raises:
        MuybridgeError: options that do not fit each other or the take.
    """
    if cutoff is not None and method != "butterworth":
        raise MuybridgeError("--cutoff goes with --smooth butterworth; the other filters have no cut-off")
    if fill > 0 and take.points is None:
        raise MuybridgeError("--fill-gaps is for points; a motion has no gaps")
    if cutoff is not None and not 0 < cutoff < 0.5 * take.fps:
        raise MuybridgeError(f"--cutoff {cutoff:g}: with {take.fps:g} frames/s it must be between 0 and "
                             f"{0.5 * take.fps:g} Hz")  # fmt: skip
    if fill <= 0 and method is None:
        return take, []
    import numpy as np

    from muybridge.geometry.smoothing.filters import FilterOptions, residual_cutoff, smooth, smooth_rotations
    from muybridge.geometry.smoothing.gaps import GapOptions, fill_gaps

    told = []
    values = take.points.points_world if take.points is not None else take.motion.root_positions_world
    if fill > 0:
        before = int(np.isnan(values).any(axis=-1).sum())
        values = fill_gaps(values, take.fps, options=GapOptions(max_gap=fill))
        left = int(np.isnan(values).any(axis=-1).sum())
        told.append(f"{before - left} missing points filled in, {left} left (longer gaps, and the ends of the take)")
    if method == "butterworth" and cutoff is None:
        cutoff = residual_cutoff(values, take.fps)
        told.append(f"cut-off {cutoff:.1f} Hz, by residual analysis")
    options = FilterOptions(cutoff_hz=cutoff)
    if method is not None:
        values = smooth(values, take.fps, method, options)
    if take.points is not None:
        return replace(take, points=replace(take.points, points_world=values)), told
    turned = smooth_rotations(take.motion.quat_wxyz, take.fps, method or "kalman", options)
    return replace(take, motion=replace(take.motion, root_positions_world=values, quat_wxyz=turned)), told
