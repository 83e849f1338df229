"""Whole takes of several synthetic people in one room, seen by cameras around it, with the truth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import ByteArray, Float32Array
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.clothing.sample import Outfit, sample_outfit
from muybridge.train.synthesis.motions.sampler import MotionClip, MotionSampler
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.takes import WINDOW_STEP_PX, person_layers
from muybridge.train.synthesis.rendering.view import View, look_at

# Least distance between the centres of people, metres, unless they came as a pair.
_LEAST_DISTANCE = 0.55
_TRIES = 40
_AT_ONCE = 32


@dataclass(frozen=True)
class Actor:
    """One person of a take.

    Attributes:
        vertices: (T, V, 3) metres, world.
        landmarks: (T, 23, 3) metres, world.
        outfit: clothes.
    """

    vertices: Float32Array
    landmarks: Float32Array
    outfit: Outfit


def cast(body: BodyModel, kinds: Sequence[str], seconds: float, fps: float, reach: float) -> list[Actor]:
    """People who perform `kinds` of motion (names of `MOTIONS`; `pair` stands for two people), kept apart.

    Args:
        body: the body model; its generator draws everybody.
        kinds: of motion.
        seconds: length of the take.
        fps: frames per second.
        reach: largest distance of the centres of their paths from the middle of the room, metres; more if necessary.

    Raises:
        ValueError: they collide in every placement.
    """
    actors: list[Actor] = []
    light = None
    for kind in kinds:
        phenotypes = body.sample_phenotypes(1)[0]
        sampler = MotionSampler(body.skeleton(phenotypes), body.rng)
        pair = kind == "pair"
        clips = sampler.sample_pair(seconds, fps) if pair else (sampler.sample(seconds, fps, kind),)
        skins = [_pose_clip(body, clip, phenotypes) for clip in clips]
        placed = _place_apart(body.rng, skins, [a.landmarks for a in actors], reach)
        gender = float(body.gender(phenotypes))
        for vertices, landmarks in placed:
            outfit = sample_outfit(body.rng, gender)
            light = outfit.light if light is None else light
            actors.append(Actor(vertices, landmarks, replace(outfit, light=light)))
    return actors


def _pose_clip(body: BodyModel, clip: MotionClip, phenotypes: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Vertices and landmarks of a clip, at its positions."""
    vertices, landmarks = [], []
    for k in range(0, len(clip.root), _AT_ONCE):
        part = slice(k, k + _AT_ONCE)
        shape = np.repeat(phenotypes[None], len(clip.root[part]), 0)
        skin, points, _, joints = body.forward(clip.rotvec[part], shape)
        shift = (clip.root[part] - joints[:, 0])[:, None].astype(np.float32)
        vertices.append(skin + shift)
        landmarks.append(points + shift)
    return np.concatenate(vertices), np.concatenate(landmarks)


def _place_apart(
    rng: np.random.Generator, skins: list[tuple[Float32Array, Float32Array]], others: list[Float32Array], reach: float
) -> list[tuple[Float32Array, Float32Array]]:
    """The people rotated and moved together to where they are near nobody else."""
    middle = np.concatenate([points for _, points in skins]).mean((0, 1)) * [1, 1, 0]
    for attempt in range(_TRIES):
        angle, heading = rng.uniform(-np.pi, np.pi, 2)
        radius = rng.uniform(0, reach * (1 + attempt / 10))
        place = np.array([np.cos(angle), np.sin(angle), 0]) * radius
        c, s = np.cos(heading), np.sin(heading)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        moved = [tuple(((a - middle) @ turn.T + place).astype(np.float32) for a in skin) for skin in skins]
        tracks = [points[..., :2].mean(1) for _, points in moved]
        if all(np.linalg.norm(t - o[..., :2].mean(1), axis=-1).min() > _LEAST_DISTANCE for t in tracks for o in others):
            return [(vertices, points) for vertices, points in moved]
    raise ValueError("these people collide: use fewer people or another seed")


