"""Training of the keypoint network: one loop, from renders on disk to checkpoints.

The loss is the cross-entropy between the softmax over a landmark's cells and a small Gaussian at its true place
(the classification form of SimCC, Li et al. 2022, in two dimensions), plus a binary one for visibility.
"""

import itertools
import pathlib
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from muybridge.arrays import ByteArray
from muybridge.errors import ModelError
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import decode_heatmaps
from muybridge.models.keypoints.metadata import crop_side
from muybridge.models.keypoints.network import STRIDE, KeypointNet, with_attention
from muybridge.models.keypoints.test_time import FIRST_PASS, LEAST, Maps, at_side
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, measure_normalisation
from muybridge.models.uncertainty import SpreadCalibration
from muybridge.train.engine import loop
from muybridge.train.engine.checkpoint import CHECKPOINT
from muybridge.train.engine.compile import compile_for_training
from muybridge.train.engine.gradient_worker import GradientWorker, is_worthwhile
from muybridge.train.engine.precision import autocast
from muybridge.train.images import dataset
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.images.options import WHOLE
from muybridge.train.keypoints.data_echoing import Echo
from muybridge.train.keypoints.evaluate import LIMB, MIRROR
from muybridge.train.keypoints.export import load_keypoint_checkpoint
from muybridge.train.keypoints.hard_examples import Difficulty, drawing_probability, mix_scenes, read_difficulty
from muybridge.train.keypoints.loss import cross_entropy, targets
from muybridge.train.keypoints.options import KeypointTraining
from muybridge.train.synthesis.rendering.store import RenderSet, load_renders

# Weight of the virtual markers' loss relative to the body landmarks'.
SURFACE_WEIGHT = 0.5
# Sides of the crops of `muybridge run`'s first pass and of partly visible people, as shares of the full side.
SMALLER = (FIRST_PASS, LEAST)
# Batches after which the workers that make crops reload which renders are hard.
_REFRESH_BATCHES = 100


@dataclass(frozen=True)
class _Crops:
    """Batches of training crops, for `dataset.batches`."""

    pool: pathlib.Path
    size: int
    smaller: float
    count: int
    difficulty: pathlib.Path
    hard: float
    scenes: float = 0.5

    def __call__(self, renders: RenderSet, seed: int) -> Callable[[], loop.Batch]:
        backgrounds = np.load(self.pool, mmap_mode="r")
        sides = (self.size, *(crop_side(share * self.size) for share in SMALLER))
        compositors = [Compositor(renders, backgrounds, side, seed) for side in sides]
        rng = np.random.default_rng([seed, 2])
        made = itertools.count()
        probability = np.empty(0)

        def next_batch() -> loop.Batch:
            nonlocal probability
            number = next(made)
            if number % _REFRESH_BATCHES == 0:
                probability = drawing_probability(read_difficulty(self.difficulty), len(renders), self.hard)
                probability = mix_scenes(probability, compositors[0].people, compositors[0].scenes, self.scenes)
            index = rng.choice(len(renders), self.count, p=probability)
            # Not the first, whose size determines how much memory the second process allocates.
            smaller = number and rng.random() < self.smaller
            batch = compositors[rng.integers(1, len(sides)) if smaller else 0].batch(self.count, index)
            landmarks = torch.cat([batch.landmarks_px, batch.markers_px], 1)
            visible = torch.cat([batch.visible, batch.markers_visible], 1)
            pixels = batch.pixels.contiguous(memory_format=torch.channels_last)  # done here, since workers have time
            return pixels, landmarks, visible, torch.from_numpy(index)

        return next_batch


