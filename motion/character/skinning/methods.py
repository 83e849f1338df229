"""The skinning methods by name, each prepared once for the meshes of a character."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.motion.character.skinning.delta_mush import prepare_mush
from muybridge.motion.character.skinning.flesh import prepare_flesh
from muybridge.motion.character.skinning.kernels import centred_blend, dual_quaternion_blend, linear_blend
from muybridge.motion.character.skinning.rotation_centres import rotation_centres
from muybridge.motion.character.skinning.skin import Rigid, Skin
from muybridge.motion.character.skinning.spherical import joint_sets

BLOCK = 64  # frames whose transforms are in memory at once


class Poser(Protocol):
    """A method prepared for one mesh: fills vertices (T, V, 3) of a shape (V, 3) for a block of frames (T, J, 4, 4)."""

    def __call__(self, shape: FloatArray, frames: FloatArray, out: Float32Array) -> None: ...


def _linear(skin: Skin) -> Poser:
    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        linear_blend(skin.affine(frames), shape.astype(np.float32), *skin.influences, out)

    return pose


def _dual_quaternion(skin: Skin) -> Poser:
    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        duals = _duals(skin.rigid(frames))
        dual_quaternion_blend(duals, skin.stretched(shape).astype(np.float32), *skin.influences, out)

    return pose


def _duals(rigid: Rigid) -> Float32Array:
    """(T, J, 8) unit dual quaternions of rigid maps, the real part first."""
    w, x, y, z = np.moveaxis(rigid.quat_wxyz, -1, 0)
    a, b, c = np.moveaxis(rigid.maps[..., 3], -1, 0)
    dual = np.stack([-a * x - b * y - c * z, a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x], -1)
    return np.ascontiguousarray(np.concatenate([rigid.quat_wxyz, 0.5 * dual], axis=-1), np.float32)


def _spherical(skin: Skin) -> Poser:
    sets = joint_sets(skin.influences, skin.stretched(skin.positions))

    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        rigid = skin.rigid(frames)
        flat = skin.stretched(shape).astype(np.float32)
        centred_blend(*rigid, flat, sets.centres(rigid.maps), sets.group, *skin.influences, out)

    return pose


def _about(skin: Skin, centres: FloatArray) -> Poser:
    table, each = centres.astype(np.float32)[None], np.arange(len(centres))

    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        flat = skin.stretched(shape).astype(np.float32)
        centred_blend(*skin.rigid(frames), flat, table, each, *skin.influences, out)

    return pose


def _delta_mush(skin: Skin) -> Poser:
    mush, linear = prepare_mush(skin), _linear(skin)

    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        linear(shape, frames, out)
        mush.apply(out, mush.details(skin.stretched(shape)[mush.first]))

    return pose


def _volume(skin: Skin, centres: FloatArray) -> Poser:
    turned, flesh = _about(skin, centres), prepare_flesh(skin)

    def pose(shape: FloatArray, frames: FloatArray, out: Float32Array) -> None:
        turned(shape, frames, out)
        flesh.apply(out, skin.stretched(shape), skin.rigid(frames).maps[..., :3])

    return pose


def _each(prepare: Callable[[Skin], Poser]) -> Callable[[Sequence[Skin]], list[Poser]]:
    return lambda skins: [prepare(skin) for skin in skins]


METHODS: dict[str, Callable[[Sequence[Skin]], list[Poser]]] = {
    "linear": _each(_linear),
    "spherical": _each(_spherical),
    "dual-quaternion": _each(_dual_quaternion),
    "rotation-centres": lambda skins: [_about(s, c) for s, c in zip(skins, rotation_centres(skins), strict=True)],
    "delta-mush": _each(_delta_mush),
    "volume": lambda skins: [_volume(s, c) for s, c in zip(skins, rotation_centres(skins), strict=True)],
}


class Skinner:
    """The meshes of a character, prepared for one method.

    Args:
        skins: of the meshes; those that hang together are prepared together.
        method: a name of `METHODS`.

    Raises:
        ValueError: no such method; the message lists those there are.
    """

    def __init__(self, skins: Sequence[Skin], method: str = "linear") -> None:
        if method not in METHODS:
            raise ValueError(f"no skinning method {method!r}; valid are {', '.join(METHODS)}")
        self.skins = tuple(skins)
        self.method = method
        self._posers = METHODS[method](self.skins)

    def pose(
        self, frames: FloatArray, shapes: Sequence[FloatArray] | None = None, meshes: Sequence[int] | None = None
    ) -> list[Float32Array]:
        """(T, V, 3) metres in the world of each mesh, all frames in memory.

        Args:
            frames: (T, J, 4, 4) of `Motion.forward`.
            shapes: (V, 3) of each mesh in place of its own, such as with morphs.
            meshes: numbers of those wanted; all by default.
        """
        chosen = range(len(self.skins)) if meshes is None else meshes
        out = [np.empty((len(frames), len(self.skins[m].positions), 3), np.float32) for m in chosen]
        for start in range(0, len(frames), BLOCK):
            self._fill(frames[start : start + BLOCK], shapes, chosen, [o[start : start + BLOCK] for o in out])
        return out

    def blocks(
        self, frames: FloatArray, shapes: Sequence[FloatArray] | None = None, size: int = BLOCK
    ) -> Iterator[tuple[int, list[Float32Array]]]:
        """The first frame and the vertices of one block of frames after another; takes of any length fit in memory.

        Args:
            frames, shapes: as in `pose`.
            size: frames in a block.
        """
        for start in range(0, len(frames), size):
            yield start, self.pose(frames[start : start + size], shapes)

    def _fill(
        self, frames: FloatArray, shapes: Sequence[FloatArray] | None, meshes: Sequence[int], out: list[Float32Array]
    ) -> None:
        for m, vertices in zip(meshes, out, strict=True):
            shape = self.skins[m].positions if shapes is None else shapes[m]
            self._posers[m](shape, frames, vertices)
