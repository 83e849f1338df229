"""What locality and the window bring to the labelling network: variants trained from nothing for equal processor time.

    python scripts/ablate_labelling.py [--minutes 1.2] [--clips runs/labels/clips]

- `local`: the shipped design: 8 neighbours, 5 rounds of messages, a window of four times;
- `wide`: 24 neighbours, so that most points of a person meet in every round;
- `narrow`: 4 neighbours;
- `two rounds`: nobody hears of anything farther than two hops;
- `no window`: trained without knowing where points were and will be.

All see the same stream of synthetic clouds. Scores are shares of the markers of held-out clips that get their label:
without a window, with it, and with it beside a second person whose markers nobody asked for, 1.2 m away. Processor
time of the training thread counts, so that other work on the machine favours none. What the repair by distances and
the votes bring needs no training: `bench_labelling.py` switches them off one by one.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import torch

from muybridge.geometry.landmarks.arrays import SURFACE
from muybridge.models.labelling.network import WINDOW, LabelNet
from muybridge.train.engine import loop
from muybridge.train.labelling.train import HELD_OUT, evaluate, held_out_batches, loss_of
from muybridge.train.synthesis.markers.augment import DUST, CloudOptions, CloudSampler
from muybridge.train.synthesis.markers.trajectories import load_marker_clips

VARIANTS: dict[str, dict[str, Any]] = {
    "local": {}, "wide": {"neighbours": 24}, "narrow": {"neighbours": 4}, "two rounds": {"layers": 2},
    "no window": {"window_lost": 1.0},
}  # fmt: skip
APART = 1.2


def crowded(batches: list[loop.Batch]) -> list[loop.Batch]:
    """The same frames with the next frame's points beside them, as a second person's."""
    out = []
    for points, seen, asked, labels in batches:
        away = torch.tensor([APART, 0.0, 0.0])
        other = torch.roll(points, 1, 0)
        there = torch.roll(seen, 1, 0)
        middle = [(p * s.unsqueeze(-1))[:, 0].sum(1) / s[:, 0].sum(1, keepdim=True) for p, s in ((points, seen),
                  (other, there))]  # fmt: skip
        other = (other + (middle[0] - middle[1])[:, None, None] + away) * there.unsqueeze(-1)
        known = torch.roll(labels, 1, 0) >= 0
        none = torch.where(known, DUST, -1)
        out.append((torch.cat([points, other], 2), torch.cat([seen, there], 2), asked, torch.cat([labels, none], 1)))
    return out


def trained(minutes: float, rate: float, clips: Path, window_lost: float = 0.35, **design: Any) -> tuple[LabelNet, int]:
    """A network after some minutes of processor time, and how many frames it saw."""
    torch.manual_seed(0)
    net = LabelNet(len(SURFACE), **design)
    sampler = CloudSampler(load_marker_clips(clips, range(HELD_OUT.stop, 100_000)), WINDOW, 3,
                           CloudOptions(window_lost=window_lost))  # fmt: skip
    optimiser = torch.optim.AdamW(net.parameters(), rate, weight_decay=0.02)
    average = loop.AveragedWeights(net, 0.99)
    begun, step = time.thread_time(), 0
    while (elapsed := time.thread_time() - begun) < minutes * 60:
        for group in optimiser.param_groups:
            group["lr"] = loop.learning_rate(rate, step, elapsed, minutes * 60, 0.5)
        batch = tuple(torch.from_numpy(a) for a in sampler.batch(48))
        if batch[0].shape[2] <= net.neighbours:
            continue
        optimiser.zero_grad(set_to_none=True)
        loss, _ = loss_of(net, batch)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        average.update(net, step)
        step += 1
    net.load_state_dict(average.state)
    return net.eval(), step * 48


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.2)
    parser.add_argument("--rate", type=float, default=3e-3)
    parser.add_argument("--clips", type=Path, default=Path("runs/labels/clips"))
    parser.add_argument("--variants", nargs="*", default=list(VARIANTS), choices=list(VARIANTS))
    a = parser.parse_args()
    torch.set_num_threads(1)
    batches = [b for b in held_out_batches(a.clips, 6) if b[0].shape[2] > 24]
    beside = crowded(batches)
    print("| variant | parameters | frames seen | frame alone | with window | beside a second person |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in a.variants:
        net, frames = trained(a.minutes, a.rate, a.clips, **VARIANTS[name])
        plain, crowd = evaluate(net, batches), evaluate(net, beside)
        size = sum(p.numel() for p in net.parameters())
        scores = " | ".join(f"{x:.2%}" for x in (plain["frame"], plain["window"], crowd["window"]))
        print(f"| {name} | {size:,} | {frames:,} | {scores} |", flush=True)


if __name__ == "__main__":
    main()
