"""Messages along the edges of a graph, aggregated at the nodes: one pass over memory instead of a dozen.

Training the labelling network on a CPU spends most of its time here. Elsewhere (on a GPU, in an export) the plain form
is used, which gives the same numbers.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from muybridge.geometry.numerics._numba import compiled_with


def gather_messages(here: Tensor, there: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
    """Largest and mean message of every node.

    Args:
        here: (R, M) a node's part of its messages.
        there: (R, M) a neighbour's part.
        edge: (R, K, M) the edge's part.
        neighbour: (R * K) rows of the neighbours.

    Returns:
        (R, 2 M) maximum, then mean, over K of ``relu(here + there[neighbour] + edge)``.
    """
    if here.requires_grad and here.device.type == "cpu" and not torch.compiler.is_compiling():
        out: Tensor = _Messages.apply(here.float(), there.float(), edge.float(), neighbour)  # type: ignore[no-untyped-call]
        return out
    rows, count, width = edge.shape
    message = torch.relu(here.unsqueeze(1) + there.index_select(0, neighbour).reshape(rows, count, width) + edge)
    return torch.cat([message.max(1).values, message.mean(1)], -1)


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, here: Tensor, there: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
        rows, count, width = edge.shape
        out = torch.empty(rows, 2 * width)
        message = torch.empty(rows, count, width)
        index = neighbour.reshape(rows, count)
        _forward(*(a.detach().contiguous().numpy() for a in (here, there, edge, index, out, message)))
        ctx.save_for_backward(index, message, out)
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        index, message, out = ctx.saved_tensors
        rows, count, width = message.shape
        here, there = torch.zeros(rows, width), torch.zeros(rows, width)
        edge = torch.empty(rows, count, width)
        arrays = (grads[0].float(), index, message, out, here, there, edge)
        _backward(*(a.contiguous().numpy() for a in arrays))
        return here, there, edge, None


@compiled_with(fastmath=True)
def _forward(here: Any, there: Any, edge: Any, index: Any, out: Any, message: Any) -> None:
    rows, count, width = edge.shape
    share = np.float32(1.0 / count)
    most, total = np.empty(width, np.float32), np.empty(width, np.float32)
    for i in range(rows):
        own = here[i]
        most[:] = 0
        total[:] = 0
        for k in range(count):
            other, link, m = there[index[i, k]], edge[i, k], message[i, k]
            for c in range(width):
                m[c] = max(own[c] + other[c] + link[c], np.float32(0.0))
            for c in range(width):
                total[c] += m[c]
                most[c] = max(most[c], m[c])
        for c in range(width):
            out[i, c] = most[c]
            out[i, width + c] = total[c] * share


@compiled_with(fastmath=True)
def _backward(grad: Any, index: Any, message: Any, out: Any, here: Any, there: Any, edge: Any) -> None:
    rows, count, width = message.shape
    share = np.float32(1.0 / count)
    zero = np.float32(0.0)
    g = np.empty(width, np.float32)
    for i in range(rows):
        top, mean, most, own = grad[i, :width], grad[i, width:], out[i, :width], here[i]
        for k in range(count):
            m, link, other = message[i, k], edge[i, k], there[index[i, k]]
            for c in range(width):
                value = mean[c] * share + (top[c] if m[c] == most[c] else zero)
                g[c] = value if m[c] > zero else zero
            for c in range(width):
                link[c] = g[c]
            for c in range(width):
                own[c] += g[c]
            for c in range(width):
                other[c] += g[c]
