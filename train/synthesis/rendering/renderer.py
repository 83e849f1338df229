"""Rendering of synthetic people with moderngl on EGL (llvmpipe where there is no GPU).

A render shows a person alone: colour with alpha, and the person's shadow on the floor. Backgrounds, occluders and
camera faults are added later (`muybridge.train.images`), so that one render serves many images.
"""

import pathlib
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.bodies.surface_markers import marker_normals, markers_seen, virtual_markers
from muybridge.train.synthesis.clothing import fabrics
from muybridge.train.synthesis.clothing.sample import Outfit
from muybridge.train.synthesis.clothing.shells import Shells
from muybridge.train.synthesis.rendering.view import FAR, NEAR, View, look_at

SHADERS = pathlib.Path(__file__).parent / "shaders"
SHADOW_MAPS = (384, 224)  # pixels: for the main light, and for the sky
PARTS = ("body", "trousers", "shirt", "shoes", "skirt", "long_hair", "hair", "hat")
DOT = 0.007  # metres, radius of a reflective dot
# Range of a person's mean luma (0..255) after exposure.
LUMA = (45.0, 205.0)

# Depth of a landmark under the skin, in metres for a body of 1.7 m: beyond it, something hides the landmark.
_DEPTH = {
    "face": 0.06,
    "shoulder": 0.11,
    "elbow": 0.08,
    "wrist": 0.07,
    "hip": 0.17,
    "knee": 0.10,
    "foot": 0.08,
}
LANDMARK_DEPTH = np.array(
    [_DEPTH["face"]] * 5 + [_DEPTH["shoulder"]] * 2 + [_DEPTH["elbow"]] * 2 + [_DEPTH["wrist"]] * 2
    + [_DEPTH["hip"]] * 2 + [_DEPTH["knee"]] * 2 + [_DEPTH["foot"]] * 8
)  # fmt: skip


