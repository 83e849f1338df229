"""Batch normalisation for training on a CPU: the same as torch's, but suited to its compiler.

torch 2.13 compiles the built-in one to loops that compute the reciprocal standard deviation, with a division and a
root, for every cell. Here everything that belongs to a channel is computed once, and a cell costs a product and a sum.
"""

import math
from typing import Any

import torch
from torch import Tensor, nn

_PLANE = (0, 2, 3)


def materialise(x: Tensor) -> Tensor:
    """`x`, contiguous, in a buffer of its own.

    The compiler recomputes cheap expressions wherever they are used, and looks through views; but not through this one,
    which needs a buffer to be a view of.
    """
    stride = [math.prod(x.shape[i + 1 :]) for i in range(x.ndim)]
    return x.contiguous().as_strided(x.shape, stride)


class BatchNorm(nn.BatchNorm2d):
    """`BatchNorm2d`, faster in compiled training steps."""

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, h, w) -> the same shape."""
        compiling = torch.compiler.is_compiling() and not torch.compiler.is_exporting()
        if not (compiling and self.training):
            return super().forward(x)
        out, mean, variance = _Normalise.apply(x, self.weight, self.bias, self.running_mean, self.eps)  # type: ignore[no-untyped-call]
        with torch.no_grad():
            cells = x.numel() / x.shape[1]
            self.running_mean.lerp_(mean, self.momentum)  # type: ignore[union-attr, arg-type]
            self.running_var.lerp_(variance * (cells / (cells - 1)), self.momentum)  # type: ignore[union-attr, arg-type]
        normalised: Tensor = out
        return normalised


class _Normalise(torch.autograd.Function):
    """(N, C, h, w) of any precision -> the same, and the mean (C,) and variance (C,) in float32."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, near: Tensor, eps: float) -> tuple[Tensor, ...]:
        """`near` (C,) approximates the mean: the closer, the less precision is lost in the difference of squares."""
        cells = x.numel() / x.shape[1]
        away = x.float() - _plane(near)
        first, second = away.sum(_PLANE) / cells, (away * away).sum(_PLANE) / cells
        mean, variance = near + first, (second - first * first).clamp(min=0)
        inverse = torch.rsqrt(variance + eps)
        scale = weight * inverse
        per_channel = materialise(torch.stack([scale, bias - mean * scale]))
        out = x.float() * _plane(per_channel[0]) + _plane(per_channel[1])
        ctx.save_for_backward(x, weight, mean, inverse)
        ctx.mark_non_differentiable(mean, variance)
        return out.to(x.dtype), mean, variance

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        """Gradients of the input, weight and bias."""
        x, weight, mean, inverse = ctx.saved_tensors
        g, cells = gradients[0].float(), x.numel() / x.shape[1]
        away = x.float() - _plane(mean)
        whole, along = g.sum(_PLANE), (g * away).sum(_PLANE)
        scale = weight * inverse
        slope = -scale * inverse * inverse * along / cells
        per_channel = materialise(torch.stack([scale, slope, -scale * whole / cells - slope * mean]))
        out = g * _plane(per_channel[0]) + x.float() * _plane(per_channel[1]) + _plane(per_channel[2])
        return out.to(x.dtype), along * inverse, whole, None, None


def _plane(channels: Tensor) -> Tensor:
    """(C,) -> (C, 1, 1), to broadcast with (N, C, h, w)."""
    return channels[:, None, None]
