"""How fast `muybridge run` is on a session: seconds of each stage, work per image, peak memory, and the machine.

Usage: python -m scripts.benchmarks.takes.speed [SESSION] [--against CHECKOUT] [--rounds 3] [-- OPTIONS OF run]

SESSION is a session folder; without one it is the demo's take. Each round runs in a new process, with the numerical
kernels compiled before the first one. With --against, another checkout of muybridge (the version before, for example)
runs the same session in turn with this one, and the ratio of the two is printed; the round with the fewest processor
seconds counts, so that other load affects both. The machine's float32 matrix product is measured in the same minute.

Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from scripts.benchmarks.common import print_header
from scripts.benchmarks.networks.networks import PRODUCT, matrix_product

HERE = Path(__file__).resolve().parents[3]
# One thread for each library: cameras run in parallel.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
# Stages whose names begin so are added up in the table.
GROUPS = ("2D", "overlay")


def main() -> None:
    """Measure and print."""
    arguments = sys.argv[1:]
    if "--once" in arguments:
        _once(arguments[1:])
        return
    at = arguments.index("--") if "--" in arguments else len(arguments)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", nargs="?", type=Path, help="a session folder; by default the demo's take")
    parser.add_argument("--against", type=Path, help="another checkout, which is run in turn with this one")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args(arguments[:at])
    with tempfile.TemporaryDirectory() as folder:
        session = options.session.resolve() if options.session else _demo(Path(folder))
        _measure(session, options.against, options.rounds, arguments[at + 1 :], Path(folder))


def _measure(session: Path, against: Path | None, rounds: int, options: list[str], folder: Path) -> None:
    checkouts = {"this": HERE, **({"before": against.resolve()} if against else {})}
    best: dict[str, dict[str, Any]] = {}
    for turn in range(rounds + 1):
        for name, checkout in checkouts.items():
            measured = _run(checkout, session, folder / "results", options)
            # The first round compiles the kernels and fills the file system's cache.
            if turn and (name not in best or measured["processor"] < best[name]["processor"]):
                best[name] = measured
    _print_whole(best)
    _print_stages(best["this"])
    _print_work(best["this"])
    print(f"\nMachine: {os.cpu_count()} processors; float32 matrix product on one, {_peak():.0f} GFLOP/s")


def _run(checkout: Path, session: Path, out: Path, options: list[str]) -> dict[str, Any]:
    """One run in a process of its own: its figures, with the seconds from start to end of the process."""
    shutil.rmtree(out, ignore_errors=True)
    places = os.pathsep.join([str(checkout / ".root"), str(HERE)])
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": places}
    command = [sys.executable, str(Path(__file__)), "--once", str(session), str(out), *options]
    start = time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{checkout}: the run failed: {(done.stderr or done.stdout).strip().splitlines()[-1]}")
    measured: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return {**measured, "wall": time.perf_counter() - start}


def _once(arguments: list[str]) -> None:
    """Run a session and print its figures as JSON: in the process whose time is measured."""
    from muybridge.infer.commands.app import run_command
    from scripts.benchmarks.takes.work_counts import counted

    session, out, *options = arguments
    with counted() as counts:
        code = run_command(["run", session, "--out", out, "--quiet", *options])
    if code:
        raise SystemExit(code)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    record = json.loads((Path(out) / "run.json").read_text())
    print(json.dumps({
        "processor": sum(u.ru_utime + u.ru_stime for u in used),
        "memory_mb": max(u.ru_maxrss for u in used) / 1024,
        "images": record["frames"] * len(record["session"]["cameras"]),
        "stages": {name: stage["seconds"] for name, stage in record["stages"].items()},
        "work": {kind: vars(tally) for kind, tally in counts.tallies.items()},
    }))  # fmt: skip


def _demo(folder: Path) -> Path:
    """The demo's take, in a folder."""
    from importlib.resources import as_file

    from muybridge.infer.demo_take.take import demo_folder

    with as_file(demo_folder()) as demo:
        return Path(shutil.copytree(demo, folder / "take", ignore=shutil.ignore_patterns("*.py", "__pycache__")))


def _peak(rounds: int = 8) -> float:
    """GFLOP/s of a float32 matrix product in one thread, the best of several."""
    product, best = matrix_product(threads=1), float("inf")
    for _ in range(rounds):
        start = time.perf_counter()
        product()
        best = min(best, time.perf_counter() - start)
    return 2e-9 * PRODUCT**3 / best


def _print_whole(best: dict[str, dict[str, Any]]) -> None:
    print_header(["version", "seconds", "processor seconds", "images/s", "peak memory"])
    for name, measured in best.items():
        print(f"| {name} | {measured['wall']:.1f} | {measured['processor']:.1f} "
              f"| {measured['images'] / measured['wall']:.1f} | {measured['memory_mb']:.0f} MB |")  # fmt: skip
    if "before" in best:
        ratios = [best["this"][figure] / best["before"][figure] for figure in ("wall", "processor", "memory_mb")]
        print(f"| ratio | {ratios[0]:.2f} | {ratios[1]:.2f} | {1 / ratios[0]:.2f} | {ratios[2]:.2f} |")


def _print_stages(measured: dict[str, Any]) -> None:
    print("\nStages; those of the cameras run side by side, so that their seconds add up to more than the whole:\n")
    print_header(["stage", "seconds"])
    total: dict[str, float] = {}
    for name, seconds in measured["stages"].items():
        group = next((g for g in GROUPS if name.startswith(g)), None)
        name = name if group is None else f"{group}, all cameras{', refined' if name.endswith('refined') else ''}"
        total[name] = total.get(name, 0.0) + seconds
    for name, seconds in total.items():
        print(f"| {name} | {seconds:.2f} |")


def _print_work(measured: dict[str, Any]) -> None:
    print(f"\nWork, for each of the {measured['images']} images:\n")
    print_header(["work", "per image", "calls", "processor seconds", "per second"])
    for kind, tally in sorted(measured["work"].items(), key=lambda item: -item[1]["seconds"]):
        rate = tally["rows"] / tally["seconds"] if tally["seconds"] else float("nan")
        print(f"| {kind} | {tally['rows'] / measured['images']:.2f} | {tally['calls']} | {tally['seconds']:.2f} "
              f"| {rate:.0f} |")  # fmt: skip


if __name__ == "__main__":
    main()
