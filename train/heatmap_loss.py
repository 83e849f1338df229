"""Cross-entropy of heatmaps against small Gaussians, written for a CPU: half the time of the same in plain torch."""

import math
from typing import Any

import torch
from torch import Tensor

from muybridge.models.keypoint_net import STRIDE

# Cells on each side of a landmark that its Gaussian reaches (five sigma).
REACH = 4
# Of the loss of landmarks outside of the crop, beside those inside.
OUTSIDE = 0.5


def heatmap_loss(logits: Tensor, landmarks_px: Tensor, sigma: float = 0.8) -> Tensor:
    """Cross-entropy (B, J) of heatmap logits (B, J, h, w) against Gaussians of `sigma` cells round `landmarks_px`
    (B, J, 2); zero for landmarks that are unknown (NaN). Of a landmark outside of the crop nothing is to be said: its
    loss is that of an even distribution, less what the best answer has, times `OUTSIDE`."""
    cells, target = _targets(landmarks_px, logits.shape[-2], logits.shape[-1], sigma)
    outside = landmarks_px.isfinite().all(-1) & (target.sum(-1) == 0)
    args = logits.permute(0, 2, 3, 1), cells, target, OUTSIDE * outside
    if torch.compiler.is_compiling():
        return _cross_entropy(*args)
    out: Tensor = _CrossEntropy.apply(*args)  # type: ignore[no-untyped-call]
    return out


def _cross_entropy(logits: Tensor, cells: Tensor, target: Tensor, even: Tensor) -> Tensor:
    """What `_CrossEntropy` is, for a compiler, which fuses it by itself."""
    logits = logits.flatten(1, 2)
    precise = logits.float()
    whole = torch.logsumexp(precise, 1)
    near = logits.gather(1, cells.transpose(1, 2)).float().transpose(1, 2)
    flat = whole - precise.mean(1) - math.log(precise.shape[1])
    return target.sum(-1) * whole - (near * target).sum(-1) + even * flat


def _targets(landmarks_px: Tensor, h: int, w: int, sigma: float) -> tuple[Tensor, Tensor]:
    """Cells (B, J, K), row by row, that the Gaussians reach, and their probabilities (B, J, K): sums of 1 or 0."""
    size = torch.tensor([w, h], device=landmarks_px.device)
    cell = (landmarks_px - (STRIDE - 1) / 2) / STRIDE
    inside = ((cell > -0.5) & (cell < size - 0.5)).all(-1)
    cell = torch.where(inside[..., None], cell, 0.0)
    near = cell.round()[..., None] + torch.arange(-REACH, REACH + 1, device=cell.device)  # (B, J, 2, 2 REACH + 1)
    share = torch.exp(-((near - cell[..., None]) ** 2) / (2 * sigma**2)) * ((near >= 0) & (near < size[:, None]))
    share = share / share.sum(-1, keepdim=True) * inside[..., None, None]
    x, y = torch.minimum(near.clamp(min=0), size[:, None] - 1).long().unbind(-2)
    target = share[..., 1, :, None] * share[..., 0, None, :]
    return (y[..., :, None] * w + x[..., None, :]).flatten(-2), target.flatten(-2)


class _CrossEntropy(torch.autograd.Function):
    """log-sum-exp of all cells less the expected logit. The logits are read once, the exponentials kept for the
    gradient, softmax minus target, which is written in the logits' own precision and memory order."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, cells: Tensor, target: Tensor, even: Tensor) -> Tensor:
        """(B, h, w, J), (B, J, K), (B, J, K), (B, J) weight of an even distribution -> (B, J)."""
        exponentials = logits.to(torch.float32, copy=True, memory_format=torch.contiguous_format)
        top = exponentials.amax((1, 2), keepdim=True)
        exponentials.sub_(top).exp_()
        total, mass = exponentials.sum((1, 2)), target.sum(-1)
        near = logits.flatten(1, 2).gather(1, cells.transpose(1, 2)).float().transpose(1, 2)
        ctx.save_for_backward(exponentials, total, cells, target, mass, even)
        ctx.dtype = logits.dtype
        whole = total.log() + top[:, 0, 0]
        loss = mass * whole - (near * target).sum(-1)
        if even.any():
            count = logits.shape[1] * logits.shape[2]
            loss += even * (whole - logits.sum((1, 2), dtype=torch.float32) / count - math.log(count))
        return loss

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        """The logits' gradient (B, h, w, J)."""
        exponentials, total, cells, target, mass, even = ctx.saved_tensors
        (each,) = gradients
        # In place: what was saved is good for one gradient.
        exponentials.mul_((each * (mass + even) / total)[:, None, None])
        if even.any():
            count = exponentials.shape[1] * exponentials.shape[2]
            exponentials.sub_((each * even / count)[:, None, None])
        taken = (-target * each[..., None]).transpose(1, 2)
        exponentials.view(len(target), -1, target.shape[1]).scatter_add_(1, cells.transpose(1, 2), taken)
        return exponentials.to(ctx.dtype), None, None, None
