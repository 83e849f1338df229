"""From renders to training crops: composition on backgrounds, occlusion and camera faults.

Whole batches at a time; random numbers come from a NumPy generator, so that a seed gives the same labels anywhere and
the same pixels on one machine.
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
from muybridge.train.images.background_difference import BackgroundDifferences
from muybridge.train.images.backgrounds import sample_backdrop
from muybridge.train.images.clutter import add_clutter, tile_by_mirroring
from muybridge.train.images.compositing import BaseCompositor, touched_sides
from muybridge.train.images.film import Film, develop, sample_films
from muybridge.train.images.occlusion import (
    draw_occluders,
    frame_people,
    loosen,
    map_borders,
    pixelate_faces,
    truncate,
)
from muybridge.train.images.options import AugmentOptions
from muybridge.train.synthesis.rendering.close_ups import BORDER, OCCLUDER, cut_boxes, map_cuts
from muybridge.train.synthesis.rendering.store import RenderSet

MIRROR = np.array([*BODY23.mirror, *(len(BODY23) + i for i in SURFACE.mirror)])


@dataclass(frozen=True)
class Batch:
    """Training crops.

    Attributes:
        image: (B, 3, S, S) uint8 RGB.
        difference: (B, 1, S, S) uint8 to the background model, zero where there is none.
        landmarks_px: (B, 23, 2).
        visible: (B, 23) bool.
        markers_px: (B, M, 2) of the body's surface, NaN where a render has none.
        markers_visible: (B, M) bool.
    """

    image: Tensor
    difference: Tensor
    landmarks_px: Tensor
    visible: Tensor
    markers_px: Tensor
    markers_visible: Tensor

    @property
    def pixels(self) -> Tensor:
        """(B, 4, S, S) uint8: the input of the network."""
        return torch.cat([self.image, self.difference], 1)


def linear_maps(angle: FloatArray, scale: FloatArray, flip: BoolArray) -> FloatArray:
    """(n, 2, 2) maps that mirror x where `flip` (n,), then rotate by `angle` (n,), radians, and scale by `scale`
    (n,)."""
    cos, sin = np.cos(angle) * scale, np.sin(angle) * scale
    linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    linear[:, :, 0] *= np.where(flip, -1, 1)[:, None]
    return linear


# Images composited together: the intermediate results fit into the processor's cache.
_AT_ONCE = 8


class Compositor(BaseCompositor):
    """Makes batches of crops from renders and backgrounds.

    Args:
        renders: people.
        backgrounds: (N, 3, S, S) pool.
        size: side of the crops, px.
        seed: random seed.
        options: of the augmentation.
    """

    def __init__(
        self,
        renders: RenderSet,
        backgrounds: ByteArray,
        size: int,
        seed: int,
        options: AugmentOptions = AugmentOptions(),  # noqa: B008 - frozen
    ) -> None:
        super().__init__(renders, backgrounds, seed)
        self.size, self.options = size, options
        # With a generator of its own: images of a seed are the same with and without background differences.
        self.differences = BackgroundDifferences(np.random.default_rng([seed, 1]))

    def batch(self, count: int, index: IndexArray | None = None) -> Batch:
        """`count` crops of random renders, or of the renders `index`, which must show people."""
        index = self.people[self.rng.integers(0, len(self.people), count)] if index is None else index
        parts = [self._few(index[i : i + _AT_ONCE]) for i in range(0, count, _AT_ONCE)]
        return Batch(*(torch.cat(arrays) for arrays in zip(*parts, strict=True)))

    def _few(self, index: IndexArray) -> tuple[Tensor, ...]:
        """Crops that are composited together, as the fields of `Batch`."""
        rng, opt, count = self.rng, self.options, len(index)
        made = self.renders.cut_px[index]
        box, lines = cut_boxes(rng, self.renders.box_px[index], opt.close_up, made)
        box, borders = frame_people(rng, box, opt.framed, np.isnan(lines[:, 0]))
        # Pictures are rotated upright where the camera's roll is known, and left as they are elsewhere.
        upright = np.isfinite(borders).any(1) & (rng.random(count) < 0.6) if opt.framed else None
        self._end_with_render(index, borders)
        matrix, flip = self._placement(loosen(rng, box, opt.loose), upright=upright)
        cuts = map_cuts(rng, lines, matrix, np.isfinite(made[:, 0]))
        frames = map_borders(borders, matrix)
        person, landmarks, visible = self._warp(index, matrix, flip)
        plate = self._background(count, opt.clutter)
        lit = self._backdrops(plate)
        image, before, hidden = self._compose(person, plate, landmarks, self.is_scene[index])
        visible &= ~hidden & ~cuts.hidden(landmarks) & ~frames.hidden(landmarks)
        for i in cuts.chosen(OCCLUDER):
            mask = torch.from_numpy(cuts.mask(i, self.size))
            image[i, :, mask] = self._background(1)[0, :, mask]
            before[i, :, mask] = 1
        light = self._light(count)
        films = sample_films(rng, count, (opt.monochrome, opt.toned, opt.faded))
        difference = self._difference(image, plate, person, before, light, films)
        image = self.faults.apply(image, light, lit) if opt.faults else image
        visible, outside = truncate(visible, landmarks, self.size, opt.truncate, rng)
        pixels = image.clamp_(0, 1).mul_(255).round_().to(torch.uint8)
        develop(pixels, films, self.faults)
        if opt.faults:
            self.faults.resample(pixels, opt.far, opt.crisp)
            pixels = self.faults.compress(pixels, films)
        outside += [(int(i), cuts.mask(i, self.size)) for i in cuts.chosen(BORDER)]
        outside += [(int(i), frames.mask(i, self.size)) for i in frames.near]
        for i, beyond in outside:  # after compression: crops are cut from compressed pictures
            for layer in (pixels, difference):
                layer[i, :, torch.from_numpy(beyond)] = 0
        inside = ((landmarks >= 0) & (landmarks <= self.size - 1)).all(-1)
        at, seen = torch.from_numpy(landmarks), torch.from_numpy(visible & inside)
        body = len(BODY23)
        return pixels, difference, at[:, :body], seen[:, :body], at[:, body:], seen[:, body:]

    def _compose(
        self, person: Tensor, plate: Tensor, landmarks: Float32Array, scene: BoolArray
    ) -> tuple[Tensor, Tensor, BoolArray]:
        """Put people in front of backgrounds, others and objects behind and in front of them.

        Args:
            person: (B, 5 or 6, S, S) layers of the renders.
            plate: (B, 3, S, S) backgrounds.
            landmarks: (B, J, 2).
            scene: (B,) renders of scenes, to which less is added.

        Returns:
            (B, 3, S, S) pictures; (B, 1, S, S) opacity of objects in front of people; and (B, J) landmarks that are
            behind something that was added.
        """
        rng, opt, count = self.rng, self.options, len(person)
        shade = person[:, 4:5] * self._column(rng.uniform(0, 0.6, count))
        image = torch.addcmul(plate, plate, shade, value=-1)
        rarer = np.where(scene, opt.scene_others, 1.0)
        chance = rng.random(count) / np.maximum(rarer, 1e-9) if len(self.whole) else np.ones(count)
        other, close = chance < opt.second_person + opt.embrace, chance >= opt.second_person
        in_front = rng.random(count) < 0.4
        front = self._second_person(image, other, close, in_front) if other.any() else None
        image.mul_(1 - person[:, 3:4]).add_(person[:, :3])
        hidden = np.zeros(landmarks.shape[:2], bool)
        if front is not None:
            hidden |= self._alpha_at(front[:, 3].numpy(), landmarks) > 0.5
            image.mul_(1 - front[:, 3:4]).add_(front[:, :3])
        occluders = draw_occluders(image, opt.occluder * rarer, self._background, rng)
        hidden |= self._alpha_at(occluders, landmarks) > 0.5
        pixelate_faces(image, landmarks, opt.mosaic, rng)
        return image, torch.from_numpy(occluders)[:, None], hidden

    def _end_with_render(self, index: IndexArray, borders: Float32Array) -> None:
        """Let the picture end where people or things of the scenes among the renders `index` (B,) continue beyond the
        render, whose sides become `borders` (B, 4), in place."""
        for k in np.flatnonzero(self.is_scene[index]):
            planes = self.renders.pixels_of(int(index[k]))
            height, width = planes.shape[1:]
            left, top, right, bottom = np.where(touched_sides(planes), [0, 0, width - 1, height - 1], np.nan)
            low, high = np.fmax(borders[k, :2], [left, top]), np.fmin(borders[k, 2:], [right, bottom])
            borders[k] = [*low, *high]

    def _light(self, count: int) -> Float32Array:
        """(B, 3) relative red, green and blue light that reaches the camera: full, too little, or tinted."""
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
        """Replace the backgrounds (B, 3, S, S) of a share of the crops by backdrops, in place. Returns (B,) where
        lights and exposure are set for the person, not for the background."""
        chosen = np.zeros(len(plate), bool)
        if self.options.backdrop:
            chosen = self.rng.random(len(plate)) < self.options.backdrop
            for i in np.nonzero(chosen)[0]:
                plate[i] = torch.from_numpy(sample_backdrop(self.rng, self.size).transpose(2, 0, 1))
            chosen &= self.rng.random(len(plate)) < 0.7
        return chosen

    def _difference(
        self, image: Tensor, plate: Tensor, person: Tensor, before: Tensor, light: Float32Array, films: dict[int, Film]
    ) -> Tensor:
        """(B, 1, S, S) uint8 difference to the background model, for a share of the crops.

        Args:
            image, plate: (B, 3, S, S) with and without people.
            person: (B, 5 or 6, S, S) layers of the renders.
            before: (B, 1, S, S) what is in front of the person: part of the room, or held or carried.
            light: as of `_light`.
            films: of some of the crops.
        """
        known = torch.from_numpy(np.nonzero(self.differences.rng.random(len(image)) < self.options.plate)[0])
        difference = torch.zeros(before.shape, dtype=torch.uint8)
        if len(known):
            static = before[known] * self._column(self.differences.rng.random(len(known)) < 0.6)
            if person.shape[1] > 5:  # a chair stays where it is, a racket does not
                still = self.differences.rng.random(len(known)) < self.options.static_things
                static = torch.maximum(static, person[known, 5:] * self._column(still))
            empty = plate[known]
            self.differences.add_people(empty, person[known], static)
            slopes = {k: films[i].slopes for k, i in enumerate(known.tolist()) if i in films}
            difference[known] = self.differences.difference(image[known], empty, static, light[known.numpy()], slopes)
        return difference

    def _column(self, values: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(np.asarray(values, np.float32)).view(-1, 1, 1, 1)

    def _placement(
        self, box: Float32Array, aside: FloatArray | None = None, upright: BoolArray | None = None
    ) -> tuple[Float32Array, BoolArray]:
        """Random positions of people in crops.

        Args:
            box: (B, 4) bounding boxes in the renders.
            aside: (B, 2) range of a sideways shift, as shares of the crop.
            upright: (B,) people who are not rolled.

        Returns:
            crop_from_render (B, 2, 3) affine maps in pixels, and which are mirrored.
        """
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
        angle = angle if upright is None else np.where(upright, 0, angle)
        flip = rng.random(n) < 0.5
        linear = linear_maps(angle, scale, flip)
        middle = (size - 1) / 2 + shift
        matrix = np.concatenate([linear, (middle - np.einsum("nij,nj->ni", linear, center))[..., None]], -1)
        return matrix.astype(np.float32), flip

    def _warp(self, index: IndexArray, matrix: Float32Array, flip: BoolArray) -> tuple[Tensor, Float32Array, BoolArray]:
        """Renders in the crop (B, 5, S, S) in 0..1, or (B, 6, S, S) if there are scenes among them; landmarks of body
        and surface, and their visibility. Renders are black outside the person, so their colours are premultiplied by
        alpha."""
        size, layers = self.size, 6 if self.is_scene[index].any() else 5
        warped = np.empty((len(index), layers, size, size), np.uint8)
        for k, i in enumerate(index):
            for plane, out in zip(self.renders.pixels_of(i)[:layers], warped[k], strict=True):
                cv2.warpAffine(plane, matrix[k], (size, size), dst=out, flags=cv2.INTER_LINEAR)
        landmarks = np.concatenate([self.renders.landmarks_px[index], self.renders.markers_px[index]], 1)
        landmarks = np.einsum("nij,nkj->nki", matrix[:, :, :2], landmarks) + matrix[:, None, :, 2]
        visible = np.concatenate([self.renders.visible[index], self.renders.markers_visible[index]], 1)
        landmarks[flip], visible[flip] = landmarks[flip][:, MIRROR], visible[flip][:, MIRROR]
        return torch.from_numpy(warped).float().div_(255), landmarks.astype(np.float32), visible

    def _background(self, count: int, clutter: float = 0.0) -> Tensor:
        """Random windows of the background pool, a share of them with clutter."""
        pictures = np.stack([self._window() for _ in range(count)])
        for i in np.nonzero(self.rng.random(count) < clutter)[0]:
            add_clutter(pictures[i], 6, self._window, self.rng)
        return torch.from_numpy(pictures.transpose(0, 3, 1, 2).astype(np.float32)).div_(255)

    def _window(self) -> ByteArray:
        """(size, size, 3) of one background. Half of them are not enlarged: otherwise blur would separate people from
        what is behind them."""
        rng, size, pool = self.rng, self.size, self.backgrounds
        source, b = pool.shape[-1], int(rng.integers(len(pool)))
        if rng.random() < 0.5:
            return tile_by_mirroring(np.ascontiguousarray(pool[b].transpose(1, 2, 0)), size, size, rng)
        window = int(rng.integers(size // 2, source + 1))
        patch = self._patch(b, self._corner(window), window)
        interpolation = cv2.INTER_AREA if window > size else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(patch, (size, size), interpolation=interpolation), np.uint8)

    def _alpha_at(self, alpha: Float32Array, landmarks: Float32Array) -> Float32Array:
        at = np.round(np.nan_to_num(landmarks)).astype(int).clip(0, self.size - 1)
        out: Float32Array = alpha[np.arange(len(alpha))[:, None], at[..., 1], at[..., 0]]
        return out

    def _second_person(self, image: Tensor, other: BoolArray, close: BoolArray, in_front: BoolArray) -> Tensor:
        """Add another person to crops.

        Args:
            image: (B, 3, S, S); people behind the subject are drawn into it.
            other: (B,) crops with another person.
            close: (B,) whether they are in a hold with the subject, else beside.
            in_front: (B,) whether they are in front.

        Returns:
            (B, 4, S, S) layer of people in front, to be drawn after the subject.
        """
        chosen = np.nonzero(other)[0]
        index = self.rng.choice(self.whole, len(chosen))
        # Not in the middle if in front of the subject: it would be unclear whose crop it is.
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
