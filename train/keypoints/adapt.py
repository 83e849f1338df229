"""Adaptation of a keypoint network to unlabelled footage.

The multi-view consensus in 3D is projected into every view and used as a label (`models.pseudo_labels`), starting from
the shipped weights, for a few minutes. Every view learns from the others: how these clothes look from behind, which leg
is the left one. Views as each other's teachers: Kocabas, Karagoz and Akbas, "Self-supervised learning of 3D human pose
using multi-view geometry", CVPR 2019; here the labels also use the whole take's evidence over time and the body model.
"""

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import decode_heatmaps
from muybridge.models.keypoints.network import CHANNELS, STRIDE, KeypointNet
from muybridge.models.pseudo_labels import PseudoLabels
from muybridge.models.uncertainty import SpreadCalibration
from muybridge.train.engine.loop import AveragedWeights, device, learning_rate, to_training_device
from muybridge.train.engine.precision import autocast
from muybridge.train.images.camera_faults import CameraFaults
from muybridge.train.images.compositor import MIRROR
from muybridge.train.keypoints.loss import heatmap_loss
from muybridge.train.keypoints.options import Adaptation
from muybridge.train.keypoints.train import SURFACE_WEIGHT

# Weight of labels that the view's own network did not detect: mostly hidden landmarks, some of them wrong labels.
_NOT_FOUND = 0.35
_VISIBILITY = 0.2
_NO_PLATE = 0.3  # share of crops without the difference to the background model
_FAULTY = 0.5  # share of batches with camera faults
_AVERAGE_DECAY = 0.99
_AT_ONCE = 32  # images per call in evaluation
_ROTATION_SD, _SCALE_SD, _SHIFT_SD = np.radians(6.0), 0.1, 0.04


@dataclass(frozen=True)
class Agreement:
    """Distance of a network's landmarks from the multi-view consensus in held-out crops.

    Attributes:
        median_px, mean_px: in network pixels; the mean counts distances above a quarter of the crop as that.
        landmarks: number of landmarks compared.
    """

    median_px: float
    mean_px: float
    landmarks: int


@dataclass(frozen=True)
class View:
    """Pseudo-labels in a network's crop geometry.

    Attributes:
        labels: the pseudo-labels.
        size: side of the network's crops, px.
        padding: side of the network's crops relative to the longer side of the person's bounding box.
    """

    labels: PseudoLabels
    size: int
    padding: float

    def plain(self, index: IndexArray) -> tuple[ByteArray, Float32Array]:
        """Crops (N, 4, S, S) as in use, and their landmarks (N, J, 2) px."""
        zero = np.zeros(len(index))
        return self.transform(index, zero, zero + 1, np.zeros((len(index), 2)), zero > 0)

    def transform(
        self, index: IndexArray, angle: FloatArray, scale: FloatArray,
        shift_px: FloatArray, flip: BoolArray,
    ) -> tuple[ByteArray, Float32Array]:  # fmt: skip
        """The same rotated (radians), scaled, translated and mirrored; the landmarks keep their order."""
        source = self.labels.crops.shape[1]
        zoom = scale * self.size / source * self.labels.padding / self.padding
        cos, sin = np.cos(angle) * zoom, np.sin(angle) * zoom
        linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        linear[:, :, 0] *= np.where(flip, -1, 1)[:, None]
        moved = (self.size - 1) / 2 + shift_px - linear @ np.full(2, (source - 1) / 2)
        matrix = np.concatenate([linear, moved[..., None]], -1)
        images = np.empty((len(index), CHANNELS, self.size, self.size), np.uint8)
        for k, i in enumerate(index):
            warped = cv2.warpAffine(self.labels.crops[i], matrix[k], (self.size, self.size), flags=cv2.INTER_LINEAR)
            images[k] = warped.transpose(2, 0, 1)
        at = np.einsum("nij,nkj->nki", linear, self.labels.landmarks_px[index]) + moved[:, None]
        return images, at.astype(np.float32)


