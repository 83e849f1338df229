"""Errors of joint centres computed from surface markers, on bodies that follow a recorded motion.

Usage: python -m scripts.benchmarks.markers.joint_centres [--bodies 6]

The truth are anny's joints, about which its skin rotates. They were placed by a rigger, not by an anatomist:
regressions made on living people differ from them mostly by that, which is constant over time; the second figure is
without it.
"""

import argparse

import numpy as np

from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.joint_centres import METHODS, centres_from_markers
from muybridge.train.correction.takes import recorded_take
from muybridge.train.synthesis.markers.trajectories import MarkerBodies
from scripts.benchmarks.markers.solver import RECORDING, read_motion


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--bodies", type=int, default=6)
    options = parser.parse_args()
    motion, bodies = read_motion(RECORDING, 12, 200), MarkerBodies(2002)
    rng, index = np.random.default_rng(1), {n: i for i, n in enumerate(SURFACE.names)}
    found: dict[tuple[str, str], list[np.ndarray]] = {}
    for phenotype in bodies.model.sample_phenotypes(options.bodies):
        take = recorded_take(bodies, phenotype, motion)
        points = take.points + rng.normal(0, 0.002, take.points.shape)
        for method in METHODS:
            centres = centres_from_markers(points, index, ("regressions", "chord") if method == "chord" else (method,))
            for k, name in enumerate(centres.names):
                j = BODY.joint_names.index(name)
                off = centres.points_world[:, k] - take.places[:, j]
                local = np.einsum("tji,tj->ti", take.turns[:, BODY.parents[j]], off)
                found.setdefault((method, name.split("_", 1)[1]), []).append(local[np.isfinite(local[:, 0])])
    for (method, joint), parts in found.items():
        every = np.concatenate(parts)
        spread = np.sqrt(np.mean([np.var(p, axis=0).sum() for p in parts]))
        print(f"{method:12s} {joint:10s} {1e3 * np.linalg.norm(every, axis=1).mean():5.1f} mm from the body's; "
              f"{1e3 * spread:4.1f} mm about its mean in a take")  # fmt: skip


if __name__ == "__main__":
    main()
