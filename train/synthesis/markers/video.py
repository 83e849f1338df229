"""Synthetic video of reflective markers: bright discs with bloom on a dark, noisy image, and false lights."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

RADIUS_M = 0.007


@dataclass(frozen=True)
class VideoFaults:
    """Faults of the image.

    Attributes:
        noise: standard deviation, grey levels.
        dark: grey level of the background.
        bloom: share of a marker's light that spreads.
        bloom_px: standard deviation of the spread.
        lamps: fixed lights in the room.
        flickers: false lights per frame and camera, each in one camera only.
    """

    noise: float = 4.0
    dark: float = 14.0
    bloom: float = 0.25
    bloom_px: float = 5.0
    lamps: int = 3
    flickers: float = 1.0


def ring_of_cameras(count: int, radius_m: float = 4.2, height_m: float = 2.4, width: int = 1024, tall: int = 1024,
                    focal_px: float = 1150.0) -> CameraGroup:  # fmt: skip
    """Cameras around the origin, facing the middle of a person."""
    cameras = []
    for k in range(count):
        angle = 2 * np.pi * k / count + 0.2
        centre = np.array([radius_m * np.cos(angle), radius_m * np.sin(angle), height_m + 0.35 * (-1) ** k])
        z = np.array([0, 0, 0.95]) - centre
        z /= np.linalg.norm(z)
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        turn = np.stack([x, np.cross(z, x), z])
        params = (focal_px, focal_px, (width - 1) / 2, (tall - 1) / 2, -0.05, 0.02, 0.0, 0.0)
        pose = np.concatenate([turn, (-turn @ centre)[:, None]], 1)
        cameras.append(Camera(f"cam{k + 1}", "OPENCV", width, tall, params, pose))
    return CameraGroup(tuple(cameras))


def markers_in_sight(
    cameras: CameraGroup, points: FloatArray, normals: FloatArray, limbs: FloatArray, radii: FloatArray
) -> BoolArray:
    """(C, M) markers that face a camera and are not behind a limb.

    Args:
        cameras: the cameras.
        points, normals: (M, 3).
        limbs: (S, 2, 3) metres, ends of capsules.
        radii: (S,) metres.
    """
    out = np.zeros((len(cameras), len(points)), bool)
    for c, camera in enumerate(cameras):
        to = camera.center_world - points
        far = np.linalg.norm(to, axis=1, keepdims=True)
        facing = np.sum(to / far * normals, axis=1) > 0.15
        # From just above the marker towards the camera; its own limb begins behind it.
        start = points + normals * 0.01
        gap = _segments(start, camera.center_world, limbs)
        own = np.array([[_distance(p, limb) for limb in limbs] for p in points])
        hidden = (gap < radii * 0.85) & (own > radii + 0.03)
        at = camera.project(points)
        inside = (at[:, 0] > 2) & (at[:, 1] > 2) & (at[:, 0] < camera.width - 3) & (at[:, 1] < camera.height - 3)
        out[c] = facing & ~hidden.any(1) & inside
    return out


def _distance(point: FloatArray, limb: FloatArray) -> float:
    along = limb[1] - limb[0]
    share = np.clip((point - limb[0]) @ along / max(along @ along, 1e-9), 0, 1)
    return float(np.linalg.norm(point - limb[0] - share * along))


def _segments(starts: FloatArray, end: FloatArray, limbs: FloatArray) -> FloatArray:
    """(M, S) distances between the segments from `starts` to `end` and the limbs, by sampling."""
    share = np.linspace(0.01, 0.5, 40)
    samples = starts[:, None] + share[:, None] * (end - starts)[:, None]
    along = limbs[:, 1] - limbs[:, 0]
    length = np.maximum(np.sum(along**2, axis=1), 1e-9)
    off = samples[:, :, None] - limbs[None, None, :, 0]
    part = np.clip(np.einsum("mksi,si->mks", off, along) / length, 0, 1)
    return np.asarray(np.linalg.norm(off - part[..., None] * along, axis=-1).min(1))


def draw_markers(
    camera: Camera, points: FloatArray, lamps: FloatArray, faults: VideoFaults, rng: np.random.Generator
) -> ByteArray:
    """(H, W) grey image of one frame.

    Args:
        camera: the camera.
        points: (N, 3) metres, visible markers.
        lamps: (K, 3) metres.
        faults: of the image.
        rng: source of random numbers.
    """
    light = np.zeros((camera.height, camera.width), np.float32)
    at, far = camera.project(points), np.linalg.norm(points - camera.center_world, axis=-1)
    focal = camera.camera_matrix[0, 0]
    for (x, y), distance in zip(at, far, strict=True):
        _disc(light, x, y, focal * RADIUS_M / distance, rng.uniform(230, 420), faults)
    for x, y in camera.project(lamps):
        if np.isfinite(x):
            _disc(light, x, y, rng.uniform(5.8, 6.2), 400.0, faults)
    for _ in range(rng.poisson(faults.flickers)):
        x, y = rng.uniform(5, camera.width - 5), rng.uniform(5, camera.height - 5)
        _disc(light, x, y, rng.uniform(1, 4), rng.uniform(120, 400), faults)
    noise = rng.integers(0, len(_NOISE) - light.size)
    grain = _NOISE[noise : noise + light.size].reshape(light.shape)
    return np.clip(light + faults.dark + faults.noise * grain + 0.5, 0, 255).astype(np.uint8)


_NOISE = np.random.default_rng(3).standard_normal(1 << 22).astype(np.float32)


def _disc(light: Float32Array, x: float, y: float, radius: float, level: float, faults: VideoFaults) -> None:
    """Adds a disc with soft edge and its glow, where the picture has it."""
    reach = int(np.ceil(radius + 3.5 * faults.bloom_px))
    left, top = max(round(x) - reach, 0), max(round(y) - reach, 0)
    right, bottom = min(round(x) + reach + 1, light.shape[1]), min(round(y) + reach + 1, light.shape[0])
    if right <= left or bottom <= top:
        return
    columns, rows = np.arange(left, right) - x, np.arange(top, bottom)[:, None] - y
    away = np.sqrt(columns**2 + rows**2)
    disc = np.clip(radius + 0.5 - away, 0, 1)
    share = min(1.0, np.pi * radius**2 / (2 * np.pi * faults.bloom_px**2))
    glow = faults.bloom * share * np.exp(-0.5 * (away / faults.bloom_px) ** 2)
    light[top:bottom, left:right] += (level * (disc + glow)).astype(np.float32)
