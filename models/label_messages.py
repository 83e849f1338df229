"""Messages along the edges of a graph, summed up at the nodes: one pass over memory instead of a dozen.

The training of the labelling network on a CPU spends most of its time here; elsewhere (a GPU, an export) the plain
form is used, which gives the same numbers.
"""

from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor


def gather_messages(here: Tensor, there: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
    """Largest and mean message of every node.

    Args:
        here: (R, M) what a node gives to its messages.
        there: (R, M) what a neighbour gives.
        edge: (R, K, M) what the edge gives.
        neighbour: (R * K) rows of the neighbours.

    Returns:
        (R, 2 M) maximum, then mean, over K of ``relu(here + there[neighbour] + edge)``.
    """
    if here.requires_grad and here.device.type == "cpu" and not torch.compiler.is_compiling():
        out: Tensor = _Messages.apply(here.float(), there.float(), edge.float(), neighbour)
        return out
    rows, count, width = edge.shape
    message = torch.relu(here.unsqueeze(1) + there.index_select(0, neighbour).reshape(rows, count, width) + edge)
    return torch.cat([message.max(1).values, message.mean(1)], -1)


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, here: Tensor, there: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
        rows, count, width = edge.shape
        out = torch.empty(rows, 2 * width)
        best = torch.empty(rows, width, dtype=torch.uint8)
        on = torch.empty(rows, count, width, dtype=torch.bool)
        index = neighbour.reshape(rows, count)
        arrays = (here, there, edge, index, out, best, on)
        _forward(*(a.detach().contiguous().numpy() for a in arrays))
        ctx.save_for_backward(index, best, on)
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        index, best, on = ctx.saved_tensors
        rows, count, width = on.shape
        here, there = torch.zeros(rows, width), torch.zeros(rows, width)
        edge = torch.empty(rows, count, width)
        arrays = (grads[0].float(), index, best, on, here, there, edge)
        _backward(*(a.contiguous().numpy() for a in arrays))
        return here, there, edge, None


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _forward(here: Any, there: Any, edge: Any, index: Any, out: Any, best: Any, on: Any) -> None:
    rows, count, width = edge.shape
    share = np.float32(1.0 / count)
    for i in range(rows):
        for c in range(width):
            out[i, c] = np.float32(0.0)
            out[i, width + c] = np.float32(0.0)
            best[i, c] = 0
        for k in range(count):
            j = index[i, k]
            for c in range(width):
                m = max(here[i, c] + there[j, c] + edge[i, k, c], np.float32(0.0))
                on[i, k, c] = m > 0
                out[i, width + c] += m * share
                if m > out[i, c]:
                    out[i, c] = m
                    best[i, c] = k


@numba.njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _backward(grad: Any, index: Any, best: Any, on: Any, here: Any, there: Any, edge: Any) -> None:
    rows, count, width = on.shape
    share = np.float32(1.0 / count)
    for i in range(rows):
        for k in range(count):
            j = index[i, k]
            for c in range(width):
                g = grad[i, width + c] * share + (grad[i, c] if best[i, c] == k else np.float32(0.0))
                g = g if on[i, k, c] else np.float32(0.0)
                edge[i, k, c] = g
                here[i, c] += g
                there[j, c] += g
