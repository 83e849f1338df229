"""Fabrics as small tiling textures made from seeded noise: weaves and patterns, prints, folds.

Every texture is a stack of layers (L, N, N, 4) uint8 that the renderer samples by cloth coordinates, so that patterns
follow limbs in any pose. Channels of a pattern: share of the second colour, brightness (128 is 1), share of the third
colour, unused. Of a print: cover, share of the print's second colour. Of folds: slope along and across the cloth (128
is 0), height, occlusion.
"""

import colorsys
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from muybridge.arrays import ByteArray, Float32Array

Colour = tuple[float, float, float]

N = 128
PATTERNS = (
    "plain", "melange", "denim", "knit", "stripes", "pinstripes", "uneven_stripes", "upright_stripes", "tartan",
    "gingham", "dots", "flowers", "camouflage", "batik", "houndstooth", "letters", "triangles", "leopard", "quilted",
    "discs",
)  # fmt: skip
PRINTS = ("words", "badge", "number", "band", "picture", "small_logo", "swoosh", "stripes")
FOLDS = ("soft", "slanted", "gathered", "draped")


def noise(rng: np.random.Generator, sigma: float | tuple[float, float], size: int = N) -> Float32Array:
    """(size, size) smooth tiling noise, mean 0, standard deviation 1."""
    out = gaussian_filter(rng.standard_normal((size, size)), sigma, mode="wrap")
    return np.asarray((out - out.mean()) / (out.std() + 1e-9), np.float32)


def octaves(rng: np.random.Generator, sigma: float, count: int = 3) -> Float32Array:
    """(N, N) tiling noise of several scales."""
    total = sum(noise(rng, sigma / 2**k) * 0.6**k for k in range(count))
    return np.asarray(total / np.std(total), np.float32)


def _step(values: Float32Array, edge: float, soft: float) -> Float32Array:
    return np.asarray(np.clip((values - edge) / soft + 0.5, 0, 1), np.float32)


def _layer(
    second: Float32Array | float = 0.0, shade: Float32Array | float = 1.0, third: Float32Array | float = 0.0
) -> ByteArray:
    planes = [np.broadcast_to(np.asarray(p, np.float32), (N, N)) for p in (second, np.asarray(shade) / 2, third, 0)]
    return np.asarray((np.stack(planes, -1).clip(0, 1) * 255).round(), np.uint8)


def _scatter(rng: np.random.Generator, count: int, low: float, high: float, petals: int = 0) -> Float32Array:
    """(N, N) discs or flowers at random positions, tiling."""
    out = np.zeros((N, N), np.float32)
    y, x = np.mgrid[:N, :N].astype(np.float32)
    for _ in range(count):
        cx, cy = rng.uniform(0, N, 2)
        dx, dy = (x - cx + N / 2) % N - N / 2, (y - cy + N / 2) % N - N / 2
        reach = rng.uniform(low, high)
        if petals:
            reach = reach * (0.7 + 0.3 * np.cos(petals * np.arctan2(dy, dx) + rng.uniform(0, 6)))
        out = np.maximum(out, np.clip((reach - np.hypot(dx, dy)) + 0.5, 0, 1))
    return out


def _letters(rng: np.random.Generator, size: int, lines: int, scale: float) -> Float32Array:
    """(size, size) rows of letters."""
    picture = np.zeros((size, size), np.uint8)
    for k in range(lines):
        count = int(rng.integers(3, 9))
        text = "".join(chr(int(c)) for c in rng.integers(65, 91, count))
        font = int(rng.choice([cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX,
                               cv2.FONT_HERSHEY_SCRIPT_SIMPLEX]))  # fmt: skip
        (width, height), _ = cv2.getTextSize(text, font, 1.0, 2)
        fit = min(scale * size / lines / height, 0.92 * size / width)
        at = (int((size - width * fit) / 2), int(size * (k + 0.5) / lines + height * fit / 2))
        cv2.putText(picture, text, at, font, fit, 255, max(1, round(size / lines * scale / 9)), cv2.LINE_AA)
    return np.asarray(picture / 255, np.float32)