def sample_rig(
    rng: np.random.Generator,
    count: int,
    size: tuple[int, int],
    distance: float,
    target_height: float = 0.95,
    span: float = 3.0,
) -> CameraGroup:
    """`count` cameras of `size` (width, height) px on tripods around the middle of the room, about `distance` metres
    from it, none exactly level, all with slightly different lenses; about `span` metres of the middle of the room fit
    into the shorter side."""
    width, height = size
    cameras = []
    start = rng.uniform(0, 2 * np.pi)
    for k in range(count):
        angle = start + 2 * np.pi * (k + rng.uniform(-0.2, 0.2)) / count
        away = distance * rng.uniform(0.88, 1.08)
        center = np.array([away * np.cos(angle), away * np.sin(angle), rng.uniform(0.9, 2.7)])
        target = np.array([*rng.normal(0, 0.15, 2), target_height])
        focal = float(min(size) * away / span * rng.uniform(0.9, 1.1))
        params = (focal, focal, (width - 1) / 2, (height - 1) / 2)
        pose = look_at(center, target, np.radians(rng.normal(0, 4)))
        cameras.append(Camera(f"cam{k + 1}", "PINHOLE", width, height, params, pose))
    return CameraGroup(tuple(cameras))


def view_of(camera: Camera) -> View:
    """The renderer's view of a pinhole camera."""
    focal, _, x, y = camera.params
    return View(camera.cam_from_world, float(focal), (float(x), float(y)), camera.width, camera.height)


def draw_people(
    renderer: Renderer, background: ByteArray, view: View, actors: Sequence[Actor], frame: int,
    rng: np.random.Generator, noise: float = 3.0,
) -> ByteArray:  # fmt: skip
    """(H, W, 3) RGB of one frame: everybody, the farthest first, shadows under all of them, noise."""
    eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
    order = sorted(actors, key=lambda a: -float(np.linalg.norm(a.landmarks[frame].mean(0) - eye)))
    found = [layer for a in order if (layer := _layer(renderer, view, a, frame)) is not None]
    picture = background.astype(np.float32)
    for (x, y), _, shadow in found:
        picture[y : y + shadow.shape[0], x : x + shadow.shape[1]] *= 1 - 0.4 * shadow[..., None] / 255
    for (x, y), rgba, _ in found:
        part = picture[y : y + rgba.shape[0], x : x + rgba.shape[1]]
        part *= 1 - rgba[..., 3:] / 255
        part += rgba[..., :3]
    picture += rng.normal(0, noise, picture.shape)
    return picture.clip(0, 255).astype(np.uint8)


def _layer(
    renderer: Renderer, view: View, actor: Actor, frame: int
) -> tuple[tuple[int, int], Float32Array, Float32Array] | None:
    """Corner (x, y) in the image, colour (h, w, 4) and shadow (h, w) of one person, in a window around them; None if
    out of sight."""
    body = actor.vertices[frame]
    light = np.array(actor.outfit.light)
    on_floor = body - body[:, 2:] * (light / max(light[2], 0.15))
    px, depth = view.project(np.concatenate([body, on_floor]).astype(float))
    if depth[: len(body)].min() < 0.3:
        return None  # the camera is inside them
    px = px[depth > 0.3]
    limit = np.array([view.width, view.height])
    low = np.floor(px.min(0) - 8).clip(0, limit).astype(int)
    high = np.ceil(px.max(0) + 8).clip(0, limit).astype(int)
    if (high - low).min() < 2:
        return None
    side = np.minimum(-(-(high - low) // WINDOW_STEP_PX) * WINDOW_STEP_PX, limit)
    low = np.minimum(low, limit - side)
    x, y = np.array(view.principal_px) - low
    window = View(view.cam_from_world, view.focal_px, (x, y), int(side[0]), int(side[1]))
    rgba, shadow = person_layers(renderer, window, body, actor.landmarks[frame], actor.outfit)
    return (int(low[0]), int(low[1])), rgba, shadow.astype(np.float32)
