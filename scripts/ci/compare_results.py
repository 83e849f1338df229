"""Compare two results folders array by array: what a change that should change nothing did change.

    python -m scripts.ci.compare_results BEFORE AFTER

Reads the points and motions that both folders hold and prints the largest absolute difference of each array, with
its unit. Exits with 1 if an array differs by more than rounding (1e-9 m, rad), is missing or has another shape.
"""

import sys
from pathlib import Path

import numpy as np

from muybridge.motion.formats.registry import read_file
from muybridge.motion.take import Take

_ROUNDING = 1e-9
_SUFFIXES = (".trc", ".c3d", ".bvh", ".glb")


def arrays_of(take: Take) -> dict[str, np.ndarray]:
    """The arrays of a take by name: points in metres, rotations as quaternions."""
    found: dict[str, np.ndarray] = {}
    if take.points is not None:
        found["points_world (m)"] = take.points.points_world
    if take.motion is not None:
        found["root_world (m)"] = take.motion.root_positions_world
        found["rotations (quaternions)"] = take.motion.quat_wxyz
        found["offsets (m)"] = take.motion.skeleton.offsets
    return found


def compare(before: Path, after: Path) -> bool:
    """Print the differences of all files that `before` holds; whether all are within rounding."""
    same = True
    for path in sorted(p for p in before.iterdir() if p.suffix in _SUFFIXES):
        other = after / path.name
        if not other.is_file():
            print(f"{path.name}: missing in {after}")
            same = False
            continue
        if path.read_bytes() == other.read_bytes():
            print(f"{path.name}: the same bytes")
            continue
        new = arrays_of(read_file(other))
        for name, array in arrays_of(read_file(path)).items():
            if name not in new or new[name].shape != array.shape:
                print(f"{path.name}: {name} is missing or has another shape")
                same = False
                continue
            if not np.array_equal(np.isnan(array), np.isnan(new[name])):
                print(f"{path.name}: {name} is missing in other frames")
                same = False
            largest = float(np.nanmax(np.abs(array - new[name]), initial=0.0))
            print(f"{path.name}: {name} differs by at most {largest:.3g}")
            same = same and largest <= _ROUNDING
    return same


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("Usage: python -m scripts.ci.compare_results BEFORE AFTER")
    sys.exit(0 if compare(Path(sys.argv[1]), Path(sys.argv[2])) else 1)
