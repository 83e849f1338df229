"""Designs of the keypoint network, trained from nothing for equal processor time on the same stream of crops.

    python scripts/compare_designs.py --minutes 8 --size 128 [--only u-shape ...]

- `u-shape`: the shipped design, dense 3x3 convolutions, heatmaps at a quarter of the resolution;
- `depthwise`: the same shape with separable convolutions, wider for about the same number of parameters;
- `simcc`: the way down of the shipped design, then one row and one column of bins a landmark at half of a pixel
  (Li et al. 2022), no way up;
- `coarse`: the shipped design with heatmaps at an eighth of the resolution, its width spent deeper down;
- `u-shape, AdamW`: the shipped design, all of its parameters trained with AdamW; the others have Muon for their
  filters, as in `muybridge train`.

Processor time of the training thread counts, not wall-clock time, so that other work on the machine favours none.
Prints a Markdown table.
"""

import argparse
import pathlib
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from muybridge.geometry.landmarks.arrays import BODY23
from muybridge.models.keypoints.network import CHANNELS, ConvUnit, KeypointNet
from muybridge.train.engine import loop
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.engine.muon import Optimisers
from muybridge.train.engine.precision import autocast
from muybridge.train.synthesis.rendering.store import load_renders

J = len(BODY23)
RATE = 1.5e-3
MIRROR = torch.tensor(BODY23.mirror)


class Separable(nn.Sequential):
    """Depthwise 3x3 and pointwise convolution, each with normalisation and ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, inputs, 3, stride, 1, groups=inputs, bias=False), nn.BatchNorm2d(inputs), nn.ReLU(True),
            nn.Conv2d(inputs, outputs, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(True),
        )  # fmt: skip


def depthwise() -> nn.Module:
    """The U-shaped net with every 3x3 convolution but the first made separable."""
    net = KeypointNet(J, widths=(64, 128, 288, 448))

    def convert(module: nn.Module) -> None:
        for name, child in module.named_children():
            if isinstance(child, nn.Conv2d) and child.kernel_size == (3, 3) and child.in_channels > CHANNELS:
                a, b, s = child.in_channels, child.out_channels, child.stride[0]
                parts = nn.Conv2d(a, a, 3, s, 1, groups=a, bias=False), nn.BatchNorm2d(a), nn.ReLU(True)
                setattr(module, name, nn.Sequential(*parts, nn.Conv2d(a, b, 1, bias=False)))
            else:
                convert(child)

    convert(net)
    return net


class Simcc(nn.Module):
    """The shipped net's way down; a linear layer gives each landmark's bins along x and y."""

    def __init__(self, size: int, bins_a_pixel: int = 2) -> None:
        super().__init__()
        self.body = KeypointNet(J)
        self.size, self.bins = size, bins_a_pixel
        cells = (size // 32) ** 2
        self.reduce = ConvUnit(160, 4 * J)
        self.x, self.y = (nn.Linear(4 * cells, size * bins_a_pixel) for _ in range(2))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3, S, S) -> logits (N, J, 2 S) along x and along y."""
        x = self.body.stem(image)
        for level in self.body.levels:
            x = level(x)
        flat = self.reduce(x).reshape(len(x), J, -1)
        return self.x(flat), self.y(flat)


