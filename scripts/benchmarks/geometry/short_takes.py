"""How often the diagnosis accuses a camera in short takes, of good calibrations and of faulty ones.

    python -m scripts.benchmarks.geometry.short_takes good --takes 200
    python -m scripts.benchmarks.geometry.short_takes faults --takes 8

The takes are simulated (`short_take_simulator`): 10 to 100 frames of one to three people who stand, walk, sit or
exercise, before 2 to 6 cameras. `good` counts accusations where nothing is wrong, and prints each. `faults` puts one of
four cameras wrong, of one person who walks or exercises:

- right: the first fault is of the right camera;
- named: it is the first, or named as the alternative;
- wrong: another camera is accused first, and the right one is not named.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.diagnosis.findings import CalibrationDiagnosis
from muybridge.infer.reconstruction.judge import person_to_check
from scripts.benchmarks.common import print_header
from scripts.benchmarks.geometry.short_take_simulator import ShortTake, simulate, with_fault

FAULTS: dict[str, tuple[float, ...]] = {
    "turned": (0.5, 1.0, 2.0), "moved": (0.05, 0.15, 0.4), "focal": (0.02, 0.05), "shifted": (2, 4, 8), "swapped": (0,),
}  # fmt: skip
UNITS = {"turned": "°", "moved": " m", "focal": "", "shifted": " frames", "swapped": ""}
LENGTHS = (20, 50, 100)


def judged(take: ShortTake) -> CalibrationDiagnosis | None:
    """The diagnosis of a take; None where nobody can be followed in it."""
    try:
        return diagnose(take.cameras, *person_to_check(take.cameras, take.keypoints, take.fps))
    except MuybridgeError:
        return None


def faulty_take(kind: str, size: float, frames: int, seed: int) -> tuple[ShortTake, set[str]]:
    """A take with one fault, and the cameras to be named."""
    rng = np.random.default_rng([seed, frames, int(1000 * size)])
    c, doing = int(rng.integers(4)), str(rng.choice(["walking", "exercise"]))
    late = (c, int(size) * (1 if rng.random() < 0.5 else -1)) if kind == "shifted" else None
    take = simulate(seed, frames, 4, 1, doing, late)
    if late is None:
        take = with_fault(take, kind, c, size, rng)
    names = take.cameras.names
    return take, {names[c], names[(c + 1) % 4]} if kind == "swapped" else {names[c]}


def outcome(report: CalibrationDiagnosis | None, guilty: set[str]) -> tuple[bool, bool, bool]:
    """Whether the right camera is accused first, whether it is named, and whether only others are."""
    if report is None or not report.faults:
        return False, False, False
    first = report.faults[0]
    named = guilty <= {*first.cameras, *first.rivals}
    return set(first.cameras) == guilty, named, not named


def good(first: int, takes: int) -> None:
    """Print the accusations in takes of good calibrations."""
    accused, judgeable, began = 0, 0, time.perf_counter()
    for seed in range(first, first + takes):
        take = simulate(seed)
        report = judged(take)
        judgeable += report is not None and np.isfinite(report.noise_px)
        if report is not None and report.faults:
            accused += 1
            print(f"seed {seed}, {take.description}: {report.sentence}", flush=True)
    print(f"{accused} of {takes} takes ({judgeable} of three cameras or more), {time.perf_counter() - began:.0f} s")


def faults(first: int, takes: int) -> None:
    """Print a table of the faults found, by size and length of the take."""
    print_header(("fault", *(f"{frames} frames: right, named, wrong" for frames in LENGTHS)))
    for kind, sizes in FAULTS.items():
        for size in sizes:
            cells = []
            for frames in LENGTHS:
                each = []
                for seed in range(first, first + takes):
                    take, guilty = faulty_take(kind, size, frames, seed)
                    each.append(outcome(judged(take), guilty))
                cells.append(", ".join(str(n) for n in np.sum(each, axis=0)))
            print(f"| {kind} {size or ''}{UNITS[kind]} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("good", "faults"))
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--takes", type=int, default=200)
    args = parser.parse_args()
    {"good": good, "faults": faults}[args.what](args.first, args.takes)


if __name__ == "__main__":
    main()
