"""A pool of backgrounds on disk, half of them painted, half views of rendered rooms."""

import functools
import pathlib
from dataclasses import dataclass

import numpy as np
from rich.progress import Progress

from muybridge.arrays import ByteArray
from muybridge.files import replacing
from muybridge.train.engine.process_pool import affordable_processes, map_in_processes
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.rooms import VIEWS_EACH, make_room_pictures
from muybridge.train.synthesis.rendering.store import MEMORY

# Images made at once: whole rooms.
_PART = 16 * VIEWS_EACH
# Starting another process takes some seconds, in which one makes this many.
_LEAST_PER_PROCESS = 500


@dataclass
class _PoolMaker:
    """Makes parts of a pool; the renderer is created for the first part with rooms.

    Attributes:
        seed: of the pool.
        painted: number of painted images, which come first; the others are views of rooms.
    """

    seed: int
    painted: int

    @functools.cached_property
    def _renderer(self) -> Renderer:
        return Renderer(BodyModel(self.seed))

    def part(self, numbers: range) -> tuple[range, ByteArray]:
        """The numbers of these images, which are all of one kind, and (len(numbers), 3, SIZE, SIZE)."""
        if numbers.start < self.painted:
            return numbers, make_backgrounds(len(numbers), SIZE, self.seed, numbers.start)
        first = numbers.start - self.painted
        return numbers, make_room_pictures(self._renderer, len(numbers), SIZE, self.seed, first)


def make_background_pool(path: pathlib.Path, count: int, seed: int) -> None:
    """Write (count, 3, SIZE, SIZE) uint8, painted ones first (`.npy`); the result does not depend on the number of
    processes."""
    painted = count - count // 2
    parts = [
        range(start, min(start + _PART, end))
        for begin, end in ((0, painted), (painted, count))
        for start in range(begin, end, _PART)
    ]
    pictures = np.empty((count, 3, SIZE, SIZE), np.uint8)
    processes = min(affordable_processes(MEMORY), max(1, count // _LEAST_PER_PROCESS))
    with Progress(transient=True) as progress:
        bar = progress.add_task("backgrounds", total=count)
        for numbers, made in map_in_processes(_PoolMaker(seed, painted).part, parts, processes):
            pictures[numbers.start : numbers.stop] = made
            progress.update(bar, advance=len(numbers))
    with replacing(path) as temporary:
        np.save(temporary, pictures)
