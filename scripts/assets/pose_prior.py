"""Learn the pose prior of `muybridge.geometry.ik` from generated motion.

Usage: python -m scripts.assets.pose_prior [--clips 90] [--components 12] [--out geometry/ik/pose_prior.npz]

Uses clips of the procedural motion generator on bodies of several builds. Each clip's joints become the landmarks of
BODY23, `fit_body` turns them into angles, and every sixth frame is an example. A tenth of the clips is held out; the
log density of their poses is printed beside that of one Gaussian and that of poses drawn uniformly within the limits.
"""

import argparse
from pathlib import Path

import numpy as np

from muybridge.geometry.fitting.body_fit import fit_body
from muybridge.geometry.ik.pose_prior import fit_prior, save_prior
from muybridge.geometry.ik.tree import theta_of_rotations, tree_of_skeleton
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SkinnedBody, forward, turn
from muybridge.train.synthesis.motions.sampler import MotionClip, MotionSampler

FPS = 30.0
JOINTS = {"shoulder": "upperarm01.", "elbow": "lowerarm01.", "wrist": "wrist.", "hip": "upperleg01.",
          "knee": "lowerleg01.", "ankle": "foot."}  # fmt: skip


def landmarks(skeleton: SkinnedBody, clip: MotionClip) -> np.ndarray:
    """(T, 23, 3) metres, landmarks of BODY23 at and near the clip's joints."""
    turns, at = forward(skeleton, turn(clip.rotvec), clip.root)

    def place(bone: str, offset: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
        b = skeleton.index(bone)
        return at[:, b] + turns[:, b] @ np.array(offset)

    out = {"nose": place("head", (0, -0.11, 0.06))}
    for side, sign in (("left", 1), ("right", -1)):
        mark = "L" if side == "left" else "R"
        for name, bone in JOINTS.items():
            out[f"{side}_{name}"] = place(bone + mark)
        out[f"{side}_eye"] = place("head", (sign * 0.03, -0.08, 0.09))
        out[f"{side}_ear"] = place("head", (sign * 0.07, 0.0, 0.07))
        out[f"{side}_heel"] = place("foot." + mark, (0, 0.05, -0.06))
        out[f"{side}_big_toe"] = place("toe1-1." + mark, (0, -0.04, 0))
        out[f"{side}_small_toe"] = place("toe5-1." + mark, (0, -0.02, 0))
    return np.stack([out[n] for n in BODY23.names], axis=1)


def poses_of(skeleton: SkinnedBody, clip: MotionClip) -> np.ndarray:
    """(T, N) angles of BODY's hinges, every sixth frame."""
    xyz = landmarks(skeleton, clip)
    t, j = xyz.shape[:2]
    covariance = np.tile(np.eye(3) * 0.01**2, (t, j, 1, 1))
    fit = fit_body(Points3D(BODY23, xyz, covariance, np.empty((0, t, j)), np.empty((0, t, j), bool), FPS))
    tree, _ = tree_of_skeleton(fit.motion.skeleton, BODY.rest)
    return theta_of_rotations(tree, fit.motion.skeleton, matrix_from_quat(fit.motion.quat_wxyz[::6]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=90)
    parser.add_argument("--components", type=int, default=12)
    parser.add_argument("--out", type=Path, default=Path("geometry/ik/pose_prior.npz"))
    arguments = parser.parse_args()
    body = BodyModel(5)
    people = body.sample_phenotypes(6)
    poses = []
    for k in range(arguments.clips):
        skeleton = body.skeleton(people[k % len(people)])
        sampler = MotionSampler(skeleton, np.random.default_rng(1000 + k))
        poses.append(poses_of(skeleton, sampler.sample(6.0, FPS)))
    tree, _ = tree_of_skeleton(BODY.skeleton(prior_shape(1.7)), BODY.rest)
    held = np.concatenate(poses[::10])
    seen = np.concatenate([p for k, p in enumerate(poses) if k % 10])
    prior = fit_prior(tree.names, seen, arguments.components)
    one = fit_prior(tree.names, seen, 1)
    even = np.random.default_rng(0).uniform(tree.lower, tree.upper, (1000, len(tree)))
    print(f"{len(seen)} examples of {len(poses)} clips; mean log density of {len(held)} held-out poses:")
    mixture, single = (p.log_density(held).mean() for p in (prior, one))
    print(f"  {arguments.components} components {mixture:.1f}, one {single:.1f}")
    print(f"  of poses drawn uniformly within the limits {prior.log_density(even).mean():.1f}")
    save_prior(arguments.out, prior)
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
