"""Pictures without colour, toned prints and faded film, on photographs and on videos alike.

A film first mixes the colours of the scene, then changes contrast, black and white, and adds grain. The same mixture
applies to the difference to a background model, since the model is made from the same pictures.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from torch import Tensor, from_numpy

from muybridge.arrays import ByteArray, Float32Array, FloatArray, IntArray
from muybridge.train.images.camera_faults import CameraFaults

# Colours that white and black become in toned prints: sepia, yellowed paper, cyanotype, selenium.
_TONES = (
    ((1.0, 0.91, 0.74), (0.17, 0.09, 0.04)), ((1.0, 0.95, 0.82), (0.1, 0.09, 0.08)),
    ((0.9, 0.97, 1.0), (0.03, 0.12, 0.3)), ((1.0, 0.93, 0.94), (0.12, 0.05, 0.12)),
)  # fmt: skip
_TONE_SHARES = (0.55, 0.2, 0.12, 0.13)
# What films and sensors without colour are sensitive to: as the eye is, anything, blue and green alone
# (orthochromatic), red alone.
_EYE = np.array([0.3, 0.56, 0.14])
_SENSITIVITY_SHARES = (0.45, 0.25, 0.2, 0.1)


@dataclass(frozen=True)
class Film:
    """What a picture makes of the colours of a scene.

    Attributes:
        mixture: (3, 3) colours from the scene's; equal rows for pictures without colour.
        contrast: slope of the tone curve in the middle greys.
        pivot: value, 0 to 1, that the contrast leaves as it is, if it is the picture's mean too; else halfway there.
        gamma: (3,) exponents, after the contrast.
        black, white: (3,) colours that black and white become.
        grain: standard deviation of the grain in middle greys.
        grain_px: standard deviation of a grain's size, as a share of the picture's side.
    """

    mixture: FloatArray
    contrast: float = 1.0
    pivot: float = 0.45
    gamma: tuple[float, ...] = (1.0, 1.0, 1.0)
    black: tuple[float, ...] = (0.0, 0.0, 0.0)
    white: tuple[float, ...] = (1.0, 1.0, 1.0)
    grain: float = 0.0
    grain_px: float = 0.0

    @property
    def slopes(self) -> Float32Array:
        """(3, 3) how far colours of the picture differ, by how far those of the scene do, in the middle greys."""
        between = self.contrast * (np.array(self.white) - np.array(self.black))
        return np.asarray(between[:, None] * self.mixture, np.float32)

    def develop(self, picture: ByteArray, faults: CameraFaults) -> ByteArray:
        """(H, W, 3) of the scene as this film shows it; `faults` gives the noise."""
        mixed = cv2.transform(picture, self.mixture)
        value = np.linspace(0, 1, 256)
        pivot = (self.pivot + float(mixed.mean()) / 255) / 2  # so that not everything becomes black or white
        steep = (pivot + self.contrast * (value - pivot)).clip(0, 1)
        low, high = np.array(self.black), np.array(self.white)
        table = low + (high - low) * steep[:, None] ** np.array(self.gamma)
        out = np.asarray(cv2.LUT(mixed, np.round(255 * table).astype(np.uint8)[:, None]), np.uint8)
        return self._with_grain(out, faults) if self.grain else out

    def _with_grain(self, picture: ByteArray, faults: CameraFaults) -> ByteArray:
        height, width = picture.shape[:2]
        noise = faults.grain(height * width).numpy().reshape(height, width)
        sigma = self.grain_px * max(height, width)
        if sigma > 0.4:  # blurred noise, of the same strength
            noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), sigma)) * np.float32(2 * np.sqrt(np.pi) * sigma)
        strength = np.sin(np.linspace(0, np.pi, 256)) * 0.8 + 0.2  # little grain in black and in white
        strong = strength.astype(np.float32)[picture[..., 1]] * np.float32(255 * self.grain)
        return np.asarray((picture + (noise * strong)[..., None]).clip(0, 255), np.uint8)


def grey(rng: np.random.Generator) -> Film:
    """A film or sensor without colour: of any sensitivity to red, green and blue, often of other contrast, grainy."""
    kind = rng.choice(4, p=_SENSITIVITY_SHARES)
    if kind == 2:
        red, blue = rng.uniform(0, 0.08), rng.uniform(0.25, 0.7)
        seen = np.array([red, 1 - red - blue, blue])
    elif kind == 3:
        seen = rng.dirichlet((12, 1, 0.5))
    else:
        seen = rng.dirichlet(9 * _EYE) if kind == 0 else rng.dirichlet((2, 2, 2))
    contrast = 1.0 if rng.random() < 0.35 else float(np.clip(np.exp(rng.normal(0.15, 0.35)), 0.5, 2))
    if rng.random() < 0.12:  # lithographic film, and copies of copies
        contrast = float(rng.uniform(1.8, 3.2))
    low, high = (rng.uniform(0, 0.14), rng.uniform(0.78, 1.0)) if rng.random() < 0.4 else (0.0, 1.0)
    coarse, grain_px = _grain(rng)
    return Film(
        np.tile(seen, (3, 1)), contrast, float(rng.uniform(0.3, 0.55)), (float(np.exp(rng.normal(0, 0.15))),) * 3,
        (float(low),) * 3, (float(high),) * 3, coarse, grain_px,
    )  # fmt: skip


def toned(rng: np.random.Generator) -> Film:
    """A print or film without colour in tones of another one: sepia, yellowed paper, cyanotype."""
    white, black = (np.array(c) for c in _TONES[rng.choice(len(_TONES), p=_TONE_SHARES)])
    much = rng.uniform(0.4, 1.2)  # of the tone
    light, dark = rng.uniform(0.75, 1.0), rng.uniform(0.2, 1.3)
    gamma = (black[::-1] - black.mean()) * rng.uniform(0, 2) + 1  # brown shadows reach into the middle tones
    return replace(
        grey(rng), white=tuple((light * (1 - much * (1 - white))).clip(0, 1).tolist()),
        black=tuple((dark * black).clip(0, 0.4).tolist()), gamma=tuple(gamma.clip(0.6, 1.5).tolist()),
    )  # fmt: skip


def faded(rng: np.random.Generator) -> Film:
    """Colour film whose dyes have faded, or a picture that was edited to look so: pale, with a cast."""
    saturation = rng.uniform(0.1, 0.75)
    mixture = saturation * np.eye(3) + (1 - saturation) * np.tile(rng.dirichlet(20 * _EYE), (3, 1))
    mixture += rng.normal(0, 0.05, (3, 3)) * (1 - np.eye(3))
    coarse, grain_px = _grain(rng)
    return Film(
        mixture / mixture.sum(1, keepdims=True), float(rng.uniform(0.65, 1.25)), float(rng.uniform(0.35, 0.6)),
        tuple(np.exp(rng.normal(0, 0.2, 3)).tolist()), tuple(rng.uniform(0, 0.22, 3).tolist()),
        tuple(rng.uniform(0.75, 1.0, 3).tolist()), coarse, grain_px,
    )  # fmt: skip


def _grain(rng: np.random.Generator) -> tuple[float, float]:
    """Strength and size of the grain, none in half of the films."""
    coarse = min(0.09, float(rng.gamma(1.3, 0.016))) if rng.random() < 0.5 else 0.0
    return coarse, float(rng.uniform(0, 1.5)) / 256


_KINDS: tuple[Callable[[np.random.Generator], Film], ...] = (grey, toned, faded)


def sample_films(rng: np.random.Generator, count: int, shares: tuple[float, float, float]) -> dict[int, Film]:
    """The films of some of `count` pictures, by their number.

    Args:
        rng: source of random numbers, not used if all shares are zero.
        count: number of pictures.
        shares: of pictures without colour, toned ones and faded ones.
    """
    if not any(shares):
        return {}
    kind: IntArray = np.searchsorted(np.cumsum(shares), rng.random(count), side="right")
    return {i: _KINDS[k](rng) for i, k in enumerate(kind.tolist()) if k < len(_KINDS)}


def develop(pixels: Tensor, films: dict[int, Film], faults: CameraFaults) -> None:
    """Show those of (B, 3, H, W) uint8 that have a film as it does, in place."""
    for i, film in films.items():
        picture = np.ascontiguousarray(pixels[i].numpy().transpose(1, 2, 0))
        pixels[i] = from_numpy(np.ascontiguousarray(film.develop(picture, faults).transpose(2, 0, 1)))
