"""Joins of generated takes, by every method, in one table.

Usage: python -m scripts.benchmarks.motion.joins [--bodies 10] [--takes 6] [--seed 80] [--methods inertial]
    [--json OUT.json]

Takes of 5 s at 60 Hz; each of a body's takes is joined to the next one, of whatever kinds they are: 50 joins of 10
bodies. Needs the `train` extra.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.joins.joining import join_motions, peak_acceleration
from muybridge.motion.blending.joins.transitions import JoinOptions, transition
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.footskate import measure_footskate
from scripts.benchmarks.common import print_header
from scripts.benchmarks.motion.generated_takes import TrueTake, generated_takes

METHODS = {
    "aligned only": JoinOptions("align"),
    "cross-fade, 0.4 s": JoinOptions("crossfade"),
    "cross-fade, least sum over degrees of freedom": JoinOptions("crossfade", measure="dofs"),
    "quadratic fit, N = 5": JoinOptions("quadratic", frames=5),
    "quadratic fit, N = 10": JoinOptions("quadratic", frames=10),
    "quadratic fit, N = 20": JoinOptions("quadratic", frames=20),
    "inertialised, C1": JoinOptions("inertial", bend=False),
    "inertialised, C2": JoinOptions("inertial"),
}
COLUMNS = ("pose_mm", "velocity", "acceleration", "planted_acceleration", "drift_mm", "planted_drift_mm")


def pairs_of(bodies: int, takes: int, seed: int) -> list[tuple[TrueTake, TrueTake]]:
    """Each body's takes, each with the next one."""
    every = generated_takes(bodies * takes, seed, bodies)
    of_body = [every[k::bodies] for k in range(bodies)]
    return [pair for takes_of in of_body for pair in zip(takes_of, takes_of[1:], strict=False)]


def scores(pair: tuple[TrueTake, TrueTake], options: JoinOptions) -> dict[str, float]:
    """Figures of one join, not planted and planted.

    `pose_mm` and `velocity` are those of the worst joint, mm and m/s, between the frames beside the join: what is left
    of the step there once the steps before and behind are taken off, and what one velocity differs from the next.
    Accelerations are the peak's share of the largest in both takes; drifts the worst contact's, mm: with planting, of
    the contacts about the join, which were planted.
    """
    motions = [take.motion for take in pair]
    own = max(peak_acceleration(m) for m in motions)
    planted = join_motions(motions, ("a", "b"), options)
    assert planted.contacts is not None
    # The same join without planting.
    place, join = planted.places[0], planted.frames[0]
    plain, _ = transition(motions[0], place.placed(motions[1]), place.leave, place.enter, options, planted.seconds[0])
    x = plain.joint_positions_world()
    steps = np.diff(x[join - 3 : join + 3], axis=0)  # the third one leads to the frame of the join
    gap = steps[2] - 0.5 * (steps[1] + steps[3])
    bends = np.diff(steps[1:4], axis=0) * motions[0].fps
    return {
        "pose_mm": 1e3 * _largest(gap),
        "velocity": _largest(bends),
        "acceleration": peak_acceleration(plain) / own,
        "planted_acceleration": peak_acceleration(planted.motion) / own,
        "drift_mm": drift_mm(plain, planted.contacts),
        "planted_drift_mm": 1e3 * planted.drift(),
    }


def data_scores(pair: tuple[TrueTake, TrueTake]) -> dict[str, float]:
    """The same of the takes themselves, in their worst frames."""
    motions = [take.motion for take in pair]
    pose, velocity = 0.0, 0.0
    for m in motions:
        steps = np.diff(m.joint_positions_world(), axis=0)
        pose = max(pose, _largest(steps[1:-1] - 0.5 * (steps[:-2] + steps[2:])))
        velocity = max(velocity, _largest(np.diff(steps, axis=0)) * m.fps)
    return {"pose_mm": 1e3 * pose, "velocity": velocity, "acceleration": 1.0, "planted_acceleration": 1.0,
            "drift_mm": max(drift_mm(t.motion, Contacts.of_feet(t.contact, t.motion.fps)) for t in pair),
            "planted_drift_mm": np.nan}  # fmt: skip


def drift_mm(motion: Motion, contacts: Contacts) -> float:
    """The largest distance between two places of one heel or ball in one of its contacts."""
    places = feet_of_motion(motion).places
    return max(
        1e3 * measure_footskate(places[:, k, p], contacts.contact[:, k, p], motion.fps).extent
        for k in range(2) for p in range(2)
    )  # fmt: skip


def _largest(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=10)
    parser.add_argument("--takes", type=int, default=6)
    parser.add_argument("--seed", type=int, default=80)
    parser.add_argument("--methods", default="", help="only those with this in their names")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    pairs = pairs_of(options.bodies, options.takes, options.seed)
    print(f"{len(pairs)} joins; median and worst of each figure")
    print_header(["method", "pose, mm", "velocity, m/s", "peak acceleration", "over the data's own", "planted",
                  "over the data's own", "drift, mm", "planted, mm"])  # fmt: skip
    out = {}
    for name, how in {"the takes themselves": None, **METHODS}.items():
        if options.methods not in name:
            continue
        rows = [data_scores(pair) if how is None else scores(pair, how) for pair in pairs]
        values = {column: np.array([row[column] for row in rows]) for column in COLUMNS}
        out[name] = {column: v.tolist() for column, v in values.items()}
        cells = []
        for column, v in values.items():
            cells.append(f"{np.median(v):.2f}, {v.max():.2f}")
            if "acceleration" in column:
                cells.append(f"{int((v > 1 + 1e-9).sum())}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