class Loss:
    """The loss of a batch; it also records which renders are hard.

    Args:
        difficulty: where that is recorded.
        losses: `losses_of`, compiled or not.
    """

    def __init__(self, difficulty: Difficulty, losses: Callable[..., tuple[Tensor, Tensor, Tensor]]) -> None:
        self.difficulty, self.losses = difficulty, losses

    def __call__(self, net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
        """Total loss, and the mean cross-entropy of the visible body landmarks for the log."""
        total, each, count = self.losses(net, batch[:3])
        self.difficulty.record(batch[3].cpu().numpy(), (each / count).cpu().numpy())
        return total, each.sum() / count.sum()


def losses_of(net: KeypointNet, batch: loop.Batch, hidden: float = 0.35) -> tuple[Tensor, Tensor, Tensor]:
    """Losses of a batch.

    Args:
        net: the network.
        batch: pixels (B, 4, S, S) uint8, landmarks (B, J, 2) px, visibility (B, J) bool.
        hidden: weight of hidden landmarks.

    Returns:
        Total loss; (B,) summed cross-entropy of the visible body landmarks of each crop, without gradients; (B,) their
        number.
    """
    image, landmarks_px, visible = batch[:3]
    body, target = len(BODY23), targets(landmarks_px, image.shape[-2] // STRIDE, image.shape[-1] // STRIDE)
    with autocast(image.device):
        heatmaps, markers, visibility = net.apart(image.float().div_(255))
    each = cross_entropy(heatmaps, target.of(slice(body)))
    if markers is not None:
        each = torch.cat([each, cross_entropy(markers, target.of(slice(body, None)))], 1)
    seen, known = visible.float(), landmarks_px.isfinite().all(-1).float()
    # Hidden landmarks count too, but less: the network should guess them and be uncertain.
    weight = hidden + (1 - hidden) * seen
    see = torch.nn.functional.binary_cross_entropy_with_logits(visibility.float(), seen, known)
    total = (each * weight)[:, :body].mean() + 0.2 * see
    if markers is not None:
        total = total + SURFACE_WEIGHT * (each * weight)[:, body:].mean()
    return total, (each * seen)[:, :body].sum(1).detach(), seen[:, :body].sum(1)


@torch.no_grad()
def body_maps(net: nn.Module, image: Tensor) -> Tensor:
    """(B, 23, S/4, S/4) logits of the body's landmarks, of (B, 4, S, S) uint8."""
    with autocast(image.device):
        heatmaps, _ = net(image.float().div_(255))
    return heatmaps[:, : len(BODY23)].float().cpu()  # type: ignore[no-any-return]


def evaluate(net: nn.Module, batches: list[Batch]) -> dict[str, float]:
    """Scores of visible landmarks in held-out crops, with points decoded as in use.

    Args:
        net: the network.
        batches: of held-out crops.

    Returns:
        Median and mean error in crop pixels; PCK at 5 % of the crop; the share of limb landmarks nearer to their
        left-right
        counterpart (flips); the mean cross-entropy, which separates versions that the others do not, since it counts
        the
        confidence in every landmark and not only the few that flip; and PCK of the same crops made smaller, like those
        of
        partly visible people.
    """
    where = next(net.parameters()).device
    errors, flips, losses, smaller = [], [], [], []
    side = batches[0].image.shape[-1]
    for batch in batches:
        maps = body_maps(net, batch.pixels.to(where))
        smaller.append(_errors_smaller(net, batch)[batch.visible])
        at = torch.from_numpy(decode_heatmaps(maps.numpy(), STRIDE, SpreadCalibration(), MIRROR).points_crop_px).float()
        distance = (at - batch.landmarks_px).norm(dim=-1)
        twin = batch.landmarks_px[:, MIRROR]
        to_twin = (at - twin).norm(dim=-1)
        apart = (batch.landmarks_px - twin).norm(dim=-1) > 0.06 * side
        errors.append(distance[batch.visible])
        flips.append((to_twin < distance)[batch.visible & torch.from_numpy(LIMB) & apart])
        losses.append(cross_entropy(maps, targets(batch.landmarks_px, *maps.shape[-2:]))[batch.visible])
    error, flip, small = torch.cat(errors), torch.cat(flips).float(), torch.cat(smaller)
    return {
        "median_px": float(error.median()), "mean_px": float(error.mean()),
        "pck05": float((error < 0.05 * side).float().mean()), "flips": float(flip.mean()),
        "held_out_loss": float(torch.cat(losses).mean()), "pck05_smaller": float((small < 0.05 * side).float().mean()),
    }  # fmt: skip


def _errors_smaller(net: nn.Module, batch: Batch) -> Tensor:
    """(B, 23) landmark errors, in pixels of the crops as they are, when read in crops of the last size in `SMALLER`."""
    device = next(net.parameters()).device

    def read(crops: ByteArray) -> Maps:
        return [body_maps(net, torch.from_numpy(crops).to(device)).numpy()]

    side = crop_side(SMALLER[-1] * batch.image.shape[-1])
    (maps,) = at_side(read, side, rows=2)(batch.pixels.numpy())
    found = decode_heatmaps(maps, STRIDE, SpreadCalibration(), MIRROR).points_crop_px
    away: Tensor = torch.linalg.vector_norm(torch.from_numpy(found).float() - batch.landmarks_px, dim=-1)
    return away


def held_out_batches(renders: pathlib.Path, pool: pathlib.Path, size: int, count: int = 8) -> list[Batch]:
    """The same held-out crops at every call: seeded, of people who are never trained on, but on the training's
    backgrounds (`muybridge eval` draws others)."""
    store = load_renders(renders, dataset.HELD_OUT)
    backgrounds = np.load(pool, mmap_mode="r")
    return [Compositor(store, backgrounds, size, 10_000 + i, WHOLE).batch(64) for i in range(count)]


def _start_network(options: KeypointTraining) -> KeypointNet | None:
    """A network like that of the run in `options.out`, else that of the file to start from, else None."""
    if loop.resumes(options):
        config = load_keypoint_checkpoint(options.out / CHECKPOINT)["config"]
        if "landmarks" not in config:
            raise ModelError(f"{options.out}: it has a run of another network; name another folder with --out")
        return KeypointNet(**config)
    return None if options.model is None else _network_from_file(options.model, options.attention)


def _network_from_file(model: pathlib.Path, attention: int) -> KeypointNet:
    net = keypoint_net_from_onnx(model)
    if net.visibility.out_features != len(BODY23) + len(SURFACE):
        raise ModelError(f"{model}: training needs a network that detects virtual markers too")
    return with_attention(net, max(attention, net.config["attention"]))


def _second_process(net: KeypointNet, options: KeypointTraining) -> AbstractContextManager[GradientWorker | None]:
    """The second process if it is requested and worthwhile."""
    if options.second and is_worthwhile(options.batch, options.threads, options.worthwhile_minutes):
        return GradientWorker(
            net, partial(losses_of, hidden=options.hidden), options.worthwhile_minutes, options.threads
        )
    return nullcontext()


def _with_echoes(
    stream: Iterator[loop.Batch], options: KeypointTraining
) -> AbstractContextManager[Iterator[loop.Batch]]:
    """The batches and, where a GPU would wait for new ones, old ones in between, unless the training must not depend on
    time."""
    if loop.device().type == "cuda" and options.echo > 1 and options.steps is None:
        return closing(Echo(stream, loop.device(), options.echo, options.seed))
    return nullcontext(stream)


def train(options: KeypointTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the path of the new one.

    Raises:
        ModelError: the options or the network to start from cannot be used.
        SessionError: the renders or the checkpoint cannot be used.
    """
    for name, share, what in (
        ("hard", options.hard, "crops"), ("smaller", options.smaller, "batches"), ("hidden", options.hidden, "loss")
    ):  # fmt: skip
        if not 0 <= share <= 1:
            raise ModelError(f"--{name} {share:g}: must be a share of the {what}, from 0 to 1")
    model = None if loop.resumes(options) else options.model
    start = _start_network(options)  # before anything that takes minutes
    with dataset.training_data(options) as pool:
        validation = held_out_batches(options.renders, pool, options.size)
        net = start or KeypointNet(len(BODY23) + len(SURFACE), attention=options.attention)
        if model is not None:
            measure_normalisation(net, [validation[0].pixels.float().div(255)])
        history = loop.TrainingHistory() if model is None else loop.TrainingHistory.of_file(model)
        run = loop.TrainingRun(options, net, lambda net: evaluate(net, validation), history)
        # The recorded losses belong to the renders of these stores.
        store = zlib.crc32(":".join(str(folder.resolve()) for folder in dataset.stores_of(options)).encode())
        difficulty = Difficulty(options.out / f"difficulty-{store:08x}.npy")
        crops = _Crops(
            pool, options.size, options.smaller, options.batch, difficulty.path, options.hard, options.scenes
        )
        losses = partial(losses_of, hidden=options.hidden)
        loss = Loss(difficulty, compile_for_training(losses, options.worthwhile_minutes))
        with (
            _second_process(net, options) as worker,
            _with_echoes(dataset.batches(options, crops, run.state["step"]), options) as stream,
        ):
            run.run(stream, loss, worker)
    return run.checkpoint
