"""Training of the network that weights skins: the sum of differences from artists' weights on generated characters."""

import functools
import pathlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from rich.progress import track
from torch import Tensor, nn

from muybridge.errors import SessionError
from muybridge.models.characters.weight_network import WeightNet
from muybridge.motion.character.weights.graph import FEATURES
from muybridge.train.characters.examples import WeightExample, load_shards, make_shard
from muybridge.train.characters.options import SkinningTraining
from muybridge.train.engine import loop
from muybridge.train.engine.process_pool import map_in_processes

# The bodies of the first shard are never trained on.
HELD_OUT = range(0, 1)
# Share of the characters whose bending skin has weights by rule, as heat gives them: many artists begin with such
# weights and leave most of them, and a mesh does not show whether one did. What is rigid keeps its weights.
BY_RULE = 0.55
_ISLAND = FEATURES.index("island")
_RIGID = 0.99  # least weight of a rigid island's points


def pack(examples: Sequence[WeightExample]) -> loop.Batch:
    """Several characters as one graph without edges between them; the first tensor has a row for each of them."""
    sizes = [len(e.base) for e in examples]
    total, width = sum(sizes), examples[0].base.shape[1]
    same, start = [], 0
    for example, size in zip(examples, sizes, strict=True):
        own = example.same.astype(np.int64)
        same.append(np.where(own < size * width, own + start * width, total * width))
        start += size

    def floats(name: str) -> Tensor:
        return torch.from_numpy(np.concatenate([getattr(e, name) for e in examples]).astype(np.float32))

    parent = torch.from_numpy(np.concatenate([e.parent for e in examples]).astype(np.int64))
    return (torch.tensor(sizes), floats("features"), floats("base"), floats("exists"), parent,
            torch.from_numpy(np.concatenate(same)), floats("target"))  # fmt: skip


def by_rule(example: WeightExample) -> WeightExample:
    """The same with weights by heat wherever an island of the mesh is not rigid to one joint."""
    _, island = np.unique(example.features[:, 0, _ISLAND], return_inverse=True)  # shares of the area tell them apart
    loose = np.ones(int(island.max()) + 1)
    np.minimum.at(loose, island.ravel(), example.target.max(axis=1).astype(np.float64))
    rigid = (loose >= _RIGID)[island.ravel(), None]
    heat = np.exp(example.base.astype(np.float32)) * example.exists
    heat = (heat / heat.sum(axis=1, keepdims=True)).astype(example.target.dtype)
    return replace(example, target=np.where(rigid, example.target, heat))


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Mean over points of the sum of absolute differences; each character counts the same. The same for the log."""
    sizes, *given, target = batch
    off = (net(*given) - target).abs().sum(1)
    share = torch.repeat_interleave(1.0 / (sizes * len(sizes)), sizes)
    loss = (off * share).sum()
    return loss, loss.detach()


@torch.no_grad()
def evaluate(net: nn.Module, held_out: Sequence[WeightExample]) -> dict[str, float]:
    """Mean sum of absolute differences (L1, 0 to 2) of weights by heat and of the network's, on held-out characters."""
    heat, net_l1 = [], []
    for example in held_out:
        batch = tuple(t.to(next(net.parameters()).device) for t in pack([example]))
        beyond = 1 - batch[-1].sum(1)  # weights of joints that are no candidates
        base = torch.softmax(batch[2] + (batch[3] - 1) * 1e4, 1) * batch[3]
        heat.append(float(((base - batch[-1]).abs().sum(1) + beyond).mean()))
        net_l1.append(float(((net(*batch[1:-1]) - batch[-1]).abs().sum(1) + beyond).mean()))
    return {"heat_l1": float(np.mean(heat)), "net_l1": float(np.mean(net_l1))}


def _stream(options: SkinningTraining, start: int) -> Iterator[loop.Batch]:
    rng = np.random.default_rng(loop.worker_seed(options.seed, start))
    data = load_shards(options.out / "examples", range(HELD_OUT.stop, 100_000))
    while True:
        chosen = [data[k] for k in rng.choice(len(data), min(options.batch, len(data)), replace=False)]
        yield pack([by_rule(e) if rng.random() < BY_RULE else e for e in chosen])


def train(options: SkinningTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the path of the new one.

    Missing examples are made first.

    Raises:
        SessionError: there are too few shards.
    """
    if options.shards <= HELD_OUT.stop:
        raise SessionError(f"--shards {options.shards}: the first is held out from training; use two or more")
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    folder = options.out / "examples"
    missing = [k for k in range(options.shards) if not (folder / f"{k:05}.npz").exists()]
    made = map_in_processes(functools.partial(_make, folder, options.seed), missing, options.workers)
    for _ in track(made, "characters", total=len(missing), transient=True):
        pass
    held_out = load_shards(folder, HELD_OUT)
    run = loop.TrainingRun(options, WeightNet(len(FEATURES)), lambda net: evaluate(net, held_out))
    run.run(_stream(options, run.state["step"]), loss_of)
    return run.checkpoint


def _make(folder: pathlib.Path, seed: int, shard: int) -> None:
    make_shard(folder, shard, seed)


def weight_net(saved: dict[str, Any]) -> WeightNet:
    """The averaged network of a checkpoint."""
    net = WeightNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
