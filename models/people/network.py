"""The person detector: box centres and extents on a coarse grid (CenterNet, Zhou et al. 2019), from RGB and the
difference to a static camera's background model."""

import torch
from torch import Tensor, nn

from muybridge.models.keypoints.network import CHANNELS, Block, ConvUnit, Lateral

# Of RGB and of the difference to the background model, which is mostly near zero: it is only scaled.
MEAN = (0.45, 0.43, 0.41, 0.0)
STD = (0.26, 0.26, 0.26, 0.2)
STRIDE = 8


class PeopleNet(nn.Module):
    """Heatmap of box centres, and distances to the edges of the box.

    Args:
        widths: channels at 1/8, 1/16 and 1/32 of the input's resolution.
        depths: residual blocks at each of these.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, widths: tuple[int, int, int] = (48, 96, 128), depths: tuple[int, int, int] = (1, 2, 2)) -> None:
        super().__init__()
        self.config = {"widths": widths, "depths": depths}
        self.register_buffer("mean", torch.tensor(MEAN).view(1, CHANNELS, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(1, CHANNELS, 1, 1), persistent=False)
        self.stem = nn.Sequential(ConvUnit(CHANNELS, 16, 2), ConvUnit(16, 32, 2), ConvUnit(32, widths[0], 2))
        self.levels = nn.ModuleList()
        for i, (width, depth) in enumerate(zip(widths, depths, strict=True)):
            down = [ConvUnit(widths[i - 1], width, 2)] if i else []
            self.levels.append(nn.Sequential(*down, *(Block(width) for _ in range(depth))))
        self.laterals = nn.ModuleList(Lateral(widths[i + 1], widths[i]) for i in (1, 0))
        self.heatmap = nn.Conv2d(widths[0], 1, 1)
        self.box = nn.Conv2d(widths[0], 4, 1)
        # Few cells are centres: the initial prediction is that none is (Lin et al. 2017).
        for layer, start in ((self.heatmap, -4.0), (self.box, 3.5)):
            assert layer.bias is not None
            nn.init.constant_(layer.bias, start)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Detect people.

        Args:
            image: (N, 4, H, W) in 0..1.

        Returns:
            Centre logits (N, 1, H/8, W/8); distances in pixels from the cell's centre to the left, top, right and
            bottom edge (N, 4, H/8, W/8).
        """
        x = self.stem((image - self.mean) / self.std)
        features = []
        for level in self.levels:
            x = level(x)
            features.append(x)
        for lateral, fine in zip(self.laterals, features[-2::-1], strict=True):
            x = lateral(x, fine)
        # The network predicts logarithms of distances, so that near and far people have equal weight.
        return self.heatmap(x), torch.exp(self.box(x).float().clamp(-2.0, 6.5))
