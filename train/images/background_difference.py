"""The difference to the background model in training crops: what a static camera adds to an image, with its faults.

Motion transfers from synthetic to real images where colours do not (Doersch and Zisserman, "Sim2real transfer learning
for 3D human pose estimation: motion to the rescue", NeurIPS 2019). In use the background model is a median over a take
at the person detector's resolution, so it is coarser than a crop, noisy, and contains people who stood still.
"""

import math
from collections.abc import Mapping

import cv2
import numpy as np
import torch
from torch import Tensor

from muybridge.arrays import Float32Array

# Shares of people in the background model: as they stand, in part (the rest moved), and at an earlier position.
STILL, PARTLY, GHOST = 0.1, 0.12, 0.1
# Range of the width of a pixel of the background model in crop pixels: of people who fill the image, and small ones.
_LOG_COARSENESS = (math.log(0.8), math.log(6.0))


class BackgroundDifferences:
    """Draws background differences and their faults.

    Args:
        rng: source of random numbers.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def add_people(self, plate: Tensor, person: Tensor, static: Tensor) -> None:
        """Add people to the background model, in place.

        Args:
            plate: (B, 3, S, S) the scene without the subject.
            person: (B, 4 or more, S, S) the subject's colours, premultiplied, and alpha.
            static: (B, 1, S, S) in 0..1 where the background model contains what the image shows.
        """
        size = plate.shape[-1]
        for i, kind in enumerate(self.rng.random(len(plate))):
            if kind < STILL:
                static[i] = torch.maximum(static[i], person[i, 3:4])
            elif kind < STILL + PARTLY:
                known = torch.from_numpy(self._half(size))
                static[i] = torch.maximum(static[i], person[i, 3:4] * known)
            elif kind < STILL + PARTLY + GHOST:
                ghost = _shift(person[i, :4], *self.rng.integers(-size // 2, size // 2, 2))
                plate[i] = plate[i] * (1 - ghost[3:]) + ghost[:3]

    def _half(self, size: int) -> Float32Array:
        """(S, S) one on one side of a line through the crop near its centre."""
        angle, offset = self.rng.uniform(0, 2 * np.pi), self.rng.normal(0, 0.15) * size
        y, x = np.mgrid[:size, :size] - (size - 1) / 2
        return np.asarray(x * np.cos(angle) + y * np.sin(angle) > offset, np.float32)

    def difference(
        self, image: Tensor, plate: Tensor, static: Tensor, light: Float32Array,
        slopes: Mapping[int, Float32Array] | None = None,
    ) -> Tensor:  # fmt: skip
        """(B, 1, S, S) uint8: mean over RGB of |image - plate| in 0..1, times 255, as coarse and noisy as in use.

        Args:
            image, plate: (B, 3, S, S) in 0..1 before camera faults.
            static: (B, 1, S, S) as in `add_people`.
            light: (B, 3) relative red, green and blue light that reaches the camera.
            slopes: of some crops, by their number, (3, 3) how a camera without or with faded colours mixes differences
                of colours.
        """
        rng, count, size = self.rng, len(image), image.shape[-1]
        flicker = np.exp(rng.normal(0, 0.02, count)) * (rng.random(count) < 0.5)
        model = plate * torch.from_numpy(np.where(flicker > 0, flicker, 1).astype(np.float32)).view(-1, 1, 1, 1)
        apart = image - model
        for i, slope in (slopes or {}).items():
            apart[i] = torch.einsum("dc,chw->dhw", torch.from_numpy(slope), apart[i])
        apart.abs_()
        raw = ((apart[:, 0] + apart[:, 1] + apart[:, 2]).div_(3) * (1 - static[:, 0])).numpy()
        # Cameras set the exposure before anything is compared.
        level = image.mean((1, 2, 3)).numpy().clip(1e-3)
        gain = np.exp(rng.normal(0, 0.4, count)) * (0.2 / level).clip(1.0, 5.0) * light.mean(1)
        coarseness = np.exp(rng.uniform(*_LOG_COARSENESS, count))
        noise = rng.gamma(1.2, 0.008, count).clip(0, 0.05)
        out = np.empty((count, 1, size, size), np.uint8)
        for i in range(count):
            side = min(size, max(8, round(size / coarseness[i])))
            small = cv2.resize(raw[i] * np.float32(gain[i]), (side, side), interpolation=cv2.INTER_AREA)
            small += np.abs(rng.standard_normal(small.shape, np.float32)) * np.float32(noise[i])
            full = cv2.resize(small, (size, size), interpolation=cv2.INTER_LINEAR)
            out[i, 0] = (full.clip(0, 1) * 255).round()
        return torch.from_numpy(out)


def _shift(layer: Tensor, dx: int, dy: int) -> Tensor:
    """(C, S, S) shifted by whole pixels, zero where nothing comes in."""
    size = layer.shape[-1]
    out = torch.zeros_like(layer)
    to_x, to_y = slice(max(dx, 0), size + min(dx, 0)), slice(max(dy, 0), size + min(dy, 0))
    of_x, of_y = slice(max(-dx, 0), size + min(-dx, 0)), slice(max(-dy, 0), size + min(-dy, 0))
    out[:, to_y, to_x] = layer[:, of_y, of_x]
    return out
