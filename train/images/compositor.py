"""From renders to training images: composition on backgrounds, occlusion, and what a camera does to an image.

Whole batches at a time; the random numbers come from a numpy generator, so that a seed gives the
same labels anywhere and the same pixels on one machine.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.images.background_difference import Plates
from muybridge.train.images.backgrounds import sample_backdrop
from muybridge.train.images.camera_faults import CameraFaults, outside_of_video
from muybridge.train.images.clutter import add_clutter, mirrored_on
from muybridge.train.synthesis.rendering.close_ups import BORDER, SOMETHING, cut_boxes, to_crop
from muybridge.train.synthesis.rendering.store import RenderSet

FACE = tuple(BODY23.index(n) for n in ("nose", "left_eye", "right_eye", "left_ear", "right_ear"))
MIRROR = np.array([*BODY23.mirror, *(len(BODY23) + i for i in SURFACE.mirror)])


@dataclass(frozen=True)
class AugmentOptions:
    """Probabilities and spreads of the augmentation.

    Attributes:
        padding: crop side over the longer side of the person's box.
        scale_sd: spread of the log of the person's size in the crop.
        shift_sd: spread of the person's place, as a share of the crop.
        rotation_sd_deg: spread of the roll that gravity alignment leaves.
        tumble: share of crops rolled by any angle up to 60 degrees.
        second_person: share of crops with another person beside the subject.
        embrace: share of crops with another person right behind or before the subject, as in a hold: of whom limbs show
            where the subject's own are hidden. A network that is trained with it on crops of one size reads others no
            more (docs/training-log.md).
        occluder: share of crops with things in front of the person.
        mosaic: share of crops with a pixelated face.
        truncate: share of crops that reach over the image's border (black there).
        close_up: share of crops that frame a part of a person, see `close_ups`.
        clutter: share of crops with things that are nobody behind the person, see `clutter`.
        plate: share of crops with the difference to the background plate, see `plates`.
        backdrop: share of crops before a curtain, a screen or a bare wall, see `backgrounds`.
        dark: share of crops underexposed, down to a tenth of the light.
        tinted: share of crops in coloured light that no camera's white balance took out.
        monochrome: share of crops of a camera without colours.
        faults: with what a camera does to an image, see `camera_faults`.
    """

    padding: float = 1.25
    scale_sd: float = 0.12
    shift_sd: float = 0.045
    rotation_sd_deg: float = 7.0
    tumble: float = 0.06
    second_person: float = 0.22
    embrace: float = 0.12
    occluder: float = 0.35
    mosaic: float = 0.08
    truncate: float = 0.12
    close_up: float = 0.1
    clutter: float = 0.5
    plate: float = 0.5
    backdrop: float = 0.08
    dark: float = 0.05
    tinted: float = 0.08
    monochrome: float = 0.08
    faults: bool = True


# What networks are scored with and their variances fitted on: whole people, of whom the rarest of what is hard for a
# network has to be asked for.
WHOLE = AugmentOptions(close_up=0, embrace=0, backdrop=0, dark=0, tinted=0, monochrome=0)


@dataclass(frozen=True)
class Batch:
    """Training images: `image` (B, 3, S, S) uint8 RGB, `difference` (B, 1, S, S) uint8 to the background plate, zero
    where there is none, `landmarks_px` (B, 23, 2), `visible` (B, 23) bool; the same of the body's surface,
    `markers_px` (B, M, 2) and `markers_visible` (B, M), NaN where a render has none."""

    image: Tensor
    difference: Tensor
    landmarks_px: Tensor
    visible: Tensor
    markers_px: Tensor
    markers_visible: Tensor

    @property
    def pixels(self) -> Tensor:
        """(B, 4, S, S) uint8: what the network sees."""
        return torch.cat([self.image, self.difference], 1)


def linear_maps(angle: FloatArray, scale: FloatArray, flip: BoolArray) -> FloatArray:
    """(n, 2, 2) maps that mirror x where `flip` (n,), then turn by `angle` (n,), radians, and scale by `scale` (n,)."""
    cos, sin = np.cos(angle) * scale, np.sin(angle) * scale
    linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    linear[:, :, 0] *= np.where(flip, -1, 1)[:, None]
    return linear


# Images that are made together: what they need in between stays in the processor's cache.
_AT_ONCE = 8


class Compositor:
    """Makes batches of crops from renders and backgrounds."""

    def __init__(
        self,
        renders: RenderSet,
        backgrounds: ByteArray,
        size: int,
        seed: int,
        options: AugmentOptions = AugmentOptions(),  # noqa: B008 - frozen
    ) -> None:
        self.renders, self.backgrounds, self.size, self.options = renders, backgrounds, size, options
        self.rng = np.random.default_rng(seed)
        self.faults = CameraFaults(self.rng)
        # With numbers of its own: the pictures of a seed are the same with plates and without.
        self.plates = Plates(np.random.default_rng([seed, 1]))
        self.whole = renders.whole  # a close-up would be cut off in mid-air beside somebody else

    def batch(self, count: int, index: IndexArray | None = None) -> Batch:
        """`count` crops of random renders, or of the renders `index`."""
        index = self.rng.integers(0, len(self.renders), count) if index is None else index
        parts = [self._few(index[i : i + _AT_ONCE]) for i in range(0, count, _AT_ONCE)]
        return Batch(*(torch.cat(arrays) for arrays in zip(*parts, strict=True)))

    def _few(self, index: IndexArray) -> tuple[Tensor, ...]:
        """The crops of a batch that are made at once, as the fields of `Batch`."""
        rng, opt, count = self.rng, self.options, len(index)
        made = self.renders.cut_px[index]
        box, lines = cut_boxes(rng, self.renders.box_px[index], opt.close_up, made)
        matrix, flip = self._placement(box)
        cuts = to_crop(rng, lines, matrix, np.isfinite(made[:, 0]))
        person, landmarks, visible = self._warp(index, matrix, flip)
        plate = self._background(count, opt.clutter)
        lit = self._backdrops(plate)
        shade = person[:, 4:] * self._column(rng.uniform(0, 0.6, count))
        image = torch.addcmul(plate, plate, shade, value=-1)
        chance = rng.random(count) if len(self.whole) else np.ones(count)
        other, close = chance < opt.second_person + opt.embrace, chance >= opt.second_person
        in_front = rng.random(count) < 0.4
        front = self._second_person(image, other, close, in_front) if other.any() else None
        image.mul_(1 - person[:, 3:4]).add_(person[:, :3])
        if front is not None:
            visible &= ~(self._alpha_at(front[:, 3].numpy(), landmarks) > 0.5)
            image.mul_(1 - front[:, 3:4]).add_(front[:, :3])
        visible, before = self._occlude(image, visible, landmarks)
        self._mosaic(image, landmarks)
        visible = visible & ~cuts.hidden(landmarks)
        for i in cuts.chosen(SOMETHING):
            mask = torch.from_numpy(cuts.mask(i, self.size))
            image[i, :, mask] = self._background(1)[0, :, mask]
            before[i, :, mask] = 1
        light = self._light(count)
        difference = self._difference(image, plate, person, before, light)
        image = self.faults.apply(image, light, lit) if opt.faults else image
        visible, outside = self._truncate(visible, landmarks)
        for i, beyond in [*outside, *((int(i), cuts.mask(i, self.size)) for i in cuts.chosen(BORDER))]:
            for layer in (image, difference):
                layer[i, :, torch.from_numpy(beyond)] = 0
        inside = ((landmarks >= 0) & (landmarks <= self.size - 1)).all(-1)
        pixels = image.clamp_(0, 1).mul_(255).round_().to(torch.uint8)
        pixels = self.faults.compress(pixels) if opt.faults else pixels
        self._monochrome(pixels)
        at, seen = torch.from_numpy(landmarks), torch.from_numpy(visible & inside)
        body = len(BODY23)
        return pixels, difference, at[:, :body], seen[:, :body], at[:, body:], seen[:, body:]

    def _light(self, count: int) -> Float32Array:
        """(B, 3) what cameras have of the red, green and blue light that they expose for: all of it, too little, or
        another mixture."""
        opt, light = self.options, np.ones((count, 3), np.float32)
        if opt.dark and opt.faults:
            dark = self.rng.random(count) < opt.dark
            light[dark] = np.exp(self.rng.uniform(np.log(0.1), np.log(0.6), (int(dark.sum()), 1)))
        if opt.tinted and opt.faults:
            tinted = self.rng.random(count) < opt.tinted
            colour = np.exp(self.rng.normal(0, 0.35, (int(tinted.sum()), 3)))
            light[tinted] *= colour / colour.mean(1, keepdims=True)
        return light

    def _backdrops(self, plate: Tensor) -> BoolArray:
        """Exchanges the backgrounds (B, 3, S, S) of a share of the crops for backdrops, in place. Returns (B,) where
        lamps and camera are set for the person, not for what is behind."""
        chosen = np.zeros(len(plate), bool)
        if self.options.backdrop:
            chosen = self.rng.random(len(plate)) < self.options.backdrop
            for i in np.nonzero(chosen)[0]:
                plate[i] = torch.from_numpy(sample_backdrop(self.rng, self.size).transpose(2, 0, 1))
            chosen &= self.rng.random(len(plate)) < 0.7
        return chosen

    def _monochrome(self, pixels: Tensor) -> None:
        """Takes the colours off a share of (B, 3, S, S) uint8, in place: sensors differ in what they see of each."""
        if self.options.monochrome:
            for i in np.nonzero(self.rng.random(len(pixels)) < self.options.monochrome)[0]:
                seen = torch.from_numpy(self.rng.dirichlet((2, 2, 2)).astype(np.float32))
                pixels[i] = torch.einsum("chw,c->hw", pixels[i].float(), seen).round_()

    def _difference(self, image: Tensor, plate: Tensor, person: Tensor, before: Tensor, light: Float32Array) -> Tensor:
        """(B, 1, S, S) uint8 to the background plate, of a share of the crops; `before` (B, 1, S, S) is what stands
        before the person: a part of the room, or held or carried. `light` is that of `_light`."""
        known = torch.from_numpy(np.nonzero(self.plates.rng.random(len(image)) < self.options.plate)[0])
        difference = torch.zeros(before.shape, dtype=torch.uint8)
        if len(known):
            static = before[known] * self._column(self.plates.rng.random(len(known)) < 0.6)
            empty = plate[known]
            self.plates.seen_before(empty, person[known], static)
            difference[known] = self.plates.difference(image[known], empty, static, light[known.numpy()])
        return difference

    def _column(self, values: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(np.asarray(values, np.float32)).view(-1, 1, 1, 1)

    def _placement(self, box: Float32Array, aside: FloatArray | None = None) -> tuple[Float32Array, BoolArray]:
        """crop_from_render (B, 2, 3) affine maps in pixels for boxes (B, 4), and which are mirrored. `aside` (B, 2)
        moves people sideways, by a share of the crop between the two."""
        rng, opt, n, size = self.rng, self.options, len(box), self.size
        center = (box[:, :2] + box[:, 2:]) / 2
        side = (box[:, 2:] - box[:, :2]).max(1)
        scale = size / (opt.padding * side) * np.exp(rng.normal(0, opt.scale_sd, n).clip(-0.35, 0.35))
        shift = rng.normal(0, opt.shift_sd, (n, 2)).clip(-0.12, 0.12) * size
        if aside is not None:
            shift[:, 0] += rng.choice([-1, 1], n) * rng.uniform(*aside.T) * size
            shift[:, 1] += rng.normal(0, 0.12, n) * size
            scale *= np.exp(rng.normal(0, 0.25, n))
        angle = np.radians(rng.normal(0, opt.rotation_sd_deg, n))
        tumble = rng.random(n) < opt.tumble
        angle = np.where(tumble, np.radians(rng.uniform(-60, 60, n)), angle)
        flip = rng.random(n) < 0.5
        linear = linear_maps(angle, scale, flip)
        middle = (size - 1) / 2 + shift
        matrix = np.concatenate([linear, (middle - np.einsum("nij,nj->ni", linear, center))[..., None]], -1)
        return matrix.astype(np.float32), flip

    def _warp(self, index: IndexArray, matrix: Float32Array, flip: BoolArray) -> tuple[Tensor, Float32Array, BoolArray]:
        """Renders in the crop (B, 5, S, S) in 0..1; landmarks of body and surface, and their visibility. Renders are
        black outside of the person, so their colours are premultiplied by alpha as they stand."""
        size = self.size
        warped = np.empty((len(index), 5, size, size), np.uint8)
        for k, i in enumerate(index):
            for plane, out in zip(self.renders.pixels_of(i), warped[k], strict=True):
                cv2.warpAffine(plane, matrix[k], (size, size), dst=out, flags=cv2.INTER_LINEAR)
        landmarks = np.concatenate([self.renders.landmarks_px[index], self.renders.markers_px[index]], 1)
        landmarks = np.einsum("nij,nkj->nki", matrix[:, :, :2], landmarks) + matrix[:, None, :, 2]
        visible = np.concatenate([self.renders.visible[index], self.renders.markers_visible[index]], 1)
        landmarks[flip], visible[flip] = landmarks[flip][:, MIRROR], visible[flip][:, MIRROR]
        return torch.from_numpy(warped).float().div_(255), landmarks.astype(np.float32), visible

    def _background(self, count: int, clutter: float = 0.0) -> Tensor:
        """Random windows of the background pool, a share of them cluttered."""
        pictures = np.stack([self._window() for _ in range(count)])
        for i in np.nonzero(self.rng.random(count) < clutter)[0]:
            add_clutter(pictures[i], 6, self._window, self.rng)
        return torch.from_numpy(pictures.transpose(0, 3, 1, 2).astype(np.float32)).div_(255)

    def _window(self) -> ByteArray:
        """(size, size, 3) of one background: half of them no larger than they were made, or blur would tell people
        from what is behind them."""
        rng, size, pool = self.rng, self.size, self.backgrounds
        source, b = pool.shape[-1], int(rng.integers(len(pool)))
        if rng.random() < 0.5:
            return mirrored_on(np.ascontiguousarray(pool[b].transpose(1, 2, 0)), size, size, rng)
        window = int(rng.integers(size // 2, source + 1))
        x, y = rng.integers(0, source - window + 1, 2)
        patch = pool[b, :, y : y + window, x : x + window].transpose(1, 2, 0)
        patch = patch[:, ::-1] if rng.random() < 0.5 else patch
        interpolation = cv2.INTER_AREA if window > size else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(patch, (size, size), interpolation=interpolation), np.uint8)

    def _alpha_at(self, alpha: Float32Array, landmarks: Float32Array) -> Float32Array:
        at = np.round(np.nan_to_num(landmarks)).astype(int).clip(0, self.size - 1)
        out: Float32Array = alpha[np.arange(len(alpha))[:, None], at[..., 1], at[..., 0]]
        return out

    def _second_person(self, image: Tensor, other: BoolArray, close: BoolArray, in_front: BoolArray) -> Tensor:
        """Another person beside the subject of the crops `other`, or, of these, with the subject in a hold if `close`:
        behind, drawn into `image` in place, or in front, returned as a layer (B, 4, S, S) for when the subject is
        drawn."""
        chosen = np.nonzero(other)[0]
        index = self.rng.choice(self.whole, len(chosen))
        # Before the subject not in the middle: nobody could tell whose crop that is.
        held = np.where(in_front[chosen, None], (0.12, 0.3), (0.0, 0.3))
        matrix, flip = self._placement(self.renders.box_px[index], np.where(close[chosen, None], held, (0.3, 0.75)))
        layer, _, _ = self._warp(index, matrix, flip)
        front = torch.zeros(len(image), 4, self.size, self.size)
        for k, i in enumerate(chosen):
            if in_front[i]:
                front[i] = layer[k, :4]
            else:
                image[i] = image[i] * (1 - layer[k, 3:4]) + layer[k, :3]
        return front

    def _occlude(self, image: Tensor, visible: BoolArray, landmarks: Float32Array) -> tuple[BoolArray, Tensor]:
        """Puts things in front of the person, in place: polygons and bars with the texture of another background.
        Returns what is visible still, and where they are, (B, 1, S, S) in 0..1."""
        rng, size = self.rng, self.size
        chosen = np.nonzero(rng.random(len(image)) < self.options.occluder)[0]
        if not len(chosen):
            return visible, torch.zeros_like(image[:, :1])
        mask = np.zeros((len(image), size, size), np.float32)
        for i in chosen:
            canvas = np.zeros((size, size), np.uint8)
            for _ in range(int(rng.integers(1, 4))):
                center = rng.uniform(0, size, 2)
                if rng.random() < 0.5:
                    reach = rng.uniform(0.04, 0.2) * size
                    angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(4, 8))))
                    corners = center + reach * np.stack([np.cos(angle), np.sin(angle)], 1) * rng.uniform(0.5, 1.6, 2)
                    cv2.fillPoly(canvas, [corners.astype(np.int32)], 255, cv2.LINE_AA)
                else:
                    end = center + rng.normal(0, 0.5, 2) * size
                    width = int(rng.integers(1, max(2, size // 12)))
                    cv2.line(canvas, center.astype(int).tolist(), end.astype(int).tolist(), 255, width, cv2.LINE_AA)
            mask[i] = canvas / 255.0
        visible = visible & ~(self._alpha_at(mask, landmarks) > 0.5)
        alpha = torch.from_numpy(mask)[:, None]
        for i, texture in zip(chosen, self._background(len(chosen)), strict=True):
            image[i].lerp_(texture, alpha[i])
        return visible, alpha

    def _mosaic(self, image: Tensor, landmarks: Float32Array) -> None:
        """Pixelated faces, as published recordings have them, in place."""
        for i in np.nonzero(self.rng.random(len(image)) < self.options.mosaic)[0]:
            face = landmarks[i, list(FACE)]
            center, reach = face.mean(0), 1.2 * float(np.abs(face - face.mean(0)).max()) + 2
            low = np.clip(center - reach, 0, self.size - 2).astype(int)
            high = np.clip(center + reach, low + 2, self.size).astype(int)
            patch = image[i : i + 1, :, low[1] : high[1], low[0] : high[0]]
            cells = int(self.rng.integers(2, 6))
            small = torch.nn.functional.adaptive_avg_pool2d(patch, cells)
            image[i : i + 1, :, low[1] : high[1], low[0] : high[0]] = torch.nn.functional.interpolate(
                small, patch.shape[-2:], mode="nearest"
            )

    def _truncate(self, visible: BoolArray, landmarks: Float32Array) -> tuple[BoolArray, list[tuple[int, BoolArray]]]:
        """Crops that reach over the border of the video: what is visible still, and where what is outside, (S, S)."""
        visible, outside = visible.copy(), []
        for i in np.nonzero(self.rng.random(len(visible)) < self.options.truncate)[0]:
            mask, (nx, ny, edge) = outside_of_video(self.rng, self.size, self.size)
            outside.append((int(i), mask))
            centred = landmarks[i] - (self.size - 1) / 2
            visible[i] &= ~(centred[:, 0] * nx + centred[:, 1] * ny > edge)
        return visible, outside
