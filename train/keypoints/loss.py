"""Cross-entropy of heatmaps against small Gaussians, written for CPUs: few passes over the logits, in their memory
order."""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from muybridge.models.keypoints.batch_norm import materialise
from muybridge.models.keypoints.network import STRIDE

# Cells on each side of a landmark that its Gaussian covers (five sigma).
REACH = 4
# Weight of landmarks outside the crop relative to those inside.
OUTSIDE = 0.5


class Targets(NamedTuple):
    """Target distributions of heatmaps of (h, w) cells: the product of a distribution over rows, times a weight, and
    one over columns. The weight is one for landmarks inside the crop, `OUTSIDE` for those outside, zero for unknown
    ones."""

    rows: Tensor  # (B, h, J), sums to the weight
    columns: Tensor  # (B, w, J), sums to one
    least: Tensor  # (B, J) least possible cross-entropy of landmarks outside; else zero

    def of(self, landmarks: slice) -> "Targets":
        """The targets of some landmarks."""
        return Targets(*(part[..., landmarks] for part in self))


# Not compiled: the compiler would recompute it for every cell.
@torch.compiler.disable  # type: ignore[untyped-decorator]
def targets(landmarks_px: Tensor, h: int, w: int, sigma: float = 0.8) -> Targets:
    """Gaussians of `sigma` cells around `landmarks_px` (B, J, 2), where NaN is unknown; a uniform distribution for
    those outside the crop."""
    size = torch.tensor([w, h], device=landmarks_px.device)
    cell = (landmarks_px - (STRIDE - 1) / 2) / STRIDE
    inside = ((cell > -0.5) & (cell < size - 0.5)).all(-1)
    outside = landmarks_px.isfinite().all(-1) & ~inside
    columns, rows = (_gaussian(cell[..., axis], n, sigma, inside) for axis, n in ((0, w), (1, h)))
    weight = inside + OUTSIDE * outside
    return Targets(rows * weight[:, None], columns, OUTSIDE * outside * math.log(h * w))


def _gaussian(cell: Tensor, n: int, sigma: float, inside: Tensor) -> Tensor:
    """(B, J) positions in cells -> (B, n, J), normalised over the cells; uniform where they are not `inside`."""
    cell = torch.where(inside, cell, 0.0)[:, None]
    at = torch.arange(n, device=cell.device)[:, None]
    # Nothing beyond the reach is kept, and computing denormal float32 numbers is slow.
    away = (at - cell).clamp(-REACH - 1, REACH + 1)
    share = torch.exp(-(away**2) / (2 * sigma**2)) * ((at - cell.round()).abs() <= REACH)
    share = torch.where(inside[:, None], share, 1.0)
    return share / share.sum(1, keepdim=True)


def heatmap_loss(logits: Tensor, landmarks_px: Tensor) -> Tensor:
    """`cross_entropy` (B, J) of heatmap logits (B, J, h, w) against Gaussians around `landmarks_px` (B, J, 2)."""
    return cross_entropy(logits, targets(landmarks_px, *logits.shape[-2:]))


def cross_entropy(logits: Tensor, target: Targets) -> Tensor:
    """Cross-entropy of heatmaps.

    Nothing should be predicted for a landmark outside the crop: its loss is that of a uniform distribution, less the
    least possible, times `OUTSIDE`.

    Args:
        logits: (B, J, h, w).
        target: of the heatmaps.

    Returns:
        (B, J); zero for unknown landmarks.
    """
    apply = _CrossEntropy.apply
    out: Tensor = apply(logits.permute(0, 2, 3, 1), target.rows, target.columns)  # type: ignore[no-untyped-call]
    return out - target.least


class _CrossEntropy(torch.autograd.Function):
    """log-sum-exp of all cells minus the expected logit. The gradient, softmax minus target, is computed from logits in
    their own precision, and in their memory order."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """(B, h, w, J), (B, h, J), (B, w, J) -> (B, J)."""
        precise = logits.to(torch.float32, copy=True)
        # Row by row, so that a row is still in the cache for the second pass.
        expected = ((precise * columns[:, None]).sum(2) * rows).sum(1)
        row_top = precise.amax(2)
        row = precise.sub_(row_top[:, :, None]).exp_().sum(2)
        top = row_top.amax(1, keepdim=True)
        whole = (row * (row_top - top).exp()).sum(1).log() + top[:, 0]
        ctx.save_for_backward(logits, rows, columns, whole)
        return rows.sum(1) * whole - expected

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """Gradient of the logits (B, h, w, J)."""
        logits, rows, columns, whole = ctx.saved_tensors
        # Per-landmark sums, which the compiler would otherwise recompute for every cell.
        each = materialise(gradients[0])
        out = logits.to(torch.float32, copy=True).sub_(whole[:, None, None]).exp_()
        out.mul_(materialise(each * rows.sum(1))[:, None, None])
        out.addcmul_(rows[:, :, None], materialise(columns * each[:, None])[:, None], value=-1.0)
        return out.to(logits.dtype), None, None
