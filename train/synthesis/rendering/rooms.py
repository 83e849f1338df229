"""Rendered rooms for backgrounds: laboratories, gyms, offices and halls with their contents, seeded.

A room is a box with windows, doors, lamps, furniture and equipment. Cameras are placed as in multi-camera recordings,
and look at a place where a person would be, framed like the crops in use.
"""

import colorsys
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray
from muybridge.train.synthesis.rendering.renderer import SHADERS, Renderer
from muybridge.train.synthesis.rendering.view import View, look_at

PLAIN, TILES, PANELS, GLOW, CURTAIN, BLIND, PICTURE, WOOD, ROUGH = range(9)
VIEWS_EACH = 8  # images per room


class RoomBuilder:
    """Collects the triangles of one room: position, normal, colour, position on the quad in metres, pattern.

    Args:
        rng: source of random numbers.
        half: (2,) half the sides of the floor, metres.
        height: metres.
    """

    def __init__(self, rng: np.random.Generator, half: FloatArray, height: float) -> None:
        self.rng, self.half, self.height = rng, half, height
        self.rows: list[FloatArray] = []

    def colour(self, low: float = 0.05, high: float = 0.9, strong: float = 0.08) -> FloatArray:
        """A linear colour typical of indoor objects: mostly grey, brown and black."""
        saturation = self.rng.uniform(0.4, 0.95) if self.rng.random() < strong else self.rng.beta(1, 7)
        value = self.rng.uniform(low, high) ** 1.6
        return np.array(colorsys.hsv_to_rgb(self.rng.random(), saturation, value))

    def quad(self, corners: FloatArray, colour: FloatArray, kind: int = PLAIN) -> None:
        """Add a quadrilateral (4, 3)."""
        across, up = corners[1] - corners[0], corners[3] - corners[0]
        normal = np.cross(across, up)
        normal /= np.linalg.norm(normal) + 1e-9
        w, h = np.linalg.norm(across), np.linalg.norm(up)
        uv = np.array([[0, 0], [w, 0], [w, h], [0, h]])
        pattern = kind + self.rng.uniform(0.02, 0.98)
        table = np.concatenate([corners, np.tile(normal, (4, 1)), np.tile(colour, (4, 1)), uv,
                                np.full((4, 1), pattern)], 1)  # fmt: skip
        self.rows.append(table[[0, 1, 2, 0, 2, 3]])

    def box(
        self, center: FloatArray, size: FloatArray, colour: FloatArray, turn: float = 0.0, kind: int = PLAIN
    ) -> None:
        """Add an upright box, rotated about the vertical by `turn` radians."""
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        for axis in range(3):
            for sign in (-1.0, 1.0):
                u, v = (axis + 1) % 3, (axis + 2) % 3
                corners = np.zeros((4, 3))
                corners[:, axis] = sign
                corners[:, u] = np.array([-1, 1, 1, -1]) * sign
                corners[:, v] = [-1, -1, 1, 1]
                self.quad(corners * size / 2 @ rotation.T + center, colour, kind)

    def rod(self, start: FloatArray, end: FloatArray, radius: float, colour: FloatArray, sides: int = 6) -> None:
        """Add a prism between two points: legs, poles, cables, lamps."""
        along = end - start
        side = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 * np.linalg.norm(along) else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side) + 1e-9
        other = np.cross(along, side)
        other /= np.linalg.norm(other) + 1e-9
        angle = np.linspace(0, 2 * np.pi, sides + 1)
        ring = radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other)
        for a, b in zip(ring[:-1], ring[1:], strict=True):
            self.quad(np.array([start + a, start + b, end + b, end + a]), colour)

    # -- contents of a room ---------------------------------------------------------------------------------

    def shell(self) -> None:
        """Add floor, ceiling, four walls and what hangs on them."""
        rng, (x, y), h = self.rng, self.half, self.height
        wall = self.colour(0.3, 0.95, 0.08)
        floor_kind = int(rng.choice([TILES, WOOD, ROUGH, PLAIN], p=[0.35, 0.25, 0.2, 0.2]))
        self.quad(np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]), self.colour(0.05, 0.8), floor_kind)
        ceiling = TILES if rng.random() < 0.5 else PLAIN
        self.quad(np.array([[-x, -y, h], [-x, y, h], [x, y, h], [x, -y, h]]), self.colour(0.5, 1.0, 0.02), ceiling)
        for a, b in self.walls():
            kind = int(rng.choice([PLAIN, PANELS, ROUGH, CURTAIN, WOOD], p=[0.6, 0.12, 0.12, 0.1, 0.06]))
            own = wall if rng.random() < 0.75 else self.colour(0.1, 0.9)
            self.quad(np.array([[*a, 0], [*b, 0], [*b, h], [*a, h]]), own * rng.uniform(0.8, 1.15), kind)
            for _ in range(int(rng.integers(0, 7))):
                self.add_to_wall(a, b)
        for _ in range(int(rng.integers(0, 7))):
            size = np.array([rng.uniform(0.15, 1.6), rng.uniform(0.1, 0.6), 0.05])
            at = np.array([rng.uniform(-x, x), rng.uniform(-y, y), h - 0.04])
            self.box(at, size, np.full(3, rng.uniform(0.6, 1.4)), rng.choice([0, np.pi / 2]), GLOW)

    def walls(self) -> list[tuple[FloatArray, FloatArray]]:
        """Ends (2,) of the four walls, ordered so that their quads face inwards."""
        x, y = self.half
        ends = np.array([[-x, -y], [-x, y], [x, y], [x, -y]])
        return [(ends[k], ends[(k + 1) % 4]) for k in range(4)]

    def add_to_wall(self, a: FloatArray, b: FloatArray) -> None:
        """Add a window, door, board, poster, screen or shelf to the wall from `a` to `b`."""
        rng = self.rng
        length = float(np.linalg.norm(b - a))
        along = np.array([*(b - a) / length, 0.0])
        inward = np.array([along[1], -along[0], 0.0])
        kind = rng.choice(["window", "blind", "door", "picture", "board", "shelf"])
        w, h = rng.uniform(0.5, 2.2), rng.uniform(0.5, 1.6)
        low = rng.uniform(0.7, 1.4)
        if kind == "door":
            w, h, low = rng.uniform(0.8, 1.7), 2.05, 0.0
        start = np.array([*a, 0]) + along * rng.uniform(0, max(length - w, 0.1)) + inward * 0.02
        start[2] = low
        up = np.array([0, 0, h])

        def panel(lift: float, colour: FloatArray, pattern: int, shrink: float = 0.0) -> None:
            o = start + inward * lift + along * shrink + np.array([0, 0, shrink])
            wide, tall = along * (w - 2 * shrink), up - np.array([0, 0, 2 * shrink])
            self.quad(np.array([o, o + wide, o + wide + tall, o + tall]), colour, pattern)

        panel(0.0, self.colour(0.05, 0.95), PLAIN)
        if kind in ("window", "blind"):
            panel(0.01, np.full(3, rng.uniform(0.3, 1.2)) * rng.uniform(0.9, 1.1, 3),
                  GLOW if kind == "window" else BLIND, 0.05)  # fmt: skip
            for t in np.linspace(0, 1, int(rng.integers(2, 5)))[1:-1]:
                foot = start + along * w * t + inward * 0.03
                self.rod(foot, foot + up, 0.02, self.colour())
        elif kind == "shelf":
            for k in range(int(rng.integers(2, 9))):
                size = np.array([rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.4)])
                rise = np.array([0, 0, size[2] / 2 + 0.3 * (k % 3)])
                center = start + along * rng.uniform(0, w) + inward * 0.18 + rise
                self.box(center, size, self.colour(strong=0.3), float(np.arctan2(along[1], along[0])))
        else:
            panel(0.01, self.colour(0.1, 1.0, 0.2), WOOD if kind == "door" else PICTURE, 0.04)

    def place(self, margin: float = 1.2) -> FloatArray:
        """A position on the floor, mostly along the walls: people move in the middle."""
        x, y = self.half
        while True:
            at = self.rng.uniform([-x + 0.3, -y + 0.3], [x - 0.3, y - 0.3])
            if np.linalg.norm(at) > margin:
                return np.array([*at, 0.0])

    def item(self) -> None:
        """Add a table, chair, cupboard, tripod, treadmill, mat, rack, heap of boxes or cable."""
        rng = self.rng
        makers = (self.table, self.chair, self.cupboard, self.tripod, self.treadmill, self.mat, self.rack, self.boxes,
                  self.cable)  # fmt: skip
        makers[rng.choice(len(makers), p=[0.16, 0.16, 0.14, 0.14, 0.06, 0.08, 0.08, 0.1, 0.08])](self.place())

    def table(self, at: FloatArray) -> None:
        """Add a table with objects on it."""
        rng, turn, colour = self.rng, self.rng.uniform(0, np.pi), self.colour()
        size = np.array([rng.uniform(0.6, 2.0), rng.uniform(0.5, 0.9), 0.04])
        top = rng.uniform(0.45, 1.05)
        self.box(at + [0, 0, top], size, colour, turn, WOOD if rng.random() < 0.4 else PLAIN)
        c, s = np.cos(turn), np.sin(turn)
        for dx, dy in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            local = np.array([dx * size[0] * 0.45, dy * size[1] * 0.45])
            foot = at + [c * local[0] - s * local[1], s * local[0] + c * local[1], 0]
            self.rod(foot, foot + [0, 0, top], 0.025, colour * 0.6)
        for _ in range(int(rng.integers(0, 6))):
            part = rng.uniform([0.03, 0.03, 0.02], [0.4, 0.3, 0.4])
            local = rng.uniform(-0.4, 0.4, 2) * size[:2]
            center = at + [c * local[0] - s * local[1], s * local[0] + c * local[1], top + part[2] / 2 + 0.02]
            self.box(center, part, self.colour(strong=0.3), rng.uniform(0, np.pi), int(rng.choice([PLAIN, PICTURE])))

    def chair(self, at: FloatArray) -> None:
        """Add seat, back and legs."""
        rng, turn, colour = self.rng, self.rng.uniform(0, 2 * np.pi), self.colour()
        seat, back = rng.uniform(0.4, 0.5), rng.uniform(0.3, 0.6)
        behind = np.array([np.cos(turn + np.pi / 2), np.sin(turn + np.pi / 2), 0]) * 0.2
        self.box(at + [0, 0, seat], np.array([0.42, 0.42, 0.05]), colour, turn)
        self.box(at + behind + [0, 0, seat + back / 2 + 0.1], np.array([0.42, 0.04, back]), colour, turn)
        for angle in turn + np.pi / 4 + np.arange(4) * np.pi / 2:
            foot = at + np.array([np.cos(angle), np.sin(angle), 0]) * 0.26
            self.rod(foot, foot * [1, 1, 0] + [0, 0, seat], 0.015, colour * 0.3)

    def cupboard(self, at: FloatArray) -> None:
        """Add a box of chest height or taller."""
        size = self.rng.uniform([0.4, 0.3, 0.6], [1.4, 0.7, 2.2])
        self.box(at + [0, 0, size[2] / 2], size, self.colour(), self.rng.uniform(0, np.pi),
                 int(self.rng.choice([PLAIN, WOOD, PANELS])))  # fmt: skip

    def tripod(self, at: FloatArray) -> None:
        """Add a stand with a camera, a lamp or a reflector, taller than a table."""
        rng, colour = self.rng, self.colour(0.01, 0.5)
        top = at + [0, 0, rng.uniform(1.0, 2.2)]
        knee = at + [0, 0, rng.uniform(0.5, 0.9)]
        for angle in rng.uniform(0, 2) + np.arange(3) * 2 * np.pi / 3:
            self.rod(at + np.array([np.cos(angle), np.sin(angle), 0]) * rng.uniform(0.3, 0.55), knee, 0.016, colour)
        self.rod(knee, top, 0.014, colour)
        self.box(top, rng.uniform(0.08, 0.5, 3), self.colour(), rng.uniform(0, np.pi),
                 GLOW if rng.random() < 0.2 else PLAIN)  # fmt: skip

    def treadmill(self, at: FloatArray) -> None:
        """Add a low plate with rails."""
        rng, turn, colour = self.rng, self.rng.uniform(0, np.pi), self.colour(0.01, 0.4)
        length, width = rng.uniform(1.4, 2.4), rng.uniform(0.6, 1.2)
        at = at * rng.uniform(0, 1)  # it may be where the person is
        self.box(at + [0, 0, 0.08], np.array([length, width, 0.16]), colour, turn)
        c, s = np.cos(turn), np.sin(turn)
        for side in (-1, 1):
            post = at + np.array([c * length / 2 - s * side * width / 2, s * length / 2 + c * side * width / 2, 0.16])
            self.rod(post, post + [0, 0, 1.0], 0.025, self.colour())
            self.rod(post + [0, 0, 1.0], post + np.array([-c * 0.6, -s * 0.6, 1.0]), 0.025, self.colour())

    def mat(self, at: FloatArray) -> None:
        """Add a mat, force plate or coloured field anywhere on the floor."""
        rng = self.rng
        size = np.array([rng.uniform(0.4, 3.0), rng.uniform(0.4, 2.0), rng.uniform(0.005, 0.3)])
        self.box(at * rng.uniform(0, 1) + [0, 0, size[2] / 2], size, self.colour(strong=0.5), rng.uniform(0, np.pi),
                 int(rng.choice([PLAIN, ROUGH, TILES])))  # fmt: skip

    def rack(self, at: FloatArray) -> None:
        """Add bars: wall bars, ladders, clothes racks, trusses."""
        rng, colour = self.rng, self.colour()
        turn, width, tall = rng.uniform(0, np.pi), rng.uniform(0.5, 1.5), rng.uniform(0.9, 2.6)
        across = np.array([np.cos(turn), np.sin(turn), 0]) * width
        radius = rng.uniform(0.01, 0.035)
        for foot in (at, at + across):
            self.rod(foot, foot + [0, 0, tall], radius, colour)
        for z in np.linspace(0.2, tall, int(rng.integers(1, 12))):
            self.rod(at + [0, 0, z], at + across + [0, 0, z], radius * 0.8, colour)

    def boxes(self, at: FloatArray) -> None:
        """Add a heap of boxes and bags."""
        z = 0.0
        for _ in range(int(self.rng.integers(1, 5))):
            size = self.rng.uniform(0.12, 0.6, 3)
            shift = np.array([*self.rng.normal(0, 0.08, 2), z + size[2] / 2])
            self.box(at + shift, size, self.colour(), self.rng.uniform(0, np.pi), int(self.rng.choice([PLAIN, ROUGH])))
            z += size[2]

    def cable(self, at: FloatArray) -> None:
        """Add a cable on the floor."""
        colour, points = self.colour(0.01, 0.6, 0.3), [at + [0, 0, 0.01]]
        heading = self.rng.uniform(0, 2 * np.pi)
        for _ in range(int(self.rng.integers(3, 10))):
            heading += self.rng.normal(0, 0.6)
            points.append(points[-1] + 0.35 * np.array([np.cos(heading), np.sin(heading), 0]))
        for a, b in zip(points[:-1], points[1:], strict=True):
            self.rod(a, b, 0.012, colour, 4)


