"""The keypoint network: a small dense U-shaped network from a crop to a position distribution for every landmark.

All convolutions are dense and 3x3: on a CPU that multiplies in bfloat16 they train three times as fast as depthwise
ones. The output is a classification over cells, not a regression: where left and right are ambiguous, a mode is right
half of the time and a mean never.
"""

import copy
from collections.abc import Sequence
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from muybridge.models.keypoints.attention import AttentionBlock
from muybridge.models.keypoints.batch_norm import BatchNorm

CHANNELS = 4  # RGB and the difference to the background model
PLATE = "difference"  # name of the input of the fourth channel in exported files
STRIDE = 4
BODY = 23  # number of body landmarks


class ConvUnit(nn.Sequential):
    """3x3 convolution, batch normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
            BatchNorm(outputs),
            nn.ReLU(inplace=True),
        )


class Block(nn.Module):
    """Residual block of two 3x3 convolutions.

    Args:
        channels: of input and output.
        hidden: between the two; as many by default.
    """

    def __init__(self, channels: int, hidden: int | None = None) -> None:
        super().__init__()
        self.first = ConvUnit(channels, hidden or channels)
        self.second = nn.Sequential(nn.Conv2d(hidden or channels, channels, 3, 1, 1, bias=False), BatchNorm(channels))

    def forward(self, x: Tensor) -> Tensor:
        """(N, channels, h, w) -> the same shape."""
        return torch.relu(x + self.second(self.first(x)))


def upsample(x: Tensor) -> Tensor:
    """(N, C, h, w) -> (N, C, 2h, 2w), bilinear, with cell centres aligned at half-cell offsets."""
    if not torch.compiler.is_compiling() or torch.compiler.is_exporting():
        return nn.functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
    out: Tensor = Upsample.apply(x)  # type: ignore[no-untyped-call]
    return out


class Upsample(torch.autograd.Function):
    """`upsample` for the compiler: torch 2.13 compiles the built-in one to a gradient of zero in bfloat16."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        """(N, C, h, w) -> (N, C, 2h, 2w): three quarters of the nearest cell, a quarter of the next."""
        for axis in (2, 3):
            size = x.shape[axis]
            at = torch.arange(2 * size, device=x.device)
            following = (at // 2 + 2 * (at % 2) - 1).clamp(0, size - 1)
            x = 0.75 * x.index_select(axis, at // 2) + 0.25 * x.index_select(axis, following)
        return x

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        """(N, C, 2h, 2w) -> (N, C, h, w): each cell contributes to four, at the border twice to the same."""
        (g,) = gradients
        for axis in (2, 3):
            last = g.shape[axis] - 1
            at = torch.arange(0, last, 2, device=g.device)
            near = g.index_select(axis, at) + g.index_select(axis, at + 1)
            far = g.index_select(axis, (at - 1).clamp(min=0)) + g.index_select(axis, (at + 2).clamp(max=last))
            g = 0.75 * near + 0.25 * far
        return g


class Lateral(nn.Module):
    """Merge coarse features into a finer level: 1x1 convolution, bilinear upsampling, sum, a residual block of `hidden`
    channels."""

    def __init__(self, coarse: int, fine: int, hidden: int | None = None) -> None:
        super().__init__()
        self.reduce = nn.Conv2d(coarse, fine, 1)
        self.block = Block(fine, hidden)

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """(N, coarse, h, w), (N, fine, 2h, 2w) -> (N, fine, 2h, 2w)."""
        out: Tensor = self.block(fine + upsample(self.reduce(coarse)))
        return out


class Head(nn.Module):
    """Heatmaps from features.

    The finest features locate landmarks to a cell, and are all that virtual markers on the skin use. Coarser features,
    which have more channels and see more of the person, also help to decide between left and right for body landmarks;
    their weights start at zero, as in files of networks that had none.

    Args:
        landmarks: number of landmarks J.
        widths: channels at 1/4, 1/8 and 1/16 of the input's resolution.
        body: number of body landmarks, which come first.
    """

    def __init__(self, landmarks: int, widths: Sequence[int], body: int) -> None:
        super().__init__()
        self.body = body
        self.fine = nn.Conv2d(widths[0], landmarks, 1)
        self.eighth, self.sixteenth = (nn.Conv2d(width, body, 1, bias=False) for width in widths[1:])
        for layer in (self.eighth, self.sixteenth):
            nn.init.zeros_(layer.weight)

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        """(N, widths[2], h, w), (N, widths[1], 2h, 2w), (N, widths[0], 4h, 4w) -> logits (N, J, 4h, 4w)."""
        body, markers = self.apart(features)
        return body if markers is None else torch.cat([body, markers], 1)

    def apart(self, features: Sequence[Tensor]) -> tuple[Tensor, Tensor | None]:
        """The logits of the body and those of the markers (None without markers) separately, so that a loss of either
        needs no copy of all."""
        sixteenth, eighth, quarter = features
        coarse = upsample(self.eighth(eighth) + upsample(self.sixteenth(sixteenth)))
        weight, bias = self.fine.weight, self.fine.bias
        if len(weight) == self.body:
            return self.fine(quarter) + coarse, None
        body, markers = (
            nn.functional.conv2d(quarter, weight[part], bias[part])  # type: ignore[index]
            for part in (slice(self.body), slice(self.body, None))
        )
        return body + coarse, markers


class KeypointNet(nn.Module):
    """Landmark heatmaps and visibility from crops: RGB and the difference to a static camera's background model, which
    is zero where there is none.

    Args:
        landmarks: number of landmarks J: those of the body first, then those on its surface (virtual markers).
        widths: channels at 1/4, 1/8, 1/16 and 1/32 of the input's resolution.
        depths: residual blocks on the way down at each of these.
        hidden: channels within the residual blocks at each of these, on the way down and up; as many as outside by
            default.
        attention: blocks of self-attention at 1/32.
    """

    def __init__(
        self,
        landmarks: int = 23,
        widths: tuple[int, int, int, int] = (32, 64, 128, 160),
        depths: tuple[int, int, int, int] = (0, 2, 2, 2),
        hidden: tuple[int, int, int, int] | None = None,
        attention: int = 0,
    ) -> None:
        super().__init__()
        hidden = hidden or widths
        self.config: dict[str, Any] = {
            "landmarks": landmarks, "widths": widths, "depths": depths, "hidden": hidden, "attention": attention,
        }  # fmt: skip
        self.stem = nn.Sequential(ConvUnit(CHANNELS, widths[0] // 2, 2), ConvUnit(widths[0] // 2, widths[0], 2))
        self.levels = nn.ModuleList()
        for i, (width, depth) in enumerate(zip(widths, depths, strict=True)):
            down = [ConvUnit(widths[i - 1], width, 2)] if i else []
            self.levels.append(nn.Sequential(*down, *(Block(width, hidden[i]) for _ in range(depth))))
        self.attention = nn.Sequential(*(AttentionBlock(widths[3]) for _ in range(attention)))
        self.laterals = nn.ModuleList(Lateral(widths[i + 1], widths[i], hidden[i]) for i in (2, 1, 0))
        self.head = Head(landmarks, widths[:3], min(landmarks, BODY))
        self.visibility = nn.Linear(widths[3], landmarks)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 4, S, S) in 0..1 -> heatmap logits (N, J, S/4, S/4), visibility logits (N, J)."""
        features, whole = self.features(image)
        return self.head(features), self.visibility(whole)

    def apart(self, image: Tensor) -> tuple[Tensor, Tensor | None, Tensor]:
        """The same, with the heatmaps of body and markers (None without markers) separate, for their losses."""
        features, whole = self.features(image)
        return *self.head.apart(features), self.visibility(whole)

    def features(self, image: Tensor) -> tuple[list[Tensor], Tensor]:
        """(N, 4, S, S) -> the features for the heatmaps, as `Head` takes them, and (N, widths[3]) of the whole crop."""
        x = self.stem(image)
        features = []
        for level in self.levels:
            x = level(x)
            features.append(x)
        x = self.attention(x)
        whole, merged = x.mean((2, 3)), []
        for lateral, fine in zip(self.laterals, features[-2::-1], strict=True):
            x = lateral(x, fine)
            merged.append(x)
        return merged, whole


