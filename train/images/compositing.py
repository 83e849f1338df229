"""What compositors of crops and of scenes share."""

import numpy as np

from muybridge.arrays import BoolArray, ByteArray
from muybridge.train.images.camera_faults import CameraFaults
from muybridge.train.synthesis.rendering.store import RenderSet

# A render's side cuts something off if so many of its pixels are opaque.
_TOUCHING = 3


class BaseCompositor:
    """Renders, backgrounds and camera faults, drawn from one generator.

    Args:
        renders: people, and scenes of people and things.
        backgrounds: (N, 3, S, S) pool.
        seed: random seed.
    """

    def __init__(self, renders: RenderSet, backgrounds: ByteArray, seed: int) -> None:
        self.renders, self.backgrounds = renders, backgrounds
        self.rng = np.random.default_rng(seed)
        self.faults = CameraFaults(self.rng)
        self.is_scene = scenes_among(renders)
        is_person = people_among(renders)
        # Renders with a subject; of one whole person; of scenes with a subject; and of things alone.
        self.people = np.flatnonzero(is_person)
        self.whole = np.intersect1d(renders.whole, np.flatnonzero(is_person & ~self.is_scene))
        self.scenes = np.flatnonzero(self.is_scene & is_person)
        self.things = np.flatnonzero(~is_person)

    def _corner(self, window: int) -> tuple[int, int]:
        """Random corner (x, y) of a square window of a background."""
        x, y = self.rng.integers(0, self.backgrounds.shape[-1] - window + 1, 2)
        return int(x), int(y)

    def _patch(self, number: int, corner: tuple[int, int], window: int) -> ByteArray:
        """(window, window, 3) of a background, mirrored at random."""
        x, y = corner
        patch = self.backgrounds[number, :, y : y + window, x : x + window].transpose(1, 2, 0)
        return patch[:, ::-1] if self.rng.random() < 0.5 else patch


def scenes_among(renders: RenderSet) -> BoolArray:
    """(N,) which renders are of scenes: their shards have the coverage of things."""
    counts = np.array([len(shard) for shard in renders.pixels], int)
    return np.repeat(np.array([shard.shape[1] > 5 for shard in renders.pixels], bool), counts)


def people_among(renders: RenderSet) -> BoolArray:
    """(N,) which renders have a subject; the others are of things alone."""
    return np.asarray(np.isfinite(renders.box_px).all(1))


def touched_sides(planes: ByteArray) -> BoolArray:
    """(4,) whether people or things of a render (5 or 6, H, W) continue beyond its left, top, right and bottom."""
    opaque = planes[3] > 64
    sides = opaque[:, 0], opaque[0], opaque[:, -1], opaque[-1]
    return np.array([side.sum() >= _TOUCHING for side in sides])
