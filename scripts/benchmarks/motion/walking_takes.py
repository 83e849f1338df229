"""Generated takes of one body that walks, runs and stands, at many speeds and in many curves.

Usage: python -m scripts.benchmarks.motion.walking_takes OUT_FOLDER [--frames 43000] [--seed 0] [--suffix .glb]

Writes one file a take, for `muybridge match build` and `muybridge graph build`. Needs the `train` extra.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.registry import write_file
from muybridge.motion.take import Take

FPS = 60.0
KINDS = {"walk": 0.65, "run": 0.25, "stand": 0.1}
_SECONDS = (8.0, 20.0)
# Fingers, toes and eyes are left out: nobody steers by them, and they are most of the bones.
_LEFT_OUT = ("finger", "metacarpal", "toe1-2", "toe2-2", "toe3-", "toe4-", "toe5-", "toe1-", "toe2-3", "eye")


def walking_takes(frames: int, seed: int = 0) -> Iterator[tuple[str, Motion]]:
    """Takes with their names, of so many frames together, 60 a second."""
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.motions.rig import turn
    from muybridge.train.synthesis.motions.sampler import MotionSampler

    body = BodyModel(seed)
    rng = np.random.default_rng(seed)
    person = body.skeleton(body.sample_phenotypes(1)[0])
    sampler = MotionSampler(person, rng)
    share = np.array(list(KINDS.values()))
    done = 0
    while done < frames:
        kind = str(rng.choice(list(KINDS), p=share / share.sum()))
        clip = sampler.sample(float(rng.uniform(*_SECONDS)), FPS, kind)
        motion = Motion(person.joints, clip.fps, clip.root, continuous_quat(quat_from_matrix(turn(clip.rotvec))))
        motion = without_joints(motion).select(slice(0, frames - done))
        yield f"{kind}_{done:06d}", motion
        done += len(motion)


def without_joints(motion: Motion) -> Motion:
    """The motion without the bones that are left out; none of those that stay hangs on one of them."""
    skeleton = motion.skeleton
    kept = [j for j, name in enumerate(skeleton.names) if not name.startswith(_LEFT_OUT)]
    place = {j: k for k, j in enumerate(kept)}
    parents = tuple(place[skeleton.parents[j]] if skeleton.parents[j] >= 0 else -1 for j in kept)
    tips = skeleton.tips[kept].copy()
    for k, j in enumerate(kept):
        children = [c for c, p in enumerate(skeleton.parents) if p == j]
        if children and k not in parents:
            tips[k] = skeleton.offsets[children].mean(axis=0)
    limited = replace(
        skeleton, names=tuple(skeleton.names[j] for j in kept), parents=parents, offsets=skeleton.offsets[kept],
        tips=tips, twist_axis=tuple(skeleton.twist_axis[j] for j in kept), lower=skeleton.lower[kept],
        upper=skeleton.upper[kept],
    )  # fmt: skip
    return Motion(limited, motion.fps, motion.root_positions_world, motion.quat_wxyz[:, kept])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=43_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--suffix", default=".glb")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, motion in walking_takes(options.frames, options.seed):
        write_file(options.out / f"{name}{options.suffix}", Take(motion=motion))
        print(f"{name}: {len(motion)} frames", flush=True)


if __name__ == "__main__":
    main()
