"""Load muybridge networks from their ONNX files, so that training can continue from shipped weights."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from muybridge.errors import ModelError, parsing
from muybridge.models.keypoints.network import CHANNELS, PLATE, KeypointNet
from muybridge.models.people.network import MEAN, STD, PeopleNet

_HEADS = ("head", "visibility")


def keypoint_net_from_onnx(path: Path) -> KeypointNet:
    """The network of an exported fp32 keypoint file.

    The exporter folds normalisation into the convolutions, so normalisation layers only add the resulting bias here. In
    evaluation mode the outputs equal those of the file.

    Raises:
        ModelError: the file is damaged, of 8 bits, or of another architecture.
    """
    stored, operators = _read(path)
    if stored.pop(PLATE, None) is not None:
        stored = {name.removeprefix("net."): value for name, value in stored.items()}
    # A network without virtual markers was exported directly, one with them inside `SeparateHeads`.
    marked = "body_visibility.weight" in stored
    with _design_errors(path):
        stored = {name.replace("body_head.fine.", "body_head."): value for name, value in stored.items()}
        for name in _HEADS if marked else ():
            for kind in ("weight", "bias"):
                parts = [stored.pop(f"{part}_{name}.{kind}") for part in ("body", "marker")]
                stored[f"net.{name}.{kind}"] = torch.cat(parts)
        state = {name.removeprefix("net.").removeprefix("body_") if marked else name: v for name, v in stored.items()}
        net = KeypointNet(len(state["visibility.bias"]), **_design(state))
        if "Sub" in operators:
            _fold_input_normalisation(state, "Div" in operators)
        # Networks of earlier versions had no background difference: its weights start at zero.
        stem = state["stem.0.0.weight"]
        state["stem.0.0.weight"] = nn.functional.pad(stem, (0, 0, 0, 0, 0, CHANNELS - stem.shape[1]))
        # They also had heatmaps of the finest features only.
        if "head.weight" in state:
            state |= {f"head.fine.{kind}": state.pop(f"head.{kind}") for kind in ("weight", "bias")}
        coarser = {k: torch.zeros_like(v) for k, v in net.head.state_dict(prefix="head.").items() if ".fine." not in k}
        state = coarser | state
        net.load_state_dict(_unfold_state(net, state))
    return net.eval()


def people_net_from_onnx(path: Path) -> PeopleNet:
    """The network of an exported person detector, as in `keypoint_net_from_onnx`.

    Raises:
        ModelError: the file is damaged, or of another architecture.
    """
    (stored, _), net = _read(path), PeopleNet()
    with _design_errors(path):
        net.load_state_dict(_unfold_state(net, stored))
    return net.eval()


def _read(path: Path) -> tuple[dict[str, Tensor], set[str]]:
    """A file's weights by name, and its operators."""
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load(str(path)).graph
        weights = {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in graph.initializer}
        return weights, {node.op_type for node in graph.node}
    except Exception as error:
        raise ModelError(f"{path}: not an ONNX model ({str(error).splitlines()[0]})") from error


@contextmanager
def _design_errors(path: Path) -> Iterator[None]:
    """Turn errors from loading the weights into a ModelError."""
    try:
        yield
    except (KeyError, RuntimeError) as error:
        raise ModelError(
            f"{path}: training cannot continue from this file ({str(error).splitlines()[0]}): it needs an fp32 "
            "network of this version's design, like the shipped one"
        ) from error


def training_record(path: Path) -> dict[str, Any]:
    """What the exporter recorded about a network's training: `images`, `minutes` (if known) and `seed`."""
    import onnx

    with parsing(path, ModelError, "an ONNX model with a record of its training"):
        metadata = {p.key: p.value for p in onnx.load(str(path)).metadata_props}
        training: dict[str, Any] = json.loads(metadata.get("training", "{}"))
        return training | {"seed": metadata.get("seed", "")}


