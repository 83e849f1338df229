"""A second process that works out the gradients of a part of every batch.

Threads within a network wait for one another at every layer, so that a processor which also makes the crops holds up
the other. A process with a copy of the network does not: it takes as many chunks of a batch as it manages while the
training's own process works on the rest, and the gradients add up. On two processors the training keeps one for itself,
or all three processes, the crops' too, would be moved to and fro between both.
"""

import contextlib
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import torch
import torch.multiprocessing
from torch import Tensor, nn

from muybridge.train.engine import precision
from muybridge.train.engine.compile import PAYS_AFTER_MINUTES, compiled
from muybridge.train.engine.malloc import keep_memory
from muybridge.train.engine.process_pool import processors

Losses = Callable[..., tuple[Tensor, ...]]

# A batch is so many chunks of one size: normalisation is over one chunk, and one compiled network does for all.
CHUNKS = 4
# After so many steps without it, the second process is tried again: what kept its processor busy may be over.
_TRIED_AGAIN = 50
_ENDED = "the training's second process ended; --no-second does without it"
# By how much less the second process is in a hurry than the training.
_NICER = 10
# What the newest step says of the time that a chunk takes.
_NEWEST = 0.2


@dataclass(frozen=True)
class _Shared:
    """Memory that both processes see."""

    weights: Tensor  # all of them, one after the other
    gradients: Tensor
    batch: tuple[Tensor, ...]  # the chunks that the second process takes, of a part one value after the other


class GradientWorker:
    """The second process, which starts with the first batch and ends with the block (a context manager), within which
    those that make the batches have to be started.

    Args:
        net: whose parameters are trained; its `config` makes another one like it.
        losses: of (network, batch): the loss first; it has to pickle.
        minutes: of the training, for `compiled`.
        threads: of the network in the training's own process.
    """

    def __init__(self, net: nn.Module, losses: Losses, minutes: float, threads: int = 1) -> None:
        self._losses, self._minutes = losses, minutes
        self._processors = processors()
        self._tight = threads == 1 and len(self._processors) == 2 and hasattr(os, "sched_setaffinity")
        self._parameters = list(net.parameters())
        self._shared: _Shared | None = None
        self._ready, self._idle = False, 0
        self._own_seconds = self._second_seconds = 0.0  # of a chunk

    def __enter__(self) -> "GradientWorker":
        if self._tight:
            os.sched_setaffinity(0, self._processors[1:])  # for now, so that all that is started runs there
        return self

    def __exit__(self, *_: object) -> None:
        if self._tight:
            os.sched_setaffinity(0, self._processors)
        if self._shared is not None:
            self._pipe.close()
            self._process.join()

    def gradients(
        self, net: nn.Module, batch: tuple[Tensor, ...], loss_of: Callable[[nn.Module, Any], tuple[Tensor, Tensor]]
    ) -> Tensor:
        """Sets the parameters' gradients to those of the mean loss of the batch's chunks.

        Args:
            net: the network, its gradients none.
            batch: images and whatever the loss needs, of a multiple of `CHUNKS` images; no later one's
                images are larger than those of the first.
            loss_of: of (network, batch): the loss, and a figure for the log.

        Returns:
            the mean of the figure, over the chunks that this process worked on.

        Raises:
            RuntimeError: the second process failed.
        """
        if self._shared is None:
            self._start(net, batch)
        theirs = self._count()
        if theirs:
            self._hand_over(batch, theirs)
        began, shown = time.perf_counter(), []
        for k in range(theirs, CHUNKS):
            loss, figure = loss_of(net, _chunk(batch, k))
            (loss / CHUNKS).backward()  # type: ignore[no-untyped-call]
            shown.append(figure)
        each = (time.perf_counter() - began) / len(shown)
        self._own_seconds = _moved(self._own_seconds, each)
        if theirs:
            self._second_seconds = _moved(self._second_seconds, self._answer() / theirs)
            for p, gradient in zip(self._parameters, self._gradients, strict=True):
                p.grad = gradient.clone() if p.grad is None else p.grad.add_(gradient)
        return torch.stack(shown).mean()

    def _start(self, net: nn.Module, batch: tuple[Tensor, ...]) -> None:
        count = sum(p.numel() for p in self._parameters)
        self._shared = _Shared(
            _memory(torch.empty(count)), _memory(torch.empty(count)),
            tuple(_memory(torch.empty(part.numel(), dtype=part.dtype)) for part in batch),
        )  # fmt: skip
        self._weights, self._gradients = (
            _views(flat, self._parameters) for flat in (self._shared.weights, self._shared.gradients)
        )
        context = torch.multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        rough = precision.pays("cpu")
        arguments = (theirs, self._shared, (type(net), net.config), self._losses, self._minutes, rough)
        self._process = context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        if self._tight:
            os.sched_setaffinity(0, self._processors[:1])
        self._hand_over(batch, 1)  # compiles while this process goes on; what comes of it is not used

    def _count(self) -> int:
        """How many chunks the second process takes, so that both are done as early as possible."""
        if not self._ready:
            if not self._pipe.poll():
                return 0
            self._answer()
            self._ready = True
        self._idle += 1
        if not self._second_seconds or self._idle > _TRIED_AGAIN:
            theirs = 1
        else:
            theirs = min(range(CHUNKS), key=lambda n: max((CHUNKS - n) * self._own_seconds, n * self._second_seconds))
        self._idle = 0 if theirs else self._idle
        return theirs

    def _hand_over(self, batch: tuple[Tensor, ...], chunks: int) -> None:
        assert self._shared is not None
        count = chunks * len(batch[0]) // CHUNKS
        shapes = [(count, *part.shape[1:]) for part in batch]
        with torch.no_grad():
            for view, p in zip(self._weights, self._parameters, strict=True):
                view.copy_(p)
        for there, part in zip(_shaped(self._shared.batch, shapes), batch, strict=True):
            there.copy_(part[:count])
        try:
            self._pipe.send((chunks, shapes))
        except OSError as error:
            raise RuntimeError(_ENDED) from error

    def _answer(self) -> float:
        """Seconds that the second process took."""
        try:
            said = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise RuntimeError(_ENDED) from error
        if isinstance(said, str):
            raise RuntimeError(f"the training's second process failed; --no-second does without it: {said}")
        return float(said)


