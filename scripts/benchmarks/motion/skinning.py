"""Skinning methods: speed, and what they do to the joints of a generated body.

    python -m scripts.benchmarks.motion.skinning

Needs the extra `train`. Volume is that of the limb from the middle of one bone to the middle of the next, over its
volume at rest, the least and the most of all steps. What a folded limb has twice, since it runs into itself, counts two
times there; once in the volume occupied, the least of all steps. Bulge is how far the vertices that both bones move
reach from the bones (98 % of them are nearer), over that at rest, the most of all steps. Crossings are pairs of
triangles of the region, the most of all steps.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.motion.character.skinning import METHODS, Skin, Skinner
from scripts.benchmarks.common import best_time, print_header
from scripts.benchmarks.motion.joint_bends import bends_of, bent_frames, generated_body, region_of
from scripts.benchmarks.motion.windings import occupied

VERTICES, FRAMES = 20_000, 64


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the body; 0 has middle proportions")
    parser.add_argument("--no-speed", action="store_true", help="only what the methods do to joints")
    options = parser.parse_args()
    if not options.no_speed:
        speed()
    deformation(options.seed)


def speed() -> None:
    """Frames per second of one core, and seconds to prepare, for a tube of 20,000 vertices with 20 bones."""
    skin, frames = tube(VERTICES, 20, FRAMES)
    print(f"{len(skin.positions):,} vertices, {len(skin.triangles):,} triangles, {skin.joints.shape[1]} influences\n")
    print_header(("method", "prepared in s", "frames/s"))
    for method in METHODS:
        Skinner([skin], method).pose(frames[:2])
        start = time.process_time()
        skinner = Skinner([skin], method)
        prepared = time.process_time() - start
        some = frames if method not in ("delta-mush", "volume") else frames[:8]
        took, _ = best_time(lambda s=skinner, f=some: s.pose(f), 5)
        print(f"| {method} | {prepared:.2f} | {len(some) / took.processor:,.0f} |", flush=True)


def tube(vertices: int, bones: int, frames: int) -> tuple[Skin, FloatArray]:
    """A tube along x with four influences at every vertex, and joints that bend it at random."""
    around = 100
    rings = vertices // around
    x = np.repeat(np.linspace(0, 2, rings), around)
    turn = np.tile(np.linspace(0, 2 * np.pi, around, endpoint=False), rings)
    positions = np.stack([x, 0.1 * np.cos(turn), 0.1 * np.sin(turn)], axis=1)
    here = np.arange(rings - 1)[:, None] * around + np.arange(around)
    right = np.arange(rings - 1)[:, None] * around + (np.arange(around) + 1) % around
    triangles = np.concatenate([np.stack([here, here + around, right], -1).reshape(-1, 3),
                                np.stack([right, here + around, right + around], -1).reshape(-1, 3)])  # fmt: skip
    place = np.linspace(0, 2, bones, endpoint=False)
    share = np.exp(-(((x[:, None] - place - 1 / bones) * bones / 2) ** 2))
    joints = np.argsort(-share, axis=1)[:, :4]
    weights = np.take_along_axis(share, joints, 1)
    bind = np.tile(np.eye(4), (bones, 1, 1))
    bind[:, 0, 3] = -place
    rng = np.random.default_rng(0)
    turns = Rotation.from_rotvec(rng.normal(0, 0.3, (frames * bones, 3))).as_matrix().reshape(frames, bones, 3, 3)
    out = np.tile(np.eye(4), (frames, bones, 1, 1))
    out[:, 0, :3, :3] = turns[:, 0]
    for j in range(1, bones):
        out[:, j, :3, :3] = out[:, j - 1, :3, :3] @ turns[:, j]
        out[:, j, :3, 3] = out[:, j - 1, :3, 3] + out[:, j - 1, :3, 0] * (place[j] - place[j - 1])
    return Skin(positions, triangles, joints, weights / weights.sum(1, keepdims=True), bind), out


def deformation(seed: int = 0) -> None:
    """Volume, bulge and crossings of each joint and method."""
    body = generated_body(seed)
    start = time.process_time()
    skinners = {m: Skinner([body.skin], m) for m in METHODS}
    print(f"\nall methods prepared for {len(body.skin.positions):,} vertices in {time.process_time() - start:.1f} s\n")
    print_header(("joint", "method", "volume", "least occupied", "bulge", "most crossings"))
    at_rest = occupied(body.skin.positions, body.skin.triangles)
    for name, bend in bends_of(body).items():
        region, frames = region_of(body, bend), bent_frames(body, bend)
        for method, skinner in skinners.items():
            posed = skinner.pose(frames)[0]
            volumes = np.array([region.volume(v) for v in posed])
            radii = np.array([region.radii(v, f) for v, f in zip(posed, frames, strict=True)])
            thick = np.quantile(radii, 0.98, axis=1)
            bulge = float((thick / thick[0]).max())
            crossings = max(region.crossings(v) for v in posed)
            held = min(occupied(v, body.skin.triangles) for v in posed)
            held = 1 + (held - at_rest) / region.volume_at_rest
            print(f"| {name} | {method} | {volumes.min():.3f} to {volumes.max():.3f} | {held:.3f} | {bulge:.3f} | "
                  f"{crossings} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
