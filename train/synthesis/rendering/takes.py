"""Whole takes of one synthetic person: a moving body in a rendered room, several cameras, with the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import PchipInterpolator

from muybridge.arrays import ByteArray, Float32Array, FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyBatch, BodyModel
from muybridge.train.synthesis.clothing.sample import Outfit
from muybridge.train.synthesis.rendering.renderer import SHADERS, Renderer
from muybridge.train.synthesis.rendering.scene_renderer import SceneRenderer
from muybridge.train.synthesis.rendering.view import View
from muybridge.train.synthesis.things.scene import Scene

STANCE = "right_heel"
# Sides of the windows for rendering are multiples of this, so that few render targets are needed.
WINDOW_STEP_PX = 160


@dataclass(frozen=True)
class Choreography:
    """A motion of one body.

    Attributes:
        rotvec: (T, bones, 3) `local-ref` rotations.
        phenotypes: (phenotypes,) of the body.
        fps: frames per second.
    """

    rotvec: FloatArray
    phenotypes: Float32Array
    fps: float


def choreograph(body: BodyModel, seconds: float, fps: float, hold: float = 0.75) -> Choreography:
    """A motion through sampled upright poses on the right leg, one every `hold` seconds, by monotone cubic
    interpolation; poses with self-penetration on the way are redrawn."""
    phenotypes = body.sample_phenotypes(1)
    labels = list(body.model.phenotype_labels)
    phenotypes[0, labels.index("age")] = 0.7
    times = np.arange(round(seconds * fps)) / fps
    keys = np.arange(0, seconds + hold, hold)
    chosen = [_standing_pose(body)]
    while len(chosen) < len(keys):
        pose = body.poses.sample(1, kinds=("stand", "balance", "kick", "reach")).rotvec[0]
        between = np.stack([chosen[-1] * (1 - t) + pose * t for t in np.linspace(0, 1, 6)[1:]])
        _, landmarks, height, joints = body.forward(between, np.repeat(phenotypes, 5, 0))
        right_knee, left_knee = landmarks[-1, 14], landmarks[-1, 13]
        on_right_leg = landmarks[-1, 22, 2] <= landmarks[-1, 21, 2] + 0.02 and right_knee[2] <= left_knee[2] + 0.1
        if on_right_leg and not body.penetrates(joints, height).any():
            chosen.append(pose)
    rotvec = PchipInterpolator(keys, np.stack(chosen))(times)
    return Choreography(rotvec, phenotypes[0], fps)


def _standing_pose(body: BodyModel) -> FloatArray:
    pose = body.poses.sample(1, kinds=("stand",)).rotvec[0]
    for bone in ("root", "head", "neck01", "neck02", "neck03"):
        pose[body.index(bone)] *= 0.3
    return np.asarray(pose)


def perform(body: BodyModel, motion: Choreography) -> BodyBatch:
    """The bodies of every frame, on the floor, with the heel of the stance leg at one point."""
    count = len(motion.rotvec)
    phenotypes = np.repeat(motion.phenotypes[None], count, 0)
    parts = []
    for k in range(0, count, 32):
        frames = slice(k, k + 32)
        kinds = np.zeros(len(motion.rotvec[frames]), np.intp)
        parts.append(body.pose(motion.rotvec[frames], phenotypes[frames], kinds))
    fields = ("vertices", "landmarks", "height", "gender", "kinds")
    batch = BodyBatch(*(np.concatenate([getattr(p, f) for p in parts]) for f in fields))
    heel = batch.landmarks[:, body.landmark(STANCE)]
    shift = np.concatenate([heel[:, :2] - heel[:1, :2], np.zeros((count, 1), np.float32)], 1)[:, None]
    return BodyBatch(batch.vertices - shift, batch.landmarks - shift, batch.height, batch.gender, batch.kinds)


class Room:
    """A box-shaped room with furniture along its walls, in the renderer's context."""

    def __init__(self, renderer: Renderer, seed: int, half_side: float = 4.5, height: float = 3.0) -> None:
        self.renderer = renderer
        ctx = renderer.ctx
        self.program: Any = ctx.program(
            vertex_shader=(SHADERS / "room.vert").read_text(), fragment_shader=(SHADERS / "room.frag").read_text()
        )
        rng = np.random.default_rng(seed)
        quads = self._walls(rng, half_side, height)
        for _ in range(14):
            quads += self._furniture(rng, half_side)
        vertices = np.concatenate(quads).astype("f4")
        self.array = ctx.vertex_array(
            self.program, [(ctx.buffer(vertices.tobytes()), "3f 3f 3f 1f", "position", "normal", "colour", "pattern")]
        )

    @staticmethod
    def _quad(corners: FloatArray, colour: FloatArray, pattern: float) -> FloatArray:
        """Two triangles (6, 10) of a quadrilateral (4, 3); the corners' order gives the normal."""
        normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
        normal /= np.linalg.norm(normal)
        row = [np.concatenate([c, normal, colour, [pattern]]) for c in corners]
        return np.stack([row[i] for i in (0, 1, 2, 0, 2, 3)])

    def _walls(self, rng: np.random.Generator, s: float, h: float) -> list[FloatArray]:
        floor, wall = rng.uniform(0.2, 0.4, 3) * 0.3 + 0.15, np.array([0.62, 0.6, 0.56])
        quads = [self._quad(np.array([[-s, -s, 0], [s, -s, 0], [s, s, 0], [-s, s, 0]]), floor, 1)]
        quads.append(self._quad(np.array([[-s, -s, h], [-s, s, h], [s, s, h], [s, -s, h]]), wall * 1.2, 0))
        ends = np.array([[-s, -s], [s, -s], [s, s], [-s, s]])
        for k in range(4):
            a, b = ends[k], ends[(k + 1) % 4]
            corners = np.array([[*b, 0], [*a, 0], [*a, h], [*b, h]])
            quads.append(self._quad(corners, wall * rng.uniform(0.8, 1.15), 2))
        return quads

    def _furniture(self, rng: np.random.Generator, s: float) -> list[FloatArray]:
        """A box against a wall: cupboards, tables, boards."""
        size = np.array([rng.uniform(0.3, 1.2), rng.uniform(0.1, 0.6), rng.uniform(0.3, 2.0)])
        low = np.array([rng.uniform(-s, s - size[0]), s - size[1], 0 if rng.random() < 0.7 else rng.uniform(0.8, 1.6)])
        colour = np.array(cv2.cvtColor(np.array([[[rng.uniform(0, 360), rng.beta(1, 3), rng.uniform(0.1, 0.8)]]],
                                                "f4"), cv2.COLOR_HSV2RGB)[0, 0], float)  # fmt: skip
        x, y, z = np.stack([low, low + size]).T
        faces = [
            [(x[0], y[0], z[0]), (x[1], y[0], z[0]), (x[1], y[0], z[1]), (x[0], y[0], z[1])],
            [(x[1], y[0], z[0]), (x[1], y[1], z[0]), (x[1], y[1], z[1]), (x[1], y[0], z[1])],
            [(x[0], y[1], z[0]), (x[0], y[0], z[0]), (x[0], y[0], z[1]), (x[0], y[1], z[1])],
            [(x[0], y[0], z[1]), (x[1], y[0], z[1]), (x[1], y[1], z[1]), (x[0], y[1], z[1])],
        ]
        turn = np.linalg.matrix_power(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), int(rng.integers(4)))
        return [self._quad(np.array(f) @ turn.T, colour, 0) for f in faces]

    def render(self, view: View, light: tuple[float, float, float]) -> ByteArray:
        """(H, W, 3) RGB of the empty room."""
        ctx = self.renderer.ctx
        target = ctx.framebuffer(
            [ctx.texture((view.width, view.height), 4)], ctx.depth_texture((view.width, view.height))
        )
        target.use()
        target.clear(0.5, 0.5, 0.5, 1, depth=1.0)
        ctx.enable(self.renderer.gl.DEPTH_TEST)
        ctx.disable(self.renderer.gl.CULL_FACE)
        self.program["clip_from_world"].write(view.clip_from_world.T.astype("f4").tobytes())
        self.program["light"].value = light
        self.renderer.noise[1].use(0)
        self.program["fractal3"].value = 0
        self.array.render()
        pixels = np.frombuffer(target.read(components=3, alignment=1), "u1").reshape(view.height, view.width, 3)
        return pixels[::-1].copy()