class RoomPainter:
    """Renders rooms in the context of a renderer."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.program: Any = renderer.ctx.program(
            vertex_shader=(SHADERS / "lab.vert").read_text(), fragment_shader=(SHADERS / "lab.frag").read_text()
        )
        self.targets: dict[tuple[int, int], object] = {}

    def build(self, rng: np.random.Generator) -> tuple[object, RoomBuilder]:
        """A vertex array of a random room, and its builder; sets lights and colours."""
        half = rng.uniform(2.2, 8.0, 2)
        builder = RoomBuilder(rng, half, float(rng.uniform(2.4, 5.0)))
        builder.shell()
        for _ in range(int(rng.integers(2, 26))):
            builder.item()
        ctx = self.renderer.ctx
        buffer = ctx.buffer(np.concatenate(builder.rows).astype("f4").tobytes())
        content = [(buffer, "3f 3f 3f 2f 1f", "position", "normal", "colour", "uv", "pattern")]
        array = ctx.vertex_array(self.program, content)
        light = rng.normal(0, 1, 3) + [0, 0, 1.5]
        lamps = np.concatenate([rng.uniform(-1, 1, (3, 2)) * half, np.full((3, 1), builder.height - 0.3)], 1)
        tint = 1 + rng.normal(0, 0.05, (3, 3))
        values = {
            "light": light / np.linalg.norm(light), "ambient": rng.uniform(0.25, 0.85) * tint[0], "lamp_at": lamps,
            "lamp_colour": rng.uniform(0.2, 2.2, (3, 1)) * tint, "room": np.array([*half, builder.height]),
        }  # fmt: skip
        for name, value in values.items():
            self.program[name].write(np.asarray(value, "f4").tobytes())
        self.program["joint"].value = float(rng.choice([0.15, 0.3, 0.6, 1.0]))
        return array, builder

    def picture(self, array: object, view: View) -> ByteArray:
        """(H, W, 3) RGB of the room in `view`, supersampled twice."""
        ctx, size = self.renderer.ctx, (view.width * 2, view.height * 2)
        if size not in self.targets:
            self.targets[size] = ctx.framebuffer([ctx.texture(size, 4)], ctx.depth_texture(size))
        target = self.targets[size]
        target.use()  # type: ignore[attr-defined]
        target.clear(0.3, 0.3, 0.3, 1, depth=1.0)  # type: ignore[attr-defined]
        ctx.enable(self.renderer.gl.DEPTH_TEST)
        ctx.disable(self.renderer.gl.CULL_FACE)
        # The same clip matrix serves any resolution.
        self.program["clip_from_world"].write(view.clip_from_world.T.astype("f4").tobytes())
        self.renderer.noise[1].use(0)
        self.program["fractal3"].value = 0
        array.render()  # type: ignore[attr-defined]
        pixels = np.frombuffer(target.read(components=3, alignment=1), "u1").reshape(size[1], size[0], 3)[::-1]  # type: ignore[attr-defined]
        return np.asarray(cv2.resize(pixels, (view.width, view.height), interpolation=cv2.INTER_AREA), np.uint8)


def room_view(rng: np.random.Generator, builder: RoomBuilder, size: int) -> View:
    """A camera in the room that frames a person standing near its middle, as a crop would."""
    x, y = builder.half
    while True:
        eye = np.array([*rng.uniform([-x + 0.1, -y + 0.1], [x - 0.1, y - 0.1]), 0.0])
        eye[2] = rng.uniform(0.3, min(builder.height - 0.1, 3.2))
        target = np.array([*rng.normal(0, 0.6, 2), rng.uniform(0.6, 1.1)])
        distance = float(np.linalg.norm(target - eye))
        if distance > 1.5:
            break
    span = rng.uniform(1.2, 3.4)  # metres that the image shows at the person's distance
    middle, pose = (size - 1) / 2, look_at(eye, target, np.radians(rng.normal(0, 3)))
    return View(pose, size * distance / span, (middle, middle), size, size)


def make_room_pictures(renderer: Renderer, count: int, size: int, seed: int, first: int = 0) -> ByteArray:
    """Images of random rooms, `VIEWS_EACH` views per room.

    Args:
        renderer: gives the context.
        count: of the images.
        size: of their sides, px.
        seed: random seed.
        first: number of the first image; a room has to begin with it.

    Returns:
        (count, 3, size, size) uint8.
    """
    painter = RoomPainter(renderer)
    out = np.empty((count, 3, size, size), np.uint8)
    for start in range(0, count, VIEWS_EACH):
        rng = np.random.default_rng([seed, first + start])
        array, builder = painter.build(rng)
        for i in range(start, min(start + VIEWS_EACH, count)):
            picture = painter.picture(array, room_view(rng, builder, size)).astype(np.float32)
            if rng.random() < 0.5:
                picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 2.5)), np.float32)
            picture *= np.exp(rng.normal(0, 0.2))
            out[i] = picture.clip(0, 255).astype(np.uint8).transpose(2, 0, 1)
        array.release()  # type: ignore[attr-defined]
    return out
