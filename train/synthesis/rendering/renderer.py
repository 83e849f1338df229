"""Rendering of synthetic people with moderngl on EGL (llvmpipe where there is no GPU).

A render shows a person alone: colour with alpha, and the person's shadow on the floor. Backgrounds, occluders and
camera faults are added later (`muybridge.train.images`), so that one render serves many images.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.bodies.surface_markers import marker_normals, virtual_markers
from muybridge.train.synthesis.clothing import fabrics
from muybridge.train.synthesis.clothing.sample import Outfit
from muybridge.train.synthesis.clothing.shells import Shells
from muybridge.train.synthesis.rendering.labels import (
    Render,
    Shape,
    antialias,
    expose,
    landmark_labels,
    marker_labels,
    read_depth,
    read_pixels,
)
from muybridge.train.synthesis.rendering.view import View, look_at

SHADERS = pathlib.Path(__file__).parent / "shaders"
SHADOW_MAPS = (384, 224)  # pixels: for the main light, and for the sky
PARTS = ("body", "trousers", "shirt", "shoes", "skirt", "long_hair", "hair", "hat")
DOT = 0.007  # metres, radius of a reflective dot
# Units of the textures by their names in the shaders.
TEXTURES = {"shadow_map": 0, "white3": 1, "fractal3": 2, "patterns": 3, "prints": 4, "folds": 5, "sky_map": 6}


class Program:
    """A shader program and its uniforms by name."""

    def __init__(self, ctx: object, vertex: str, fragment: str) -> None:
        self.program = ctx.program(vertex_shader=vertex, fragment_shader=fragment)  # type: ignore[attr-defined]
        members = {k: self.program[k] for k in self.program}
        self._uniforms = {k: m for k, m in members.items() if hasattr(m, "value")}

    def set(self, values: dict[str, object]) -> None:
        """Set those of `values` that the program has; matrices are (4, 4)."""
        for key, uniform in self._uniforms.items():
            if key in values:
                value = values[key]
                if isinstance(value, np.ndarray):
                    uniform.write(value.T.astype("f4").tobytes())
                else:
                    uniform.value = value


@dataclass(frozen=True, eq=False)
class Lighting:
    """Projections of the two lamps, the main light and the sky, and of shadows.

    Attributes:
        lamps: clip_from_world (4, 4) of the main light and of the sky.
        shear: (4, 4) moves every point along the main light until z = 0: a shadow on the floor.
    """

    lamps: tuple[FloatArray, FloatArray]
    shear: FloatArray

    @classmethod
    def around(cls, center: FloatArray, radius: float, outfit: Outfit) -> "Lighting":
        """The lamps of `outfit` for everything within `radius` metres of `center` (3,)."""
        shear, light = np.eye(4), outfit.light
        shear[0, 2], shear[1, 2], shear[2, 2] = -light[0] / max(light[2], 0.15), -light[1] / max(light[2], 0.15), 0.0
        return cls((_lamp(light, center, radius), _lamp(outfit.sky, center, radius)), shear)

    def uniforms(self, view: View) -> dict[str, object]:
        """Those of the shaders of people and things that depend on the view and the lamps."""
        return {
            "clip_from_world": view.clip_from_world, "light_clip_from_world": self.lamps[0],
            "sky_clip_from_world": self.lamps[1],
            "eye_world": tuple(-view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]),
        } | TEXTURES  # fmt: skip


def _lamp(light: tuple[float, float, float], center: FloatArray, radius: float) -> FloatArray:
    pose = np.vstack([look_at(center + np.array(light) * radius, center), [0, 0, 0, 1]])
    scale = np.diag([1 / (radius * 1.05), 1 / (radius * 1.05), 1 / (radius * 2), 1.0])
    scale[2, 3] = -0.5
    return np.asarray(scale @ pose)


class Renderer:
    """An OpenGL context with the body's buffers; one per process.

    Args:
        body: the body model.

    Raises:
        MissingExtraError: there is no OpenGL.
    """

    def __init__(self, body: BodyModel) -> None:
        import moderngl

        self.gl = moderngl
        try:
            self.ctx = moderngl.create_context(standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1")  # type: ignore[arg-type]
        except Exception as error:
            from muybridge.errors import MissingExtraError

            raise MissingExtraError(
                f"no OpenGL context through EGL ({error}): install libegl1 libgl1 libgles2 libgl1-mesa-dri "
                "libegl-mesa0 (Debian's names)"
            ) from error
        self.body = body
        self._programs()
        self._buffers(body)
        self._targets: dict[tuple[int, int], tuple[object, object, object]] = {}

    @property
    def device(self) -> str:
        """Name of the rendering device; llvmpipe is the CPU."""
        return str(self.ctx.info["GL_RENDERER"])

    def _programs(self) -> None:
        common = (SHADERS / "common.glsl").read_text()
        vertex = (SHADERS / "person.vert").read_text()
        self.programs: dict[str, list[Program]] = {}
        # One program per part: on a CPU a shader pays for every branch in its source.
        for name, projection in (("person", "clip"), ("depth", "light_clip"), ("mask", "clip")):
            fragment = (SHADERS / f"{name}.frag").read_text()
            self.programs[name] = [
                Program(self.ctx, *(
                    common.replace("PART_NUMBER", str(part)) + stage
                    for stage in (vertex.replace("PROJECTION", projection + "_from_world"), fragment)
                )) for part in range(len(PARTS) + 1)
            ]  # fmt: skip
        self.dots = Program(self.ctx, (SHADERS / "dots.vert").read_text(), (SHADERS / "dots.frag").read_text())
        self._noise()

    def _noise(self) -> None:
        rng = np.random.default_rng(1)
        white = rng.random((32, 32, 32)).astype("f4")

        def grow(a: Float32Array, k: int) -> Float32Array:
            from scipy.ndimage import zoom

            return np.asarray(zoom(a, k, order=1, mode="grid-wrap", grid_mode=True), np.float32)

        fractal = 0.5 * grow(white[:16, :16, :16], 4) + 0.25 * grow(white, 2) + 0.25 * rng.random((64, 64, 64))
        self.noise = [
            self.ctx.texture3d((n,) * 3, 1, (a.clip(0, 1) * 255).astype("u1").tobytes())
            for n, a in ((32, white), (64, fractal))
        ]
        self.cloth = []
        for layers in (fabrics.make_patterns(), fabrics.make_prints(), fabrics.make_folds()):
            n = layers.shape[1]
            texture = self.ctx.texture_array((n, n, len(layers)), 4, layers.tobytes())
            texture.build_mipmaps()
            texture.filter = (self.gl.LINEAR_MIPMAP_LINEAR, self.gl.LINEAR)
            self.cloth.append(texture)

    def _buffers(self, body: BodyModel) -> None:
        self._shells = Shells(body)
        shells = self._shells
        self.dynamic = self.ctx.buffer(reserve=shells.count * 36, dynamic=True)
        self.dot_buffer = self.ctx.buffer(reserve=256 * 12, dynamic=True)
        self.static = self.ctx.buffer(shells.static.tobytes())
        indices = [self.ctx.buffer(f.astype("i4").tobytes()) for f in shells.parts]
        self.arrays: dict[str, list[object]] = {}
        coarse = self.ctx.buffer(shells.coarse_body.astype("i4").tobytes())
        for name, programs in self.programs.items():
            self.arrays[name] = []
            for part, index in enumerate(indices if name == "person" else [coarse, *indices[1:]]):
                program = programs[min(part, len(PARTS))].program
                content = [
                    self._attributes(program, self.dynamic, (("position", 12), ("normal", 12), ("slack", 12))),
                    self._attributes(program, self.static, (("rest", 12), ("traits", 16))),
                ]
                self.arrays[name].append(self.ctx.vertex_array(program, [c for c in content if len(c) > 2], index))
        self.dot_array = self.ctx.vertex_array(self.dots.program, [(self.dot_buffer, "3f", "position")])
        self.shadow_textures = [self.ctx.depth_texture((n, n)) for n in SHADOW_MAPS]
        for shadow in self.shadow_textures:
            shadow.compare_func = ""
            shadow.repeat_x = shadow.repeat_y = False
        self.shadow_targets = [self.ctx.framebuffer([], t) for t in self.shadow_textures]

    @staticmethod
    def _attributes(program: object, buffer: object, fields: tuple[tuple[str, int], ...]) -> tuple[object, ...]:
        """A vertex array's content entry; attributes that the compiler dropped become padding."""
        used = [n for n, _ in fields if n in program]  # type: ignore[operator]
        layout = " ".join(f"{size // 4}f" if n in used else f"{size}x" for n, size in fields)
        return (buffer, layout, *used)

    def load(self, vertices: Float32Array) -> None:
        """Use `vertices` (V, 3) as the person for the next renders."""
        self.use(self.shape(vertices))

    def shape(self, vertices: Float32Array) -> Shape:
        """What the renderer needs of a posed body, to be used repeatedly."""
        table, normals = self._shells.shape(vertices)
        markers = virtual_markers(vertices[None])[0]
        return Shape(vertices, table, normals, markers, marker_normals(normals[None, : len(vertices)])[0])

    def use(self, shape: Shape) -> None:
        """Draw `shape` from now on."""
        self.loaded = shape
        self.dynamic.write(shape.table.tobytes())

    def dress(self, outfit: Outfit) -> None:
        """Write the accessories and dots of `outfit` at their positions on the loaded person."""
        vertices = self.loaded.vertices
        table = self._shells.accessories(outfit.accessories, vertices)
        if len(table):
            self.dynamic.write(table.tobytes(), offset=self._shells.first * 36)
        count, seed = outfit.dots
        if count:
            chosen = np.random.default_rng(seed).choice(self._shells.dot_places, count, replace=False)
            at = vertices[chosen] + self.loaded.normals[chosen] * (0.6 * DOT + 0.005)
            self.dot_buffer.write(at.astype("f4").tobytes())

    def draw(self, name: str, outfit: Outfit, values: dict[str, object]) -> None:
        """Draw the loaded and dressed person into the current target with one of `programs`."""
        for part, array in enumerate(self.arrays[name]):
            if 0 < part < len(PARTS) and PARTS[part] not in outfit.parts:
                continue
            if part >= len(PARTS) + len(outfit.accessories):
                break
            if part == 0:
                self.ctx.enable(self.gl.CULL_FACE)
            else:
                self.ctx.disable(self.gl.CULL_FACE)
            program = self.programs[name][min(part, len(PARTS))]
            if part <= len(PARTS):
                program.set(values)
            if part >= len(PARTS):
                item = outfit.accessories[part - len(PARTS)]
                program.set({"item_colour": item.colour, "item_hair": int(item.hair)})
            array.render()  # type: ignore[attr-defined]

    def draw_person(self, outfit: Outfit, values: dict[str, object], view: View) -> None:
        """Draw the colours of the loaded and dressed person."""
        self.draw("person", outfit, values)
        if outfit.dots[0]:
            lamps = np.mean(outfit.values["light_colour"]) + np.mean(outfit.values["ambient_up"])
            reach = 2 * DOT * view.focal_px
            self.dots.set({"clip_from_world": view.clip_from_world, "reach_px": reach, "light": float(lamps)})
            self.ctx.enable(self.gl.PROGRAM_POINT_SIZE)
            self.dot_array.render(self.gl.POINTS, vertices=outfit.dots[0])

    def render(self, view: View, outfit: Outfit, landmarks_world: NDArray[np.floating]) -> Render:
        """Render the loaded person in `outfit`; the floor is at z = 0."""
        body = self.loaded.vertices[:BODY_VERTICES]
        center = ((body.min(0) + body.max(0)) / 2).astype(float)
        radius = float(np.linalg.norm(body - center, axis=1).max())
        lighting = Lighting.around(center, radius, outfit)
        self.dress(outfit)
        common = outfit.uniforms() | lighting.uniforms(view)
        self.bind_textures()
        self.ctx.enable(self.gl.DEPTH_TEST)
        for shadow_target, lamp in zip(self.shadow_targets, lighting.lamps, strict=True):
            shadow_target.use()
            shadow_target.clear(depth=1.0)
            self.draw("depth", outfit, common | {"light_clip_from_world": lamp})
        target, mask_target, depth_texture = self.target(view.width, view.height)
        mask_target.use()  # type: ignore[attr-defined]
        mask_target.clear(0, 0, 0, 0)  # type: ignore[attr-defined]
        self.ctx.disable(self.gl.DEPTH_TEST)
        self.draw("mask", outfit, common | {"clip_from_world": view.clip_from_world @ lighting.shear})
        self.ctx.enable(self.gl.DEPTH_TEST)
        target.use()  # type: ignore[attr-defined]
        target.clear(0, 0, 0, 0, depth=1.0)  # type: ignore[attr-defined]
        self.draw_person(outfit, common, view)
        return self._read(view, target, mask_target, depth_texture, landmarks_world)

    def bind_textures(self) -> None:
        """Make the textures that the shaders of people and things sample available, in the order of `TEXTURES`."""
        for unit, texture in enumerate((self.shadow_textures[0], *self.noise, *self.cloth, self.shadow_textures[1])):
            texture.use(unit)  # type: ignore[attr-defined]

    def target(self, width: int, height: int) -> tuple[object, object, object]:
        """Targets of that size for colour and for shadow, and the depth of the first."""
        if (width, height) not in self._targets:
            depth = self.ctx.depth_texture((width, height))
            colour = self.ctx.framebuffer([self.ctx.texture((width, height), 4)], depth)
            mask = self.ctx.framebuffer([self.ctx.texture((width, height), 1)])
            self._targets[(width, height)] = (colour, mask, depth)
        return self._targets[(width, height)]

    def _read(
        self, view: View, target: object, mask: object, depth: object, landmarks_world: NDArray[np.floating]
    ) -> Render:
        rgba, shadow, metres = read_pixels(view, target), read_pixels(view, mask), read_depth(view, depth)
        labels = landmark_labels(view, self.loaded, metres, landmarks_world)
        return Render(antialias(expose(rgba)), shadow, *labels, *marker_labels(view, self.loaded, metres))
