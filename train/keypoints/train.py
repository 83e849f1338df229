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

import numpy as np
import torch
from torch import Tensor, nn

from muybridge.arrays import ByteArray
from muybridge.errors import ModelError
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import decode_heatmaps
from muybridge.models.keypoints.metadata import crop_side
from muybridge.models.keypoints.network import STRIDE, KeypointNet
from muybridge.models.keypoints.rescale import FIRST_LOOK, LEAST, Maps, at_side
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, measure_normalisation
from muybridge.models.uncertainty import SpreadCalibration
from muybridge.train.engine import loop
from muybridge.train.engine.compile import compiled
from muybridge.train.engine.gradient_worker import GradientWorker, pays
from muybridge.train.engine.precision import autocast
from muybridge.train.images.compositor import WHOLE, Batch, Compositor
from muybridge.train.keypoints.data_echoing import Echo
from muybridge.train.keypoints.evaluate import LIMB, MIRROR
from muybridge.train.keypoints.export import load_checkpoint
from muybridge.train.keypoints.hard_examples import Difficulty, drawing_probability, read_difficulty
from muybridge.train.keypoints.loss import cross_entropy, targets
from muybridge.train.options import KeypointTraining
from muybridge.train.synthesis.rendering.store import RenderSet, load_renders

# Of the virtual markers' loss beside the body landmarks'.
SURFACE_WEIGHT = 0.5
# Sides of the crops that `muybridge run` reads at first, and of people seen in part, as shares of the whole.
SMALLER = (FIRST_LOOK, LEAST)
# Batches after which those who make crops look up which renders are hard.
_LOOKED_UP = 100


@dataclass(frozen=True)
class _Crops:
    """Batches of training crops, for `loop.batches`."""

    pool: pathlib.Path
    size: int
    smaller: float
    count: int
    difficulty: pathlib.Path
    hard: float

    def __call__(self, renders: RenderSet, seed: int) -> Callable[[], loop.Batch]:
        backgrounds = np.load(self.pool, mmap_mode="r")
        sides = (self.size, *(crop_side(share * self.size) for share in SMALLER))
        compositors = [Compositor(renders, backgrounds, side, seed) for side in sides]
        rng = np.random.default_rng([seed, 2])
        made = itertools.count()
        probability = np.empty(0)

        def following() -> loop.Batch:
            nonlocal probability
            number = next(made)
            if number % _LOOKED_UP == 0:
                probability = drawing_probability(read_difficulty(self.difficulty), len(renders), self.hard)
            index = rng.choice(len(renders), self.count, p=probability)
            # Not the first, whose size says how much memory the second process needs.
            smaller = number and rng.random() < self.smaller
            batch = compositors[rng.integers(1, len(sides)) if smaller else 0].batch(self.count, index)
            landmarks = torch.cat([batch.landmarks_px, batch.markers_px], 1)
            visible = torch.cat([batch.visible, batch.markers_visible], 1)
            pixels = batch.pixels.contiguous(memory_format=torch.channels_last)  # here, where there is time
            return pixels, landmarks, visible, torch.from_numpy(index)

        return following


