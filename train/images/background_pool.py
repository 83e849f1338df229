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
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.rooms import VIEWS_EACH, make_room_pictures
from muybridge.train.synthesis.rendering.store import MEMORY, SIZE

# Pictures that are made at once: whole rooms.
_PART = 16 * VIEWS_EACH
# Another process takes some seconds to begin, in which one makes so many.
_PAYS = 500


@dataclass
class _Backdrops:
    """Makes parts of a pool; what renders rooms begins with the first of them.

    Attributes:
        seed: of the pool.
        painted: how many of its pictures, the first, are painted; the others are views of rooms.
    """

    seed: int
    painted: int

    @functools.cached_property
    def _renderer(self) -> Renderer:
        return Renderer(BodyModel(self.seed))

    def part(self, numbers: range) -> tuple[range, ByteArray]:
        """(len(numbers), 3, SIZE, SIZE) of these pictures, all of one kind, and which they are."""
        if numbers.start < self.painted:
            return numbers, make_backgrounds(len(numbers), SIZE, self.seed, numbers.start)
        first = numbers.start - self.painted
        return numbers, make_room_pictures(self._renderer, len(numbers), SIZE, self.seed, first)


def make_background_pool(path: pathlib.Path, count: int, seed: int) -> None:
    """Writes (count, 3, SIZE, SIZE) uint8, painted ones first (`.npy`); the same in one process or several."""
    painted = count - count // 2
    parts = [
        range(start, min(start + _PART, end))
        for begin, end in ((0, painted), (painted, count))
        for start in range(begin, end, _PART)
    ]
    pictures = np.empty((count, 3, SIZE, SIZE), np.uint8)
    processes = min(affordable_processes(MEMORY), max(1, count // _PAYS))
    with Progress(transient=True) as progress:
        bar = progress.add_task("backgrounds", total=count)
        for numbers, made in map_in_processes(_Backdrops(seed, painted).part, parts, processes):
            pictures[numbers.start : numbers.stop] = made
            progress.update(bar, advance=len(numbers))
    with replacing(path) as temporary:
        np.save(temporary, pictures)
