"""Blends of walks at two speeds against the walk in the middle, and how far their feet slide.

Usage: python -m scripts.benchmarks.motion.blends [--bodies 8] [--seed 80] [--data ../shared/data/motion]

For each body, walks of one style at three speeds, 5 s at 60 Hz: the slow and the fast one are blended by halves, and
the result is compared with the one in the middle. "Linear" stretches one take evenly to the length of the other. Needs
the `train` extra.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import (
    Blended,
    RegistrationCurve,
    Weights,
    blend_motions,
    facing_frames,
    plant_blend,
    register,
    same_skeleton,
)
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts, find_contacts
from muybridge.motion.contacts.footskate import measure_footskate
from muybridge.motion.editing.resampling import motion_at
from muybridge.motion.editing.root_path import GroundPath, without_path
from muybridge.motion.formats.registry import read_file
from scripts.benchmarks.common import print_header

FPS, SECONDS = 60.0, 5.0
FROUDE = (0.27, 0.36, 0.45)  # of the walks, whose speed is this times the root of gravity times the leg
SMOOTH_S = 0.33


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk whose phase is known: strides since the left foot first came down.

    Attributes:
        motion: of all bones.
        first: frame at which the phase is zero.
        stride: frames of a stride.
    """

    motion: Motion
    first: float
    stride: float

    def phase(self, frames: FloatArray) -> FloatArray:
        """Of frames."""
        return (frames - self.first) / self.stride

    def frame(self, phase: FloatArray) -> FloatArray:
        """The inverse of `phase`."""
        return self.first + self.stride * phase


def walks(bodies: int, seed: int) -> list[list[Walk]]:
    """Of each body, walks at the three speeds."""
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.motions.solve import Solver
    from muybridge.train.synthesis.motions.stage import Stage
    from muybridge.train.synthesis.motions.standing import walk

    class OneStyle(Stage):
        """A stage on which each draw of the same kind gives the same value, so that walks differ in speed alone."""

        froude = 0.0

        def u(self, low: float, high: float) -> float:
            if (low, high) == (0.25, 0.5):
                return self.froude + 0.1 * self.calm
            self.counts = getattr(self, "counts", {})
            key = (low, high) if low else (low,)  # the first step begins at a share of the stride
            count = self.counts[key] = self.counts.get(key, -1) + 1
            place = np.random.default_rng([style, round(1e3 * abs(low)), count]).uniform()
            return float(low + (high - low) * place)

        def wander(self, low: float, high: float, hold: float) -> FloatArray:
            return np.full(len(self.t), 0.5 * (low + high))

    body = BodyModel(seed)
    time, out = np.arange(round(SECONDS * FPS)) / FPS, []
    for style, phenotype in enumerate(body.sample_phenotypes(bodies)):
        person, takes = body.skeleton(phenotype), []
        solver = Solver(person)
        for froude in FROUDE:
            stage = OneStyle(solver, time, np.random.default_rng([seed, style]), 1.0)
            stage.froude = froude
            walk(stage)
            local, root = solver.solve(stage.s)
            motion = Motion(person.joints, FPS, root, continuous_quat(quat_from_matrix(local)))
            onsets = np.flatnonzero(np.diff((stage.s["contactL"] > 0.5).astype(int)) == 1) + 1
            stride, first = np.polyfit(np.arange(len(onsets)), onsets, 1)
            takes.append(Walk(motion, float(first), float(stride)))
        out.append(takes)
    return out


def strides(walk: Walk, count: int) -> Walk:
    """So many strides, from one contact of the left foot to another."""
    first, stop = (round(float(x)) for x in walk.frame(np.array([0.0, count])))
    return Walk(walk.motion.select(slice(first, stop + 1)), walk.first - first, walk.stride)


def linear(motions: list[Motion]) -> RegistrationCurve:
    """Motions stretched evenly to the length of the first, and laid by their own facing frames."""
    last = len(motions[0]) - 1.0
    u = np.arange(len(motions[0]), dtype=np.float64)
    warps = tuple(PchipInterpolator([0.0, last], [0.0, len(m) - 1.0]) for m in motions)
    paths = []
    for motion, warp in zip(motions, warps, strict=True):
        own, at = facing_frames(motion, SMOOTH_S), np.asarray(warp(u))
        whole = np.arange(len(own.yaw))
        places = np.stack([np.interp(at, whole, own.places[:, k]) for k in range(2)], axis=1)
        paths.append(GroundPath(places, np.interp(at, whole, own.yaw)))
    return RegistrationCurve(tuple(motions), 0, 0.0, last, warps, tuple(paths), u, np.zeros(len(motions)))


