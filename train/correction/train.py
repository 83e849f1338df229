"""Training of the correction network: the classical fit's error on synthetic people, predicted from the fit's
residuals."""

import functools
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from rich.progress import track
from torch import Tensor, nn

from muybridge.errors import SessionError
from muybridge.geometry.skeleton.body import BODY
from muybridge.models.correction.features import ANGLE, LENGTH, carriers, mirrored
from muybridge.models.correction.network import SolverNet
from muybridge.train.correction.examples import load_fits, make_fits
from muybridge.train.correction.options import SolverTraining
from muybridge.train.correction.ridge import solve_linear
from muybridge.train.engine import loop
from muybridge.train.engine.checkpoint import CHECKPOINT
from muybridge.train.engine.process_pool import map_in_processes

# The people and motions of the first shard are never trained on.
HELD_OUT = range(0, 1)
TRAINED_ON = range(HELD_OUT.stop, 100_000)
# A degree counts as much as this many millimetres; the targets are 13 mm and 4.3 degrees.
_DEGREE_MM = 3.0
_ROTATION, _SHIFT = np.rad2deg(ANGLE) * _DEGREE_MM, LENGTH * 1000


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Mean distance to the true correction in millimetres, as in the scores; the same again for the log."""
    markers, known, joints, target = batch
    error = net(markers, known, joints) - target
    rotation, shift = error[..., :3] * _ROTATION, error[..., 3:] * _SHIFT
    reached = net.reached(known)  # type: ignore[operator]
    # Smooth within half a millimetre of the target.
    loss = sum(((v.square().sum(-1) + 0.25).sqrt() * reached).sum() / reached.sum() for v in (rotation, shift))
    assert isinstance(loss, Tensor)
    return loss, loss.detach()


@torch.no_grad()
def evaluate(net: nn.Module, data: tuple[Tensor, ...]) -> dict[str, float]:
    """Mean joint errors of the classical fit and of the corrected one, in millimetres and degrees.

    Args:
        net: the network.
        data: markers, known, joints, target and frame rate of the examples.

    Returns:
        `fit_deg`, `fit_mm`, `net_deg` and `net_mm` over all examples, and each for every frame rate (`net_mm_30`); only
        joints at or next to a marker count.
    """
    data = tuple(t.to(next(net.parameters()).device) for t in data)
    reached = net.reached(data[1].float())  # type: ignore[operator]

    def mean(each: Tensor) -> Tensor:
        average: Tensor = (each * reached).sum(-1) / reached.sum(-1)
        return average

    correction = torch.cat([net(*(t[k : k + 512].float() for t in data[:3])) for k in range(0, len(data[0]), 512)])
    out = {}
    for name, error in (("fit", data[3]), ("net", data[3] - correction)):
        degrees = torch.rad2deg(mean(error[..., :3].norm(dim=-1)) * ANGLE)
        millimetres = mean(error[..., 3:].norm(dim=-1)) * LENGTH * 1000
        out[f"{name}_deg"], out[f"{name}_mm"] = float(degrees.mean()), float(millimetres.mean())
        for rate in np.unique(data[4].cpu().numpy()):
            at = data[4] == rate
            out[f"{name}_deg_{int(rate)}"] = float(degrees[at].mean())
            out[f"{name}_mm_{int(rate)}"] = float(millimetres[at].mean())
    return out


def _stream(options: SolverTraining, start: int) -> Iterator[loop.Batch]:
    """Batches of examples, half of them mirrored."""
    rng = np.random.default_rng(loop.worker_seed(options.seed, start))
    data = load_fits(options.out / "fits", TRAINED_ON)[:4]
    while True:
        chosen = rng.integers(0, len(data[0]), options.batch)
        batch = tuple(t[torch.from_numpy(chosen)].float() for t in data)
        if rng.random() < 0.5:
            batch = tuple(torch.from_numpy(np.ascontiguousarray(a)) for a in mirrored(*(t.numpy() for t in batch)))
        yield batch


def _make_shard(options: SolverTraining, followed: bool, shard: int) -> None:
    make_fits(options.clips, options.out / "fits", range(shard, shard + 1), options.seed, followed)


def _make_all(options: SolverTraining) -> None:
    """Make the missing fits of all shards, and of the people who follow them, in `options.workers` processes."""
    for followed in (False, True):  # the followers need the clips of the others
        fits = options.out / "fits" / ("followed" if followed else "")
        missing = [k for k in range(options.shards) if not (fits / f"{k:05}.npz").exists()]
        made = map_in_processes(functools.partial(_make_shard, options, followed), missing, options.workers)
        for _ in track(made, "fits", total=len(missing), transient=True):
            pass


def train(options: SolverTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the path of the new one.

    Missing fits are made first. A new run begins with the linear part, which is solved in closed form.

    Raises:
        SessionError: there are too few shards.
    """
    if options.shards <= HELD_OUT.stop:
        raise SessionError(f"--shards {options.shards}: the first is held out from training; use two or more")
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    _make_all(options)
    held_out = load_fits(options.out / "fits", HELD_OUT)
    net = SolverNet(carriers(), list(BODY.parents))
    if not (options.out / CHECKPOINT).exists():
        # Neighbouring frames of a take are nearly equal.
        solve_linear(net, tuple(t[::3] for t in load_fits(options.out / "fits", TRAINED_ON)))
    run = loop.TrainingRun(options, net, lambda net: evaluate(net, held_out))
    run.run(_stream(options, run.state["step"]), loss_of)
    return run.checkpoint


def solver_net(saved: dict[str, Any]) -> SolverNet:
    """The averaged network of a checkpoint."""
    net = SolverNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
