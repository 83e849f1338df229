"""Training of the solver's network: what the classical fit is off on synthetic people, from what it left over."""

import pathlib
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor, nn

from muybridge.errors import MuybridgeError
from muybridge.files import replacing
from muybridge.geometry.body import BODY
from muybridge.geometry.landmarks import CMU, PLUG_IN_GAIT
from muybridge.geometry.marker_body import marker_body
from muybridge.geometry.marker_fit import MarkerFitOptions, fit_markers
from muybridge.geometry.solver_features import ANGLE, LENGTH, carriers, solver_input, target_of
from muybridge.models.solver_net import WINDOW, SolverNet
from muybridge.train import loop
from muybridge.train.marker_clouds import FPS
from muybridge.train.options import SolverTraining
from muybridge.train.solver_clips import SolverClips, load_solver_clips, make_solver_clips
from muybridge.train.solver_takes import Spoiling, marker_columns, spoil

# The first shard's people and motions are never trained on.
HELD_OUT = range(0, 1)
_KEYS = ("markers", "known", "joints", "target")


def fitted(clips: SolverClips, k: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Clip `k` spoiled and fitted: the network's inputs and the right answers, every other frame."""
    table, columns = marker_body(), marker_columns((PLUG_IN_GAIT, CMU)[int(rng.integers(2))])
    turns, places = clips.turns[k].astype(np.float64), clips.places[k].astype(np.float64)
    placed = rng.normal(0, 1, (len(table.carrier), 3)) * table.tolerance[:, None] * rng.uniform(0, 1) * [1, 1, 0.4]
    points = clips.points[k] + np.einsum("tmij,mj->tmi", turns[:, carriers()], placed)
    how = Spoiling(rng.uniform(0, 0.25), rng.uniform(0, 0.15), 0.05, 0.002, float(rng.choice([0.0, 0.25])))
    seen, _ = spoil(points[:, columns], FPS, how, rng)
    fit = fit_markers(seen, columns, FPS, MarkerFitOptions(calibration_frames=48, rounds=2, steps=1))
    given = solver_input(fit, seen, WINDOW)
    every = slice(None, None, 2)
    return {"markers": given.markers[every].astype(np.float16), "known": given.known[every].astype(np.float16),
            "joints": given.joints[every].astype(np.float16),
            "target": target_of(given, turns, places)[every]}  # fmt: skip


def make_fits(clips: pathlib.Path, out: pathlib.Path, shards: range, seed: int = 0) -> None:
    """One file of fits a shard of clips, where there is none yet."""
    out.mkdir(parents=True, exist_ok=True)
    for number in shards:
        path = out / f"{number:05}.npz"
        if path.exists():
            continue
        make_solver_clips(clips, range(number, number + 1), seed)
        shard = load_solver_clips(clips, range(number, number + 1))
        rng = np.random.default_rng([seed, number])
        made = []
        for k in range(len(shard.points)):
            try:
                made.append(fitted(shard, k, rng))
            except (MuybridgeError, np.linalg.LinAlgError):
                continue  # a clip so spoiled that nothing can be fitted teaches nothing
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **{key: np.concatenate([m[key] for m in made]) for key in _KEYS})  # type: ignore[arg-type]


def load_fits(folder: pathlib.Path, shards: range) -> tuple[Tensor, ...]:
    """Markers, known, joints and targets of those of `shards` that are there."""
    found = [np.load(p) for p in sorted(folder.glob("*.npz")) if p.stem.isdecimal() and int(p.stem) in shards]
    if not found:
        return ()
    return tuple(torch.from_numpy(np.concatenate([f[k] for f in found])).float() for k in _KEYS)


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Robust distance to the right answer, and the same for the log."""
    markers, known, joints, target = batch
    loss = nn.functional.smooth_l1_loss(net(markers, known, joints), target, beta=0.3)
    return loss, loss.detach()


@torch.no_grad()
def evaluate(net: nn.Module, data: tuple[Tensor, ...]) -> dict[str, float]:
    """Mean joint errors of the classical fit and of the corrected one: millimetres and degrees."""
    out = {}
    answer = torch.cat([net(*(t[k : k + 512] for t in data[:3])) for k in range(0, len(data[0]), 512)])
    for name, left in (("fit", data[3]), ("net", data[3] - answer)):
        out[f"{name}_deg"] = float(torch.rad2deg(left[..., :3].norm(dim=-1).mean() * ANGLE))
        out[f"{name}_mm"] = float(left[..., 3:].norm(dim=-1).mean() * LENGTH * 1000)
    return out


def _stream(options: SolverTraining, start: int) -> Iterator[loop.Batch]:
    rng = np.random.default_rng(loop.worker_seed(options.seed, start))
    while True:
        data = load_fits(options.out / "fits", range(HELD_OUT.stop, 100_000))
        for _ in range(400):
            chosen = torch.from_numpy(rng.integers(0, len(data[0]), options.batch))
            yield tuple(t[chosen] for t in data)


def train(options: SolverTraining) -> pathlib.Path:
    """Trains for `options.minutes` from the last checkpoint in `options.out`; returns the checkpoint's path."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    make_fits(options.clips, options.out / "fits", range(options.shards), options.seed)
    held_out = load_fits(options.out / "fits", HELD_OUT)
    fit = loop.Fit(options, SolverNet(carriers(), list(BODY.parents)), lambda net: evaluate(net, held_out))
    fit.run(_stream(options, fit.state["step"]), loss_of)
    return fit.checkpoint


def trained_network(checkpoint: pathlib.Path) -> SolverNet:
    """The network of a checkpoint with its averaged weights."""
    saved = torch.load(checkpoint, map_location="cpu", weights_only=False)
    net = SolverNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
