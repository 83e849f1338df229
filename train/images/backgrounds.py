"""Backgrounds without photographs: rooms, dead leaves, fractal noise, outdoors, backdrops. Seeded."""

import colorsys

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray, Float32Array

Colour = tuple[float, float, float]


def _muted(rng: np.random.Generator, lo: float = 0.05, hi: float = 0.95) -> Colour:
    """Colours of walls and objects: mostly of low saturation, sometimes strong."""
    strong = rng.random() < 0.1
    saturation = rng.uniform(0.4, 0.95) if strong else rng.beta(1.0, 6.0)
    return colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(lo, hi))


def fractal_noise(rng: np.random.Generator, size: int, slope: float, channels: int = 1) -> Float32Array:
    """(size, size, channels) noise whose amplitude falls as frequency to the power -slope, unit variance."""
    fy = np.fft.fftfreq(size)[:, None]
    fx = np.fft.rfftfreq(size)[None]
    amplitude = 1 / np.maximum(np.hypot(fx, fy), 1 / size) ** slope
    out = np.empty((size, size, channels), np.float32)
    for c in range(channels):
        spectrum = amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape))
        noise = np.fft.irfft2(spectrum, s=(size, size))
        out[..., c] = (noise - noise.mean()) / (noise.std() + 1e-9)
    return out


def _texture(image: Float32Array, mask: ByteArray | None, rng: np.random.Generator) -> None:
    """Multiply a region by faint noise and a lighting gradient, in place."""
    size = len(image)
    noise = fractal_noise(rng, size, rng.uniform(0.6, 1.6))[..., 0] * rng.uniform(0.0, 0.1)
    x, y = np.meshgrid(np.linspace(-1, 1, size), np.linspace(-1, 1, size))
    noise = noise + (x * rng.normal(0, 0.15) + y * rng.normal(0, 0.15)).astype(np.float32)
    gain = (1 + noise)[..., None]
    image[:] = image * gain if mask is None else np.where(mask[..., None] > 0, image * gain, image)


def _quad(rng: np.random.Generator, size: int, span: tuple[float, float], tall: float) -> NDArray[np.int32]:
    """A slightly distorted rectangle, as boards and boxes look from a room camera."""
    w = size * rng.uniform(*span)
    h = w * np.exp(rng.normal(np.log(tall), 0.6))
    x, y = rng.uniform(-0.1, 1.1, 2) * size
    shear, tilt = rng.normal(0, 0.2), rng.normal(0, 0.12)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [w / 2, h / 2]
    corners = corners @ np.array([[1, tilt], [shear * 0.5, 1]])
    return np.asarray(np.round(corners + [x, y]), np.int32)


