"""The training loop: time budget, learning rate, averaged weights, checkpoints and logs."""

import json
import os
import pathlib
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from muybridge.errors import ModelError, SessionError
from muybridge.models.onnx_files.import_weights import training_record
from muybridge.train.engine import precision
from muybridge.train.engine.checkpoint import CHECKPOINT, load_checkpoint, save_checkpoint
from muybridge.train.engine.curves import write_curves
from muybridge.train.engine.gradient_worker import GradientWorker
from muybridge.train.engine.muon import Optimisers
from muybridge.train.engine.options import Training
from muybridge.train.engine.process_pool import processors

# Images first, then whatever the loss needs.
Batch = tuple[Tensor, ...]

_SAVE_EVERY_S = 180
_WARM_UP_STEPS = 300
_MAX_GRADIENT_NORM = 5.0


def device() -> torch.device:
    """The GPU if there is one, else the CPU: the same loop serves both."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def learning_rate(peak: float, step: int, elapsed: float, budget: float, decay: float) -> float:
    """Learning rate of a step: warm-up, then constant, then a linear fall to a hundredth.

    The constant stretch lets a later run continue from the same weights.

    Args:
        peak: the constant rate.
        step: steps so far; the rate rises over the first 300.
        elapsed, budget: seconds so far, and in total; or steps.
        decay: share of the budget, at its end, over which the rate falls.
    """
    warm = min(1.0, (step + 1) / _WARM_UP_STEPS)
    left = max(0.0, (budget - elapsed) / max(budget * decay, 1e-9))
    return peak * warm * max(0.01, min(1.0, left))


class AveragedWeights:
    """Moving average of a network's parameters and buffers (Polyak averaging).

    Args:
        net: the network.
        decay: share of the average that remains after a step; smaller during the first steps.
        share: least share of all steps so far to average over, counted from the last; 1 is the mean of all.
    """

    def __init__(self, net: nn.Module, decay: float = 0.9995, share: float = 0.0) -> None:
        self.decay, self.share = decay, share
        self.state = {k: v.detach().clone() for k, v in net.state_dict().items()}

    @torch.no_grad()
    def update(self, net: nn.Module, step: int) -> None:
        """Move the average towards the network; faster in the first steps."""
        decay = min(self.decay, (1 + step) / (10 + step))
        decay = max(decay, 1 - 1 / (1 + self.share * step))
        now = net.state_dict()
        averaged = [key for key, value in now.items() if value.dtype.is_floating_point]
        torch._foreach_lerp_([self.state[key] for key in averaged], [now[key] for key in averaged], 1 - decay)
        for key in now.keys() - set(averaged):
            self.state[key].copy_(now[key])


def log_line(path: pathlib.Path, record: Mapping[str, Any]) -> None:
    """Append one JSON line."""
    with path.open("a") as file:
        file.write(json.dumps(dict(record)) + "\n")


def machine_facts() -> dict[str, Any]:
    """What throughput depends on, for the log."""
    return {
        "machine": platform.machine(), "python": platform.python_version(), "torch": torch.__version__,
        "cpus": os.cpu_count(), "device": str(device()), "precision": precision.name(device()),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }  # fmt: skip


class Throughput:
    """Images per second since the last call.

    Args:
        images: count at the start.
    """

    def __init__(self, images: int = 0) -> None:
        self.time, self.images = time.monotonic(), images

    def __call__(self, images: int) -> float:
        now = time.monotonic()
        rate = (images - self.images) / max(now - self.time, 1e-9)
        self.time, self.images = now, images
        return rate


def worker_count(options: Training, on_cpu: int = 1) -> int:
    """Number of processes that make images: `options.workers`, else `on_cpu` beside a network on the CPU, else all
    processors but one, since a GPU waits for images however many processes make them."""
    if options.workers is not None:
        return options.workers
    return max(1, len(processors()) - 1) if device().type == "cuda" else on_cpu


def resumes(options: Training) -> bool:
    """Whether `options.out` has a checkpoint to continue from."""
    return (options.out / CHECKPOINT).exists()


class TrainingHistory(NamedTuple):
    """How long a network has been trained.

    Attributes:
        images: number of images.
        seconds: training time.
    """

    images: int = 0
    seconds: float = 0.0

    @classmethod
    def of_file(cls, path: pathlib.Path) -> "TrainingHistory":
        """The history recorded in an ONNX file."""
        record = training_record(path)
        return cls(record.get("images", 0), 60 * record.get("minutes", 0.0))


class TrainingRun:
    """One training run: network, optimiser, averaged weights and counters, resumed from a checkpoint if there is one.

    Args:
        options: the training's options.
        net: the network; its `config` goes into the checkpoint.
        score: figures of merit of the averaged network, for the log and the checkpoint.
        history: earlier training of `net`, used if there is no checkpoint.

    Raises:
        SessionError: the checkpoint is damaged or of another network.
    """

    def __init__(
        self, options: Training, net: nn.Module, score: Callable[[nn.Module], dict[str, float]],
        history: TrainingHistory | None = None,
    ) -> None:  # fmt: skip
        self.options, self.score = options, score
        options.out.mkdir(parents=True, exist_ok=True)
        self.checkpoint, self.log = options.out / CHECKPOINT, options.out / "log.jsonl"
        self.net = to_training_device(net)
        self.optimiser = Optimisers(net, options.rate, muon=options.muon)
        self.average = AveragedWeights(self.net, share=options.average)
        self.state: dict[str, Any] = {"step": 0} | (history or TrainingHistory())._asdict()
        self.scores: dict[str, float] = {}
        if resumes(options):
            self._resume()
        log_line(self.log, {"options": {k: str(v) for k, v in asdict(options).items()}} | machine_facts() | self.state)

    def _resume(self) -> None:
        try:
            saved = load_checkpoint(self.checkpoint, device())
        except ModelError as error:
            raise SessionError(f"{error}; remove it, or start a new run with another --out") from error
        try:
            self.net.load_state_dict(saved["net"])
        except (KeyError, RuntimeError) as error:
            raise SessionError(
                f"{self.checkpoint}: of another network design than this version's, so training cannot resume; start "
                "a new run with another --out, from its weights with --model FILE.onnx"
            ) from error
        if self.optimiser.accepts(saved.get("optimiser")):
            self.optimiser.load_state_dict(saved["optimiser"])
        self.average.state = saved["average"]
        self.state, self.scores = saved["state"], saved.get("scores", {})

    def run(
        self, stream: Iterator[Any], loss_of: Callable[[nn.Module, Any], tuple[Tensor, Tensor]],
        worker: GradientWorker | None = None,
    ) -> None:  # fmt: skip
        """Train for `options.minutes`, or `options.steps`, or until the run has `options.all_steps`.

        Args:
            stream: batches: tuples that begin with the images.
            loss_of: of (network, batch): the loss, and a figure for the log.
            worker: a second process that computes part of each batch.

        Raises:
            SessionError: training diverged; the last checkpoint stays.
        """
        steps, start = self.options.all_steps or self.options.steps, time.monotonic()
        budget = self.options.minutes * 60 if steps is None else float(steps)
        first = 0 if self.options.all_steps else self.state["step"]
        earlier_seconds = self.state["seconds"]
        rate, losses, saved_at = Throughput(self.state["images"]), [], start
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        with Progress(*columns, transient=True) as progress, terminated_like_interrupted():
            bar = progress.add_task("training", total=budget)
            try:
                while True:
                    step, elapsed = self.state["step"] - first, time.monotonic() - start
                    spent = elapsed if steps is None else step
                    if spent >= budget:
                        break
                    self.optimiser.set_rate(learning_rate(self.options.rate, step, spent, budget, self.options.decay))
                    batch = tuple(t.to(device(), non_blocking=True) for t in next(stream))
                    losses.append(self._step(batch, loss_of, worker))
                    self.state["images"] += len(batch[0])
                    self.state["seconds"] = earlier_seconds + elapsed
                    status = f"{self.state['images']:,} images, loss {losses[-1]:.2f}"
                    progress.update(bar, completed=spent, description=status)
                    if time.monotonic() - saved_at > _SAVE_EVERY_S:
                        self._save(losses, rate)
                        losses, saved_at = [], time.monotonic()
            except KeyboardInterrupt:
                print("interrupted; saving a checkpoint", flush=True)
                self._write(self.scores)  # at once: scoring takes a while, for which nobody may wait
                self._save(losses, rate)
                raise
        self._save(losses, rate)

    def _step(
        self, batch: Any, loss_of: Callable[[nn.Module, Any], tuple[Tensor, Tensor]], worker: GradientWorker | None
    ) -> float:
        self.net.train()
        self.net.zero_grad(set_to_none=True)
        if worker is not None:
            figure = worker.gradients(self.net, batch, loss_of)
        else:
            loss, figure = loss_of(self.net, batch)
            loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.net.parameters(), _MAX_GRADIENT_NORM)
        value = float(figure)
        self._raise_if_diverged(not np.isfinite(value + float(norm)))
        self.optimiser.step()
        self.average.update(self.net, self.state["step"])
        self.state["step"] += 1
        return value

    def _raise_if_diverged(self, diverged: bool) -> None:
        """Raise SessionError, before anything is overwritten, if training has `diverged`."""
        if diverged:
            raise SessionError(
                f"training diverged after {self.state['images']:,} images (its loss or weights are not finite); "
                f"{self.checkpoint} is as last saved: continue with less than --rate {self.options.rate:g}"
            )

    def averaged(self) -> nn.Module:
        """The network with averaged weights, in evaluation mode."""
        net: nn.Module = type(self.net)(**self.net.config)  # type: ignore[arg-type]
        net.load_state_dict(self.average.state)
        return to_training_device(net).eval()

    def _write(self, scores: dict[str, float]) -> None:
        """Write the checkpoint."""
        save_checkpoint(self.checkpoint, {
            "net": self.net.state_dict(), "optimiser": self.optimiser.state_dict(), "average": self.average.state,
            "state": dict(self.state), "config": self.net.config, "scores": scores,
            "options": {k: str(v) for k, v in asdict(self.options).items()},
        })  # fmt: skip

    def _save(self, losses: list[float], rate: "Throughput") -> None:
        speed = rate(self.state["images"])
        self._raise_if_diverged(not all(bool(w.isfinite().all()) for w in self.net.parameters()))
        self.scores = scores = self.score(self.averaged())
        self._write(scores)
        if not losses:  # nothing new since the last save
            return
        loss = float(np.mean(losses))
        log_line(self.log, dict(self.state) | {"loss": loss, "images_a_second": round(speed, 1)} | scores)
        write_curves(self.log)
        figures = "  ".join(f"{k} {v:.3f}" for k, v in scores.items())
        minutes = self.state["seconds"] / 60
        print(f"{self.state['images']:>9,} images {minutes:6.1f} min  loss {loss:.3f}  {figures}  {speed:.0f} images/s",
              flush=True)  # fmt: skip


@contextmanager
def terminated_like_interrupted() -> Iterator[None]:
    """Let the signal that ends processes (SIGTERM) raise KeyboardInterrupt while the block runs."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # only that one may handle signals
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def to_training_device(net: nn.Module) -> nn.Module:
    """The network on the training device, in the memory layout that is fastest."""
    net.to(device())
    return net.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def worker_seed(seed: int, *parts: int) -> int:
    """A 32-bit seed from several numbers."""
    return int(np.random.SeedSequence([seed, *parts]).generate_state(1)[0])