class Coarse(nn.Module):
    """Heatmaps at an eighth of the resolution."""

    def __init__(self) -> None:
        super().__init__()
        self.net = KeypointNet(J, widths=(32, 72, 136, 160), depths=(1, 2, 3, 2))
        del self.net.laterals[2]
        self.net.head = nn.Conv2d(72, J, 1)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3, S, S) -> logits (N, J, S / 8, S / 8), visibility."""
        net = self.net
        x = net.stem(image)
        features = []
        for level in net.levels:
            x = level(x)
            features.append(x)
        visibility = net.visibility(x.mean((2, 3)))
        for lateral, fine in zip(net.laterals, features[2:0:-1], strict=True):
            x = lateral(x, fine)
        return net.head(x), visibility


def bins_loss(logits: Tensor, place: Tensor, sigma: float) -> Tensor:
    """Cross-entropy (B, J) of logits (B, J, n) against Gaussians of `sigma` bins at `place` (B, J)."""
    at = torch.arange(logits.shape[-1], device=logits.device)
    target = torch.exp(-((at - place[..., None]) ** 2) / (2 * sigma**2))
    target = target / (target.sum(-1, keepdim=True) + 1e-9)
    return -(target * torch.log_softmax(logits.float(), -1)).sum(-1)


def loss_of(net: nn.Module, batch: Batch) -> Tensor:
    """The same weighting for all: hidden landmarks count a third, those outside of the crop nothing."""
    with autocast(batch.pixels.device):
        first, second = net(batch.pixels.float().div(255).contiguous(memory_format=torch.channels_last))
    at, size = batch.landmarks_px, batch.image.shape[-1]
    inside = ((at > 0) & (at < size - 1)).all(-1)
    if first.ndim == 3:
        per_px = first.shape[-1] / size
        each = bins_loss(first, (at[..., 0] + 0.5) * per_px - 0.5, 4.0) + bins_loss(
            second, (at[..., 1] + 0.5) * per_px - 0.5, 4.0)  # fmt: skip
    else:
        stride = size / first.shape[-1]
        cell = (at + 0.5) / stride - 0.5
        h, w = first.shape[-2:]
        gauss = [torch.exp(-((torch.arange(n) - cell[..., k, None]) ** 2) / (2 * 0.8**2)) for k, n in ((0, w), (1, h))]
        x, y = (g / (g.sum(-1, keepdim=True) + 1e-9) for g in gauss)
        log_p = torch.log_softmax(first.float().flatten(2), -1).view_as(first)
        each = -torch.einsum("bjyx,bjx,bjy->bj", log_p, x, y)
    weight = (0.35 + 0.65 * batch.visible.float()) * inside
    return (each * weight).mean()


def decode(first: Tensor, second: Tensor, size: int) -> Tensor:
    """Pixels (B, J, 2) of the modes, refined by the centre of mass of their neighbourhood."""
    if first.ndim == 3:
        return torch.stack([(m.argmax(-1) + 0.5) * size / m.shape[-1] - 0.5 for m in (first, second)], -1)
    n, j, h, w = first.shape
    p = first.float().flatten(2).softmax(-1).view(n, j, h, w)
    best = p.flatten(2).argmax(-1)
    u, v = best % w, best // w
    x, y = torch.arange(w), torch.arange(h)
    near = ((x - u[..., None]).abs() <= 2).float()[:, :, None] * ((y - v[..., None]).abs() <= 2).float()[..., None]
    p = p * near
    p = p / p.sum((2, 3), keepdim=True)
    cell = torch.stack([(p * x).sum((2, 3)), (p * y[:, None]).sum((2, 3))], -1)
    return (cell + 0.5) * (size / w) - 0.5


@torch.no_grad()
def score(net: nn.Module, batches: list[Batch]) -> dict[str, float]:
    """Median error, PCK at 5 % of the box and swaps on held-out crops."""
    net.eval()
    error, swap = [], []
    for batch in batches:
        with autocast(batch.pixels.device):
            out = net(batch.pixels.float().div(255).contiguous(memory_format=torch.channels_last))
        at = decode(*out, batch.image.shape[-1])
        distance = (at - batch.landmarks_px).norm(dim=-1)
        twin = (at - batch.landmarks_px[:, MIRROR]).norm(dim=-1)
        error.append(distance[batch.visible])
        swap.append((twin < distance)[:, 5:][batch.visible[:, 5:]])
    side = batches[0].image.shape[-1] / 1.25
    e, s = torch.cat(error), torch.cat(swap).float()
    pck = (e < 0.05 * side).float().mean()
    return {"median px": float(e.median()), "PCK@0.05": float(pck), "swaps": float(s.mean())}


def train(make: Callable[[], nn.Module], muon: bool, options: argparse.Namespace) -> tuple[nn.Module, int]:
    """A design trained for `options.minutes` of processor time; the images are made outside of the account."""
    torch.manual_seed(0)
    net = make().to(memory_format=torch.channels_last)
    optimiser = Optimisers(net, RATE, muon=muon)
    store = load_renders(options.renders, loop.TRAINED_ON)
    compositor = Compositor(store, np.load(options.pool, mmap_mode="r"), options.size, 5)
    used, images, budget, step = 0.0, 0, options.minutes * 60, 0
    average = loop.AveragedWeights(net)
    while used < budget:
        batch = compositor.batch(32)
        began = time.process_time()
        net.train()
        optimiser.set_rate(loop.learning_rate(RATE, step, used, budget, 0.4))
        net.zero_grad(set_to_none=True)
        loss_of(net, batch).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        average.update(net, step)
        used += time.process_time() - began
        images, step = images + 32, step + 1
    net.load_state_dict(average.state)
    return net, images


def speed(net: nn.Module, size: int) -> float:
    """Crops a second of processor time in evaluation, float32, batches of 16."""
    net.eval()
    image = torch.rand(16, CHANNELS, size, size).contiguous(memory_format=torch.channels_last)
    with torch.inference_mode():
        net(image)
        began = time.process_time()
        for _ in range(5):
            net(image)
    return 80 / (time.process_time() - began)


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--renders", type=pathlib.Path, default=pathlib.Path("runs/renders"))
    parser.add_argument("--pool", type=pathlib.Path, default=pathlib.Path("runs/pool-5000-0.npy"))
    parser.add_argument("--only", nargs="+", help="names of designs")
    options = parser.parse_args()
    torch.set_num_threads(1)
    held_out, pool = load_renders(options.renders, loop.HELD_OUT), np.load(options.pool, mmap_mode="r")
    batches = [Compositor(held_out, pool, options.size, 10_000 + i).batch(64) for i in range(8)]
    print("| design | parameters | images seen | images/s | median px | PCK@0.05 of the box | swaps | crops/s in use |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)
    designs: dict[str, Callable[[], nn.Module]] = {
        "u-shape": lambda: KeypointNet(J), "depthwise": depthwise, "simcc": lambda: Simcc(options.size),
        "coarse": Coarse, "u-shape, AdamW": lambda: KeypointNet(J),
    }  # fmt: skip
    for name, make in designs.items():
        if options.only and name not in options.only:
            continue
        net, images = train(make, not name.endswith("AdamW"), options)
        s, parameters = score(net, batches), sum(p.numel() for p in net.parameters()) / 1e6
        rate = images / options.minutes / 60
        print(f"| {name} | {parameters:.2f} M | {images:,} | {rate:.0f} | {s['median px']:.2f} | {s['PCK@0.05']:.3f} "
              f"| {s['swaps']:.3f} | {speed(net, options.size):.0f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