@dataclass(frozen=True)
class Render:
    """Image and labels of a person in a view.

    Attributes:
        rgba: (H, W, 4) uint8, premultiplied by alpha, which is coverage.
        shadow: (H, W) uint8, where the floor lies in the person's shadow.
        landmarks_px: (23, 2) pixels.
        visible: (23,) whether the landmark is in the image and not hidden by the person's own body.
        box_px: (4,) left, top, right, bottom of the whole body, also outside the image.
        markers_px: (M, 2) pixels of the virtual markers, in the order of `SURFACE`.
        markers_visible: (M,) whether the marker faces the camera, is in the image and not behind a limb.
        cut_px: (3,) where the person of a close-up has to be cut off, see `close_ups.Cuts`; else NaN.
    """

    rgba: ByteArray
    shadow: ByteArray
    landmarks_px: Float32Array
    visible: BoolArray
    box_px: Float32Array
    markers_px: Float32Array
    markers_visible: BoolArray
    cut_px: Float32Array = field(default_factory=lambda: np.full(3, np.nan, np.float32))


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
        self.vertices = vertices
        table, self._normals = self._shells.shape(vertices)
        self.markers = virtual_markers(vertices[None])[0]
        self.marker_normals = marker_normals(self._normals[None, : len(vertices)])[0]
        self.dynamic.write(table.tobytes())

    def _dress(self, outfit: Outfit) -> None:
        """Write the accessories and dots of `outfit` at their positions on the loaded person."""
        table = self._shells.accessories(outfit.accessories, self.vertices)
        if len(table):
            self.dynamic.write(table.tobytes(), offset=self._shells.first * 36)
        count, seed = outfit.dots
        if count:
            chosen = np.random.default_rng(seed).choice(self._shells.dot_places, count, replace=False)
            at = self.vertices[chosen] + self._normals[chosen] * (0.6 * DOT + 0.005)
            self.dot_buffer.write(at.astype("f4").tobytes())

    def _draw(self, name: str, outfit: Outfit, values: dict[str, object]) -> None:
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

    def _draw_dots(self, outfit: Outfit, view: View) -> None:
        lamps = np.mean(outfit.values["light_colour"]) + np.mean(outfit.values["ambient_up"])
        reach = 2 * DOT * view.focal_px
        self.dots.set({"clip_from_world": view.clip_from_world, "reach_px": reach, "light": float(lamps)})
        self.ctx.enable(self.gl.PROGRAM_POINT_SIZE)
        self.dot_array.render(self.gl.POINTS, vertices=outfit.dots[0])

    def render(self, view: View, outfit: Outfit, landmarks_world: NDArray[np.floating]) -> Render:
        """Render the loaded person in `outfit`; the floor is at z = 0."""
        body = self.vertices[:BODY_VERTICES]
        center = ((body.min(0) + body.max(0)) / 2).astype(float)
        radius = float(np.linalg.norm(body - center, axis=1).max())
        lamps = self._light(outfit.light, center, radius), self._light(outfit.sky, center, radius)
        shear = np.eye(4)
        # A shadow on the floor: every point moves along the light until z = 0.
        shear[0, 2], shear[1, 2], shear[2, 2] = (
            -outfit.light[0] / max(outfit.light[2], 0.15), -outfit.light[1] / max(outfit.light[2], 0.15), 0.0
        )  # fmt: skip
        self._dress(outfit)
        common = outfit.uniforms() | {
            "clip_from_world": view.clip_from_world, "light_clip_from_world": lamps[0], "sky_clip_from_world": lamps[1],
            "eye_world": tuple(-view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]),
            "shadow_map": 0, "white3": 1, "fractal3": 2, "patterns": 3, "prints": 4, "folds": 5,
            "sky_map": 6,
        }  # fmt: skip
        for unit, texture in enumerate((self.shadow_textures[0], *self.noise, *self.cloth, self.shadow_textures[1])):
            texture.use(unit)  # type: ignore[attr-defined]
        self.ctx.enable(self.gl.DEPTH_TEST)
        for shadow_target, lamp in zip(self.shadow_targets, lamps, strict=True):
            shadow_target.use()
            shadow_target.clear(depth=1.0)
            self._draw("depth", outfit, common | {"light_clip_from_world": lamp})
        target, mask_target, depth_texture = self._target(view.width, view.height)
        mask_target.use()  # type: ignore[attr-defined]
        mask_target.clear(0, 0, 0, 0)  # type: ignore[attr-defined]
        self.ctx.disable(self.gl.DEPTH_TEST)
        self._draw("mask", outfit, common | {"clip_from_world": view.clip_from_world @ shear})
        self.ctx.enable(self.gl.DEPTH_TEST)
        target.use()  # type: ignore[attr-defined]
        target.clear(0, 0, 0, 0, depth=1.0)  # type: ignore[attr-defined]
        self._draw("person", outfit, common)
        if outfit.dots[0]:
            self._draw_dots(outfit, view)
        return self._read(view, target, mask_target, depth_texture, landmarks_world)

    @staticmethod
    def _light(light: tuple[float, float, float], center: FloatArray, radius: float) -> FloatArray:
        pose = np.vstack([look_at(center + np.array(light) * radius, center), [0, 0, 0, 1]])
        scale = np.diag([1 / (radius * 1.05), 1 / (radius * 1.05), 1 / (radius * 2), 1.0])
        scale[2, 3] = -0.5
        return np.asarray(scale @ pose)

    def _target(self, width: int, height: int) -> tuple[object, object, object]:
        if (width, height) not in self._targets:
            depth = self.ctx.depth_texture((width, height))
            colour = self.ctx.framebuffer([self.ctx.texture((width, height), 4)], depth)
            mask = self.ctx.framebuffer([self.ctx.texture((width, height), 1)])
            self._targets[(width, height)] = (colour, mask, depth)
        return self._targets[(width, height)]

    def _read(
        self, view: View, target: object, mask: object, depth: object, landmarks_world: NDArray[np.floating]
    ) -> Render:
        w, h = view.width, view.height
        rgba = np.frombuffer(target.read(components=4), "u1").reshape(h, w, 4)[::-1]  # type: ignore[attr-defined]
        shadow = np.frombuffer(mask.read(components=1, alignment=1), "u1").reshape(h, w)[::-1]  # type: ignore[attr-defined]
        z = np.frombuffer(depth.read(alignment=1), "f4").reshape(h, w)[::-1]  # type: ignore[attr-defined]
        metres = 2 * FAR * NEAR / (FAR + NEAR - (2 * z - 1) * (FAR - NEAR))
        px, depth_m = _clip_near(*view.project(landmarks_world))
        body_px = np.ascontiguousarray(view.project(self.vertices[:BODY_VERTICES])[0].T)
        box = np.concatenate([body_px.min(1), body_px.max(1)])
        inside, surface = _surface_depth(px, metres)
        height = float(np.ptp(self.vertices[:BODY_VERTICES], axis=0).max())
        visible = inside & (depth_m - surface < LANDMARK_DEPTH * min(height, 1.8) / 1.7 + 0.02)
        labels = px.astype(np.float32), visible, box.astype(np.float32)
        return Render(
            _antialias(_expose(rgba.copy())), shadow.copy(), *labels, *self._read_markers(view, metres, height)
        )

    def _read_markers(self, view: View, metres: NDArray[np.floating], height: float) -> tuple[Float32Array, BoolArray]:
        """Pixels (M, 2) of the loaded person's markers and whether they are visible."""
        px, depth_m = _clip_near(*view.project(self.markers))
        inside, surface = _surface_depth(px, metres)
        eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
        seen = markers_seen(self.markers, self.marker_normals, eye, depth_m, surface, height)
        return px.astype(np.float32), inside & seen


