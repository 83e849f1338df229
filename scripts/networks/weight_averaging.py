"""Average the weights of several networks of one training run, each taken after its learning rate had fallen.

Wortsman et al., "Model soups", ICML 2022; Izmailov et al., "Averaging weights leads to wider optima", UAI 2018.
Networks between which training continued at a constant rate lie in one basin, whose centre is lower than its sides.
"""

import pathlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch

from muybridge.errors import ModelError
from muybridge.models.keypoints.network import KeypointNet
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, people_net_from_onnx, training_record
from muybridge.models.people.network import PeopleNet
from muybridge.train.engine.loop import TrainingHistory


def average_keypoints(paths: Sequence[pathlib.Path]) -> dict[str, Any]:
    """A checkpoint, as `publish_keypoints` takes it, with the mean of fp32 muybridge keypoint networks.

    Args:
        paths: ONNX files. Normalisation is folded into their convolutions, so that no statistics have to be measured
            again. A file that is listed twice counts twice.

    Raises:
        ModelError: fewer than two files, or one that is not a muybridge network or of another design than the first.
    """
    return _average(paths, keypoint_net_from_onnx)


def average_people(paths: Sequence[pathlib.Path]) -> dict[str, Any]:
    """The same for person detectors, for `publish_people`."""
    return _average(paths, people_net_from_onnx)


def _average(paths: Sequence[pathlib.Path], read: Callable[[pathlib.Path], KeypointNet | PeopleNet]) -> dict[str, Any]:
    if len(paths) < 2:
        raise ModelError("an average needs two networks or more")
    nets = [read(path) for path in paths]
    states = [net.state_dict() for net in nets]
    for path, state in zip(paths, states, strict=True):
        if {k: v.shape for k, v in state.items()} != {k: v.shape for k, v in states[0].items()}:
            raise ModelError(f"{path}: of another design than {paths[0]}; average networks of one training run")
    mean = {k: torch.stack([s[k].float() for s in states]).mean(0).to(v.dtype) for k, v in states[0].items()}
    return {
        "average": mean, "config": nets[0].config, "scores": {},
        "state": _combined_history(dict.fromkeys(paths))._asdict(),
        "options": {"seed": training_record(paths[0])["seed"]},
    }  # fmt: skip


def _combined_history(paths: Iterable[pathlib.Path]) -> TrainingHistory:
    """Combined history: that of the youngest network, from which the others are assumed to have continued, plus what
    each of them saw since."""
    seen = [TrainingHistory.of_file(path) for path in paths]
    first = min(seen)
    return TrainingHistory(
        first.images + sum(s.images - first.images for s in seen),
        first.seconds + sum(s.seconds - first.seconds for s in seen),
    )
