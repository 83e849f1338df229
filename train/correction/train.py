"""Training of the solver's network: what the classical fit is off on synthetic people, from what it left over."""

import functools
import pathlib
from collections.abc import Iterator

import numpy as np
import torch
from rich.progress import track
from torch import Tensor, nn

from muybridge.errors import SessionError
from muybridge.geometry.skeleton.body import BODY
from muybridge.models.correction.features import ANGLE, LENGTH, carriers, mirrored
from muybridge.models.correction.network import SolverNet
from muybridge.train.correction.examples import load_fits, make_fits
from muybridge.train.correction.ridge import solve_linear
from muybridge.train.engine import loop
from muybridge.train.engine.process_pool import shared_out
from muybridge.train.options import SolverTraining

# The first shard's people and motions are never trained on.
HELD_OUT = range(0, 1)
TRAINED_ON = range(HELD_OUT.stop, 100_000)
# Millimetres count as much as degrees times this many: the bars are 13 mm and 4.3 degrees.
_DEGREE_MM = 3.0
_ROTATION, _SHIFT = np.rad2deg(ANGLE) * _DEGREE_MM, LENGTH * 1000


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Mean distance to the right answer, the same that is scored, in millimetres; and the same for the log."""
    markers, known, joints, target = batch
    off = net(markers, known, joints) - target
    turn, shift = off[..., :3] * _ROTATION, off[..., 3:] * _SHIFT
    there = net.reached(known)  # type: ignore[operator]
    # Rounded within half a millimetre of the answer.
    loss = sum(((v.square().sum(-1) + 0.25).sqrt() * there).sum() / there.sum() for v in (turn, shift))
    assert isinstance(loss, Tensor)
    return loss, loss.detach()


@torch.no_grad()
def evaluate(net: nn.Module, data: tuple[Tensor, ...]) -> dict[str, float]:
    """Mean joint errors of the classical fit and of the corrected one, millimetres and degrees: of all examples and
    of each frame rate; of joints that markers tell of."""
    data = tuple(t.to(next(net.parameters()).device) for t in data)
    there = net.reached(data[1].float())  # type: ignore[operator]

    def mean(each: Tensor) -> Tensor:
        average: Tensor = (each * there).sum(-1) / there.sum(-1)
        return average

    answer = torch.cat([net(*(t[k : k + 512].float() for t in data[:3])) for k in range(0, len(data[0]), 512)])
    out = {}
    for name, left in (("fit", data[3]), ("net", data[3] - answer)):
        degrees = torch.rad2deg(mean(left[..., :3].norm(dim=-1)) * ANGLE)
        millimetres = mean(left[..., 3:].norm(dim=-1)) * LENGTH * 1000
        out[f"{name}_deg"], out[f"{name}_mm"] = float(degrees.mean()), float(millimetres.mean())
        for rate in np.unique(data[4].cpu().numpy()):
            at = data[4] == rate
            out[f"{name}_deg_{int(rate)}"] = float(degrees[at].mean())
            out[f"{name}_mm_{int(rate)}"] = float(millimetres[at].mean())
    return out


def _stream(options: SolverTraining, start: int) -> Iterator[loop.Batch]:
    """Batches of examples, half of them in a mirror."""
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
    """Fits of all shards and of those who follow them, in `options.workers` processes."""
    for followed in (False, True):  # who need the clips of the others
        fits = options.out / "fits" / ("followed" if followed else "")
        missing = [k for k in range(options.shards) if not (fits / f"{k:05}.npz").exists()]
        made = shared_out(functools.partial(_make_shard, options, followed), missing, options.workers)
        for _ in track(made, "fits", total=len(missing), transient=True):
            pass


def train(options: SolverTraining) -> pathlib.Path:
    """Trains for `options.minutes` from the last checkpoint in `options.out`; returns the checkpoint's path.

    What fits are missing is made first. A new run begins with the part that is solved in closed form.
    """
    if options.shards <= HELD_OUT.stop:
        raise SessionError(f"--shards {options.shards}: the first is held out from training; make two or more")
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    _make_all(options)
    held_out = load_fits(options.out / "fits", HELD_OUT)
    net = SolverNet(carriers(), list(BODY.parents))
    if not (options.out / loop.CHECKPOINT).exists():
        # Neighbouring frames of a take tell the same.
        solve_linear(net, tuple(t[::3] for t in load_fits(options.out / "fits", TRAINED_ON)))
    fit = loop.Fit(options, net, lambda net: evaluate(net, held_out))
    fit.run(_stream(options, fit.state["step"]), loss_of)
    return fit.checkpoint


def trained_network(checkpoint: pathlib.Path) -> SolverNet:
    """The network of a checkpoint with its averaged weights."""
    saved = torch.load(checkpoint, map_location="cpu", weights_only=False)
    net = SolverNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
