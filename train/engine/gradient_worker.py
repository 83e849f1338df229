"""A second process that computes the gradients of part of every batch.

The threads of a network wait for one another at every layer, so that a processor which also makes crops holds up the
others. A process with its own copy of the network does not: it takes as many chunks of a batch as it can finish while
the main process works on the rest, and the gradients are summed. On two processors the main process keeps one for
itself; otherwise the scheduler would move all three processes, including the one that makes crops, between both.
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
from muybridge.train.engine.compile import PAYS_AFTER_MINUTES, compile_for_training
from muybridge.train.engine.malloc import keep_memory
from muybridge.train.engine.process_pool import processors

Losses = Callable[..., tuple[Tensor, ...]]

# Chunks per batch, all of one size: normalisation is over one chunk, and one compiled network serves all.
CHUNKS = 4
# After this many steps without it the second process is tried again: its processor may be free by then.
_RETRY_STEPS = 50
_ENDED = "the second training process ended; --no-second trains without it"
# How much the niceness of the second process is raised.
_NICENESS = 10
# Weight of the newest step in the running mean of the time per chunk.
_NEWEST = 0.2


@dataclass(frozen=True)
class _Shared:
    """Memory shared by both processes."""

    weights: Tensor  # all of them, concatenated
    gradients: Tensor
    batch: tuple[Tensor, ...]  # the chunks of the second process, each part flattened


class GradientWorker:
    """The second process, a context manager: it starts with the first batch and ends with the block.

    Processes that make batches have to be started inside the block, which decides on which processors they run.

    Args:
        net: the network being trained; its `config` creates a copy.
        losses: of (network, batch): a tuple that begins with the loss; must be picklable.
        minutes: length of the training, for `compile_for_training`.
        threads: of the network in the main process.
    """

    def __init__(self, net: nn.Module, losses: Losses, minutes: float, threads: int = 1) -> None:
        self._losses, self._minutes = losses, minutes
        self._processors = processors()
        self._tight = threads == 1 and len(self._processors) == 2 and hasattr(os, "sched_setaffinity")
        self._parameters = list(net.parameters())
        self._shared: _Shared | None = None
        self._ready, self._idle = False, 0
        self._own_seconds = self._second_seconds = 0.0  # per chunk

    def __enter__(self) -> "GradientWorker":
        if self._tight:
            os.sched_setaffinity(0, self._processors[1:])  # for now, so that child processes run there
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
        """Set the parameters' gradients to those of the mean loss of the batch's chunks.

        Args:
            net: the network; its gradients are None.
            batch: images and whatever the loss needs, of a multiple of `CHUNKS` images. Images must not be larger
                than those of the first batch.
            loss_of: of (network, batch): the loss, and a figure for the log.

        Returns:
            The figure's mean over the chunks of this process.

        Raises:
            RuntimeError: the second process failed.
        """
        if self._shared is None:
            self._start(net, batch)
        theirs = self._count()
        if theirs:
            self._hand_over(batch, theirs)
        start, figures = time.perf_counter(), []
        for k in range(theirs, CHUNKS):
            loss, figure = loss_of(net, _chunk(batch, k))
            (loss / CHUNKS).backward()  # type: ignore[no-untyped-call]
            figures.append(figure)
        each = (time.perf_counter() - start) / len(figures)
        self._own_seconds = _running_mean(self._own_seconds, each)
        if theirs:
            self._second_seconds = _running_mean(self._second_seconds, self._receive() / theirs)
            for p, gradient in zip(self._parameters, self._gradients, strict=True):
                p.grad = gradient.clone() if p.grad is None else p.grad.add_(gradient)
        return torch.stack(figures).mean()

    def _start(self, net: nn.Module, batch: tuple[Tensor, ...]) -> None:
        count = sum(p.numel() for p in self._parameters)
        self._shared = _Shared(
            _share(torch.empty(count)), _share(torch.empty(count)),
            tuple(_share(torch.empty(part.numel(), dtype=part.dtype)) for part in batch),
        )  # fmt: skip
        self._weights, self._gradients = (
            _views(flat, self._parameters) for flat in (self._shared.weights, self._shared.gradients)
        )
        context = torch.multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        bfloat16 = precision.bfloat16_is_faster("cpu")
        arguments = (theirs, self._shared, (type(net), net.config), self._losses, self._minutes, bfloat16)
        self._process = context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        if self._tight:
            os.sched_setaffinity(0, self._processors[:1])
        self._hand_over(batch, 1)  # makes it compile meanwhile; the result is not used

    def _count(self) -> int:
        """Number of chunks for the second process, such that both finish as early as possible."""
        if not self._ready:
            if not self._pipe.poll():
                return 0
            self._receive()
            self._ready = True
        self._idle += 1
        if not self._second_seconds or self._idle > _RETRY_STEPS:
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
        for memory, part in zip(_in_shape(self._shared.batch, shapes), batch, strict=True):
            memory.copy_(part[:count])
        try:
            self._pipe.send((chunks, shapes))
        except OSError as error:
            raise RuntimeError(_ENDED) from error

    def _receive(self) -> float:
        """Wait for the second process; the seconds that it took."""
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise RuntimeError(_ENDED) from error
        if isinstance(answer, str):
            raise RuntimeError(f"the second training process failed; --no-second trains without it: {answer}")
        return float(answer)


def is_worthwhile(batch: int, threads: int, minutes: float) -> bool:
    """Whether training should use a second process: on a CPU with more processors than the network has threads, in a
    run long enough to compile twice, with a batch size divisible by `CHUNKS`."""
    spare = len(processors()) > threads
    return not torch.cuda.is_available() and spare and minutes >= PAYS_AFTER_MINUTES and batch % CHUNKS == 0


def _share(tensor: Tensor) -> Tensor:
    """The tensor in shared memory."""
    shared: Tensor = tensor.share_memory_()  # type: ignore[no-untyped-call]
    return shared


def _in_shape(memory: tuple[Tensor, ...], shapes: list[tuple[int, ...]]) -> tuple[Tensor, ...]:
    """The beginning of each part's memory in that part's shape; images in channels-last order, which is fastest."""
    parts = [flat[: math.prod(shape)].view(shape) for flat, shape in zip(memory, shapes, strict=True)]
    return tuple(
        part.view(len(part), *part.shape[2:], part.shape[1]).movedim(-1, 1) if part.ndim == 4 else part
        for part in parts
    )


def _chunk(batch: tuple[Tensor, ...], k: int, chunks: int = CHUNKS) -> tuple[Tensor, ...]:
    """The k-th chunk of a batch."""
    size = len(batch[0]) // chunks
    return tuple(part[k * size : (k + 1) * size] for part in batch)


def _running_mean(mean: float, newest: float) -> float:
    return mean + _NEWEST * (newest - mean) if mean else newest


def _views(flat: Tensor, parameters: list[nn.Parameter]) -> list[Tensor]:
    """Each parameter's part of the concatenated memory, with the parameter's strides."""
    starts = [0]
    for p in parameters:
        starts.append(starts[-1] + p.numel())
    return [flat.as_strided(p.shape, p.stride(), start) for p, start in zip(parameters, starts, strict=False)]


def _work(
    pipe: Connection, shared: _Shared, design: tuple[type[nn.Module], dict[str, Any]], losses: Losses, minutes: float,
    bfloat16: bool,
) -> None:  # fmt: skip
    """Main function of the second process: receive chunks and send gradients until the other end of the pipe is closed,
    in whatever way its process ended."""
    try:
        _serve(pipe, shared, design, losses, minutes, bfloat16)
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        return
    except Exception as error:  # the main process reports it, whatever it is
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            pipe.send(f"{type(error).__name__}: {error}")


def _lower_priority() -> None:
    """Give precedence to the processes that make crops or render."""
    if not hasattr(os, "nice"):
        return
    before = os.nice(0)
    # The niceness of a training with the lowest priority cannot be raised further, but SCHED_IDLE is lower still.
    if os.nice(_NICENESS) < before + _NICENESS and hasattr(os, "SCHED_IDLE"):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def _serve(
    pipe: Connection, shared: _Shared, design: tuple[type[nn.Module], dict[str, Any]], losses: Losses, minutes: float,
    bfloat16: bool,
) -> None:  # fmt: skip
    _lower_priority()
    torch.set_num_threads(1)
    keep_memory()
    precision.fix_precision(bfloat16)
    kind, config = design
    net = kind(**config).to(memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    parameters = list(net.parameters())
    for p, view in zip(parameters, _views(shared.weights, parameters), strict=True):
        p.data = view
    gradients, compiled = _views(shared.gradients, parameters), compile_for_training(losses, minutes)
    while True:
        chunks, shapes = pipe.recv()
        start, batch = time.perf_counter(), _in_shape(shared.batch, shapes)
        net.zero_grad(set_to_none=True)
        for k in range(chunks):
            loss, *_ = compiled(net, _chunk(batch, k, chunks))
            (loss / CHUNKS).backward()  # type: ignore[no-untyped-call]
        for p, gradient in zip(parameters, gradients, strict=True):
            gradient.zero_() if p.grad is None else gradient.copy_(p.grad)
        pipe.send(time.perf_counter() - start)