def _furniture(image: Float32Array, rng: np.random.Generator, count: int) -> None:
    size = len(image)
    for _ in range(count):
        kind = rng.choice(["panel", "box", "window", "lines", "blob", "bars"], p=[0.3, 0.2, 0.12, 0.16, 0.1, 0.12])
        colour = _muted(rng)
        if kind in ("panel", "box", "window"):
            quad = _quad(rng, size, (0.05, 0.5), 1.0)
            cv2.fillPoly(image, [quad], colour, cv2.LINE_AA)
            if kind == "box":  # a second, darker face
                shift = np.array([rng.normal(0, 0.1), rng.normal(0, 0.06)]) * size
                face = np.array([quad[1], quad[2], quad[2] + shift, quad[1] + shift]).astype(np.int32)
                cv2.fillPoly(image, [face], tuple(c * rng.uniform(0.4, 0.8) for c in colour), cv2.LINE_AA)
            if kind == "window":
                bright = tuple(np.clip(np.array(colour) + rng.uniform(0.2, 0.8), 0, 1).tolist())
                inner = np.round(quad.mean(0) + (quad - quad.mean(0)) * 0.88).astype(np.int32)
                cv2.fillPoly(image, [inner], bright, cv2.LINE_AA)
            if rng.random() < 0.4:
                edge = tuple(c * rng.uniform(0.2, 0.8) for c in colour)
                cv2.polylines(image, [quad], True, edge, int(rng.integers(1, 4)), cv2.LINE_AA)
        elif kind == "bars":  # blinds, radiators, ladders, stripes
            quad = _quad(rng, size, (0.08, 0.35), 1.0).astype(float)
            for t in np.linspace(0, 1, int(rng.integers(4, 18))):
                a, b = quad[0] * (1 - t) + quad[3] * t, quad[1] * (1 - t) + quad[2] * t
                ends = tuple(a.astype(int).tolist()), tuple(b.astype(int).tolist())
                cv2.line(image, *ends, colour, int(rng.integers(1, 4)), cv2.LINE_AA)
        elif kind == "lines":  # cables, stands, legs of chairs and tripods
            start = rng.uniform(0, 1, 2) * size
            for _ in range(int(rng.integers(1, 6))):
                bend = rng.normal(0, 0.15 * size, (4, 2)).cumsum(0) * rng.choice([0.2, 1.0])
                path = np.vstack([start, start + rng.normal(0, 0.3 * size, 2) * np.linspace(0.3, 1, 4)[:, None] + bend])
                width = int(rng.integers(1, 7))
                cv2.polylines(image, [np.round(path).astype(np.int32)], False, colour, width, cv2.LINE_AA)
        else:
            center, axes = rng.uniform(0, 1, 2) * size, rng.uniform(0.01, 0.15, 2) * size
            cv2.ellipse(image, (center.astype(int).tolist()), axes.astype(int).tolist(), rng.uniform(0, 180), 0,
                        360, colour, -1, cv2.LINE_AA)  # fmt: skip


def _room(rng: np.random.Generator, size: int) -> Float32Array:
    """Wall, floor, sometimes a second wall and a ceiling, then objects; the camera is not level."""
    image = np.empty((size, size, 3), np.float32)
    image[:] = _muted(rng, 0.25, 1.0)
    _texture(image, None, rng)
    horizon = rng.uniform(0.15, 0.85) * size
    corner = rng.uniform(-0.3, 1.3) * size
    left, right = horizon + rng.normal(0, 0.12, 2) * size
    floor = np.array([[0, left], [corner, horizon], [size, right], [size, size], [0, size]])
    if rng.random() < 0.6:
        wall = np.array([[corner, 0], [size, 0], [size, size], [corner, size]]).astype(np.int32)
        mask = np.zeros((size, size), np.uint8)
        cv2.fillPoly(mask, [wall], 255)
        image[mask > 0] *= rng.uniform(0.6, 1.1)
    if rng.random() < 0.25:
        cv2.fillPoly(image, [np.array([[0, 0], [size, 0], [size, size * 0.15], [corner, size * 0.22],
                                       [0, size * 0.1]]).astype(np.int32)], _muted(rng, 0.5, 1.0))  # fmt: skip
    behind = int(rng.integers(0, 18))
    _furniture(image, rng, behind)
    mask = np.zeros((size, size), np.uint8)
    cv2.fillPoly(mask, [floor.astype(np.int32)], 255)
    image[mask > 0] = _muted(rng, 0.05, 0.9)
    _texture(image, mask, rng)
    _furniture(image, rng, int(rng.integers(0, 7)))
    return image


def _dead_leaves(rng: np.random.Generator, size: int) -> Float32Array:
    image = np.empty((size, size, 3), np.float32)
    image[:] = _muted(rng)
    base = np.array(_muted(rng))
    largest = rng.uniform(0.1, 0.4) * size
    for _ in range(int(rng.integers(30, 220))):
        radius = 1 / np.sqrt(rng.uniform(1 / largest**2, 1 / 9))
        center = rng.uniform(-0.1, 1.1, 2) * size
        colour = np.array(_muted(rng)) if rng.random() < 0.5 else base * rng.uniform(0.4, 1.5)
        tuple_colour = tuple(float(c) for c in colour.clip(0, 1))
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
        points = center + radius * np.stack([np.cos(angles), np.sin(angles)], 1) * rng.uniform(0.4, 2, 2)
        if rng.random() < 0.4:
            cv2.circle(image, tuple(center.astype(int).tolist()), int(radius), tuple_colour, -1, cv2.LINE_AA)
        else:
            cv2.fillPoly(image, [points.astype(np.int32)], tuple_colour, cv2.LINE_AA)
    return image


