"""Data echoing (Choi et al. 2019): train on crops again while a GPU would otherwise wait for new ones.

A GPU trains on a batch in a third of the time in which sixteen processors make one. So it keeps the crops that it
received and, as long as there is no new batch, trains on old ones, each time rotated, translated, mirrored and relit at
random.
"""

import contextlib
import queue
import threading
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from muybridge.train.images.compositor import MIRROR, linear_maps

Batch = tuple[Tensor, ...]

# Number of batches whose crops are mixed into an echoed one.
_SOURCES = 8
# Share of the GPU's free memory for stored crops.
_MEMORY = 0.5
# Standard deviations of the changes, which add to those of the training's own crops (`AugmentOptions`). Half of the
# crops are not moved, since resampling blurs.
_MOVED_SHARE = 0.5
_ROTATION_SD_DEG, _SCALE_SD, _SHIFT_SD = 7.0, 0.08, 0.03
_GAIN_SD, _TINT_SD, _GAMMA_SD = 0.15, 0.05, 0.15


class Echo(Iterator[Batch]):
    """New batches as they arrive, and augmented old crops as long as there is none.

    Args:
        stream: batches of (B, 4, S, S) uint8 pixels, (B, J, 2) landmarks, px, (B, J) bool visibility, and (B,) numbers;
            S may vary between batches.
        device: where crops are kept.
        times: mean number of times a crop is used at most.
        seed: random seed.
    """

    def __init__(self, stream: Iterator[Batch], device: torch.device, times: int, seed: int) -> None:
        self.times, self.device = times, device
        self.fresh = self.used = 0
        self._rng = np.random.default_rng([seed, 3])
        self._kept: dict[int, list[Batch]] = defaultdict(list)
        self._free = _MEMORY * torch.cuda.mem_get_info()[0] if device.type == "cuda" else 1e9
        self._queue: queue.Queue[Batch | BaseException] = queue.Queue(maxsize=4)
        self._closed = threading.Event()
        threading.Thread(target=self._fetch, args=(stream,), daemon=True).start()

    def close(self) -> None:
        """Stop fetching batches."""
        self._closed.set()
        with contextlib.suppress(queue.Empty):
            while True:
                self._queue.get_nowait()

    def _fetch(self, stream: Iterator[Batch]) -> None:
        try:
            for batch in stream:
                self._queue.put(tuple(part.to(self.device) for part in batch))
                if self._closed.is_set():
                    return
            raise StopIteration
        except BaseException as error:  # raised in the training thread
            self._queue.put(error)

    def __next__(self) -> Batch:
        if self.fresh and self._queue.empty() and self.used < self.times * self.fresh:
            batch = self._echo()
        else:
            item = self._queue.get()
            if isinstance(item, BaseException):
                raise item
            self.fresh += len(item[0])
            self._keep(item)
            batch = item
        self.used += len(batch[0])
        return batch

    def _keep(self, batch: Batch) -> None:
        """Store a batch, in place of another one if memory is full."""
        same, size = self._kept[batch[0].shape[-1]], sum(part.nbytes for part in batch)
        if size <= self._free or not same:
            self._free -= size
            same.append(batch)
        else:
            same[self._rng.integers(len(same))] = batch

    def _echo(self) -> Batch:
        sides = list(self._kept)
        share = np.array([len(self._kept[side]) for side in sides], float)
        same = self._kept[sides[self._rng.choice(len(sides), p=share / share.sum())]]
        count = len(same[0][0])
        parts = []
        for few in np.array_split(np.arange(count), min(_SOURCES, count)):
            source = same[self._rng.integers(len(same))]
            chosen = torch.from_numpy(self._rng.choice(len(source[0]), len(few), replace=False)).to(self.device)
            parts.append(tuple(part[chosen] for part in source))
        pixels, landmarks, visible, *rest = (torch.cat(each) for each in zip(*parts, strict=True))
        return (*augment(pixels, landmarks, visible, self._rng), *rest)


def augment(
    pixels: Tensor, landmarks_px: Tensor, visible: Tensor, rng: np.random.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Crops rotated, scaled, translated, mirrored and relit at random; reflected beyond their border.

    Args:
        pixels: (B, 4, S, S) uint8: red, green, blue, difference to the background model.
        landmarks_px: (B, J, 2), of body and surface.
        visible: (B, J) bool.
        rng: source of random numbers.

    Returns:
        The same for the new crops.
    """
    count, size, device = len(pixels), pixels.shape[-1], pixels.device
    flip = rng.random(count) < 0.5
    moved = rng.random(count) < _MOVED_SHARE
    angle = np.radians(rng.normal(0, _ROTATION_SD_DEG, count)) * moved
    scale = np.exp(rng.normal(0, _SCALE_SD, count) * moved)
    linear = linear_maps(angle, scale, flip)
    shift = rng.normal(0, _SHIFT_SD, (count, 2)) * moved[:, None]  # relative to the side of the crop
    # From the new crop to the old one, in units of half a side from the centre.
    back = np.linalg.inv(linear)
    theta = np.concatenate([back, -2 * back @ shift[..., None]], -1)
    theta_, linear_, shift_, flip_ = (torch.from_numpy(a).to(device) for a in (theta, linear, shift * (size - 1), flip))
    grid = torch.nn.functional.affine_grid(theta_.float(), [count, 4, size, size], align_corners=True)
    new = torch.nn.functional.grid_sample(pixels.float(), grid, padding_mode="reflection", align_corners=True)
    gain = rng.normal(0, _GAIN_SD, (count, 1)) + rng.normal(0, _TINT_SD, (count, 3))
    power = np.exp(rng.normal(0, _GAMMA_SD, (count, 1)))
    lit = torch.from_numpy(np.stack([np.exp(gain), np.broadcast_to(power, gain.shape)])).to(device).float()
    colour = (new[:, :3] / 255).clamp_(0, 1) ** lit[1, :, :, None, None] * lit[0, :, :, None, None]
    new[:, :3] = 255 * colour
    middle = (size - 1) / 2
    at = (linear_.float() @ (landmarks_px - middle).mT).mT + middle + shift_.float()[:, None]
    mirror = torch.from_numpy(MIRROR).to(device)
    at = torch.where(flip_[:, None, None], at[:, mirror], at)
    seen = torch.where(flip_[:, None], visible[:, mirror], visible)
    seen &= ((at >= 0) & (at <= size - 1)).all(-1)
    out = new.clamp_(0, 255).round_().to(torch.uint8)
    return out.contiguous(memory_format=torch.channels_last), at, seen
