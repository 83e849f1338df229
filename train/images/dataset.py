"""Batches of training images: renders composited on backgrounds in worker processes."""

import pathlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset

from muybridge.errors import SessionError
from muybridge.train.engine.loop import Batch, worker_count, worker_seed
from muybridge.train.engine.malloc import keep_memory
from muybridge.train.engine.options import ImageTraining
from muybridge.train.images.background_pool import make_background_pool
from muybridge.train.synthesis.rendering.store import RenderSet, load_renders, shard_numbers, shard_path
from muybridge.train.synthesis.rendering.worker import RenderWorker

# The first shards of a store are never trained on.
HELD_OUT = range(0, 4)
TRAINED_ON = range(HELD_OUT.stop, 100_000)
# Training starts when this many more shards exist.
_FIRST_SHARDS = 4
# Batches after which a worker reloads the store and its compositors; a growing store is checked more often, since a
# network soon memorises few people.
_RELOAD_BATCHES, _CHECK_BATCHES, _GROWTH = 500, 25, 1.1

# From renders and a seed to a function that gives the next batch.
BatchMaker = Callable[[RenderSet, int], Callable[[], Batch]]


@contextmanager
def training_data(options: ImageTraining) -> Iterator[pathlib.Path]:
    """Set up training on images: random seed, threads, renders and backgrounds.

    If there are no renders, the first are waited for, and the others are made while the block runs.

    Yields:
        Path of the background pool.

    Raises:
        SessionError: there are no renders to train on or to validate with.
    """
    if 0 < options.shards <= HELD_OUT.stop and not shard_numbers(options.renders):
        raise SessionError(
            f"--shards {options.shards}: the first {HELD_OUT.stop} are held out from training; make more, such as 60"
        )
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    keep_memory()
    with RenderWorker(options.renders, options.shards, options.seed) as renders:
        if renders.making:
            background_pool(options)  # takes some minutes, in which the first renders are made
        renders.wait_for(HELD_OUT.stop + _FIRST_SHARDS)
        if options.steps is not None:  # what is trained on must not depend on when it is made
            renders.wait_for(options.shards)
        _check_renders(options)
        yield background_pool(options)


def _check_renders(options: ImageTraining) -> None:
    for store in options.scene_renders:
        if not len(load_renders(store, TRAINED_ON)):
            raise SessionError(
                f"{store}: no renders to train on (the first {HELD_OUT.stop} shards are held out); make some with "
                "`muybridge synth`"
            )
    trained_on = load_renders(options.renders, TRAINED_ON)
    if options.whole_people and len(trained_on) and not len(trained_on.whole):
        raise SessionError(
            f"{options.renders}: only renders of parts of people, which scenes cannot be made of; name a store "
            "of whole people (`muybridge synth` without --close-ups)"
        )
    if not len(trained_on):
        raise SessionError(
            f"{options.renders}: no renders to train on (the first {HELD_OUT.stop} shards are held out); "
            "make some with `muybridge synth`"
        )
    if not len(load_renders(options.renders, HELD_OUT)):
        first, last = (shard_path(options.renders, number).name for number in (HELD_OUT[0], HELD_OUT[-1]))
        raise SessionError(
            f"{options.renders}: none of {first} to {last}, to validate with; `muybridge synth` makes them"
        )


def load_stores(folders: Sequence[pathlib.Path], numbers: range) -> RenderSet:
    """The renders of several stores, one after the other; pixels stay on disk.

    Args:
        folders: the stores.
        numbers: of the shards of each.
    """
    stores = [load_renders(folder, numbers) for folder in folders]
    labels = [field.name for field in fields(RenderSet) if field.name != "pixels"]
    return RenderSet(
        [pixels for store in stores for pixels in store.pixels],
        **{name: np.concatenate([getattr(store, name) for store in stores]) for name in labels},
    )


def stores_of(options: ImageTraining) -> list[pathlib.Path]:
    """The folders of all stores to train on."""
    return [options.renders, *options.scene_renders]


def batches(options: ImageTraining, make: BatchMaker, start: int, on_cpu: int = 1) -> Iterator[Batch]:
    """Endless training batches from worker processes.

    Args:
        options: the training's options.
        make: from renders and a seed to a function that gives the next batch; must be picklable.
        start: step of the run, so that a resumed run gets other images than before.
        on_cpu: as in `worker_count`.
    """
    stream, count = _Stream(options, make, start), worker_count(options, on_cpu)
    ahead = 4 if count else None
    return iter(DataLoader(stream, batch_size=None, num_workers=count, prefetch_factor=ahead))


class _Stream(IterableDataset[Batch]):
    def __init__(self, options: ImageTraining, make: BatchMaker, start: int) -> None:
        self.options, self.make, self.start = options, make, start

    def __iter__(self) -> Iterator[Batch]:
        worker = torch.utils.data.get_worker_info()
        if worker:
            torch.set_num_threads(1)
            keep_memory()
        count = 0
        while True:
            # New shards are picked up while they are being made.
            stores = stores_of(self.options)
            known = _count(stores)
            renders = load_stores(stores, TRAINED_ON)
            seed = worker_seed(self.options.seed, self.start, worker.id if worker else 0, count)
            next_batch = self.make(renders, seed)
            for k in range(1, _RELOAD_BATCHES + 1):
                yield next_batch()
                count += 1
                if k % _CHECK_BATCHES == 0 and _count(stores) > _GROWTH * known:
                    break


def _count(stores: Sequence[pathlib.Path]) -> int:
    return sum(len(shard_numbers(store)) for store in stores)


def background_pool(options: ImageTraining) -> pathlib.Path:
    """Path of the background pool beside the run's folder, made on the first call: half of it painted, half of it views
    of rendered rooms.

    Raises:
        SessionError: the pool cannot be read.
    """
    path = options.out.parent / f"pool-{options.backgrounds}-{options.seed}.npy"
    if not path.exists():
        make_background_pool(path, options.backgrounds, options.seed)
    try:
        np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise SessionError(f"{path}: unreadable background pool ({error}); remove it, and it is made again") from error
    return path