def pays(batch: int, threads: int, minutes: float) -> bool:
    """Whether a training has a second process: on a CPU with a processor more than the network's threads, in a run
    that is long enough to compile twice, with batches that can be divided."""
    spare = len(processors()) > threads
    return not torch.cuda.is_available() and spare and minutes >= PAYS_AFTER_MINUTES and batch % CHUNKS == 0


def _memory(tensor: Tensor) -> Tensor:
    """The tensor where other processes see it."""
    shared: Tensor = tensor.share_memory_()  # type: ignore[no-untyped-call]
    return shared


def _shaped(memory: tuple[Tensor, ...], shapes: list[tuple[int, ...]]) -> tuple[Tensor, ...]:
    """The beginning of each part's memory in the shape of that part; images in the order of memory that is fastest."""
    parts = [flat[: math.prod(shape)].view(shape) for flat, shape in zip(memory, shapes, strict=True)]
    return tuple(
        part.view(len(part), *part.shape[2:], part.shape[1]).movedim(-1, 1) if part.ndim == 4 else part
        for part in parts
    )


def _chunk(batch: tuple[Tensor, ...], k: int, chunks: int = CHUNKS) -> tuple[Tensor, ...]:
    """The k-th of a batch's chunks."""
    size = len(batch[0]) // chunks
    return tuple(part[k * size : (k + 1) * size] for part in batch)


def _moved(mean: float, newest: float) -> float:
    return mean + _NEWEST * (newest - mean) if mean else newest


def _views(flat: Tensor, parameters: list[nn.Parameter]) -> list[Tensor]:
    """Each parameter's part of the memory of all, in its order of memory."""
    starts = [0]
    for p in parameters:
        starts.append(starts[-1] + p.numel())
    return [flat.as_strided(p.shape, p.stride(), start) for p, start in zip(parameters, starts, strict=False)]


def _work(
    pipe: Connection, shared: _Shared, design: tuple[type[nn.Module], dict[str, Any]], losses: Losses, minutes: float,
    rough: bool,
) -> None:  # fmt: skip
    """The second process: chunks come, gradients go, until the other end of the pipe is closed, however its holder
    ended."""
    try:
        _answer_all(pipe, shared, design, losses, minutes, rough)
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        return
    except Exception as error:  # whatever it is, the training has to hear of it
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            pipe.send(f"{type(error).__name__}: {error}")


def _give_way() -> None:
    """Whoever makes crops, or renders, comes first."""
    if not hasattr(os, "nice"):
        return
    before = os.nice(0)
    # A training that is at the lowest priority itself can't have a part of it at a lower one, but for this.
    if os.nice(_NICER) < before + _NICER and hasattr(os, "SCHED_IDLE"):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def _answer_all(
    pipe: Connection, shared: _Shared, design: tuple[type[nn.Module], dict[str, Any]], losses: Losses, minutes: float,
    rough: bool,
) -> None:  # fmt: skip
    _give_way()
    torch.set_num_threads(1)
    keep_memory()
    precision.settle(rough)
    kind, config = design
    net = kind(**config).to(memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    parameters = list(net.parameters())
    for p, view in zip(parameters, _views(shared.weights, parameters), strict=True):
        p.data = view
    gradients, fused = _views(shared.gradients, parameters), compiled(losses, minutes)
    while True:
        chunks, shapes = pipe.recv()
        began, batch = time.perf_counter(), _shaped(shared.batch, shapes)
        net.zero_grad(set_to_none=True)
        for k in range(chunks):
            loss, *_ = fused(net, _chunk(batch, k, chunks))
            (loss / CHUNKS).backward()  # type: ignore[no-untyped-call]
        for p, gradient in zip(parameters, gradients, strict=True):
            gradient.zero_() if p.grad is None else gradient.copy_(p.grad)
        pipe.send(time.perf_counter() - began)