class _Sampler:
    """Batches of footage, each crop rotated, scaled, translated and mirrored at random."""

    def __init__(self, view: View, visibility: Float32Array, seed: int) -> None:
        self.view, self.visibility = view, visibility
        self.chosen = np.flatnonzero(~view.labels.held_out)
        self.rng = np.random.default_rng(seed)
        self.faults = CameraFaults(self.rng)

    def batch(self, count: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Images (B, 4, S, S) in 0..1, landmarks (B, J, 2) px, whether the view agreed (B, J), visibility (B, J) in
        0..1."""
        rng = self.rng
        index = rng.choice(self.chosen, count)
        angle, scale = rng.normal(0, _ROTATION_SD, count), np.exp(rng.normal(0, _SCALE_SD, count))
        shift_px, flip = rng.normal(0, _SHIFT_SD, (count, 2)) * self.view.size, rng.random(count) < 0.5
        images, at = self.view.transform(index, angle, scale, shift_px, flip)
        agreed, visible = self.view.labels.agreed[index], self.visibility[index]
        for values in (at, agreed, visible):
            values[flip] = values[flip][:, MIRROR[: values.shape[1]]]
        image = torch.from_numpy(images).float() / 255
        if rng.random() < _FAULTY:
            image[:, :3] = self.faults.apply(image[:, :3]).clamp(0, 1)
        image[torch.from_numpy(rng.random(count) < _NO_PLATE), 3] = 0
        return image, torch.from_numpy(at), torch.from_numpy(agreed), torch.from_numpy(visible)


def train_on_footage(
    net: KeypointNet, view: View, options: Adaptation, report: Callable[[float], None]
) -> tuple[KeypointNet, int]:
    """Train a network on footage.

    Args:
        net: the initial network, with folded normalisation (`models.onnx_files.import_weights`); it is not changed.
        view: crops with labels.
        options: of the training.
        report: called with the elapsed share of the time.

    Returns:
        The network with averaged weights, and the number of images that it saw.
    """
    torch.manual_seed(options.seed)
    student = to_training_device(copy.deepcopy(net)).eval()  # normalisation layers stay fixed: they are only a bias
    sampler = _Sampler(view, _visibility(net, view), options.seed)
    optimiser = torch.optim.AdamW(student.parameters(), options.rate, weight_decay=0.0)
    average, step, start = AveragedWeights(student, _AVERAGE_DECAY), 0, time.monotonic()
    budget = 60 * options.minutes if options.steps is None else float(options.steps)
    while (spent := time.monotonic() - start if options.steps is None else step) < budget:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(options.rate, 6 * step, spent, budget, 0.5)
        optimiser.zero_grad(set_to_none=True)
        loss = _loss(student, *(t.to(device()) for t in sampler.batch(options.batch)))
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(student.parameters(), 5.0)
        optimiser.step()
        average.update(student, step)
        step += 1
        report(min(1.0, spent / budget))
    out = copy.deepcopy(net)
    out.load_state_dict(average.state)
    return out.eval(), step * options.batch


def _loss(net: nn.Module, image: Tensor, at: Tensor, agreed: Tensor, visible: Tensor) -> Tensor:
    """Cross-entropy of the heatmaps; visibility is kept at the initial network's own prediction."""
    with autocast(image.device):
        heatmaps, visibility = net(image)
    inside = ((at >= 0) & (at <= image.shape[-1] - 1)).all(-1, keepdim=True)
    each = heatmap_loss(heatmaps, torch.where(inside, at, torch.nan)) * (_NOT_FOUND + (1 - _NOT_FOUND) * agreed.float())
    kept = torch.nn.functional.binary_cross_entropy_with_logits(visibility.float(), visible)
    body = len(BODY23)
    total = each[:, :body].mean() + _VISIBILITY * kept
    return total + SURFACE_WEIGHT * each[:, body:].mean() if each.shape[1] > body else total


@torch.no_grad()
def _visibility(net: KeypointNet, view: View) -> Float32Array:
    """(N, J) visibility in 0..1 that the network predicts for the crops as they are."""
    batches = np.split(np.arange(len(view.labels.crops)), range(_AT_ONCE, len(view.labels.crops), _AT_ONCE))
    seen = [net(torch.from_numpy(view.plain(index)[0]).float() / 255)[1].sigmoid() for index in batches]
    return np.asarray(torch.cat(seen).numpy())


@torch.no_grad()
def measure_agreement(net: KeypointNet, view: View) -> Agreement:
    """Distance between the network's body landmarks and the labels in held-out crops (in all crops if none is held
    out)."""
    labels, body = view.labels, len(BODY23)
    chosen = np.flatnonzero(labels.held_out) if labels.held_out.any() else np.arange(len(labels.crops))
    distances = []
    for index in np.split(chosen, range(_AT_ONCE, len(chosen), _AT_ONCE)):
        images, at = view.plain(index)
        heatmaps = net(torch.from_numpy(images).float() / 255)[0][:, :body].numpy()
        found = decode_heatmaps(heatmaps, STRIDE, SpreadCalibration()).points_crop_px
        distances.append(np.linalg.norm(found - at[:, :body], axis=-1))
    distance = np.concatenate(distances)
    distance = distance[np.isfinite(distance)]
    return Agreement(float(np.median(distance)), float(np.minimum(distance, view.size / 4).mean()), len(distance))