def _natural(rng: np.random.Generator, size: int) -> Float32Array:
    """Coloured 1/f noise, sometimes under a sky: grass, trees, gravel, walls out of focus."""
    noise = fractal_noise(rng, size, rng.uniform(0.7, 1.8), 1) * rng.uniform(0.05, 0.3)
    chroma = fractal_noise(rng, size, rng.uniform(1.0, 1.8), 3) * rng.uniform(0.0, 0.03)
    image = (np.array(_muted(rng, 0.2, 0.9), np.float32) * (1 + noise) + chroma).astype(np.float32)
    if rng.random() < 0.4:
        line = int(rng.uniform(0.1, 0.7) * size)
        sky = np.array(_muted(rng, 0.6, 1.0), np.float32) * np.linspace(1, rng.uniform(0.8, 1.2), line)[:, None, None]
        image[:line] = sky + noise[:line] * 0.15
    _furniture(image, rng, int(rng.integers(0, 4)))
    return np.asarray(image)


def sample_backdrop(rng: np.random.Generator, size: int) -> Float32Array:
    """(size, size, 3) in 0..1: a black or coloured curtain, a keying screen, a bare wall; sometimes with a floor of the
    same or another colour, and lit from one side."""
    kind = rng.random()
    if kind < 0.5:
        colour: Colour = _muted(rng, 0.0, 0.08)
    elif kind < 0.65:  # green and blue screens
        hue = rng.normal(0.36 if rng.random() < 0.7 else 0.61, 0.02)
        colour = colorsys.hsv_to_rgb(hue, rng.uniform(0.5, 0.95), rng.uniform(0.3, 0.8))
    else:
        colour = _muted(rng, 0.1, 1.0)
    image = np.empty((size, size, 3), np.float32)
    image[:] = colour
    x = np.linspace(0, 1, size, dtype=np.float32)
    if rng.random() < 0.3:  # folds
        phase = 2 * np.pi * rng.uniform(4, 25) * x + rng.uniform(0, 4) * np.sin(2 * np.pi * rng.uniform(0.5, 3) * x)
        image *= (1 + rng.uniform(0.05, 0.4) * np.sin(phase))[None, :, None]
    if rng.random() < 0.5:
        bottom = int(rng.uniform(0.4, 1.0) * size)
        image[bottom:] = np.array(colour) * rng.uniform(0.5, 1.5) if rng.random() < 0.5 else _muted(rng, 0.02, 0.7)
    y = x[:, None]
    distance = np.hypot(x - rng.uniform(-0.3, 1.3), y - rng.uniform(-0.3, 1.3))
    return np.asarray(image * np.exp(-rng.uniform(0, 1.5) * distance**2)[..., None], np.float32).clip(0, 1)


def sample_background(rng: np.random.Generator, size: int) -> ByteArray:
    """(size, size, 3) uint8."""
    kind = rng.choice(3, p=[0.55, 0.2, 0.25])
    image = (_room, _dead_leaves, _natural)[kind](rng, size)
    image += fractal_noise(rng, size, rng.uniform(0.3, 1.2), 1) * rng.uniform(0, 0.035)
    blur = rng.choice([0.0, 0.7, 1.5, 3.0])
    if blur > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur), np.float32)
    exposure = np.exp(rng.normal(0, 0.25))
    return np.asarray(np.clip(image * exposure, 0, 1) * 255, np.uint8)


def make_backgrounds(count: int, size: int, seed: int, first: int = 0) -> ByteArray:
    """(count, 3, size, size) uint8: the backgrounds of a seed, starting with number `first`."""
    cv2.setNumThreads(1)
    out = np.empty((count, 3, size, size), np.uint8)
    for i in range(count):
        out[i] = sample_background(np.random.default_rng([seed, first + i]), size).transpose(2, 0, 1)
    return out
