"""The network that finds joints: points of a surface vote for the place of every joint.

Tokens are points spread over the body, each with what its neighbourhood looks like; they attend to one another, and
each votes for a place relative to itself. Joints are means of the votes, as anchors vote in A2J (Xiong and others,
Anchor-to-joint regression network for 3D articulated pose estimation, 2019).
"""

from typing import Any

import torch
from torch import Tensor, nn

_REACH = 0.2  # of the height: the unit of votes
_LOCAL = 0.05  # of the height: the unit within a neighbourhood


class _Layer(nn.Module):
    """Attention between the tokens, then a network per token."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.first, self.second = nn.LayerNorm(width), nn.LayerNorm(width)
        self.ask = nn.Linear(width, 3 * width)
        self.answer = nn.Linear(width, width)
        self.mix = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, h: Tensor) -> Tensor:
        batch, count, width = h.shape
        q, k, v = (t.reshape(batch, count, self.heads, -1).transpose(1, 2)
                   for t in self.ask(self.first(h)).split(width, -1))  # fmt: skip
        weight = torch.softmax(q @ k.transpose(-1, -2) * (width // self.heads) ** -0.5, -1)
        h = h + self.answer((weight @ v).transpose(1, 2).reshape(batch, count, width))
        out: Tensor = h + self.mix(self.second(h))
        return out


class RigNet(nn.Module):
    """Points of a body to its joints.

    Args:
        joints: number of joints.
        tokens: points that vote, the first of those given.
        near: points of a token's neighbourhood.
        width: of a token's state.
        layers: of attention.
        heads: of each.
    """

    def __init__(self, joints: int = 22, tokens: int = 192, near: int = 24, width: int = 80, layers: int = 4,
                 heads: int = 4) -> None:  # fmt: skip
        super().__init__()
        self.config: dict[str, Any] = {"joints": joints, "tokens": tokens, "near": near, "width": width,
                                       "layers": layers, "heads": heads}  # fmt: skip
        self.joints, self.tokens, self.near = joints, tokens, near
        self.local = nn.Sequential(nn.Linear(6, 32), nn.ReLU(), nn.Linear(32, width))
        self.place = nn.Sequential(nn.Linear(6, width), nn.ReLU(), nn.Linear(width, width))
        self.layers = nn.ModuleList(_Layer(width, heads) for _ in range(layers))
        self.votes = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, joints * 5))

    def forward(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Joints.

        Args:
            points: (B, N, 6) points and normals of bodies of height 1 that stand and face -Y; the first `tokens` are
                spread over the body.

        Returns:
            (B, J, 3) places of the joints, and (B, J) logarithms of the expected distance from the true ones.
        """
        batch = points.shape[0]
        place, token = points[..., :3], points[:, : self.tokens]
        at = token[..., :3]
        gap = (at * at).sum(-1, keepdim=True) + (place * place).sum(-1).unsqueeze(1) - 2 * at @ place.transpose(1, 2)
        nearest = gap.topk(self.near, dim=2, largest=False).indices.reshape(batch, -1, 1)
        around = points.gather(1, nearest.expand(-1, -1, 6)).reshape(batch, self.tokens, self.near, 6)
        offset = (around[..., :3] - at.unsqueeze(2)) / _LOCAL
        h = self.local(torch.cat([offset, around[..., 3:]], -1)).amax(2) + self.place(token)
        for layer in self.layers:
            h = layer(h)
        votes = self.votes(h).reshape(batch, self.tokens, self.joints, 5)
        share = torch.softmax(votes[..., 0], 1).unsqueeze(-1)
        places = (share * (at.unsqueeze(2) + _REACH * votes[..., 1:4])).sum(1)
        return places, (share * votes[..., 4:]).sum(1).squeeze(-1) - 4.0