def _weaves(rng: np.random.Generator, y: Float32Array, x: Float32Array) -> list[ByteArray]:
    fine = noise(rng, 0.6)
    melange = octaves(rng, 1.5)
    twill = np.sin((x + y) * 2 * np.pi / 4)
    knit = np.sin(x * 2 * np.pi / 8) * 0.12 + np.sin(y * 2 * np.pi / 8 + 2 * np.abs(np.sin(x * np.pi / 8))) * 0.08
    return [
        _layer(0, 1 + 0.03 * fine),
        _layer(_step(melange, 0.4, 1.5) * 0.6, 1 + 0.08 * fine),
        _layer(_step(octaves(rng, 18), 0.5, 2.5) * 0.35, 1 + 0.07 * twill + 0.1 * noise(rng, (6, 1))),
        _layer(0, 1 + knit + 0.05 * fine),
    ]


def _lines(rng: np.random.Generator, y: Float32Array, x: Float32Array) -> list[ByteArray]:
    uneven = np.zeros(N, np.float32)
    third = np.zeros(N, np.float32)
    for _ in range(4):
        at, width = rng.integers(0, N), rng.integers(4, 22)
        (uneven if rng.random() < 0.6 else third)[(np.arange(width) + at) % N] = 1
    fold = np.ones((1, N), np.float32)
    bars = _step(np.sin(y * 2 * np.pi / 64), 0, 0.3)
    tartan = 0.5 * _step(np.sin(y * 2 * np.pi / 64), 0, 0.2) + 0.5 * _step(np.sin(x * 2 * np.pi / 64), 0, 0.2)
    thread = np.maximum(((x + 9) % 64 < 4), ((y + 9) % 64 < 4)).astype(np.float32)
    check = 0.5 * ((x % 32) < 16) + 0.5 * ((y % 32) < 16)
    return [
        _layer(bars),
        _layer((y % 32 < 7).astype(np.float32)),
        _layer(uneven[:, None] * fold, 1, third[:, None] * fold),
        _layer((x % 32 < 12).astype(np.float32), 1, (x % 64 > 60).astype(np.float32)),
        _layer(tartan, 1, 0.7 * thread),
        _layer(check.astype(np.float32)),
    ]


