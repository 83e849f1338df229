"""Muon for the filters of convolutions, AdamW for everything else.

Muon (Jordan et al. 2024) orthogonalises every step of a weight matrix, so that all directions move equally, including
those in which gradients are rare. Steps are scaled to the size of AdamW's (Liu et al. 2025, "Muon is scalable for LLM
training", equation 4), times `FASTER`.

`torch.optim.Muon` (torch 2.9 and later) takes the same steps, bit for bit, in bfloat16, but is not used here: it
always iterates in bfloat16, which on a CPU without bfloat16 instructions takes 14 to 25 times as long for our filters
and changes a step by one percent; and it accepts only two-dimensional parameters, while our filters have four axes in
channels-last order, of which no matrix can be a view.
"""

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

from muybridge.train.engine.precision import bfloat16_is_faster

# Learning rate of the filters relative to that of all other parameters.
FASTER = 2.5
_MOMENTUM = 0.95
# Coefficients of the quintic whose iteration takes singular values to about one (Jordan et al. 2024).
_QUINTIC = (3.4445, -4.7750, 2.0315)
_ITERATIONS = 5
# Filters over fewer channels belong to the first layer, whose inputs are pixels; AdamW trains them.
_LEAST_CHANNELS = 16


def orthogonalise(matrix: Tensor) -> Tensor:
    """(m, n) approximately U V^T of a matrix U S V^T, by Newton-Schulz iteration: singular values of about one."""
    a, b, c = _QUINTIC
    tall = matrix.shape[0] > matrix.shape[1]
    x = matrix.mT if tall else matrix
    x = x.bfloat16() if bfloat16_is_faster(matrix.device.type) else x.float()
    x = x / (x.norm() + 1e-7)
    for _ in range(_ITERATIONS):
        gram = x @ x.mT
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    out: Tensor = (x.mT if tall else x).to(matrix.dtype)
    return out


class Muon(torch.optim.Optimizer):
    """Muon for convolution filters.

    Args:
        params: filters (outputs, inputs, h, w), each treated as a matrix of `outputs` rows.
        lr: learning rate, in AdamW's units.
        weight_decay: share of a weight removed per step, relative to the learning rate.
    """

    def __init__(self, params: Iterable[Tensor], lr: float, weight_decay: float) -> None:
        super().__init__(params, {"lr": lr, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # type: ignore[override]
        """Take one step; `closure` is ignored."""
        for group in self.param_groups:
            rate = FASTER * group["lr"]
            for p in group["params"]:
                if p.grad is None:
                    continue
                if "momentum" not in self.state[p]:
                    self.state[p]["momentum"] = torch.zeros_like(p)
                momentum = self.state[p]["momentum"]
                momentum.lerp_(p.grad, 1 - _MOMENTUM)
                step = p.grad.lerp(momentum, _MOMENTUM).flatten(1)  # Nesterov momentum
                p.mul_(1 - rate * group["weight_decay"])
                p.add_(orthogonalise(step).view_as(p), alpha=-0.2 * rate * math.sqrt(max(step.shape)))


class Optimisers:
    """Both optimisers of a network behind one interface.

    Args:
        net: the network.
        lr: learning rate.
        weight_decay: of both optimisers.
        muon: if false, AdamW trains all parameters.
    """

    def __init__(self, net: nn.Module, lr: float, weight_decay: float = 0.02, muon: bool = True) -> None:
        wide = [p for p in net.parameters() if p.ndim == 4 and p.shape[1] >= _LEAST_CHANNELS and p.shape[2] > 1]
        filters = wide if muon else []
        chosen = {id(p) for p in filters}
        others = [p for p in net.parameters() if id(p) not in chosen]
        self.parts: list[torch.optim.Optimizer] = [torch.optim.AdamW(others, lr, weight_decay=weight_decay)]
        if filters:
            self.parts.append(Muon(filters, lr, weight_decay))

    def set_rate(self, lr: float) -> None:
        """Set the learning rate."""
        for part in self.parts:
            for group in part.param_groups:
                group["lr"] = lr

    def step(self) -> None:
        """Take one step of all parameters."""
        for part in self.parts:
            part.step()

    def state_dict(self) -> list[dict[str, Any]]:
        """State of the optimisers, for a checkpoint."""
        return [part.state_dict() for part in self.parts]

    def accepts(self, states: Any) -> bool:
        """Whether a checkpoint's states are of the same optimisers (with or without Muon); the first versions stored
        them in another form."""
        return isinstance(states, list) and len(states) == len(self.parts)

    def load_state_dict(self, states: list[dict[str, Any]]) -> None:
        """Restore states that `accepts` accepts."""
        for part, state in zip(self.parts, states, strict=True):
            part.load_state_dict(state)
