"""Training of the labelling network on synthetic marker clouds."""

import pathlib
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn

from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE
from muybridge.models.labelling.network import WINDOW, LabelNet
from muybridge.train.engine import loop
from muybridge.train.engine.precision import autocast
from muybridge.train.labelling.options import LabelTraining
from muybridge.train.synthesis.markers.augment import DUST, CloudOptions, CloudSampler
from muybridge.train.synthesis.markers.trajectories import MarkerClips, load_marker_clips, make_marker_clips

HELD_OUT = range(0, 4)
# Batches after which new shards are loaded.
REFRESH = 1500

_SHARES = {
    "all": ((PLUG_IN_GAIT, 0.5), (CMU, 0.3)),
    "pig39": ((PLUG_IN_GAIT, 0.9),),
    "cmu41": ((CMU, 0.9),),
}


def loss_of(net: nn.Module, batch: loop.Batch) -> tuple[Tensor, Tensor]:
    """Cross-entropy of the assignment over the known points; the same again for the log."""
    points, seen, asked, labels = batch
    with autocast(points.device):
        scores = net.logits(points, seen, asked)  # type: ignore[operator]
    # Columns of labels that no frame of the batch has are left out.
    columns = torch.cat([asked.amax(0) > 0, asked.new_ones(1) > 0])
    place = torch.cumsum(columns, 0) - 1
    scores, asked, labels = scores[..., columns], asked[:, columns[:-1]], torch.where(labels >= 0, place[labels], -1)
    assigned = net.assign(scores.float(), seen, asked)  # type: ignore[operator]
    known = labels >= 0
    loss = -assigned.gather(2, labels.clamp(min=0).unsqueeze(-1)).squeeze(-1)[known].mean()
    return loss, loss.detach()


@torch.no_grad()
def evaluate(net: nn.Module, batches: list[loop.Batch]) -> dict[str, float]:
    """Share of markers that get the right label, without a time window (`frame`) and with one (`window`)."""
    out = {}
    for name in ("frame", "window"):
        right = total = 0
        for points, seen, asked, labels in batches:
            known = seen.clone()
            if name == "frame":
                known[:, 1:] = 0
            predicted = net(points, known, asked).argmax(-1)
            marker = (labels >= 0) & (labels < DUST)
            right += int((predicted == labels)[marker].sum())
            total += int(marker.sum())
        out[name] = right / max(total, 1)
    return out


def _tensors(sampler: CloudSampler, count: int) -> loop.Batch:
    return tuple(torch.from_numpy(a) for a in sampler.batch(count))


def held_out_batches(clips: pathlib.Path, count: int = 8, options: CloudOptions | None = None) -> list[loop.Batch]:
    """The same frames at every call, of clips that are never trained on."""
    sampler = CloudSampler(load_marker_clips(clips, HELD_OUT), WINDOW, 9, options or CloudOptions(window_lost=0.0))
    return [_tensors(sampler, 64) for _ in range(count)]


def _stream(options: LabelTraining, start: int) -> Iterator[loop.Batch]:
    count = 0
    while True:
        clips: MarkerClips = load_marker_clips(options.clips, range(HELD_OUT.stop, 100_000))
        seed = loop.worker_seed(options.seed, start, count)
        sampler = CloudSampler(clips, WINDOW, seed, CloudOptions(_SHARES[options.markerset]))
        for _ in range(REFRESH):
            yield _tensors(sampler, options.batch)
            count += 1


def train(options: LabelTraining) -> pathlib.Path:
    """Train for `options.minutes` or `steps` from the last checkpoint in `options.out`; return the new one's path."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    if not len(load_marker_clips(options.clips, range(HELD_OUT.stop, 100_000)).points):
        make_marker_clips(options.clips, range(options.shards), options.seed)
    validation = held_out_batches(options.clips)
    run = loop.TrainingRun(options, LabelNet(len(SURFACE)), lambda net: evaluate(net, validation))
    run.run(_stream(options, run.state["step"]), loss_of)
    return run.checkpoint


def label_net(saved: dict[str, Any]) -> LabelNet:
    """The averaged network of a checkpoint."""
    net = LabelNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()