class Loss:
    """The loss of a batch, which also tells which renders are hard.

    Args:
        difficulty: where it is noted.
        losses: `losses_of`, as it is or compiled.
    """

    def __init__(self, difficulty: Difficulty, losses: Callable[..., tuple[Tensor, Tensor, Tensor]]) -> None:
        self.difficulty, self.losses = difficulty, losses

    def __call__(self, net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
        """Total loss, and the mean cross-entropy of the visible landmarks of the body for the log."""
        total, each, count = self.losses(net, batch[:3])
        self.difficulty.note(batch[3].cpu().numpy(), (each / count).cpu().numpy())
        return total, each.sum() / count.sum()


def losses_of(net: KeypointNet, batch: loop.Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Total loss; (B,) summed cross-entropy of the visible landmarks of the body of each crop, without gradients; and
    (B,) how many these are."""
    image, landmarks_px, visible = batch[:3]
    body, target = len(BODY23), targets(landmarks_px, image.shape[-2] // STRIDE, image.shape[-1] // STRIDE)
    with autocast(image.device):
        heatmaps, markers, visibility = net.apart(image.float().div_(255))
    each = cross_entropy(heatmaps, target.of(slice(body)))
    if markers is not None:
        each = torch.cat([each, cross_entropy(markers, target.of(slice(body, None)))], 1)
    seen, known = visible.float(), landmarks_px.isfinite().all(-1).float()
    # Hidden landmarks count too, less: the network shall guess them and know that it guesses.
    weight = 0.35 + 0.65 * seen
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
    """Figures of merit of visible landmarks in held-out crops, points decoded as in use.

    Returns:
        median and mean error in crop pixels, PCK at 5 % of the crop, the share of the limbs' landmarks that lie
        nearer to their mirror twin (left-right swaps), and the mean cross-entropy, which tells versions apart that
        the others do not: it counts how sure the network is of each landmark and not only the few that tip over; and
        PCK of the same crops made smaller, as those of people seen in part are.
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
    """(B, 23) errors of landmarks, in pixels of the crops as they are, read in crops of the last of `SMALLER`."""
    device = next(net.parameters()).device

    def look(crops: ByteArray) -> Maps:
        return [body_maps(net, torch.from_numpy(crops).to(device)).numpy()]

    side = crop_side(SMALLER[-1] * batch.image.shape[-1])
    (maps,) = at_side(look, side, rows=2)(batch.pixels.numpy())
    found = decode_heatmaps(maps, STRIDE, SpreadCalibration(), MIRROR).points_crop_px
    away: Tensor = torch.linalg.vector_norm(torch.from_numpy(found).float() - batch.landmarks_px, dim=-1)
    return away


def held_out_batches(renders: pathlib.Path, pool: pathlib.Path, size: int, count: int = 8) -> list[Batch]:
    """The same held-out crops for every call: seeded, of people who are never trained on (on known backgrounds;
    `muybridge eval` draws others)."""
    store = load_renders(renders, loop.HELD_OUT)
    backgrounds = np.load(pool, mmap_mode="r")
    return [Compositor(store, backgrounds, size, 10_000 + i, WHOLE).batch(64) for i in range(count)]


def _given(options: KeypointTraining) -> KeypointNet | None:
    """A network as that of the run that goes on, else that of the file that training begins with, if there is one."""
    if loop.resumes(options):
        config = load_checkpoint(options.out / loop.CHECKPOINT)["config"]
        if "landmarks" not in config:
            raise ModelError(f"{options.out}: a run of another network goes on there; name another folder with --out")
        return KeypointNet(**config)
    return None if options.model is None else _network_of(options.model)


def _network_of(model: pathlib.Path) -> KeypointNet:
    net = keypoint_net_from_onnx(model)
    if net.visibility.out_features != len(BODY23) + len(SURFACE):
        raise ModelError(f"{model}: training needs a network that finds virtual markers too")
    return net


def _second(net: KeypointNet, options: KeypointTraining) -> AbstractContextManager[GradientWorker | None]:
    """The second process, if it is wished for and pays."""
    if options.second and pays(options.batch, options.threads, options.minutes):
        return GradientWorker(net, losses_of, options.minutes, options.threads)
    return nullcontext()


def _echoed(stream: Iterator[loop.Batch], options: KeypointTraining) -> AbstractContextManager[Iterator[loop.Batch]]:
    """The batches, and old ones among them where a GPU would wait for new ones."""
    if loop.device().type == "cuda" and options.echo > 1:
        return closing(Echo(stream, loop.device(), options.echo, options.seed))
    return nullcontext(stream)


def train(options: KeypointTraining) -> pathlib.Path:
    """Trains for `options.minutes` from the last checkpoint in `options.out`; returns the checkpoint's path."""
    for name, share, what in (("hard", options.hard, "crops"), ("smaller", options.smaller, "batches")):
        if not 0 <= share <= 1:
            raise ModelError(f"--{name} {share:g}: it is a share of the {what}, 0 to 1")
    model = None if loop.resumes(options) else options.model
    given = _given(options)  # before all that takes minutes
    with loop.prepared(options) as pool:
        validation = held_out_batches(options.renders, pool, options.size)
        net = given or KeypointNet(len(BODY23) + len(SURFACE))
        if model is not None:
            measure_normalisation(net, [validation[0].pixels.float().div(255)])
        seen = loop.Seen() if model is None else loop.Seen.of(model)
        fit = loop.Fit(options, net, lambda net: evaluate(net, validation), seen)
        # Losses are of the renders of one store.
        store = zlib.crc32(str(options.renders.resolve()).encode())
        difficulty = Difficulty(options.out / f"difficulty-{store:08x}.npy")
        crops = _Crops(pool, options.size, options.smaller, options.batch, difficulty.path, options.hard)
        loss = Loss(difficulty, compiled(losses_of, options.minutes))
        with (
            _second(net, options) as other,
            _echoed(loop.batches(options, crops, fit.state["step"]), options) as stream,
        ):
            fit.run(stream, loss, other)
    return fit.checkpoint
