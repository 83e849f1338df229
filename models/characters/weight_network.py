"""The network that weights skins: what it adds to the logarithm of weights by heat, for each pair of point and joint.

Nodes are pairs of a point and a joint near to it. Messages come from the same joint at neighbouring points, from the
joint's parent and children at the same point, and from all joints there. After HeterSkinNet (Pan and others, 2021),
whose bones are nodes of their own; here what they know is in the features of the pairs.
"""

from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn


class _Round(nn.Module):
    """One round of messages."""

    def __init__(self, width: int, message: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.send = nn.Linear(width, message)
        self.own, self.near = nn.Linear(width, width), nn.Linear(message, width, bias=False)
        self.kin = nn.Linear(2 * message, width, bias=False)
        self.here = nn.Linear(message, width, bias=False)
        self.mix = nn.Linear(width, width)

    def forward(self, h: Tensor, links: Tensor, same: Tensor, exists: Tensor) -> Tensor:
        x = self.norm(h)
        sent = torch.relu(self.send(x)) * exists
        kin = torch.cat([links @ sent, links.transpose(1, 2) @ sent], -1)
        here = self.here(sent.amax(1, keepdim=True))
        mixed = self.own(x) + self.near(mean_of_neighbours(sent, same)) + self.kin(kin) + here
        out: Tensor = h + self.mix(torch.relu(mixed))
        return out


def mean_of_neighbours(sent: Tensor, same: Tensor) -> Tensor:
    """(P, K, M) mean over the neighbours of what the pairs (P, K, M) of the same joint send.

    Training on a CPU takes a sparse product, which needs no memory for the messages of each edge.

    Args:
        sent: (P, K, M).
        same: (P, N, K) pairs, P * K for none.
    """
    points, count, width = sent.shape
    if sent.requires_grad and sent.device.type == "cpu" and not torch.compiler.is_compiling():
        out: Tensor = _Mean.apply(sent, same)  # type: ignore[no-untyped-call]
        return out
    there = (same < points * count).to(sent.dtype)
    share = (there / there.sum(1, keepdim=True).clamp(min=1.0)).unsqueeze(-1)
    rows = torch.cat([sent.reshape(points * count, width), sent.new_zeros(1, width)])
    near = rows.index_select(0, same.reshape(-1)).reshape(points, -1, count, width)
    return (near * share).sum(1)


class _Mean(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sent: Tensor, same: Tensor) -> Tensor:
        points, count, width = sent.shape
        pairs = points * count
        table = same.transpose(1, 2).reshape(pairs, -1).numpy()
        row, column = (table < pairs).nonzero()
        amount = np.maximum(np.bincount(row, minlength=pairs), 1)
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=pairs))])
        matrix = sparse.csr_matrix(((1.0 / amount[row]).astype(np.float32), table[row, column], start), (pairs, pairs))
        ctx.matrix = matrix
        flat = np.ascontiguousarray(sent.detach().reshape(pairs, width).numpy())
        return torch.from_numpy(matrix @ flat).reshape(sent.shape)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        grad = grads[0]
        flat = np.ascontiguousarray(grad.reshape(-1, grad.shape[-1]).numpy())
        return torch.from_numpy(ctx.matrix.T @ flat).reshape(grad.shape), None


class WeightNet(nn.Module):
    """Pairs of points and joints to weights.

    Args:
        features: of a pair.
        width: of a pair's state.
        message: width of the messages.
        rounds: of messages.
    """

    def __init__(self, features: int, width: int = 32, message: int = 16, rounds: int = 4) -> None:
        super().__init__()
        self.config: dict[str, Any] = {"features": features, "width": width, "message": message, "rounds": rounds}
        self.first = nn.Sequential(nn.Linear(features, width), nn.ReLU(), nn.Linear(width, width))
        self.rounds = nn.ModuleList(_Round(width, message) for _ in range(rounds))
        self.out = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 1))
        last = self.out[1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)

    def forward(self, features: Tensor, base: Tensor, exists: Tensor, parent: Tensor, same: Tensor) -> Tensor:
        """Weights.

        Args:
            features: (P, K, F) of the pairs.
            base: (P, K) logarithm of the weights to start from.
            exists: (P, K) 1 where there is a pair, else 0.
            parent: (P, K) int64, the place among the K of the joint's parent; K for none.
            same: (P, N, K) int64, the pair of the same joint at neighbouring points; P * K for none.

        Returns:
            (P, K) weights, each row's sum one, zero where there is no pair.
        """
        count = base.shape[1]
        places = torch.arange(count, device=parent.device)
        links = (parent.unsqueeze(2) == places).to(features.dtype)
        known = exists.unsqueeze(-1)
        h = self.first(features)
        for one in self.rounds:
            h = one(h, links, same, known)
        added = self.out(h).squeeze(-1)
        return torch.softmax(base + added + (exists - 1) * 1e4, 1) * exists
