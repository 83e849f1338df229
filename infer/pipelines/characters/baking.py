"""A skinning method baked into a written GLB: morph targets that correct what viewers do, frame by frame."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.infer.pipelines.characters.retarget import Placed, Target
from muybridge.motion.character.skinning import BakeOptions, bake
from muybridge.motion.formats.gltf.morph_tracks import MorphTracks, add_morph_tracks
from muybridge.motion.formats.gltf.write import GLTF_FROM_WORLD
from muybridge.wording import counted

BAKED = (".glb", ".vrm")
_MOST_PLACES = 100_000_000  # vertices times frames that are held at once, some 5 GB


def check_baked(out: Path, method: str, takes: int) -> None:
    """MuybridgeError where a method cannot be baked into a file: of another format, or without takes."""
    if method == "linear":
        return
    if out.suffix.lower() not in BAKED:
        raise MuybridgeError(f"{out}: {method} skinning is baked into {' and '.join(BAKED)} files only",
                             remedy="other_name")  # fmt: skip
    if not takes:
        raise MuybridgeError(f"{method} skinning is baked frame by frame, and there is no take to bake; give one with "
                             "--motion, or leave out --skinning")  # fmt: skip


def bake_takes(path: Path, target: Target, placed: Sequence[Placed], method: str, options: BakeOptions) -> str:
    """Bake a skinning method into a GLB that has been written with its takes.

    Args:
        path: the file.
        target: the character in it.
        placed: its takes.
        method: a name of `muybridge.motion.character.METHODS`.
        options: of baking.

    Returns:
        A sentence on how near the file comes to the method, and how much larger it is.

    Raises:
        MuybridgeError: the takes are too long to be baked.
    """
    character = target.character
    motions = [one.result.motion for one in placed]
    frames = np.concatenate([motion.forward() for motion in motions])
    skinner = character.skinner(method)
    vertices = sum(len(skin.positions) for skin in skinner.skins)
    if vertices * len(frames) > _MOST_PLACES:
        longest = _MOST_PLACES // vertices
        raise MuybridgeError(f"{path}: {counted(len(frames), 'frame')} of {vertices:,} vertices "
                             f"are too many to bake {method} skinning; at most {longest} frames fit: cut the takes, "
                             "lower --fps, or leave out --skinning")  # fmt: skip
    before = path.stat().st_size
    baked = [bake(skinner, m, frames, options) for m in range(len(skinner.skins))]
    targets = [np.asarray(b.targets @ GLTF_FROM_WORLD.T.astype(np.float32), np.float32) for b in baked]
    ends = np.cumsum([len(m) for m in motions])[:-1]
    split = [np.split(b.weights, ends) for b in baked]
    tracks = {one.name: MorphTracks([parts[k] for parts in split], motions[k].fps) for k, one in enumerate(placed)}
    add_morph_tracks(path, targets, tracks)
    count, error = sum(len(b.targets) for b in baked), max(b.error for b in baked)
    return (f"{method} skinning is baked into {counted(count, 'morph target')}: within {error * 1e3:.1f} mm of it; the "
            f"file grew from {before / 1e6:.1f} to {path.stat().st_size / 1e6:.1f} MB")  # fmt: skip
