"""The linear part of the correction network, solved in closed form: ridge regression of the corrections of each
joint."""

import numpy as np
import torch
from torch import Tensor

from muybridge.models.correction.features import mirrored
from muybridge.models.correction.network import SolverNet

# Examples with an error above _FAR are ignored; those below _NEAR have equal weight; in units of LENGTH and ANGLE.
_FAR = 6.0
_NEAR = 0.3
_BATCH = 1024


@torch.no_grad()
def solve_linear(net: SolverNet, data: tuple[Tensor, ...], strength: float = 0.02) -> None:
    """Set the weights of `net.near` by ridge regression on standardised features, over `data` and its mirror images.

    Args:
        net: whose weights are set.
        data: markers, known, joints and targets.
        strength: of the ridge, relative to the variance of a feature.
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
            # Errors are weighted by their size, not its square, so that good fits stay good.
            use = net.reached(known) * (size_off < _FAR) / (_NEAR + size_off)
            x = torch.cat([near.inputs(markers, known, joints), torch.ones(*target.shape[:2], 1)], -1).transpose(0, 1)
            weighted = (x * use.T.unsqueeze(-1)).transpose(1, 2)
            gram += weighted @ x
            right += weighted @ target.transpose(0, 1)
    count = gram[:, -1:, -1:].clamp(min=1.0)
    mean = gram[:, -1, :-1] / count[:, 0]
    spread = (gram.diagonal(dim1=1, dim2=2)[:, :-1] / count[:, 0] - mean**2).clamp(min=0)
    # A feature that hardly varies carries no information; the constant in the ridge suppresses it.
    ridge = torch.cat([(spread + 1e-4) * strength, torch.zeros(len(mean), 1)], 1) * count[:, 0]
    solved = torch.linalg.solve(gram.double() + torch.diag_embed(ridge.double() + 1e-6), right.double()).float()
    near.weight.copy_(solved[:, :-1])
    near.bias.copy_(solved[:, -1])
