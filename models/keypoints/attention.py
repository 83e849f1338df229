"""Self-attention among the coarsest cells of the keypoint network: what is hidden is inferred from the whole person.

A cell at 1/32 of the resolution sees a part of a person with convolutions alone; a hidden ankle is where hip, knee and
the chair say. 64 cells attend to each other for one hundredth of the network's arithmetic.
"""

import torch
from torch import Tensor, nn

from muybridge.models.keypoints.batch_norm import BatchNorm

_HEAD_CHANNELS = 32
_EXPANSION = 2


class AttentionBlock(nn.Module):
    """Multi-head self-attention over all cells, then two 1x1 convolutions, both residual.

    Vaswani and others 2017, with two changes: positions enter through a depthwise convolution of the values, so that
    any size of input works (CSWin, Dong and others 2022, eq. 7), and normalisations are those of convolutions, which
    disappear in exported files. The last layer of each branch starts at zero, so that a trained network to which blocks
    are added is the same network at first.

    Args:
        channels: of input and output, which are not negative (after a ReLU).
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.heads = max(1, channels // _HEAD_CHANNELS)
        if channels % self.heads:
            raise ValueError(f"{channels} channels cannot be divided into {self.heads} heads")
        self.qkv = nn.Sequential(nn.Conv2d(channels, 3 * channels, 1, bias=False), BatchNorm(3 * channels))
        self.near = nn.Conv2d(channels, channels, 3, 1, 1, groups=channels)
        self.out = nn.Conv2d(channels, channels, 1, bias=False)
        hidden = _EXPANSION * channels
        self.wide = nn.Sequential(nn.Conv2d(channels, hidden, 1, bias=False), BatchNorm(hidden), nn.ReLU(inplace=True))
        self.narrow = nn.Conv2d(hidden, channels, 1, bias=False)
        for last in (self.out, self.narrow):
            nn.init.zeros_(last.weight)

    def forward(self, x: Tensor) -> Tensor:
        """(N, channels, h, w) -> the same shape."""
        batch, channels, height, width = x.shape
        query, key, value = self.qkv(x).chunk(3, 1)
        q, k, v = (
            part.reshape(batch, self.heads, channels // self.heads, height * width) for part in (query, key, value)
        )
        among = torch.softmax(q.transpose(2, 3) @ k * (channels // self.heads) ** -0.5, -1)
        mixed = (v @ among.transpose(2, 3)).reshape(batch, channels, height, width)
        x = torch.relu(x + self.out(mixed + self.near(value)))
        return torch.relu(x + self.narrow(self.wide(x)))
