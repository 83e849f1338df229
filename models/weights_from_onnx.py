"""A keypoint network of ours back from its ONNX file, so that training can go on from what was shipped."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor, nn

from muybridge.errors import ModelError
from muybridge.models.keypoint_net import KeypointNet

_HEADS = ("head", "visibility")


def keypoint_net_from_onnx(path: Path) -> KeypointNet:
    """The network of a file that `muybridge train keypoints` exported in fp32.

    The exporter folds normalisation into convolutions: here it does nothing but add the bias that came of it. In
    evaluation mode the outputs are those of the file.

    Raises:
        ModelError: the file is damaged, of 8 bits, or of another architecture.
    """
    import onnx
    from onnx import numpy_helper

    try:
        initializers = onnx.load(str(path)).graph.initializer
        there = {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in initializers}
    except Exception as error:
        raise ModelError(f"{path}: not an ONNX model ({str(error).splitlines()[0]})") from error
    # A network without virtual markers was exported as it is, one with them within `SeparateHeads`.
    marked = "body_head.weight" in there
    try:
        for name in _HEADS if marked else ():
            for kind in ("weight", "bias"):
                parts = [there.pop(f"{part}_{name}.{kind}") for part in ("body", "marker")]
                there[f"net.{name}.{kind}"] = torch.cat(parts)
        here = {name.removeprefix("net.") if marked else name: value for name, value in there.items()}
        net = KeypointNet(len(here["head.bias"]))
        net.load_state_dict(_unfolded(net, here))
    except (KeyError, RuntimeError) as error:
        raise ModelError(
            f"{path}: training cannot go on from this file ({str(error).splitlines()[0]}): it takes an fp32 network of "
            "this version's design, as the shipped one"
        ) from error
    return net.eval()


def _unfolded(net: KeypointNet, weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """A state of `net`: convolutions as they are in the file, normalisations with nothing but their bias."""
    state = net.state_dict()
    normalisations = {name: m for name, m in net.named_modules() if isinstance(m, nn.BatchNorm2d)}
    for name, module in normalisations.items():
        before = f"{name.rpartition('.')[0]}.0"  # the convolution that it follows
        state[f"{name}.running_mean"] = torch.zeros(module.num_features)
        state[f"{name}.running_var"] = torch.ones(module.num_features)
        state[f"{name}.weight"] = torch.full((module.num_features,), math.sqrt(1 + module.eps))
        state[f"{name}.bias"] = weights[f"{before}.weight_bias"]
    plain = {k for k in state if k.rpartition(".")[0] not in normalisations}
    return state | {k: weights[k] for k in plain}