def with_attention(net: KeypointNet, blocks: int) -> KeypointNet:
    """A copy of a network with this many blocks of self-attention; new ones change nothing until they are trained.

    Raises:
        ValueError: it has more blocks than that.
    """
    if net.config["attention"] > blocks:
        raise ValueError(f"the network has {net.config['attention']} blocks of attention already, not {blocks}")
    larger = KeypointNet(**net.config | {"attention": blocks}).train(net.training)
    larger.load_state_dict(net.state_dict(), strict=False)
    return larger


class SeparateHeads(nn.Module):
    """A `KeypointNet` with separate outputs for body landmarks and virtual markers, so that either can be computed
    alone.

    Args:
        net: a network of J landmarks.
        body: number of body landmarks, which come first.

    Raises:
        ValueError: the network has another number of body landmarks.
    """

    def __init__(self, net: KeypointNet, body: int) -> None:
        super().__init__()
        self.net = net
        if body != net.head.body:
            raise ValueError(f"the network's head has {net.head.body} landmarks of the body, not {body}")
        self.marker_head = _rows(net.head.fine, slice(body, None))
        self.marker_visibility = _rows(net.visibility, slice(body, None))
        self.body_head = copy.deepcopy(net.head)
        self.body_head.fine = _rows(net.head.fine, slice(body))
        self.body_visibility = _rows(net.visibility, slice(body))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """(N, 4, S, S) -> heatmaps and visibility of the body, then of the markers; logits as of `KeypointNet`."""
        features, whole = self.net.features(image)
        return (
            self.body_head(features), self.body_visibility(whole),
            self.marker_head(features[-1]), self.marker_visibility(whole),
        )  # fmt: skip


class PlateApart(nn.Module):
    """A four-channel network as one of two inputs, for callers without a background model: see `onnx_files.export`.

    Args:
        net: a `KeypointNet` or its `SeparateHeads`; it is copied.
    """

    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = copy.deepcopy(net)

    def forward(self, image: Tensor, difference: Tensor) -> tuple[Tensor, ...]:
        """(N, 3, S, S) RGB, (N, 1, S, S) or (1, 1, 1, 1) difference -> as the network."""
        spread = difference.expand(image.shape[0], 1, *image.shape[2:])
        out: tuple[Tensor, ...] = self.net(torch.cat([image, spread], 1))
        return out


_Layer = TypeVar("_Layer", nn.Conv2d, nn.Linear)


def _rows(layer: _Layer, rows: slice) -> _Layer:
    """A copy of a layer with some of its outputs."""
    part = copy.deepcopy(layer)
    part.weight = nn.Parameter(layer.weight[rows].detach().clone())
    part.bias = nn.Parameter(layer.bias[rows].detach().clone())  # type: ignore[index]
    return part
