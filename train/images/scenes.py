"""Training scenes for the person detector: several people of any size in front of one background, things among them,
and its background model."""

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from muybridge.train.images.background_difference import GHOST, PARTLY, STILL
from muybridge.train.images.camera_faults import outside_of_video
from muybridge.train.images.clutter import add_clutter, tile_by_mirroring
from muybridge.train.images.compositing import BaseCompositor, Layer, extent_of, layer_of_render, scaled_render
from muybridge.train.images.distractors import (
    HELD_SHARE,
    LIT_SHARE,
    MOVED_SHARE,
    cast_shadow,
    hold,
    light_up,
    move_things,
)
from muybridge.train.images.film import Film, develop, sample_films
from muybridge.train.synthesis.rendering.store import RenderSet

# Share of scenes with a person larger than the image, of whom the upper part is visible.
CLOSE_SHARE = 0.12
# Share of people who stand beside somebody, arm in arm or one half behind the other.
BESIDE_SHARE = 0.3
# Share of scenes with somebody near the camera, cut off by the image border, if the store has close-ups.
NEAR_SHARE = 0.25
# Share of scenes in which a low sun or a lamp casts people's shadows onto the floor, which are not people.
CAST_SHARE = 0.3
# Share of the people who come with those and the things around them, if the store has renders of scenes.
SCENE_SHARE = 0.5
# Shares of pictures with things behind, and with one in front of everybody, if the store has renders of things alone.
THINGS_SHARE, BEFORE_SHARE = 0.45, 0.15
# Share of things that are part of the background model.
STATIC_SHARE = 0.5
# Longest side of people who are enlarged so that a render fills the picture, pixels.
_LARGEST = 900
# Shares of pictures without colour, toned and faded ones, see `film`; and of those in coloured light.
_FILMS = (0.08, 0.04, 0.04)
_TINTED = 0.05
SHAPES = ((192, 320), (320, 192), (256, 320), (320, 256))  # height, width


@dataclass(frozen=True)
class SceneBatch:
    """Scenes and the people in them.

    Attributes:
        image: (B, 4, H, W) uint8: RGB and difference to the background model.
        boxes: of each scene (n, 4) pixels: left, top, right, bottom.
        ignore: of each scene (m, 4): people too hidden to be required.
    """

    image: Tensor
    boxes: list[Float32Array]
    ignore: list[Float32Array]


@dataclass
class _Placed:
    """Somebody in a scene.

    Attributes:
        number: of the layer in `owners`, which people of one render share.
        box: (4,) pixels, also of what is hidden or outside of the picture.
        area: pixels of people in the box, in the layer.
        seen: share of the person that the render shows.
    """

    number: int
    box: FloatArray
    area: int
    seen: float = 1.0

    def visible(self, owners: NDArray[np.int16]) -> int:
        """Number of pixels in the box that belong to the layer."""
        left, top, right, bottom = np.maximum(np.round(self.box), 0).astype(int)
        return int((owners[top : bottom + 1, left : right + 1] == self.number).sum())


