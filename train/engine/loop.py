"""What the training loops share: time budget, learning rate, averaged weights, checkpoints, logs."""

import json
import os
import pathlib
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from muybridge.errors import SessionError
from muybridge.files import replacing
from muybridge.models.onnx_files.import_weights import trained_for
from muybridge.train.engine import precision
from muybridge.train.engine.curves import write_curves
from muybridge.train.engine.gradient_worker import GradientWorker
from muybridge.train.engine.muon import Optimisers
from muybridge.train.engine.process_pool import processors
from muybridge.train.options import Training

CHECKPOINT = "checkpoint.pt"

# Images first, then whatever the loss needs.
Batch = tuple[Tensor, ...]


def device() -> torch.device:
    """A GPU when there is one, else the CPU: the same loop serves both."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def learning_rate(peak: float, step: int, elapsed: float, budget: float, decay: float) -> float:
    """Warm-up over 300 steps, then constant, then falling linearly to a hundredth over the last `decay` share of
    the time `budget` (seconds). A constant rate lets a later run go on from the same weights."""
    warm = min(1.0, (step + 1) / 300)
    left = max(0.0, (budget - elapsed) / max(budget * decay, 1e-9))
    return peak * warm * max(0.01, min(1.0, left))


class AveragedWeights:
    """Moving average of a network's parameters and buffers (Polyak averaging).

    Args:
        net: the network.
        decay: what is left of the average after a step; less in the first steps.
        share: of all steps up to now, over how many of the last it is taken at least: 1 is the mean of all.
    """

    def __init__(self, net: nn.Module, decay: float = 0.9995, share: float = 0.0) -> None:
        self.decay, self.share = decay, share
        self.state = {k: v.detach().clone() for k, v in net.state_dict().items()}

    @torch.no_grad()
    def update(self, net: nn.Module, step: int) -> None:
        """Moves the average towards the network; faster in the first steps."""
        decay = min(self.decay, (1 + step) / (10 + step))
        decay = max(decay, 1 - 1 / (1 + self.share * step))
        now = net.state_dict()
        moved = [key for key, value in now.items() if value.dtype.is_floating_point]
        torch._foreach_lerp_([self.state[key] for key in moved], [now[key] for key in moved], 1 - decay)
        for key in now.keys() - set(moved):
            self.state[key].copy_(now[key])


def save_atomically(path: pathlib.Path, content: Mapping[str, Any]) -> None:
    """A killed run leaves the last whole checkpoint."""
    with replacing(path) as temporary:
        torch.save(dict(content), temporary)


def log_line(path: pathlib.Path, record: Mapping[str, Any]) -> None:
    """Appends one JSON line."""
    with path.open("a") as file:
        file.write(json.dumps(dict(record)) + "\n")


def machine() -> dict[str, Any]:
    """What a throughput figure depends on."""
    return {
        "machine": platform.machine(), "python": platform.python_version(), "torch": torch.__version__,
        "cpus": os.cpu_count(), "device": str(device()), "precision": precision.name(device()),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }  # fmt: skip


class Throughput:
    """Images a second since the last call."""

    def __init__(self, images: int = 0) -> None:
        self.time, self.images = time.monotonic(), images

    def __call__(self, images: int) -> float:
        now = time.monotonic()
        rate = (images - self.images) / max(now - self.time, 1e-9)
        self.time, self.images = now, images
        return rate


def workers(options: Training, on_cpu: int = 1) -> int:
    """How many processes make the images: those of the options, or `on_cpu` beside a network on the CPU. A GPU waits
    for them, however many they are."""
    if options.workers is not None:
        return options.workers
    return max(1, len(processors()) - 1) if device().type == "cuda" else on_cpu


def resumes(options: Training) -> bool:
    """Whether a call goes on from a checkpoint in `options.out`."""
    return (options.out / CHECKPOINT).exists()


class Seen(NamedTuple):
    """What a network was trained on.

    Attributes:
        images, seconds: how many and for how long.
    """

    images: int = 0
    seconds: float = 0.0

    @classmethod
    def of(cls, path: pathlib.Path) -> "Seen":
        """What a network's file says."""
        told = trained_for(path)
        return cls(told.get("images", 0), 60 * told.get("minutes", 0.0))


