"""What compositors of crops and of scenes share."""

import numpy as np

from muybridge.arrays import ByteArray
from muybridge.train.images.camera_faults import CameraFaults
from muybridge.train.synthesis.rendering.store import RenderSet


class BaseCompositor:
    """Renders, backgrounds and camera faults, drawn from one generator.

    Args:
        renders: people.
        backgrounds: (N, 3, S, S) pool.
        seed: random seed.
    """

    def __init__(self, renders: RenderSet, backgrounds: ByteArray, seed: int) -> None:
        self.renders, self.backgrounds = renders, backgrounds
        self.rng = np.random.default_rng(seed)
        self.faults = CameraFaults(self.rng)
        self.whole = renders.whole

    def _corner(self, window: int) -> tuple[int, int]:
        """Random corner (x, y) of a square window of a background."""
        x, y = self.rng.integers(0, self.backgrounds.shape[-1] - window + 1, 2)
        return int(x), int(y)

    def _patch(self, number: int, corner: tuple[int, int], window: int) -> ByteArray:
        """(window, window, 3) of a background, mirrored at random."""
        x, y = corner
        patch = self.backgrounds[number, :, y : y + window, x : x + window].transpose(1, 2, 0)
        return patch[:, ::-1] if self.rng.random() < 0.5 else patch
