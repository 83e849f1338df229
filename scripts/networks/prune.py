"""Prune a trained keypoint network: drop residual blocks, and channels within those that remain, whose contribution the
others take over by least squares. The outputs stay nearly the same; further training recovers most of the rest.

The cost of dropping something: Hassibi and Stork, "Second order derivatives for network pruning: optimal brain
surgeon", NIPS 1992. Layer-wise reconstruction: He, Zhang and Sun, "Channel pruning for accelerating very deep neural
networks", ICCV 2017.
"""

import copy
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from muybridge.errors import ModelError
from muybridge.models.keypoints.network import Block, KeypointNet

# Ridge relative to the mean square of the inputs, for a stable inverse.
_RIDGE = 1e-6
# Cells per image at most.
_CELLS = 256
# At most this share of the remaining channels is dropped at once.
_AT_ONCE = 1 / 32
_IMAGES_AT_ONCE = 8
_TAPS = 9  # of a 3x3 filter


@torch.no_grad()
def prune(net: KeypointNet, depths: Sequence[int], hidden: Sequence[int], images: Sequence[Tensor]) -> KeypointNet:
    """A network like `net` with fewer blocks and channels.

    Args:
        net: not changed.
        depths: residual blocks on the way down at each of the four resolutions; the last of each level are dropped.
        hidden: channels within the blocks at each of them, on the way down and up.
        images: batches (N, 4, S, S) in 0..1, like those in use.

    Raises:
        ModelError: more blocks or channels than there are, or no channels.
    """
    have = net.config
    for name, wanted, least in (("depths", depths, 0), ("hidden", hidden, 1)):
        if len(wanted) != len(have[name]) or any(not least <= w <= h for w, h in zip(wanted, have[name], strict=True)):
            raise ModelError(f"{name} {tuple(wanted)}: each may be from {least} to as many as there are, {have[name]}")
    out = copy.deepcopy(net).eval()
    for i, depth in enumerate(depths):
        level = list(out.levels[i].children())
        out.levels[i] = nn.Sequential(*level[: len(level) - have["depths"][i] + depth])
    # Laterals begin at the third resolution.
    for i, part in (*enumerate(out.levels), *zip((2, 1, 0), out.laterals, strict=True)):
        for block in [module for module in part.modules() if isinstance(module, Block)]:
            _prune_block(block, hidden[i], out, images)
    like = KeypointNet(**have | {"depths": tuple(depths), "hidden": tuple(hidden)})
    like.load_state_dict(out.state_dict())
    return like.eval()


def _prune_block(block: Block, count: int, net: nn.Module, images: Sequence[Tensor]) -> None:
    """Reduce a block of `net` to the `count` hidden channels that change its output least."""
    first, normalisation, second = block.first[0], block.first[1], block.second[0]
    assert isinstance(first, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d) and isinstance(second, nn.Conv2d)
    channels = first.out_channels
    if count == channels:
        return
    products = _products(block, net, images)
    outputs, whole = second.out_channels, second.weight.reshape(second.out_channels, -1).double()
    wanted = products[:, :-1] @ whole.T
    kept, weights = _select_channels(products, wanted, channels, count)
    index = torch.tensor(kept)
    block.first[0], block.second[0] = (
        nn.Conv2d(a, b, 3, 1, 1, bias=False) for a, b in ((first.in_channels, count), (count, outputs))
    )
    block.first[0].weight.copy_(first.weight[index])  # type: ignore[operator]
    block.second[0].weight.copy_(weights[:-1].T.reshape(outputs, count, 3, 3))  # type: ignore[operator]
    block.first[1] = type(normalisation)(count, normalisation.eps)
    for name in ("weight", "bias", "running_mean", "running_var"):
        getattr(block.first[1], name).data.copy_(getattr(normalisation, name)[index])
    block.first.eval()
    # The mean contribution of the dropped channels goes into the bias of the next normalisation.
    after = block.second[1]
    assert isinstance(after, nn.BatchNorm2d) and after.running_var is not None
    after.bias.add_(after.weight / torch.sqrt(after.running_var + after.eps) * weights[-1].float())


def _products(block: Block, net: nn.Module, images: Sequence[Tensor]) -> Tensor:
    """(9 C + 1, 9 C + 1) sums of products of the inputs of the second filters of a block, extended by a constant one
    for the mean."""
    total: Tensor | None = None
    generator = torch.Generator().manual_seed(0)

    def note(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        nonlocal total
        patches = nn.functional.unfold(inputs[0].float(), 3, padding=1)  # (N, 9 C, cells)
        some = torch.randperm(patches.shape[-1], generator=generator)[:_CELLS]
        rows = patches[:, :, some].transpose(1, 2).flatten(0, 1).double()
        rows = torch.cat([rows, torch.ones(len(rows), 1, dtype=torch.double)], 1)
        total = rows.T @ rows if total is None else total + rows.T @ rows

    hook = block.second.register_forward_pre_hook(note)
    for batch in images:
        for part in torch.split(batch, _IMAGES_AT_ONCE):
            net(part)
    hook.remove()
    assert total is not None
    total.diagonal().add_(_RIDGE * total.diagonal().mean())
    return total


def _select_channels(products: Tensor, wanted: Tensor, channels: int, count: int) -> tuple[list[int], Tensor]:
    """Indices of the `count` channels to keep, and the weights (9 count + 1, outputs) that compensate for the
    others."""
    kept, whole = list(range(channels)), len(products) - 1

    def rows() -> Tensor:
        return torch.tensor([_TAPS * c + tap for c in kept for tap in range(_TAPS)] + [whole])

    while True:
        at = rows()
        inverse = torch.linalg.inv(products[at][:, at])
        weights = inverse @ wanted[at]
        if len(kept) == count:
            return kept, weights
        # Increase of the error of the best weights without each channel.
        parts = [slice(_TAPS * c, _TAPS * (c + 1)) for c in range(len(kept))]
        cost = torch.stack([(weights[p] * torch.linalg.solve(inverse[p, p], weights[p])).sum() for p in parts])
        going = min(max(1, int(_AT_ONCE * len(kept))), len(kept) - count)
        for index in sorted(cost.argsort()[:going].tolist(), reverse=True):
            kept.pop(index)
