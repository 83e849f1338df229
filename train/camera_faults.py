"""What a camera does to an image: defocus, motion blur, low resolution, colour, tone, noise, compression."""

import cv2
import kornia
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


class CameraFaults:
    """Random image formation on batches, drawn from `rng`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def _column(self, values: NDArray[np.floating]) -> Tensor:
        return torch.from_numpy(np.asarray(values, np.float32)).view(-1, 1, 1, 1)

    def _some(self, share: float, image: Tensor) -> Tensor:
        return torch.from_numpy(np.nonzero(self.rng.random(len(image)) < share)[0])

    def _uniform(self, low: float, high: float, count: int) -> Tensor:
        return torch.from_numpy(self.rng.uniform(low, high, count).astype(np.float32))

    def apply(self, image: Tensor) -> Tensor:
        """(B, 3, H, W) in 0..1 -> the same shape, not clamped."""
        rng = self.rng
        some = self._some(0.45, image)
        if len(some):
            sigma = self._uniform(0.3, 1.6, len(some)).view(-1, 1).expand(-1, 2) * (min(image.shape[-2:]) / 192)
            image[some] = kornia.filters.gaussian_blur2d(image[some], (7, 7), sigma)
        some = self._some(0.15, image)
        if len(some):
            angle = self._uniform(0, 180, len(some))
            length = int(rng.choice([3, 5, 7, 9]))
            image[some] = kornia.filters.motion_blur(image[some], length, angle, torch.zeros(len(some)))
        some = self._some(0.15, image)
        if len(some):
            share = rng.uniform(0.3, 0.8)
            small = [int(n * share) for n in image.shape[-2:]]
            low = torch.nn.functional.interpolate(image[some], small, mode="area")
            image[some] = torch.nn.functional.interpolate(low, image.shape[-2:], mode="bilinear")
        some = self._some(0.35, image)
        if len(some):
            image[some] = kornia.enhance.adjust_hue(image[some].clamp(0, 1), self._uniform(-0.25, 0.25, len(some)))
        grey = image.mean(1, keepdim=True)
        saturation = self._column(np.exp(rng.normal(0, 0.35, len(image))) * (rng.random(len(image)) > 0.1))
        image = grey + (image - grey) * saturation
        image = image * self._column(np.exp(rng.normal(0, 0.12, len(image))))
        balance = torch.from_numpy(np.exp(rng.normal(0, 0.06, (len(image), 3, 1, 1))).astype(np.float32))
        contrast = self._column(np.exp(rng.normal(0, 0.22, len(image))))
        level = image.mean((1, 2, 3), keepdim=True)
        image = ((image - level) * contrast + level) * balance + self._column(rng.normal(0, 0.05, len(image)))
        gamma = self._column(np.exp(rng.normal(0, 0.25, len(image))))
        image = image.clamp(1e-4, 1) ** gamma
        noise = rng.gamma(1.2, 0.014, len(image)).clip(0, 0.08)
        grain = torch.from_numpy(rng.standard_normal(image.shape, np.float32))
        return image + grain * self._column(noise)

    def compress(self, pixels: Tensor) -> Tensor:
        """JPEG, which stands for the video codec's losses too."""
        for i in np.nonzero(self.rng.random(len(pixels)) < 0.3)[0]:
            quality = int(self.rng.uniform(15, 85))
            picture = np.ascontiguousarray(pixels[i].numpy().transpose(1, 2, 0))
            _, code = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
            pixels[i] = torch.from_numpy(cv2.imdecode(code, cv2.IMREAD_COLOR).transpose(2, 0, 1).copy())
        return pixels


def outside_of_video(
    rng: np.random.Generator, height: int, width: int
) -> tuple[NDArray[np.bool_], tuple[float, float, float]]:
    """What lies beyond the video's border, black in an image that reaches over it: slanted where the picture of a
    rolled camera was turned upright.

    Returns:
        mask (height, width), and (nx, ny, edge): a point p, taken from the image's middle, is outside if
        nx * px + ny * py > edge.
    """
    slant = rng.normal(0, 0.25) if rng.random() < 0.7 else 0.0
    turns = int(rng.integers(4))
    angle = slant + turns * np.pi / 2
    edge = (height if turns % 2 else width) * (0.5 - 0.5 * rng.beta(1.0, 3.0))
    nx, ny = float(np.cos(angle)), float(np.sin(angle))
    y, x = np.mgrid[:height, :width].astype(np.float32)
    mask = (x - (width - 1) / 2) * nx + (y - (height - 1) / 2) * ny > edge
    return mask, (nx, ny, float(edge))
