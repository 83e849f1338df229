"""Training of the person detector: focal loss on centres as in CenterNet (Zhou et al. 2019), generalised IoU
(Rezatofighi et al. 2019) on boxes at the cells around each centre."""

import pathlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from muybridge.arrays import Float32Array
from muybridge.models.onnx_files.import_weights import measure_normalisation, people_net_from_onnx
from muybridge.models.people.decode import box_overlap, decode_people
from muybridge.models.people.network import STRIDE, PeopleNet
from muybridge.train.engine import loop
from muybridge.train.engine.compile import compile_for_training
from muybridge.train.engine.precision import autocast
from muybridge.train.images import dataset
from muybridge.train.images.scenes import SHAPES, SceneBatch, SceneCompositor
from muybridge.train.people.options import PeopleTraining
from muybridge.train.synthesis.rendering.store import RenderSet, load_renders


@dataclass(frozen=True)
class _Targets:
    heat: Float32Array  # (B, h, w): 1 at centres, falling off around them
    weight: Float32Array  # (B, h, w): 0 where detecting a hidden person is neither right nor wrong
    box: Float32Array  # (B, 4, h, w)
    has_box: Float32Array  # (B, h, w)


def make_targets(batch: SceneBatch) -> _Targets:
    """Targets of the network for the boxes of `batch`."""
    count, _, height, width = batch.image.shape
    h, w = height // STRIDE, width // STRIDE
    heat, weight = np.zeros((count, h, w), np.float32), np.ones((count, h, w), np.float32)
    box, has_box = np.zeros((count, 4, h, w), np.float32), np.zeros((count, h, w), np.float32)
    y, x = np.mgrid[:h, :w] * STRIDE + (STRIDE - 1) / 2
    for i in range(count):
        for b in batch.ignore[i]:
            weight[i][(x >= b[0]) & (x <= b[2]) & (y >= b[1]) & (y <= b[3])] = 0
        order = np.argsort([-(b[2] - b[0]) * (b[3] - b[1]) for b in batch.boxes[i]])
        for b in batch.boxes[i][order]:  # small people last: they keep cells shared with large ones
            # A centre outside the image is moved to its border.
            cx, cy = np.clip((b[0] + b[2]) / 2, 0, width - 1), np.clip((b[1] + b[3]) / 2, 0, height - 1)
            spread = np.maximum(0.12 * (b[2:] - b[:2]), 0.6 * STRIDE)
            bump = np.exp(-(((x - cx) / spread[0]) ** 2 + ((y - cy) / spread[1]) ** 2) / 2)
            at = int(np.clip(cy // STRIDE, 0, h - 1)), int(np.clip(cx // STRIDE, 0, w - 1))
            bump[at] = 1
            heat[i] = np.maximum(heat[i], bump)
            weight[i][bump > 0.5] = 1
            near = bump > 0.6
            box[i][:, near] = np.stack([x - b[0], y - b[1], b[2] - x, b[3] - y])[:, near]
            has_box[i][near] = 1
    # The network's exponential output is positive: an edge cannot be on the wrong side of a cell's centre.
    return _Targets(heat, weight, np.maximum(box, 0.2), has_box)


@dataclass(frozen=True)
class _Scenes:
    """Batches of training scenes, for `dataset.batches`."""

    pool: pathlib.Path
    count: int
    scenes: float

    def __call__(self, renders: RenderSet, seed: int) -> Callable[[], loop.Batch]:
        compositor = SceneCompositor(renders, np.load(self.pool, mmap_mode="r"), seed, self.scenes)
        return lambda: as_tensors(compositor.batch(self.count))


def as_tensors(batch: SceneBatch) -> tuple[Tensor, ...]:
    """Images and targets for `loss_of`."""
    t = make_targets(batch)
    return (batch.image, *(torch.from_numpy(a) for a in (t.heat, t.weight, t.box, t.has_box)))


def generalised_iou(a: Tensor, b: Tensor) -> Tensor:
    """(...) of two boxes, each given as distances (..., 4) from one common point to its left, top, right and bottom
    edge."""
    low, high = torch.minimum(a, b), torch.maximum(a, b)
    both = (low[..., 0] + low[..., 2]) * (low[..., 1] + low[..., 3])
    hull = (high[..., 0] + high[..., 2]) * (high[..., 1] + high[..., 3])
    areas = [(t[..., 0] + t[..., 2]) * (t[..., 1] + t[..., 3]) for t in (a, b)]
    union = areas[0] + areas[1] - both
    return both / (union + 1e-6) - (hull - union) / (hull + 1e-6)


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Total loss, and the box loss for the log."""
    image, *targets = batch
    with autocast(image.device):
        logits, distance = net(image.float().div_(255))
    return _loss_of_outputs(logits, distance, *targets)


def _loss_of_outputs(
    logits: Tensor, distance: Tensor, heat: Tensor, weight: Tensor, box: Tensor, has_box: Tensor
) -> tuple[Tensor, Tensor]:
    """`loss_of` for given network outputs."""
    logits = logits[:, 0].float()
    p = torch.sigmoid(logits).clamp(1e-5, 1 - 1e-5)
    positive = (heat >= 0.999).float()
    found = -((1 - p) ** 2) * torch.log(p) * positive
    rejected = -(p**2) * torch.log(1 - p) * (1 - heat) ** 4 * (1 - positive) * weight
    centres = (found.sum() + rejected.sum()) / positive.sum().clamp(min=1)
    iou = generalised_iou(distance.float().permute(0, 2, 3, 1), box.permute(0, 2, 3, 1))
    boxes = ((1 - iou) * has_box).sum() / has_box.sum().clamp(min=1)
    return centres + boxes, boxes.detach()


@torch.no_grad()
def evaluate(net: nn.Module, batches: list[SceneBatch], threshold: float = 0.3) -> dict[str, float]:
    """Scores on held-out scenes.

    Args:
        net: the network.
        batches: of scenes.
        threshold: least score of a detection.

    Returns:
        Recall, and precision at IoU 0.5; mean IoU of the detected people; and the loss, which shows small gains.
    """
    where = next(net.parameters()).device
    found, people, false, total, overlap, losses = 0, 0, 0, 0, [], []
    for batch in batches:
        image, *targets = (t.to(where) for t in as_tensors(batch))
        with autocast(where):
            logits, distance = net(image.float().div(255))
        losses.append(float(_loss_of_outputs(logits, distance, *targets)[0]))
        detected = decode_people(
            logits.float().cpu().numpy(), distance.float().cpu().numpy(), STRIDE, threshold, max_people=8
        )
        for i in range(len(batch.image)):
            guess = detected[i].boxes_px
            iou = box_overlap(guess, batch.boxes[i].astype(np.float64))
            hidden = box_overlap(guess, batch.ignore[i].astype(np.float64)).max(1, initial=0) > 0.3
            best = iou.max(0, initial=0)
            found, people = found + int((best > 0.5).sum()), people + len(best)
            overlap.extend(best[best > 0.5].tolist())
            wrong = (iou.max(1, initial=0) < 0.5) & ~hidden
            false, total = false + int(wrong.sum()), total + int((~hidden).sum())
    return {
        "recall": found / max(people, 1), "precision": 1 - false / max(total, 1),
        "iou": float(np.mean(overlap)) if overlap else 0.0, "held_out_loss": float(np.mean(losses)),
    }  # fmt: skip


def held_out_scenes(renders: pathlib.Path, pool: pathlib.Path) -> list[SceneBatch]:
    """The same scenes at every call, of people who are never trained on: one batch of each shape."""
    held_out = SceneCompositor(load_renders(renders, dataset.HELD_OUT), np.load(pool, mmap_mode="r"), 10_000)
    return [held_out.batch(32, shape) for shape in SHAPES]


def train(options: PeopleTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the new one's path."""
    model = None if loop.resumes(options) else options.model
    start = None if model is None else people_net_from_onnx(model)  # before anything that takes minutes
    with dataset.training_data(options) as pool:
        validation = held_out_scenes(options.renders, pool)
        net = start or PeopleNet()
        if start is not None:
            measure_normalisation(net, [validation[0].image.float().div(255)])
        history = loop.TrainingHistory() if model is None else loop.TrainingHistory.of_file(model)
        run = loop.TrainingRun(options, net, lambda net: evaluate(net, validation), history)
        scenes = dataset.batches(options, _Scenes(pool, options.batch, options.scenes), run.state["step"], on_cpu=2)
        run.run(scenes, compile_for_training(loss_of, options.worthwhile_minutes))
    return run.checkpoint
