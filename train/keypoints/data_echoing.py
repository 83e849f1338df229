"""Crops seen again while the next are being made (data echoing, Choi et al. 2019), where a GPU would wait for them.

A GPU trains on a batch in a third of the time in which sixteen processors make one. So it keeps the crops that it was
given, and as long as no new batch is there it trains on old ones, each time turned, moved, mirrored and lit anew.
"""

import contextlib
import queue
import threading
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from muybridge.train.images.compositor import MIRROR, turned

Batch = tuple[Tensor, ...]

# Crops of so many batches are mixed into one that is seen again.
_MIXED = 8
# Share of the GPU's free memory for what is kept.
_MEMORY = 0.5
# Spreads of how crops are altered: those of the training's own crops (`AugmentOptions`), once more. Half of the crops
# stay as sharp as they are: to turn one blurs it.
_MOVED = 0.5
_ROTATION_SD_DEG, _SCALE_SD, _SHIFT_SD = 7.0, 0.08, 0.03
_GAIN_SD, _TINT_SD, _GAMMA_SD = 0.15, 0.05, 0.15


class Echo(Iterator[Batch]):
    """New batches as they come, and old crops as long as none is there.

    Args:
        stream: batches of (B, 4, S, S) uint8 pixels, (B, J, 2) landmarks, px, (B, J) bool whether they are visible, and
            (B,) numbers; S may change from one to the next.
        device: where they are kept.
        times: how often a crop is seen at most, in the mean.
        seed: of what is drawn.
    """

    def __init__(self, stream: Iterator[Batch], device: torch.device, times: int, seed: int) -> None:
        self.times, self.device = times, device
        self.made = self.seen = 0
        self._rng = np.random.default_rng([seed, 3])
        self._kept: dict[int, list[Batch]] = defaultdict(list)
        self._free = _MEMORY * torch.cuda.mem_get_info()[0] if device.type == "cuda" else 1e9
        self._come: queue.Queue[Batch | BaseException] = queue.Queue(maxsize=4)
        self._closed = threading.Event()
        threading.Thread(target=self._fetch, args=(stream,), daemon=True).start()

    def close(self) -> None:
        """Nothing more is fetched."""
        self._closed.set()
        with contextlib.suppress(queue.Empty):
            while True:
                self._come.get_nowait()

    def _fetch(self, stream: Iterator[Batch]) -> None:
        try:
            for batch in stream:
                self._come.put(tuple(part.to(self.device) for part in batch))
                if self._closed.is_set():
                    return
            raise StopIteration
        except BaseException as error:  # the training raises it
            self._come.put(error)

    def __next__(self) -> Batch:
        if self.made and self._come.empty() and self.seen < self.times * self.made:
            batch = self._again()
        else:
            come = self._come.get()
            if isinstance(come, BaseException):
                raise come
            self.made += len(come[0])
            self._keep(come)
            batch = come
        self.seen += len(batch[0])
        return batch

    def _keep(self, batch: Batch) -> None:
        """Beside the others, or in place of one where there is no room."""
        same, size = self._kept[batch[0].shape[-1]], sum(part.nbytes for part in batch)
        if size <= self._free or not same:
            self._free -= size
            same.append(batch)
        else:
            same[self._rng.integers(len(same))] = batch

    def _again(self) -> Batch:
        sides = list(self._kept)
        share = np.array([len(self._kept[side]) for side in sides], float)
        same = self._kept[sides[self._rng.choice(len(sides), p=share / share.sum())]]
        count = len(same[0][0])
        parts = []
        for few in np.array_split(np.arange(count), min(_MIXED, count)):
            source = same[self._rng.integers(len(same))]
            chosen = torch.from_numpy(self._rng.choice(len(source[0]), len(few), replace=False)).to(self.device)
            parts.append(tuple(part[chosen] for part in source))
        pixels, landmarks, visible, *rest = (torch.cat(each) for each in zip(*parts, strict=True))
        return (*altered(pixels, landmarks, visible, self._rng), *rest)


def altered(
    pixels: Tensor, landmarks_px: Tensor, visible: Tensor, rng: np.random.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Crops turned, scaled, moved, mirrored and lit otherwise; beyond their border they are reflected.

    Args:
        pixels: (B, 4, S, S) uint8: red, green, blue, difference to the plate.
        landmarks_px: (B, J, 2), of body and surface.
        visible: (B, J) bool.
        rng: source of random numbers.

    Returns:
        the same of the new crops.
    """
    count, size, device = len(pixels), pixels.shape[-1], pixels.device
    flip = rng.random(count) < 0.5
    moved = rng.random(count) < _MOVED
    angle = np.radians(rng.normal(0, _ROTATION_SD_DEG, count)) * moved
    scale = np.exp(rng.normal(0, _SCALE_SD, count) * moved)
    linear = turned(angle, scale, flip)
    shift = rng.normal(0, _SHIFT_SD, (count, 2)) * moved[:, None]  # of the crop's side
    # From the new crop to the old one, in units of half of the side from the middle.
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
