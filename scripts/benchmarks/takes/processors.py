"""How far the results of `muybridge run` move between processors, emulated on one.

Usage: python -m scripts.benchmarks.takes.processors [SESSION] [--as rounding libraries graph] [--seeds 1]
       [--out FOLDER] [-- OPTIONS OF run]

SESSION is a session folder; without one it is the balancing take. It is run once as it is, and once for every wish:

- `rounding`: every output of a network gets a relative noise of 1e-6, a few units in the last place of float32, as from
  another order of additions or other fused multiplications; once per seed;
- `libraries`: OpenBLAS, OpenCV, numba and numpy use the code for processors without AVX2 and fused multiplications;
- `graph`: onnxruntime runs the networks without its optimisations. This computes the network of 8 bits in float32,
  which is another network rather than another processor.

Prints, for every stage in order, the largest difference from the first run, where it is, and how many values differ by
more than the bar (0.3 mm in 3D, 0.1 px in an image). Runs are kept under --out and not repeated where they are there.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from scripts.benchmarks.common import DATA, print_header

HERE = Path(__file__).resolve().parents[3]
AS_IT_IS, ROUNDING, LIBRARIES, GRAPH = "as it is", "rounding", "libraries", "graph"
# Relative noise of what networks return.
NOISE = 1e-6
OLDER = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FP16,AVX",
    "NUMBA_CPU_NAME": "nehalem",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3",
}
BAR = {"mm": 0.3, "px": 0.1, "": 0.01}


class Stage(NamedTuple):
    """The values of a stage that are compared.

    Attributes:
        name: for the table.
        unit: of the values.
        values: (..., T, J, D), or (..., T, D) for boxes; NaN where missing.
        columns: (J,) names; empty for boxes.
    """

    name: str
    unit: str
    values: FloatArray
    columns: tuple[str, ...] = ()


def main() -> None:
    """Run and compare."""
    arguments = sys.argv[1:]
    if "--once" in arguments:
        _once(*arguments[1:3], int(arguments[3]), arguments[4:])
        return
    at = arguments.index("--") if "--" in arguments else len(arguments)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", nargs="?", type=Path, default=DATA / "balancing", help="a session folder")
    parser.add_argument("--as", dest="wishes", nargs="+", choices=[ROUNDING, LIBRARIES, GRAPH], default=[ROUNDING])
    parser.add_argument("--seeds", type=int, default=1, help="how many times with noise")
    parser.add_argument("--out", type=Path, help="folder in which the runs are kept")
    options = parser.parse_args(arguments[:at])
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) if options.out is None else options.out.resolve()
        first = _run(options.session, out / "first", AS_IT_IS, 0, arguments[at + 1 :])
        for wish in options.wishes:
            for seed in range(options.seeds if wish == ROUNDING else 1):
                other = _run(options.session, out / f"{wish}-{seed}", wish, seed, arguments[at + 1 :])
                print(f"\n{wish} {seed}\n")
                print_differences(first, other)


def print_differences(first: Path, other: Path) -> None:
    """Print a table of the largest differences between two results folders, stage by stage."""
    print_header(["stage", "largest", "beyond the bar", "of", "where"])
    for one, two in zip(stages(first), stages(other), strict=True):
        if one.values.shape != two.values.shape:
            print(f"| {one.name} | {one.values.shape} and {two.values.shape} |")
            continue
        away = np.linalg.norm(one.values - two.values, axis=-1)
        lost = int((np.isfinite(one.values) != np.isfinite(two.values)).any(-1).sum())
        known = np.isfinite(away)
        if not known.any():
            continue
        worst = np.unravel_index(int(np.nanargmax(away)), away.shape)
        where = [str(n) for n in worst]
        if one.columns:
            where[-1] = one.columns[worst[-1]]
        beyond, unit = int((away[known] > BAR[one.unit]).sum()), one.unit
        print(f"| {one.name} | {away[worst]:.4f} {unit} | {beyond} | {known.sum()} | {' '.join(where)}"
              + (f"; {lost} in one only |" if lost else " |"), flush=True)  # fmt: skip


def stages(out: Path) -> Iterator[Stage]:
    """What the stages of a results folder have found, in order."""
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.infer.reconstruction.motion_arrays import unpack_motion

    for path in _of(out, "landmarks-*.npz"):
        arrays, _ = _stored(path)
        yield Stage(f"{path.stem}: boxes", "px", arrays["boxes_px"])
        yield Stage(f"{path.stem}: points", "px", arrays["body23.points_px"], BODY23.names)
        yield Stage(f"{path.stem}: scores", "", arrays["body23.score"][..., None], BODY23.names)
    for path in _of(out, "points*.npz"):
        if "refined" not in path.stem:
            yield Stage(path.stem, "mm", 1000 * _stored(path)[0]["points_world"], BODY23.names)
    for path in _of(out, "refined*.npz"):
        arrays, _ = _stored(path)
        yield Stage(f"{path.stem}: boxes", "px", arrays["boxes_px"])
        for kind, name in (("alone.", "points without the prior"), ("", "points")):
            yield Stage(f"{path.stem}: {name}", "px", arrays[f"{kind}body23.points_px"], BODY23.names)
        yield Stage(f"{path.stem}: scores", "", arrays["body23.score"][..., None], BODY23.names)
    for pattern in ("points*refined.npz", "smooth*.npz"):
        for path in _of(out, pattern):
            yield Stage(path.stem, "mm", 1000 * _stored(path)[0]["points_world"], BODY23.names)
    for path in _of(out, "motion*.npz"):
        motion = unpack_motion(*_stored(path))
        yield Stage(f"{path.stem}: joints", "mm", 1000 * motion.forward()[..., :3, 3], tuple(motion.skeleton.names))


def _of(out: Path, pattern: str) -> list[Path]:
    return sorted((out / "work").glob(pattern))


def _stored(path: Path) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """The arrays and facts of a stage."""
    with np.load(path) as stored:
        arrays = {n.removeprefix("array_"): stored[n].astype(float) for n in stored.files if n != "stage"}
        return arrays, json.loads(str(stored["stage"]))["facts"]


def _run(session: Path, out: Path, wish: str, seed: int, options: list[str]) -> Path:
    """One run in a process of its own; its results folder."""
    if (out / "run.json").is_file():
        return out
    older = {**OLDER, "NUMBA_CACHE_DIR": str(out.parent / "numba")} if wish == LIBRARIES else {}
    places = os.pathsep.join([str(HERE / ".root"), str(HERE)])
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **older, "PYTHONPATH": places}
    command = [sys.executable, str(Path(__file__)), "--once", str(out), wish, str(seed), str(session.resolve())]
    done = subprocess.run([*command, *options], env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{wish}: the run failed: {(done.stderr or done.stdout).strip().splitlines()[-1]}")
    return out


def _once(out: str, wish: str, seed: int, arguments: list[str]) -> None:
    """Run a session as on another processor."""
    from muybridge.infer.commands.app import run_command

    if wish == GRAPH:
        _without_optimisations()
    with rounding(seed) if wish == ROUNDING else nullcontext():
        code = run_command(["run", *arguments, "--out", out, "--quiet", "--no-overlays"])
    if code:
        raise SystemExit(code)


@contextmanager
def rounding(seed: int) -> Iterator[None]:
    """Let outputs of muybridge's networks differ in the last places, by the seed and by their values alone: the same
    whichever thread comes first."""
    from muybridge.infer.networks import keypoints

    exact = keypoints.run_session

    def noisy(values: Any) -> Any:
        rng = np.random.default_rng([seed, int(np.asarray(values).view(np.uint32).sum(dtype=np.uint64))])
        return (values * (1 + NOISE * rng.uniform(-1, 1, values.shape))).astype(np.float32)

    def run_session(*arguments: Any) -> Any:
        return [noisy(values) for values in exact(*arguments)]

    keypoints.run_session = run_session
    try:
        yield
    finally:
        keypoints.run_session = exact


def _without_optimisations() -> None:
    """Let onnxruntime run networks as they are written."""
    import onnxruntime

    usual = onnxruntime.SessionOptions

    def settings() -> Any:
        made = usual()
        made.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        return made

    onnxruntime.SessionOptions = settings


if __name__ == "__main__":
    main()
