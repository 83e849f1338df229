"""The part of the solver's network that is solved in closed form: ridge regression of each joint's corrections."""

import numpy as np
import torch
from torch import Tensor

from muybridge.models.correction.features import mirrored
from muybridge.models.correction.network import SolverNet

# Examples off by more than _FAR teach nothing of others, units of LENGTH and ANGLE; those within _NEAR count alike.
_FAR = 6.0
_NEAR = 0.3
_BATCH = 1024


@torch.no_grad()
def solve_linear(net: SolverNet, data: tuple[Tensor, ...], strength: float = 0.02) -> None:
    """Sets the weights of `net.near` to those that come nearest to the right answers of `data` and of their mirror
    images: ridge regression on standardised features.

    Args:
        net: whose weights are set.
        data: markers, known, joints and targets.
        strength: of the ridge, against the variance of a feature.
    """
    near = net.near
    size = near.weight.shape[1]
    gram = torch.zeros(len(near.weight), size + 1, size + 1)
    right = torch.zeros(len(near.weight), size + 1, 6)
    for k in range(0, len(data[0]), _BATCH):
        batch = tuple(t[k : k + _BATCH].float() for t in data[:4])
        glass = (torch.from_numpy(np.ascontiguousarray(a)) for a in mirrored(*(t.numpy() for t in batch)))
        for markers, known, joints, target in (batch, tuple(glass)):
            size_off = target.norm(dim=-1)
            # Errors count by their size and not its square, so that good fits stay good.
            use = net.reached(known) * (size_off < _FAR) / (_NEAR + size_off)
            x = torch.cat([near.inputs(markers, known, joints), torch.ones(*target.shape[:2], 1)], -1).transpose(0, 1)
            weighted = (x * use.T.unsqueeze(-1)).transpose(1, 2)
            gram += weighted @ x
            right += weighted @ target.transpose(0, 1)
    count = gram[:, -1:, -1:].clamp(min=1.0)
    mean = gram[:, -1, :-1] / count[:, 0]
    spread = (gram.diagonal(dim1=1, dim2=2)[:, :-1] / count[:, 0] - mean**2).clamp(min=0)
    # A feature that hardly varies says nothing; its place in the ridge keeps it out.
    ridge = torch.cat([(spread + 1e-4) * strength, torch.zeros(len(mean), 1)], 1) * count[:, 0]
    solved = torch.linalg.solve(gram.double() + torch.diag_embed(ridge.double() + 1e-6), right.double()).float()
    near.weight.copy_(solved[:, :-1])
    near.bias.copy_(solved[:, -1])