class Fit:
    """One training run: network, optimiser, averaged weights and counters, resumed where there is a checkpoint.

    Args:
        options: the training's options.
        net: the network; its `config` goes into the checkpoint.
        score: figures of merit of the averaged network, for the log and the checkpoint.
        seen: what `net` was trained on before, where there is no checkpoint.
    """

    def __init__(
        self, options: Training, net: nn.Module, score: Callable[[nn.Module], dict[str, float]],
        seen: Seen | None = None,
    ) -> None:  # fmt: skip
        self.options, self.score = options, score
        options.out.mkdir(parents=True, exist_ok=True)
        self.checkpoint, self.log = options.out / CHECKPOINT, options.out / "log.jsonl"
        self.net = placed(net)
        self.optimiser = Optimisers(net, options.rate, muon=options.muon)
        self.average = AveragedWeights(self.net, share=options.average)
        self.state: dict[str, Any] = {"step": 0} | (seen or Seen())._asdict()
        if resumes(options):
            try:
                saved = torch.load(self.checkpoint, map_location=device(), weights_only=False)
                saved["net"], saved["optimiser"], saved["average"], saved["state"]
            except Exception as error:  # of pickle, zip files, torch: no base but this
                raise SessionError(
                    f"{self.checkpoint}: not a training checkpoint of muybridge, or a damaged one; remove it, or start "
                    "a new run with another --out"
                ) from error
            try:
                self.net.load_state_dict(saved["net"])
            except RuntimeError as error:
                raise SessionError(
                    f"{self.checkpoint}: of another design than this version's, so training cannot resume; start a new "
                    "run with another --out, from its weights with --model FILE.onnx"
                ) from error
            if self.optimiser.fits(saved["optimiser"]):
                self.optimiser.load_state_dict(saved["optimiser"])
            self.average.state = saved["average"]
            self.state = saved["state"]
        log_line(self.log, {"options": {k: str(v) for k, v in asdict(options).items()}} | machine() | self.state)

    def run(
        self, stream: Iterator[Any], loss_of: Callable[[nn.Module, Any], tuple[Tensor, Tensor]],
        second: GradientWorker | None = None,
    ) -> None:  # fmt: skip
        """Trains for `options.minutes`. `loss_of(net, batch)` gives the loss and a figure for the log; a batch is
        a tuple that begins with the images. A `second` process may take a part of each."""
        budget, began = self.options.minutes * 60, time.monotonic()
        before, first = self.state["seconds"], self.state["step"]
        rate, losses, saved_at = Throughput(self.state["images"]), [], began
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        with Progress(*columns, transient=True) as progress:
            bar = progress.add_task("training", total=budget)
            try:
                while (elapsed := time.monotonic() - began) < budget:
                    step = self.state["step"] - first
                    self.optimiser.set_rate(learning_rate(self.options.rate, step, elapsed, budget, self.options.decay))
                    batch = tuple(t.to(device(), non_blocking=True) for t in next(stream))
                    losses.append(self._step(batch, loss_of, second))
                    self.state["images"] += len(batch[0])
                    self.state["seconds"] = before + elapsed
                    done = f"{self.state['images']:,} images, loss {losses[-1]:.2f}"
                    progress.update(bar, completed=elapsed, description=done)
                    if time.monotonic() - saved_at > 180:
                        self._save(losses, rate)
                        losses, saved_at = [], time.monotonic()
            except KeyboardInterrupt:
                print("stopped; what was learned is being saved", flush=True)
                self._save(losses, rate)
                raise
        self._save(losses, rate)

    def _step(
        self, batch: Any, loss_of: Callable[[nn.Module, Any], tuple[Tensor, Tensor]], second: GradientWorker | None
    ) -> float:
        self.net.train()
        self.net.zero_grad(set_to_none=True)
        if second is not None:
            shown = second.gradients(self.net, batch, loss_of)
        else:
            loss, shown = loss_of(self.net, batch)
            loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        said = float(shown)
        self._refuse(not np.isfinite(said + float(norm)))
        self.optimiser.step()
        self.average.update(self.net, self.state["step"])
        self.state["step"] += 1
        return said

    def _refuse(self, diverged: bool) -> None:
        """SessionError, before anything is overwritten, if the training has `diverged`."""
        if diverged:
            raise SessionError(
                f"the training diverged after {self.state['images']:,} images (its loss or weights are no numbers any "
                f"more); {self.checkpoint} is as it was last saved: go on with less than --rate {self.options.rate:g}"
            )

    def averaged(self) -> nn.Module:
        """The network with averaged weights, in evaluation mode."""
        net: nn.Module = type(self.net)(**self.net.config)  # type: ignore[arg-type]
        net.load_state_dict(self.average.state)
        return placed(net).eval()

    def _save(self, losses: list[float], rate: "Throughput") -> None:
        speed = rate(self.state["images"])
        self._refuse(not all(bool(w.isfinite().all()) for w in self.net.parameters()))
        scores = self.score(self.averaged())
        save_atomically(self.checkpoint, {
            "net": self.net.state_dict(), "optimiser": self.optimiser.state_dict(), "average": self.average.state,
            "state": dict(self.state), "config": self.net.config, "scores": scores,
            "options": {k: str(v) for k, v in asdict(self.options).items()},
        })  # fmt: skip
        if not losses:  # the last save was a moment ago
            return
        loss = float(np.mean(losses))
        log_line(self.log, dict(self.state) | {"loss": loss, "images_a_second": round(speed, 1)} | scores)
        write_curves(self.log)
        shown = "  ".join(f"{k} {v:.3f}" for k, v in scores.items())
        minutes = self.state["seconds"] / 60
        print(f"{self.state['images']:>9,} images {minutes:6.1f} min  loss {loss:.3f}  {shown}  {speed:.0f} images/s",
              flush=True)  # fmt: skip


def placed(net: nn.Module) -> nn.Module:
    """A network where training takes place, in the order of memory that is fastest."""
    net.to(device())
    return net.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def worker_seed(seed: int, *parts: int) -> int:
    """A 32-bit seed from several numbers."""
    return int(np.random.SeedSequence([seed, *parts]).generate_state(1)[0])