def rmse_mm(made: Motion, blended: Blended, truth: Walk, sources: list[Walk]) -> float:
    """Root mean square distance of the joints from the truth's, each in its facing frame.

    A frame of the blend is compared with the truth at the mean phase of the frames that it was made of.
    """
    phase = np.mean([w.phase(f) for w, f in zip(sources, blended.frames, strict=True)], axis=0)
    at = truth.frame(phase)
    inside = (at >= 0) & (at <= len(truth.motion) - 1)
    seen = []
    for motion, frames in ((made, np.flatnonzero(inside).astype(np.float64)), (truth.motion, at[inside])):
        own = facing_frames(motion, SMOOTH_S)
        whole = np.arange(len(own.yaw))
        places = np.stack([np.interp(frames, whole, own.places[:, c]) for c in range(2)], axis=1)
        path = GroundPath(places, np.interp(frames, whole, own.yaw))
        seen.append(without_path(motion_at(motion, frames), path).joint_positions_world())
    return 1e3 * float(np.sqrt(((seen[0] - seen[1]) ** 2).sum(axis=-1).mean()))


def drift_mm(motion: Motion, contacts: Contacts) -> float:
    """The largest distance between two places of one heel or ball in one of its contacts."""
    places = feet_of_motion(motion).places
    return max(1e3 * measure_footskate(places[:, k, p], contacts.contact[:, k, p], motion.fps).extent
               for k in (0, 1) for p in (0, 1))  # fmt: skip


def speed(motion: Motion) -> float:
    """Metres per second over the ground, from the first to the last frame."""
    x = motion.root_positions_world[[0, -1], :2]
    return float(np.linalg.norm(x[1] - x[0])) * motion.fps / (len(motion) - 1)


def generated(bodies: int, seed: int) -> None:
    half = Weights.checked([0.5, 0.5], 2)
    rows: dict[str, list[tuple[float, float, float, float]]] = {}
    for takes in walks(bodies, seed):
        kinds = {"takes of 5 s": takes, "two strides": [strides(t, 2) for t in takes]}
        for name, (slow, middle, fast) in kinds.items():
            sources = [slow, fast]
            curve = register([slow.motion, fast.motion], ["slow", "fast"])
            blended = blend_motions(curve, half)
            planted = plant_blend(blended, curve)
            even = blend_motions(linear([slow.motion, fast.motion]), half)
            rows.setdefault(name, []).append((
                rmse_mm(blended.motion, blended, middle, sources), rmse_mm(even.motion, even, middle, sources),
                rmse_mm(planted.motion, blended, middle, sources), drift_mm(planted.motion, planted.contacts),
            ))  # fmt: skip
    print_header(["takes", "registration curves, mm", "planted, mm", "linear, mm", "change", "bodies better by 30 %",
                  "drift, planted, worst, mm"])  # fmt: skip
    for name, values in rows.items():
        own, even, planted, drift = np.array(values).T
        change = 100 * (own.mean() / even.mean() - 1)
        better = int((own <= 0.7 * even).sum())
        print(f"| {name} | {own.mean():.1f} | {planted.mean():.1f} | {even.mean():.1f} | {change:+.0f} % | "
              f"{better} of {len(own)} | {drift.max():.2f} |")  # fmt: skip


def captured(folder: Path) -> None:
    walk = read_file(folder / "02_01.amc").motion
    run = read_file(folder / "02_03.amc").motion
    assert walk is not None and run is not None
    faster, _ = same_skeleton([replace(walk, fps=1.3 * walk.fps)], ["02_01, faster"], walk.fps)
    print_header(["blend", "speed, m/s", "drift before planting, mm", "planted, mm", "in contacts found anew, mm"])
    for name, other in {"02_01 and itself 1.3 times as fast": faster[0], "02_01 and the run 02_03": run}.items():
        for share in (0.25, 0.5, 0.75):
            curve = register([walk, other], ["walk", "other"])
            blended = blend_motions(curve, Weights.checked([1 - share, share], 2))
            planted = plant_blend(blended, curve)
            drifts = [drift_mm(m, planted.contacts) for m in (blended.motion, planted.motion)]
            anew = drift_mm(planted.motion, find_contacts(planted.motion))
            print(f"| {name}, {1 - share:g} to {share:g} | {speed(blended.motion):.2f} | {drifts[0]:.1f} | "
                  f"{drifts[1]:.2f} | {anew:.1f} |")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=8)
    parser.add_argument("--seed", type=int, default=80)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/motion"))
    options = parser.parse_args()
    generated(options.bodies, options.seed)
    if (options.data / "02_01.amc").is_file():
        captured(options.data)


if __name__ == "__main__":
    main()
