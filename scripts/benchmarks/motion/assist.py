"""Arms and spine of takes whose legs alone are given, from other takes, against the nearest pose and the truth.

    python -m scripts.benchmarks.motion.assist [--data ../shared/data/motion] [--generated 8] [--seed 3]

Every take in turn is the key-framed one: its root and legs are kept, its arms, spine and head are taken away, and made
from all the other takes. The swing of an arm is the angle, ahead and back, of the line from shoulder to wrist; its
correlation over time with that of the take is what counts. The baseline copies the pose of the frame whose legs are
nearest.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.assistance.completion import assist, driving_joints
from muybridge.motion.assistance.fragments import vectors_about
from muybridge.motion.assistance.takes import CapturedTake, bring_take, mirrored
from muybridge.motion.editing.resampling import resample
from muybridge.motion.formats import read_file

FPS = 60.0
SIDES = ("left", "right")
LEGS = ("thigh", "shin", "foot", "toe")


@dataclass(frozen=True, eq=False)
class NamedTake:
    """A take, the joints' roles, and what it is called."""

    name: str
    motion: Motion
    roles: dict[str, int]


def named_take(path: Path) -> NamedTake:
    """A take of a file, at `FPS`."""
    motion = read_file(path).motion
    assert motion is not None
    return NamedTake(path.stem, resample(motion, FPS), find_motion_roles(motion).roles)


def real_takes(folder: Path) -> list[NamedTake]:
    """The recorded takes: a walk and a run, and others among which these must be found."""
    return [named_take(folder / name) for name in ("02_01.amc", "02_03.amc", "01_01.amc", "cmu_91_48.fbx")]


def generated(count: int, seed: int) -> list[NamedTake]:
    """Generated walks of 5 s, each of another person."""
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.motions.rig import turn
    from muybridge.train.synthesis.motions.sampler import MotionSampler

    body, rng = BodyModel(seed), np.random.default_rng(seed)
    out = []
    for k, phenotype in enumerate(body.sample_phenotypes(count)):
        person = body.skeleton(phenotype)
        clip = MotionSampler(person, rng).sample(5.0, FPS, "walk")
        quat = continuous_quat(quat_from_matrix(turn(clip.rotvec)))
        out.append(NamedTake(f"generated {k + 1}", Motion(person.joints, clip.fps, clip.root, quat), person.roles))
    return out


def legs_alone(take: NamedTake) -> tuple[Motion, tuple[int, ...]]:
    """The take without the movement of all that is above its legs, and the joints of that."""
    motion, above = take.motion, take.motion.skeleton.is_ancestor
    legs = [take.roles[f"{side}_thigh"] for side in SIDES]
    made = [j for j in range(len(motion.skeleton))
            if not above[legs[0], j] and not above[legs[1], j]
            and not above[j, legs[0]] and not above[j, legs[1]]]  # fmt: skip
    quat = motion.quat_wxyz.copy()
    quat[:, made] = np.array([1.0, 0, 0, 0])
    return replace(motion, quat_wxyz=quat), tuple(made)


def others_of(take: NamedTake, takes: list[NamedTake]) -> list[CapturedTake]:
    """All other takes on the skeleton of this one, and their mirror images."""
    keys, _ = legs_alone(take)
    others = [bring_take(t.name, t.motion, t.roles, keys, take.roles) for t in takes if t is not take]
    return others + [mirrored(t, take.roles) for t in others]


def swings(motion: Motion, roles: dict[str, int]) -> FloatArray:
    """(T, 2) radians: how far ahead of the hanging position the line from shoulder to wrist is, left and right."""
    places = motion.joint_positions_world()
    across = places[:, roles["left_thigh"]] - places[:, roles["right_thigh"]]
    ahead = np.cross(across, [0.0, 0, 1])
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    out = []
    for side in SIDES:
        arm = places[:, roles[f"{side}_hand"]] - places[:, roles[f"{side}_upper_arm"]]
        out.append(np.arctan2((arm * ahead).sum(1), -arm[:, 2]))
    return np.unwrap(np.stack(out, 1), axis=0)


def nearest_pose(keys: Motion, takes: list[CapturedTake], made: tuple[int, ...], driving: tuple[int, ...]) -> Motion:
    """The baseline: in each frame, the made joints of the captured frame whose driving joints are nearest."""
    mean = keys.quat_wxyz[:, list(driving)].mean(axis=0)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    ours = vectors_about(mean, keys.quat_wxyz[:, list(driving)])
    theirs = np.concatenate([vectors_about(mean, t.motion.quat_wxyz[:, list(driving)]) for t in takes])
    poses = np.concatenate([t.motion.quat_wxyz[:, list(made)] for t in takes])
    far = (ours**2).sum(1)[:, None] + (theirs**2).sum(1)[None] - 2 * ours @ theirs.T
    quat = keys.quat_wxyz.copy()
    quat[:, list(made)] = poses[np.argmin(far, axis=1)]
    return replace(keys, quat_wxyz=continuous_quat(quat))


def correlations(one: FloatArray, other: FloatArray) -> FloatArray:
    """(2,) of the swings (T, 2)."""
    return np.array([np.corrcoef(one[:, k], other[:, k])[0, 1] for k in range(one.shape[1])])


def main() -> None:
    """Measure, and print a row for each take."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/motion"))
    parser.add_argument("--generated", type=int, default=0)
    parser.add_argument("--seed", type=int, default=3)
    arguments = parser.parse_args()
    takes = real_takes(arguments.data)
    if arguments.generated:
        takes += generated(arguments.generated, arguments.seed)
    print("take               frames  fragments   assist l, r     nearest pose l, r   rms l, r (deg): assist, nearest")
    for take in takes:
        keys, made = legs_alone(take)
        others = others_of(take, takes)
        driving = driving_joints(keys, made, take.roles)
        done = assist(keys, others, made, driving)
        base = nearest_pose(keys, others, made, driving)
        truth, mine, theirs = (swings(m, take.roles) for m in (take.motion, done.motion, base))
        rms = [np.degrees(np.sqrt(np.mean((x - truth) ** 2, axis=0))) for x in (mine, theirs)]
        used = sorted({others[f.clip].name for f in done.match.fragments})
        print(f"{take.name:18s} {len(keys):6d} {len(done.wanted):6d}     "
              f"{'  '.join(f'{c:.2f}' for c in correlations(mine, truth))}         "
              f"{'  '.join(f'{c:.2f}' for c in correlations(theirs, truth))}         "
              f"{'  '.join(f'{v:.0f}' for v in np.concatenate(rms))}   {done.match.costs.mean():.2f} {used}",
              flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
