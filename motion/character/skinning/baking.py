"""Skinning baked to what every viewer has: linear blending with morph targets, or morph targets alone.

A viewer adds morph targets to the mesh at rest and then blends linearly. What another method does differently in a
frame is therefore taken back through the blended matrix of each vertex, and becomes a target for that frame.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray
from muybridge.motion.character.skinning.methods import BLOCK, Skinner
from muybridge.motion.character.skinning.skin import Skin

MODES = ("correctives", "vertices")
_COLLAPSED = 0.1  # smallest stretch of a blended matrix through which a difference is taken back in full


@dataclass(frozen=True)
class BakeOptions:
    """What a baked mesh is made of.

    Attributes:
        mode: "correctives", targets on top of linear blending, or "vertices", targets that hold whole poses for a mesh
            without skin.
        tolerance: metres that a vertex may be from the method's own result; targets are added until all are nearer.
        most: targets, at which it stops anyway.
    """

    mode: str = "correctives"
    tolerance: float = 1e-3
    most: int = 32

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ValueError(f"no such way to bake: {self.mode!r}; valid are {', '.join(MODES)}")
        if self.most < 1 or not self.tolerance > 0:
            raise ValueError("a baked mesh needs at least one target, and a tolerance above zero")


@dataclass(frozen=True, eq=False)
class Baked:
    """A mesh as a viewer can play it.

    Attributes:
        positions: (V, 3) metres at rest; in the mode "vertices" the first pose of all, in the world.
        targets: (M, V, 3) metres, offsets from positions at full weight.
        weights: (T, M) of the targets in each frame.
        key_frames: (M,) the frames that the targets were taken from.
        skinned: whether the joints go on moving the mesh; without, its vertices are in the world.
        error: metres, the largest distance of a vertex from the method's own result.
    """

    positions: FloatArray
    targets: Float32Array
    weights: Float32Array
    key_frames: tuple[int, ...]
    skinned: bool
    error: float


def bake(skinner: Skinner, mesh: int, frames: FloatArray, options: BakeOptions | None = None) -> Baked:
    """Bake one mesh over a take.

    Targets are the residuals of key frames. The first is the frame of the largest residual; each further one that of
    the largest error left, until the tolerance or the number of targets is reached. The weights of the targets are
    least squares in every frame, so that a target also serves the frames that are like its own.

    Args:
        skinner: of the character, with any method.
        mesh: its number.
        frames: (T, J, 4, 4) of `Motion.forward`.
        options: see `BakeOptions`.

    Raises:
        ValueError: no frames.
    """
    options = options or BakeOptions()
    if not len(frames):
        raise ValueError("there are no frames to bake")
    skin = skinner.skins[mesh]
    exact = skinner.pose(frames, meshes=[mesh])[0]
    if options.mode == "vertices":
        rest = exact[0].astype(np.float64)
        return _chosen(exact - exact[0], exact, None, rest, options)
    blended = Skinner([skin]).pose(frames)[0]
    residual = np.empty_like(exact)
    for start in range(0, len(frames), BLOCK):
        block = slice(start, start + BLOCK)
        residual[block] = _taken_back(skin, skin.affine(frames[block]), exact[block] - blended[block])
    maps = skin.affine(frames)
    return _chosen(residual, exact - blended, (skin, maps), skin.positions, options)


def _matrices(skin: Skin, maps: Float32Array) -> FloatArray:
    """(V, 3, 3) the blended matrices of one frame's maps (J, 3, 4)."""
    out = np.zeros((len(skin.positions), 3, 3))
    for k in range(skin.joints.shape[1]):
        out += skin.weights[:, k, None, None] * maps[skin.joints[:, k], :, :3]
    return out


def _taken_back(skin: Skin, maps: Float32Array, differences: Float32Array) -> Float32Array:
    """(T, V, 3) differences in the world as offsets at rest; damped where a blended matrix has collapsed."""
    out = np.empty_like(differences)
    for t, frame in enumerate(maps):
        matrix = _matrices(skin, frame)
        turned = np.swapaxes(matrix, 1, 2)
        damped = turned @ matrix
        least = np.linalg.eigvalsh(damped)[:, 0]
        damped += np.maximum(_COLLAPSED**2 - least, 0.0)[:, None, None] * np.eye(3)
        out[t] = np.linalg.solve(damped, turned @ differences[t][..., None])[..., 0]
    return out


def _chosen(
    residual: Float32Array, wanted: Float32Array, skinned: tuple[Skin, Float32Array] | None, rest: FloatArray,
    options: BakeOptions,
) -> Baked:  # fmt: skip
    """Key frames of residuals (T, V, 3), chosen one by one by the error that is left in the world."""
    count = len(residual)
    flat = residual.reshape(count, -1)
    gram = (flat.astype(np.float64) @ flat.T.astype(np.float64)) if flat.size else np.zeros((count, count))
    target = wanted if skinned is not None else residual
    keys: list[int] = []
    weights = np.zeros((count, 0))
    error = _errors(np.zeros_like(residual), target, skinned)
    while error.max(initial=0.0) > options.tolerance and len(keys) < min(options.most, count):
        open_frames: BoolArray = ~np.isin(np.arange(count), keys)
        keys.append(int(np.argmax(np.where(open_frames, error, -1.0))))
        weights = _weights(gram, keys)
        made = np.tensordot(weights.astype(np.float32), residual[keys], axes=1)
        error = _errors(made, target, skinned)
    return Baked(rest, residual[keys].astype(np.float32), weights.astype(np.float32), tuple(keys), skinned is not None,
                 float(error.max(initial=0.0)))  # fmt: skip


def _weights(gram: FloatArray, keys: list[int]) -> FloatArray:
    """(T, M) weights of key frames that come nearest to each frame; a key frame's own target is itself."""
    own = gram[np.ix_(keys, keys)]
    scale = np.trace(own) / len(keys)
    return np.asarray(np.linalg.solve(own + 1e-9 * scale * np.eye(len(keys)), gram[keys]).T)


def _errors(made: Float32Array, target: Float32Array, skinned: tuple[Skin, Float32Array] | None) -> FloatArray:
    """(T,) metres, the largest distance of a vertex in each frame once the joints moved what the targets made."""
    out = np.zeros(len(made))
    for t in range(len(made)):
        moved = made[t]
        if skinned is not None:
            moved = (_matrices(skinned[0], skinned[1][t]) @ moved[..., None])[..., 0]
        out[t] = np.linalg.norm(moved - target[t], axis=1).max(initial=0.0)
    return out