@torch.no_grad()
def measure_normalisation(net: nn.Module, images: Sequence[Tensor]) -> None:
    """Undo the folding of normalisation: scale filters to outputs of unit variance on `images`, followed by
    normalisations with that variance and mean, so that training can continue as from any other network.

    Folded filters have the scale of the last normalisation, fifty times larger in one layer than in another: the step
    of one learning rate would be too large for some and too small for others.

    Args:
        net: of convolutions followed by normalisations; changed in place without changing its outputs in evaluation
            mode.
        images: batches (N, 4, S, S) in 0..1, of the kind that it is trained on.
    """
    units = [list(m) for m in net.modules() if isinstance(m, nn.Sequential) and len(m) > 1]
    pairs = [(unit[0], unit[1]) for unit in units
             if isinstance(unit[0], nn.Conv2d) and isinstance(unit[1], nn.BatchNorm2d)]  # fmt: skip
    moments: dict[nn.Module, list[Tensor]] = {normalisation: [] for _, normalisation in pairs}

    def measure(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        x = inputs[0].double()
        moments[module].append(torch.stack([x.mean((0, 2, 3)), (x**2).mean((0, 2, 3))]))

    hooks = [module.register_forward_pre_hook(measure) for module in moments]
    training = net.training
    net.eval()
    for batch in images:
        net(batch)
    net.train(training)
    for hook in hooks:
        hook.remove()
    for convolution, normalisation in pairs:
        mean, square = torch.stack(moments[normalisation]).mean(0)
        deviation = (square - mean**2).clamp(min=1e-12).sqrt()
        assert normalisation.running_mean is not None and normalisation.running_var is not None
        gain = normalisation.weight / torch.sqrt(normalisation.running_var + normalisation.eps)
        convolution.weight /= deviation[:, None, None, None]
        normalisation.bias.add_(gain * (mean - normalisation.running_mean))
        normalisation.weight.copy_(gain * deviation * math.sqrt(1 + normalisation.eps))
        normalisation.running_mean.copy_(mean / deviation)
        normalisation.running_var.fill_(1.0)


def _design(weights: dict[str, Tensor]) -> dict[str, Any]:
    """Depths, numbers of channels and blocks of attention of a network with these weights, for `KeypointNet`."""
    levels = range(4)
    blocks = [[n for n in weights if n.startswith(f"levels.{i}.") and n.endswith("first.0.weight")] for i in levels]
    widths = [len(weights["stem.1.0.weight"]), *(len(weights[f"levels.{i}.0.0.weight"]) for i in levels[1:])]
    # The finest level may have no blocks on the way down; the coarsest has none on the way up.
    hidden = [len(weights[f"laterals.{2 - i}.block.first.0.weight"]) for i in levels[:3]]
    hidden.append(len(weights[blocks[3][0]]) if blocks[3] else widths[3])
    attention = sum(name.startswith("attention.") and name.endswith(".out.weight") for name in weights)
    return {
        "widths": tuple(widths), "depths": tuple(map(len, blocks)), "hidden": tuple(hidden), "attention": attention,
    }  # fmt: skip


def _fold_input_normalisation(weights: dict[str, Tensor], divides: bool) -> None:
    """Fold the input normalisation of earlier networks into their first filters.

    These subtracted the images' mean and, if `divides`, divided by the standard deviation. The only difference is
    beyond the border, which was the mean and is black.

    Args:
        weights: by name as in a muybridge file; changed in place.
        divides: whether there was a division.
    """
    mean, deviation = (torch.tensor(values).view(1, -1, 1, 1) for values in (MEAN, STD))
    filters = weights["stem.0.0.weight"]
    channels = filters.shape[1]
    if divides:
        filters = filters / deviation[:, :channels]
    weights["stem.0.0.weight"] = filters
    weights["stem.0.0.weight_bias"] = weights["stem.0.0.weight_bias"] - (filters * mean[:, :channels]).sum((1, 2, 3))


def _unfold_state(net: nn.Module, weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """A state of `net`: convolutions as in the file, normalisations that only add a bias."""
    state = net.state_dict()
    normalisations = {name: m for name, m in net.named_modules() if isinstance(m, nn.BatchNorm2d)}
    for name, module in normalisations.items():
        before = f"{name.rpartition('.')[0]}.0"  # the convolution before it
        state[f"{name}.running_mean"] = torch.zeros(module.num_features)
        state[f"{name}.running_var"] = torch.ones(module.num_features)
        state[f"{name}.weight"] = torch.full((module.num_features,), math.sqrt(1 + module.eps))
        state[f"{name}.bias"] = weights[f"{before}.weight_bias"]
    plain = {k for k in state if k.rpartition(".")[0] not in normalisations}
    return state | {k: weights[k] for k in plain}