def person_layers(
    renderer: Renderer, view: View, vertices: Float32Array, landmarks: Float32Array, outfit: Outfit
) -> tuple[Float32Array, ByteArray]:
    """Colour (H, W, 4) and soft shadow (H, W) of a person (V, 3), rendered at twice the size for smooth edges."""
    double = View(
        view.cam_from_world, view.focal_px * 2, (view.principal_px[0] * 2 + 0.5, view.principal_px[1] * 2 + 0.5),
        view.width * 2, view.height * 2,
    )  # fmt: skip
    renderer.load(vertices)
    shot = renderer.render(double, outfit, landmarks)
    size = (view.width, view.height)
    rgba = cv2.resize(shot.rgba, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    shadow = cv2.GaussianBlur(cv2.resize(shot.shadow, size, interpolation=cv2.INTER_AREA), (0, 0), 3)
    return rgba, np.asarray(shadow, np.uint8)


def draw_frame(
    renderer: Renderer, background: ByteArray, view: View, batch: BodyBatch, outfit: Outfit, frame: int,
    rng: np.random.Generator,
) -> ByteArray:  # fmt: skip
    """(H, W, 3) RGB of one frame: the person, the shadow, noise."""
    rgba, shadow = person_layers(renderer, view, batch.vertices[frame], batch.landmarks[frame], outfit)
    alpha = rgba[..., 3:] / 255
    picture = background * (1 - 0.4 * shadow[..., None] / 255.0) * (1 - alpha) + rgba[..., :3]
    picture += rng.normal(0, 3.0, picture.shape)
    return picture.clip(0, 255).astype(np.uint8)


def draw_scene(
    renderer: SceneRenderer, background: Float32Array, view: View, scene: Scene, outfits: Sequence[Outfit]
) -> Float32Array:
    """(H, W, 3) RGB, 0 to 255: the people and things of a scene before a background, with their shadows on the
    floor."""
    light = np.array(outfits[0].light)
    points = np.concatenate([p.vertices for p in scene.people] + [t.vertices_world for t in scene.things])
    shadow = points - points[:, 2:] * (light / max(light[2], 0.15))
    px, depth_m = view.project(np.concatenate([points, shadow]).astype(float))
    limit, px = np.array([view.width, view.height]), px[depth_m > 0.3]
    low = np.floor(px.min(0) - 8).clip(0, limit).astype(int)
    high = np.ceil(px.max(0) + 8).clip(0, limit).astype(int)
    side = np.minimum(-(-(high - low) // WINDOW_STEP_PX) * WINDOW_STEP_PX, limit)
    low = np.minimum(low, limit - side)
    (x, y), (w, h) = low.tolist(), side.tolist()
    center = (view.principal_px[0] - x, view.principal_px[1] - y)
    renderer.load(scene)
    shot = renderer.render(View(view.cam_from_world, view.focal_px, center, w, h), outfits)
    rgba = shot.rgba.astype(np.float32)
    soft = cv2.GaussianBlur(shot.shadow, (0, 0), 3)
    picture = background.copy()
    part = picture[y : y + h, x : x + w]
    part *= (1 - 0.4 * soft[..., None].astype(np.float32) / 255) * (1 - rgba[..., 3:] / 255)
    part += rgba[..., :3]
    return picture
