"""Training of the network that finds joints in a mesh."""

import functools
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from rich.progress import track
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

from muybridge.arrays import Float32Array
from muybridge.errors import SessionError
from muybridge.models.characters.rig_network import RigNet
from muybridge.motion.character.rigging.placement.learned import mirrored_roles
from muybridge.motion.character.rigging.points import POINTS, upright_points
from muybridge.train.characters.bodies import ROLES, load_bodies, make_body_shard
from muybridge.train.characters.options import RiggerTraining
from muybridge.train.engine import loop
from muybridge.train.engine.process_pool import map_in_processes

HELD_OUT = range(0, 1)
_UNSURE = 0.1  # weight of the expected distance's likelihood
_TILT, _TURN, _STRETCH = np.radians(2.0), np.radians(6.0), 0.08  # standard deviations of what bodies are changed by


def given_and_wanted(
    points: np.ndarray, joints: np.ndarray, rng: np.random.Generator | None
) -> tuple[Float32Array, Float32Array]:
    """The network's input (POINTS, 6) and the joints (J, 3) of a body; changed at random where `rng` is given."""
    points, joints = points.astype(np.float32), joints.astype(np.float32)
    if rng is None:
        points = points[:: len(points) // POINTS][:POINTS]
    else:
        points = points[rng.choice(len(points), POINTS, replace=False)]
        if rng.random() < 0.5:
            joints = joints[mirrored_roles()] * np.array([-1, 1, 1], np.float32)
            points = points * np.array([-1, 1, 1, -1, 1, 1], np.float32)
        turn = Rotation.from_rotvec(rng.normal(0, 1, 3) * [_TILT, _TILT, _TURN]).as_matrix()
        scale = np.exp(rng.normal(0, _STRETCH, 3))
        matrix = (np.diag(scale) @ turn).astype(np.float32)
        normal = points[:, 3:] @ np.linalg.inv(matrix).astype(np.float32)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        shift = np.array([rng.normal(0, 0.01 * float(np.ptp(points[:, 2]))), 0, 0], np.float32)
        points = np.concatenate([points[:, :3] @ matrix.T + shift, normal], axis=1)
        joints = joints @ matrix.T + shift
    upright, origin, height = upright_points(points)
    return upright, ((joints - origin) / height).astype(np.float32)


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Mean distance from the true joints, percent of the height, and the likelihood of the expected one; for the log
    the distance alone."""
    points, wanted = batch
    places, spread = net(points)
    off = ((places - wanted).square().sum(-1) + 1e-8).sqrt()
    unsure = off.detach() * torch.exp(-spread) + spread
    return 100 * off.mean() + _UNSURE * unsure.mean(), 100 * off.detach().mean()


@torch.no_grad()
def evaluate(net: nn.Module, held_out: loop.Batch) -> dict[str, float]:
    """Mean distance of the joints from the true ones on held-out bodies, percent of the height."""
    at = next(net.parameters()).device
    points, wanted = held_out
    off = torch.cat([(net(points[k : k + 16].to(at))[0] - wanted[k : k + 16].to(at)).norm(dim=-1)
                     for k in range(0, len(points), 16)])  # fmt: skip
    return {"mean_percent": 100 * float(off.mean()), "worst_percent": 100 * float(off.amax(1).mean())}


def packed(points: np.ndarray, joints: np.ndarray, rng: np.random.Generator | None) -> loop.Batch:
    """Several bodies as one batch."""
    pairs = [given_and_wanted(p, j, rng) for p, j in zip(points, joints, strict=True)]
    return torch.from_numpy(np.stack([p for p, _ in pairs])), torch.from_numpy(np.stack([j for _, j in pairs]))


def _stream(options: RiggerTraining, start: int) -> Iterator[loop.Batch]:
    rng = np.random.default_rng(loop.worker_seed(options.seed, start))
    points, joints = load_bodies(options.out / "bodies", range(HELD_OUT.stop, 100_000))
    while True:
        chosen = rng.choice(len(points), min(options.batch, len(points)), replace=False)
        yield packed(points[chosen], joints[chosen], rng)


def train(options: RiggerTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the path of the new one.

    Missing bodies are made first.

    Raises:
        SessionError: there are too few shards.
    """
    if options.shards <= HELD_OUT.stop:
        raise SessionError(f"--shards {options.shards}: the first is held out from training; use two or more")
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    folder = options.out / "bodies"
    missing = [k for k in range(options.shards) if not (folder / f"{k:05}.npz").exists()]
    made = map_in_processes(functools.partial(make_body_shard, folder, options.seed), missing, options.workers)
    for _ in track(made, "bodies", total=len(missing), transient=True):
        pass
    held_out = packed(*load_bodies(folder, HELD_OUT), None)
    run = loop.TrainingRun(options, RigNet(len(ROLES)), lambda net: evaluate(net, held_out))
    run.run(_stream(options, run.state["step"]), loss_of)
    return run.checkpoint


def rig_net(saved: dict[str, Any]) -> RigNet:
    """The averaged network of a checkpoint."""
    net = RigNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