class SceneCompositor(BaseCompositor):
    """Makes batches of scenes from renders and backgrounds.

    Args:
        renders: people, and scenes of people and things.
        backgrounds: (N, 3, S, S) pool.
        seed: random seed.
        scenes: share of the people who come with those and the things around them, if there are renders of scenes.
    """

    def __init__(self, renders: RenderSet, backgrounds: ByteArray, seed: int, scenes: float = SCENE_SHARE) -> None:
        super().__init__(renders, backgrounds, seed)
        self.scene_share = scenes if len(self.scenes) else 0.0
        self.near = renders.close_ups

    def batch(self, count: int, shape: tuple[int, int] | None = None) -> SceneBatch:
        """`count` scenes of one shape (height, width)."""
        height, width = shape or SHAPES[self.rng.integers(len(SHAPES))]
        scenes = [self._scene(height, width) for _ in range(count)]
        frames = torch.from_numpy(np.stack([s[0] for s in scenes]).transpose(0, 3, 1, 2).astype(np.float32))
        tint = np.where(self.rng.random((count, 1)) < _TINTED, np.exp(self.rng.normal(0, 0.35, (count, 3))), 1)
        image = self.faults.apply(frames.div_(255), tint.astype(np.float32))
        pixels = torch.empty(count, 4, height, width, dtype=torch.uint8).to(memory_format=torch.channels_last)
        pixels[:, :3] = (image.clamp_(0, 1) * 255).add_(0.5)
        films = sample_films(self.rng, count, _FILMS)
        develop(pixels[:, :3], films, self.faults)
        for i, (frame, plate, *_) in enumerate(scenes):
            pixels[i, 3] = torch.from_numpy(self._difference(frame, plate, films.get(i)))
        self.faults.compress(pixels[:, :3], films)
        return SceneBatch(pixels, [s[2] for s in scenes], [s[3] for s in scenes])

    def _difference(self, frame: ByteArray, plate: ByteArray, film: Film | None) -> ByteArray:
        """(H, W) difference to the background model, of random strength and noise; zero in half of the scenes."""
        gain = float(np.exp(self.rng.normal(0, 0.3)))
        if self.rng.random() < 0.5:
            return np.zeros(frame.shape[:2], np.uint8)
        apart = cv2.absdiff(frame, plate)
        if film is not None:
            apart = cv2.transform(cv2.subtract(frame, plate, dtype=cv2.CV_32F), film.slopes)
            apart = cv2.absdiff(apart, np.zeros_like(apart)).clip(0, 255)
        between = cv2.transform(apart, np.full((1, 3), 1 / 3, np.float32))
        noise = np.abs(self.faults.grain(between.size).numpy()).reshape(between.shape)
        return np.asarray((gain * (between + 2.55 * noise) + 0.5).clip(0, 255), np.uint8)

    def _scene(self, height: int, width: int) -> tuple[ByteArray, ByteArray, Float32Array, Float32Array]:
        rng, texture = self.rng, partial(self._plate, height, width)
        plate = texture()
        if rng.random() < 0.6:
            add_clutter(plate, 8, texture, rng)
        frame = plate.copy()
        if rng.random() < MOVED_SHARE:
            move_things(frame, plate, texture, rng)
        count = int(rng.choice(6, p=[0.06, 0.4, 0.26, 0.14, 0.09, 0.05]))
        size = np.exp(rng.uniform(np.log(28), np.log(300), count)) if count else np.zeros(0)
        if count and rng.random() < CLOSE_SHARE:  # someone at a desk, or passing close to the camera
            size[0] = np.exp(rng.uniform(np.log(300), np.log(700)))
        owners = np.full((height, width), -1, np.int16)
        if len(self.things) and rng.random() < THINGS_SHARE:
            for _ in range(int(rng.integers(1, 4))):
                self._thing(frame, plate, owners)
        people = self._people(frame, plate, owners, size)
        near = len(self.near) > 0 and rng.random() < NEAR_SHARE
        if near:
            people.append(self._near(frame, owners, count))
            if rng.random() < 0.4:
                self._copy(frame, plate, owners == count)
            if rng.random() < 0.4:
                self._desk(frame, plate, owners)
        if rng.random() < 0.35:
            self._occluder(frame, plate, owners)
        if len(self.things) and rng.random() < BEFORE_SHARE:
            self._thing(frame, plate, owners)
        for number in np.nonzero(rng.random(count + near) < HELD_SHARE)[0]:
            mine = owners == number
            if mine.any():
                owners[hold(frame, mine, texture, rng)] = -1
        if rng.random() < LIT_SHARE:
            light_up(frame, rng)
        if rng.random() < 0.2:
            beyond, _ = outside_of_video(rng, height, width)
            frame[beyond] = plate[beyond] = 0
            owners[beyond] = -1
        if near and (owners == count).any():  # only the part inside the image can be required
            people[-1].box = extent_of(owners == count)
        visible = np.array([person.visible(owners) for person in people])
        share = visible / np.array([max(person.area, 1) for person in people]) * np.array([p.seen for p in people])
        good = (share > 0.25) & (visible > 60)
        stack = np.array([person.box for person in people], np.float32).reshape(-1, 4)
        return frame, plate, stack[good], stack[~good]

    def _people(self, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16], size: FloatArray) -> list[_Placed]:
        """Draw people of these sizes, pixels, far ones first; some with those and the things around them."""
        rng, beside = self.rng, self._beside(size)
        height, width = owners.shape
        people = []
        roll = np.radians(rng.normal(0, 8 if rng.random() < 0.8 else 20))
        placed: dict[int, FloatArray] = {}
        light = self._light() if rng.random() < CAST_SHARE else None
        for number, k in enumerate(np.argsort(size)):
            layer = self._layer(float(size[k]), roll, height, width)
            box = layer.boxes[0]
            mate = next((placed[m] for m in beside[k] if m in placed), None)
            shift = self._place(height, width, box) if mate is None else self._next_to(mate, box)
            shift = layer.at_borders(shift, height, width)
            if light is not None:
                cast_shadow(frame, layer.pixels[..., 3], float(box[3]), shift, light)
            thing = self._paste(frame, owners, layer, number, shift)
            if thing.any() and rng.random() < STATIC_SHARE:
                self._copy(frame, plate, thing)
            placed[int(k)] = box + np.tile(shift, 2)
            self._before(frame, plate, owners, number, layer, shift)
            people += self._of_layer(layer, number, shift)
        return people

    def _of_layer(self, layer: Layer, number: int, shift: IndexArray) -> list[_Placed]:
        """The people of a layer."""
        there = np.tile(shift, 2)
        return [
            _Placed(number, box + there, layer.area(box), float(seen))
            for box, seen in zip(layer.boxes, layer.seen, strict=True)
        ]

    def _layer(self, side: float, roll: float, height: int, width: int) -> Layer:
        """Somebody whose bounding box has a longer side of `side` pixels, alone or with those and the things around
        them, so large that what a render cuts off is outside of the picture."""
        if self.scene_share and self.rng.random() < self.scene_share:
            index = int(self.rng.choice(self.scenes))
            layer = layer_of_render(self.renders, index, side, (height, width), _LARGEST)
            if layer is not None:
                return layer.mirrored() if self.rng.random() < 0.5 else layer
        pixels, box = self._person(side, roll)
        return Layer(pixels, box[None])

    def _thing(self, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16]) -> None:
        """Draw a thing without people, which may be part of the background model."""
        rng, (height, width) = self.rng, owners.shape
        side = float(np.exp(rng.uniform(np.log(25), np.log(260))))
        layer = layer_of_render(self.renders, int(rng.choice(self.things)), side, (height, width), _LARGEST)
        if layer is None:
            return
        layer = layer.mirrored() if rng.random() < 0.5 else layer
        extent = np.array([0, 0, *layer.pixels.shape[1::-1]], float)
        shift = layer.at_borders(self._place(height, width, extent), height, width)
        thing = self._paste(frame, owners, layer, -1, shift)
        if rng.random() < STATIC_SHARE:
            self._copy(frame, plate, thing)

    def _light(self) -> tuple[float, float, float, float]:
        """Direction and look of cast shadows: shift across and up the image (negative: towards the camera) per pixel of
        a person's height, the light that remains, and the softness of the edges in pixels."""
        rng = self.rng
        away = rng.uniform(0.05, 0.7) * rng.choice([-1, 1])
        return rng.normal(0, 0.9), away, rng.uniform(0.3, 0.8), float(np.exp(rng.uniform(np.log(0.3), np.log(3))))

    def _before(
        self, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16], number: int,
        layer: Layer, shift: IndexArray,
    ) -> None:  # fmt: skip
        """Draw the last person into the background model too, as for people who stay in place for long: as they stand,
        except for a part that moved, or at an earlier position.

        Args:
            frame, plate: the scene and its background model.
            owners: number of the person at each pixel.
            number: of this person.
            layer: of the person.
            shift: of the layer in the frame.
        """
        rng, kind = self.rng, self.rng.random()
        if kind < STILL + PARTLY:
            mine = owners == number
            if kind > STILL and mine.any():
                y, x = np.mgrid[: len(mine), : mine.shape[1]]
                left, top, right, bottom = extent_of(mine)
                normal = rng.normal(0, 1, 2)
                edge = rng.normal(0, 0.2) * max(right - left, bottom - top)
                mine &= (x - (left + right) / 2) * normal[0] + (y - (top + bottom) / 2) * normal[1] > edge
            plate[mine] = frame[mine]
        elif kind < STILL + PARTLY + GHOST:
            far = max(2, 1.4 * max(layer.pixels.shape[:2]))
            away = np.exp(rng.uniform(np.log(1), np.log(far))) * rng.choice([-1, 1], 2) * rng.random(2)
            nobody = np.empty_like(owners)
            self._paste(plate, nobody, layer, number, np.round(shift + away).astype(int))

    def _beside(self, size: FloatArray) -> list[list[int]]:
        """For every person those whom they stand beside; makes these similar in `size`."""
        beside: list[list[int]] = [[] for _ in size]
        for k in range(1, len(size)):
            if self.rng.random() < BESIDE_SHARE:
                size[k] = size[k - 1] * np.exp(self.rng.normal(0, 0.1))
                beside[k].append(k - 1)
                beside[k - 1].append(k)
        return beside

    def _next_to(self, mate: FloatArray, box: FloatArray) -> IndexArray:
        """(2,) pixels by which a box moves to touch or half cover another one, on the same floor."""
        rng = self.rng
        across = rng.uniform(0.3, 1.1) * (mate[2] - mate[0] + box[2] - box[0]) / 2 * rng.choice([-1, 1])
        up = rng.normal(0, 0.04) * (mate[3] - mate[1])
        return np.array([(mate[0] + mate[2] - box[0] - box[2]) / 2 + across, mate[3] - box[3] + up]).round().astype(int)

    def _plate(self, height: int, width: int) -> ByteArray:
        rng = self.rng
        source = self.backgrounds.shape[-1]
        window = int(rng.integers(source * 2 // 3, source + 1))
        corner = self._corner(window)
        patch = self._patch(int(rng.integers(len(self.backgrounds))), corner, window)
        if rng.random() < 0.35:
            return np.ascontiguousarray(cv2.resize(patch, (width, height), interpolation=cv2.INTER_LINEAR))
        return tile_by_mirroring(np.ascontiguousarray(patch), height, width, rng)

    def _person(self, side: float, roll: float) -> tuple[ByteArray, FloatArray]:
        """A render scaled so that the longer side of the bounding box has `side` pixels: (h, w, 5), and the box in
        it."""
        small, *_ = scaled_render(self.renders, int(self.rng.choice(self.whole)), side, roll)
        if self.rng.random() < 0.5:
            small = small[:, ::-1]
        opaque = small[..., 3] > 127
        return small, extent_of(opaque if opaque.any() else np.ones_like(opaque))  # a person of a few pixels

    def _near(self, frame: ByteArray, owners: NDArray[np.int16], number: int) -> _Placed:
        """Draw somebody whom the border of `frame` cuts off where their close-up is cut."""
        rng = self.rng
        height, width = owners.shape
        index = int(rng.choice(self.near))
        small, scale, origin = scaled_render(self.renders, index, float(np.exp(rng.uniform(np.log(90), np.log(330)))))
        nx, ny, edge = (float(v) for v in self.renders.cut_px[index])
        normal = np.array([nx, ny])
        edge = float(np.floor(edge * scale - normal @ origin))  # the last pixel, which the border is next to
        rows, columns = np.mgrid[: len(small), : small.shape[1]]
        small[columns * normal[0] + rows * normal[1] > edge] = 0
        if rng.random() < 0.5:
            small = small[:, ::-1]
            edge, normal = edge - float(normal[0]) * (small.shape[1] - 1), normal * [-1, 1]
        opaque = small[..., 3] > 127
        if not opaque.any():
            return _Placed(number, np.zeros(4), 0)
        box = extent_of(opaque)
        size = np.array([width, height])
        center = rng.uniform(0.1, 0.9, 2) * size
        shift = center - (box[:2] + box[2:]) / 2
        # The cut lies on the image border: the far one for a normal of +1, else the near one.
        border = np.where(normal > 0, size - 1, 0) - normal * edge
        shift = np.where(normal != 0, border, shift)
        layer, at = Layer(small, box[None]), np.round(shift).astype(int)
        self._paste(frame, owners, layer, number, at)
        return self._of_layer(layer, number, at)[0]

    def _desk(self, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16]) -> None:
        """Draw something at the bottom of the image, in front of everybody."""
        inside = np.zeros(owners.shape, bool)
        inside[round(self.rng.uniform(0.72, 0.97) * len(owners)) :] = True
        self._cover(inside, frame, plate, owners)

    def _cover(self, inside: BoolArray, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16]) -> None:
        """Draw part of the room over everybody, in the frame and in the background model."""
        texture = self._plate(*owners.shape)
        frame[inside] = plate[inside] = texture[inside]
        owners[inside] = -1

    def _paste(
        self, frame: ByteArray, owners: NDArray[np.int16], layer: Layer, number: int, shift: IndexArray
    ) -> BoolArray:
        """Draw a layer into `frame`, shifted by `shift`; return (H, W) where its things are."""
        height, width = owners.shape
        pixels = layer.pixels
        x0, y0 = np.maximum(shift, 0)
        x1, y1 = np.minimum(shift + np.array(pixels.shape[1::-1]), [width, height])
        things = np.zeros((height, width), bool)
        if x0 < x1 and y0 < y1:
            part = pixels[y0 - shift[1] : y1 - shift[1], x0 - shift[0] : x1 - shift[0]]
            alpha = part[..., 3:4].astype(np.float32) / 255
            shade = 1 - part[..., 4:5].astype(np.float32) / 255 * self.rng.uniform(0, 0.6)
            target = frame[y0:y1, x0:x1]
            target[:] = (target * shade * (1 - alpha) + part[..., :3]).clip(0, 255).astype(np.uint8)
            owners[y0:y1, x0:x1][alpha[..., 0] > 0.5] = number
            if part.shape[2] > 5:
                things[y0:y1, x0:x1] = part[..., 5] > 127
                owners[things] = -1
        return things

    def _place(self, height: int, width: int, box: FloatArray) -> IndexArray:
        """(2,) pixels by which the box moves to a random position."""
        rng = self.rng
        center = rng.uniform(0.02, 0.98, 2) * [width, height]
        if rng.random() < 0.75:  # entirely in the image if possible
            half = (box[2:] - box[:2]) / 2
            low, high = half, np.array([width, height]) - half
            center = np.where(low < high, rng.uniform(np.minimum(low, high), np.maximum(low, high)), center)
            if low[1] >= high[1]:  # too tall for the image: it shows the upper part
                center[1] = half[1] + rng.uniform(-0.05, 0.4) * height
        return np.round(center - (box[:2] + box[2:]) / 2).astype(int)

    @staticmethod
    def _copy(frame: ByteArray, plate: ByteArray, where: BoolArray) -> None:
        plate[where] = frame[where]

    def _occluder(self, frame: ByteArray, plate: ByteArray, owners: NDArray[np.int16]) -> None:
        """Draw something of the room in front of people."""
        rng = self.rng
        height, width = owners.shape
        mask = np.zeros((height, width), np.uint8)
        center = rng.uniform(0, 1, 2) * [width, height]
        reach = rng.uniform(0.04, 0.3) * max(width, height)
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 7))))
        corners = center + reach * np.stack([np.cos(angle), np.sin(angle)], 1) * rng.uniform(0.4, 1.6, 2)
        cv2.fillPoly(mask, [corners.astype(np.int32)], 1)
        self._cover(mask > 0, frame, plate, owners)
