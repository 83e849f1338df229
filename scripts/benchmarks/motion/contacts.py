"""Contacts and planting against generated motion with truth, and against force plates.

Usage: python -m scripts.benchmarks.motion.contacts [--takes 200] [--seed 50] [--json OUT.json]

Prints F1 of the frames in which heels, balls and feet stand, as the motion is and with the noise of our own captures;
then, planted with the true contacts, how far a flat foot drifts, how often it slides, how deep it is in the floor, the
peak acceleration of joints and the distance to the truth; then, where shared data are, the onsets of a recorded walk,
solved, against its force plates. Needs the `train` extra.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts, find_contacts
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.contacts.planting import plant_feet
from muybridge.motion.contacts.plates import plate_loads
from scripts.benchmarks.common import DATA, print_header
from scripts.benchmarks.motion.generated_takes import TrueTake, generated_takes, noisy
from scripts.benchmarks.motion.plant_scores import score

WALK = DATA / "markers" / "walk_force_plates.c3d"


def contact_scores(takes: list[TrueTake], shaken: bool) -> dict[str, float]:
    """F1 of heels, of balls, of feet, and of the worst take's feet."""
    counts = {name: np.zeros(3) for name in ("heel", "ball", "foot")}
    worst = 1.0
    for k, take in enumerate(takes):
        found = find_contacts(noisy(take, k) if shaken else take.motion, roles=take.roles)
        true_heel = take.contact[..., 0] | take.striking
        foot = np.zeros(3)
        for name, mine, truth in (("heel", found.contact[..., 0], true_heel),
                                  ("ball", found.contact[..., 1], take.contact[..., 1]),
                                  ("foot", found.feet, true_heel | take.contact[..., 1])):  # fmt: skip
            foot = np.array([(mine & truth).sum(), mine.sum(), truth.sum()], np.float64)
            counts[name] += foot
        worst = min(worst, _f1(foot))
    return {name: _f1(count) for name, count in counts.items()} | {"worst take": worst}


def _f1(count: FloatArray) -> float:
    return float(2 * count[0] / max(count[1] + count[2], 1))


def planting_scores(takes: list[TrueTake], shaken: bool) -> dict[str, float]:
    """Figures of planting with true contacts: the worst take's, or shares of all frames and takes."""
    rows = []
    for k, take in enumerate(takes):
        motion = noisy(take, k) if shaken else take.motion
        planted = plant_feet(motion, _true_contacts(take), roles=take.roles).motion
        rows.append([score(m, take.motion, take.roles, take.contact) for m in (take.motion, motion, planted)])
    frames = max(sum(after.sliding[1] for *_, after in rows), 1)
    grown = np.array(
        [after.acceleration / max(truth.acceleration, before.acceleration) for truth, before, after in rows]
    )
    ratio = np.array([after.acceleration / truth.acceleration for truth, _, after in rows])
    before_ratio = np.array([before.acceleration / truth.acceleration for truth, before, _ in rows])
    return {
        "drift mm": max(after.drift_mm for *_, after in rows),
        "sliding % before": 100 * sum(before.sliding[0] for _, before, _ in rows) / frames,
        "sliding % after": 100 * sum(after.sliding[0] for *_, after in rows) / frames,
        "in the floor mm": max(after.deep_mm for *_, after in rows),
        "acceleration within 1.2 of truth, % of takes before": float(100 * (before_ratio <= 1.2).mean()),
        "acceleration within 1.2 of truth, % of takes after": float(100 * (ratio <= 1.2).mean()),
        "acceleration against the larger of truth and before, worst": float(grown.max()),
        "distance mm before": float(np.mean([before.distance_mm for _, before, _ in rows])),
        "distance mm after": float(np.mean([after.distance_mm for *_, after in rows])),
        "takes farther from the truth": float(sum(a.distance_mm > b.distance_mm + 0.1 for _, b, a in rows)),
    }


def _true_contacts(take: TrueTake) -> Contacts:
    heights = feet_of_motion(take.motion, take.roles).places[..., 2][take.contact]
    clearance = np.full((2, 2), float(np.median(heights)) if len(heights) else np.nan)
    return Contacts.of_feet(take.contact, take.motion.fps, Floor(), clearance)


def plate_onsets(path: Path) -> list[float]:
    """Milliseconds by which each onset of a solved recording is later than its force plate's."""
    import tempfile

    from muybridge.infer.pipelines.solve_points import SolvePointsOptions, solve_points
    from muybridge.infer.runtime.progress import Progress
    from muybridge.motion.formats.points.c3d import read_c3d_take

    with tempfile.TemporaryDirectory() as folder, Progress(quiet=True) as progress:
        motion = solve_points(path, Path(folder) / "solved", SolvePointsOptions(), True, progress).body.motion
    feet = find_contacts(motion).feet
    mine = [first for k in range(2) for first, _ in contact_spans(feet[:, k]) if first > 0]
    plates = [first for load in plate_loads(read_c3d_take(path)) for first in _onsets(load.loaded)]
    return [1e3 * (min(mine, key=lambda f: abs(f - plate)) - plate) / motion.fps for plate in plates]


def _onsets(loaded: BoolArray) -> list[int]:
    return [first for first, _ in contact_spans(loaded) if first > 0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    takes = generated_takes(options.takes, options.seed)
    out: dict[str, Any] = {}
    for title, scores in (("contacts, F1", contact_scores), ("planted with true contacts", planting_scores)):
        clean, shaken = scores(takes, False), scores(takes, True)
        out[title] = {"clean": clean, "noise": shaken}
        print_header([title, "clean", "noise of captures"])
        for name, value in clean.items():
            print(f"| {name} | {value:.3f} | {shaken[name]:.3f} |", flush=True)
        print()
    if WALK.is_file():
        out["onsets after the plates', ms"] = late = plate_onsets(WALK)
        print(f"onsets after the plates', ms: {late}; median of the sizes {np.median(np.abs(late)):.0f}")
    if options.json:
        options.json.write_text(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