def _motifs(rng: np.random.Generator, y: Float32Array, x: Float32Array) -> list[ByteArray]:
    dots = np.hypot((x + 16 * ((y // 32) % 2)) % 32 - 16, y % 32 - 16)
    flowers, leaves = _scatter(rng, 14, 8, 16, 5), _scatter(rng, 22, 4, 9, 2)
    tooth = (((x // 8 + y // 8) % 2) + (((x + y) % 16) < 4)).clip(0, 1).astype(np.float32)
    spots = noise(rng, 4)
    ridges = np.abs(np.sin(y * np.pi / 32))
    triangles = ((x % 32) > (y % 32)).astype(np.float32)
    pick = noise(rng, 8)
    return [
        _layer(np.clip(8 - dots + 0.5, 0, 1)),
        _layer(flowers, 1, leaves * (1 - flowers)),
        _layer(_step(octaves(rng, 9), 0.2, 0.25), 1, _step(octaves(rng, 9), 0.7, 0.25)),
        _layer(_step(octaves(rng, 14), 0, 2.0), 1 + 0.1 * noise(rng, 5), _step(octaves(rng, 10), 1.1, 0.8)),
        _layer(tooth),
        _layer(_letters(rng, N, 4, 0.6)),
        _layer(triangles, 1, _step(pick, 0.5, 0.2) * (1 - triangles)),
        _layer(_step(-np.abs(spots - 0.6), -0.35, 0.2), 1, _step(spots, 1.0, 0.2)),
        _layer(0, np.asarray(0.55 + 0.5 * ridges**0.4, np.float32)),
        _layer(_scatter(rng, 40, 3, 12), 1, _scatter(rng, 25, 3, 12)),
    ]


def make_patterns(seed: int = 1) -> ByteArray:
    """(len(PATTERNS), N, N, 4): weaves and all-over patterns, in the order of `PATTERNS`."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:N, :N].astype(np.float32)
    return np.stack(_weaves(rng, y, x) + _lines(rng, y, x) + _motifs(rng, y, x))


def make_prints(seed: int = 2, variants: int = 3) -> ByteArray:
    """(variants * len(PRINTS), N, N, 4): prints on chest or back; layer = variant * kinds + kind. Row 0 is the
    bottom."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:N, :N].astype(np.float32) / N - 0.5
    layers = []
    for _ in range(variants):
        words = _letters(rng, N, int(rng.integers(1, 4)), 0.7)
        badge = np.clip((0.36 - np.hypot(x, y)) * N, 0, 1)
        number = np.zeros((N, N), np.uint8)
        cv2.putText(number, str(rng.integers(1, 99)), (8, 100), cv2.FONT_HERSHEY_SIMPLEX, 3.0, 255, 13, cv2.LINE_AA)
        band = (np.abs(y - 0.05) < 0.18).astype(np.float32)
        square = (np.maximum(np.abs(x), np.abs(y)) < 0.42).astype(np.float32)
        small = (np.hypot(x - 0.3, y + 0.3) < 0.09).astype(np.float32)
        curve = np.zeros((N, N), np.uint8)
        points = np.stack([np.linspace(12, 116, 6), rng.uniform(20, 108, 6)], 1).astype(np.int32)
        cv2.polylines(curve, [points], False, 255, 12, cv2.LINE_AA)
        bars = ((y * 100) % 22 < 11).astype(np.float32) * (np.abs(x) < 0.4)
        covers = [words, badge, number / 255, band, square, small, curve / 255, bars]
        inner = [words * 0, _letters(rng, N, 2, 0.5), words * 0, _letters(rng, N, 1, 0.3),
                 _step(octaves(rng, 12), 0, 0.4), words * 0, words * 0, words * 0]  # fmt: skip
        for cover, second in zip(covers, inner, strict=True):
            layers.append(_layer(np.asarray(cover, np.float32), 2 * np.asarray(second, np.float32))[::-1])
    return np.stack(layers)


def make_folds(seed: int = 3) -> ByteArray:
    """(len(FOLDS), N, N, 4): slopes along and across, height and occlusion of creased cloth."""
    rng = np.random.default_rng(seed)

    def ridged(height: Float32Array) -> Float32Array:
        """Creases are narrow valleys between broad bulges."""
        return np.asarray(1 - np.abs(height) ** 0.8, np.float32)

    def turned(sigma: tuple[float, float], slant: int) -> Float32Array:
        field = noise(rng, sigma)
        return np.stack([np.roll(row, slant * k) for k, row in enumerate(field)])

    heights = [
        octaves(rng, 14, 4) * 0.8,
        ridged(turned((9, 4), 1)) + ridged(turned((9, 4), -1)) + 0.4 * octaves(rng, 12, 2),
        ridged(noise(rng, (3, 14))) + 0.6 * ridged(noise(rng, (2, 9))) + 0.4 * octaves(rng, 10, 2),
        ridged(noise(rng, (16, 3.5))) + 0.7 * octaves(rng, 16, 2),
    ]
    layers = []
    for height in heights:
        smooth = gaussian_filter(height, 1.2, mode="wrap")
        smooth = (smooth - smooth.mean()) / smooth.std()
        along = (np.roll(smooth, -1, 0) - np.roll(smooth, 1, 0)) / 2
        across = (np.roll(smooth, -1, 1) - np.roll(smooth, 1, 1)) / 2
        occlusion = 0.5 + 0.5 * np.clip((smooth - gaussian_filter(smooth, 6, mode="wrap")) / 1.2, -1, 1)
        planes = [along * 1.2 + 0.5, across * 1.2 + 0.5, smooth / 6 + 0.5, occlusion]
        layers.append(np.asarray((np.stack(planes, -1).clip(0, 1) * 255).round(), np.uint8))
    return np.stack(layers)


def colour_of(values: Any) -> Colour:
    """Three numbers as a colour."""
    return tuple(float(c) for c in values)  # type: ignore[return-value]


def fabric_colour(rng: np.random.Generator) -> Colour:
    """Linear colour of a worn fabric: mostly dark, grey, white and blue; saturated colours are rare."""
    kind = rng.random()
    if kind < 0.30:  # black and charcoal: even black cloth returns 3 % of the light
        return colour_of(np.exp(rng.uniform(np.log(0.026), np.log(0.1))) * rng.uniform(0.85, 1.15, 3))
    if kind < 0.42:  # white and light grey
        return colour_of(rng.uniform(0.4, 0.82) * rng.uniform(0.92, 1.03, 3))
    if kind < 0.54:  # navy to jeans
        return colour_of(np.array([0.25, 0.38, 0.75]) * rng.uniform(0.06, 0.5) * rng.uniform(0.85, 1.15, 3))
    if kind < 0.64:  # beige, khaki, brown
        return colour_of(np.array([0.55, 0.42, 0.26]) * rng.uniform(0.12, 1.1) * rng.uniform(0.85, 1.15, 3))
    saturation = rng.uniform(0.6, 0.95) if rng.random() < 0.3 else rng.beta(1.4, 2.2)
    return colour_of(np.array(colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.05, 0.8))))
