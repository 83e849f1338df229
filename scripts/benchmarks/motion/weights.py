"""Weights against those of artists, which were taken away.

    python -m scripts.benchmarks.motion.weights HERO.glb ... [--bodies 2] [--network FILE.onnx]

For each character and method: the mean over vertices of the sum of absolute differences (L1, from 0 to 2), the mean
distance of the vertices from the artist's over ten random poses as a share of the height, and seconds. Generated bodies
(`--bodies`, extra `train`) have the weights of their own artist. Characters of rigid parts count with their parts.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics.rotations import quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.infer.networks.characters import SkinningNetwork
from muybridge.motion.character import Character, Skin, Skinner, read_character, skin_weights
from muybridge.motion.character.weights import WEIGHT_METHODS
from scripts.benchmarks.common import print_header
from scripts.benchmarks.motion.joint_bends import generated_body

POSES, SPREAD_DEG = 10, 25.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("characters", type=Path, nargs="*")
    parser.add_argument("--bodies", type=int, default=0)
    parser.add_argument("--network", type=Path, help="that corrects weights by heat: rows named `learned`")
    arguments = parser.parse_args()
    network = SkinningNetwork(arguments.network) if arguments.network else None
    print_header(("character", "vertices", "joints", "method", "L1", "poses, % of height", "least sum", "s"))
    for path in arguments.characters:
        character = read_character(path)
        score(path.stem, joined(character), character.skeleton, character.root_at_rest, network)
    for k in range(arguments.bodies):
        body = generated_body(k)
        score(f"generated body {k}", body.skin, body.skeleton, body.joints[0], network)


def joined(character: Character) -> Skin:
    """All skinned meshes of a character as one; its rigid parts where it has no skin."""
    meshes = [m for m in character.meshes if not m.rigid] or list(character.meshes)
    width = max(m.joints.shape[1] for m in meshes)
    starts = np.cumsum([0, *(len(m.positions) for m in meshes)])
    places = character.rest_motion().forward()[0]
    return Skin(
        np.concatenate([m.positions for m in meshes]),
        np.concatenate([m.triangles + n for m, n in zip(meshes, starts[:-1], strict=True)]),
        np.concatenate([np.pad(m.joints, ((0, 0), (0, width - m.joints.shape[1]))) for m in meshes]),
        np.concatenate([np.pad(m.weights, ((0, 0), (0, width - m.weights.shape[1]))) for m in meshes]),
        np.linalg.inv(places),
    )


def score(name: str, skin: Skin, skeleton: Skeleton, root: FloatArray, network: SkinningNetwork | None) -> None:
    """Print the rows of a character."""
    artist = dense(skin.joints, skin.weights, len(skeleton))
    joints = np.linalg.inv(skin.bind)[:, :3, 3]
    height = float(np.ptp(skin.positions[:, 2]))
    frames = random_poses(skeleton, root)
    wanted = Skinner([skin]).pose(frames)[0]
    for method in (*WEIGHT_METHODS[1:], *(["learned"] if network else [])):
        start = time.process_time()
        learned = method == "learned"
        weights = skin_weights(skin.positions, skin.triangles, joints, np.array(skeleton.parents),
                               "heat" if learned else method, network=network if learned else None,
                               names=skeleton.names)  # fmt: skip
        seconds = time.process_time() - start
        most = int(np.count_nonzero(weights, axis=1).max())
        chosen = np.argsort(-weights, axis=1)[:, :most]
        own = Skin(skin.positions, skin.triangles, chosen, np.take_along_axis(weights, chosen, 1), skin.bind)
        away = np.linalg.norm(Skinner([own]).pose(frames)[0] - wanted, axis=2).mean()
        print(f"| {name} | {len(skin.positions):,} | {len(skeleton)} | {method} | "
              f"{np.abs(weights - artist).sum(axis=1).mean():.3f} | {100 * away / height:.2f} | "
              f"{weights.sum(axis=1).min():.7f} | {seconds:.2f} |", flush=True)  # fmt: skip


def dense(joints: IntArray, weights: FloatArray, count: int) -> FloatArray:
    """(V, J) of (V, K) joints and weights."""
    out = np.zeros((len(joints), count))
    np.add.at(out, (np.arange(len(joints))[:, None], joints), weights)
    return out


def random_poses(skeleton: Skeleton, root: FloatArray) -> FloatArray:
    """(T, J, 4, 4) poses in which every joint turns at random."""
    rng = np.random.default_rng(7)
    turns = Rotation.from_rotvec(rng.normal(0, np.radians(SPREAD_DEG), (POSES * len(skeleton), 3))).as_matrix()
    quat = quat_from_matrix(turns).reshape(POSES, len(skeleton), 4)
    slides = None
    if skeleton.sliding:
        slides = np.tile([skeleton.offsets[j] + (root if skeleton.parents[j] < 0 else 0.0)
                          for j in skeleton.sliding], (POSES, 1, 1))  # fmt: skip
    return Motion(skeleton, 30.0, np.tile(root, (POSES, 1)), quat, slides).forward()


if __name__ == "__main__":
    main()