def _expose(rgba: ByteArray) -> ByteArray:
    """Bring the mean luma of a person into `LUMA`, in place, like a camera's exposure control."""
    person = rgba[..., 3] > 0
    for _ in range(3 if person.any() else 0):
        luma = float(rgba[person, :3].mean(0) @ [0.299, 0.587, 0.114])
        wanted = float(np.clip(luma, *LUMA))
        if abs(wanted - luma) < 1:
            break
        steps, gain = np.arange(256) / 255, wanted / max(luma, 4.0)
        curve = (1 - (1 - steps) ** gain) if gain > 1 else steps * gain  # brightening keeps white white
        rgba[..., :3] = (curve.clip(0, 1) * 255).round().astype(np.uint8)[rgba[..., :3]]
    return rgba


def _antialias(rgba: ByteArray) -> ByteArray:
    """Smooth the silhouette; the inside keeps its detail."""
    smooth = cv2.GaussianBlur(rgba, (3, 3), 0.65)
    cover = smooth[..., 3]
    edge = (cover > 0) & (cover < 255)
    rgba[edge] = smooth[edge]
    return rgba


def _clip_near(px: FloatArray, depth_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels and depths; points clipped by the near plane are moved far outside any image."""
    px[depth_m < NEAR] = -1e5
    return px, depth_m


def _surface_depth(px: FloatArray, metres: NDArray[np.floating]) -> tuple[BoolArray, NDArray[np.floating]]:
    """(J,) whether `px` (J, 2) lie in the image, and the median depth of the 3 x 3 pixels around each: robust to
    aliasing at silhouettes."""
    at = np.round(px).astype(int)
    size = np.array(metres.shape[::-1])
    inside = np.all((at >= 1) & (at < size - 1), axis=1)
    x, y = at.clip(1, size - 2).T
    return np.asarray(inside), np.median([metres[y + j, x + i] for i in (-1, 0, 1) for j in (-1, 0, 1)], 0)
