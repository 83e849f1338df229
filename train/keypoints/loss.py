"""Cross-entropy of heatmaps against small Gaussians, written for a CPU: few passes over the logits, as they lie."""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from muybridge.models.keypoints.batch_norm import worked_out
from muybridge.models.keypoints.network import STRIDE

# Cells on each side of a landmark that its Gaussian reaches (five sigma).
REACH = 4
# Of the loss of landmarks outside of the crop, beside those inside.
OUTSIDE = 0.5


class Targets(NamedTuple):
    """What heatmaps of (h, w) cells shall be: products of a distribution over rows, times a weight, and one over
    columns. The weight is one for landmarks inside of the crop, `OUTSIDE` for those outside, zero for unknown ones."""

    rows: Tensor  # (B, h, J), sums are the weight
    columns: Tensor  # (B, w, J), sums are one
    least: Tensor  # (B, J) cross-entropy of the best answer where that is to say nothing, outside; else zero

    def of(self, landmarks: slice) -> "Targets":
        """Those of some of the landmarks."""
        return Targets(*(part[..., landmarks] for part in self))


# Made before and not among what is compiled, which would work them out anew for every cell.
@torch.compiler.disable  # type: ignore[untyped-decorator]
def targets(landmarks_px: Tensor, h: int, w: int, sigma: float = 0.8) -> Targets:
    """Gaussians of `sigma` cells round `landmarks_px` (B, J, 2), where NaN is unknown; an even distribution for those
    outside of the crop."""
    size = torch.tensor([w, h], device=landmarks_px.device)
    cell = (landmarks_px - (STRIDE - 1) / 2) / STRIDE
    inside = ((cell > -0.5) & (cell < size - 0.5)).all(-1)
    outside = landmarks_px.isfinite().all(-1) & ~inside
    columns, rows = (_gaussian(cell[..., axis], n, sigma, inside) for axis, n in ((0, w), (1, h)))
    weight = inside + OUTSIDE * outside
    return Targets(rows * weight[:, None], columns, OUTSIDE * outside * math.log(h * w))


def _gaussian(cell: Tensor, n: int, sigma: float, inside: Tensor) -> Tensor:
    """(B, J) places in cells -> (B, n, J) with sums of one over the cells, even where they are not `inside`."""
    cell = torch.where(inside, cell, 0.0)[:, None]
    at = torch.arange(n, device=cell.device)[:, None]
    # Nothing beyond is kept, and numbers too small for float32 are slow to make.
    away = (at - cell).clamp(-REACH - 1, REACH + 1)
    share = torch.exp(-(away**2) / (2 * sigma**2)) * ((at - cell.round()).abs() <= REACH)
    share = torch.where(inside[:, None], share, 1.0)
    return share / share.sum(1, keepdim=True)


def heatmap_loss(logits: Tensor, landmarks_px: Tensor) -> Tensor:
    """`cross_entropy` (B, J) of heatmap logits (B, J, h, w) against Gaussians round `landmarks_px` (B, J, 2)."""
    return cross_entropy(logits, targets(landmarks_px, *logits.shape[-2:]))


def cross_entropy(logits: Tensor, target: Targets) -> Tensor:
    """(B, J) of heatmap logits (B, J, h, w); zero for landmarks that are unknown. Of a landmark outside of the crop
    nothing is to be said: its loss is that of an even distribution, less what the best answer has, times `OUTSIDE`."""
    apply = _CrossEntropy.apply
    out: Tensor = apply(logits.permute(0, 2, 3, 1), target.rows, target.columns)  # type: ignore[no-untyped-call]
    return out - target.least


class _CrossEntropy(torch.autograd.Function):
    """log-sum-exp of all cells less the expected logit. For the gradient, softmax minus target, the logits are kept in
    their own precision; it is written in that and in their order of memory."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """(B, h, w, J), (B, h, J), (B, w, J) -> (B, J)."""
        precise = logits.to(torch.float32, copy=True)
        # Row by row, so that a row is still in the cache when it is gone over again.
        expected = ((precise * columns[:, None]).sum(2) * rows).sum(1)
        row_top = precise.amax(2)
        row = precise.sub_(row_top[:, :, None]).exp_().sum(2)
        top = row_top.amax(1, keepdim=True)
        whole = (row * (row_top - top).exp()).sum(1).log() + top[:, 0]
        ctx.save_for_backward(logits, rows, columns, whole)
        return rows.sum(1) * whole - expected

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """The logits' gradient (B, h, w, J)."""
        logits, rows, columns, whole = ctx.saved_tensors
        # The gradient of each landmark's loss comes from sums that the compiler would work out anew for every cell.
        each = worked_out(gradients[0])
        out = logits.to(torch.float32, copy=True).sub_(whole[:, None, None]).exp_()
        out.mul_(worked_out(each * rows.sum(1))[:, None, None])
        out.addcmul_(rows[:, :, None], worked_out(columns * each[:, None])[:, None], value=-1.0)
        return out.to(logits.dtype), None, None
