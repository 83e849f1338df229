"""A pool of backgrounds on disk, half of them painted, half views of rendered rooms."""

import functools
import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.progress import Progress

from muybridge.files import replacing
from muybridge.train.backgrounds import make_backgrounds
from muybridge.train.bodies import BodyModel
from muybridge.train.processes import affordable, shared_out
from muybridge.train.render import Renderer
from muybridge.train.renders import MEMORY, SIZE
from muybridge.train.rooms import VIEWS_EACH, make_room_pictures

# Pictures that are made at once: whole rooms.
_PART = 16 * VIEWS_EACH
# Another process takes some seconds to begin, in which one makes so many.
_PAYS = 500


@dataclass
class _Backdrops:
    """Makes parts of a pool; what renders rooms begins with the first of them."""

    seed: int

    @functools.cached_property
    def _renderer(self) -> Renderer:
        return Renderer(BodyModel(self.seed))

    def part(self, what: tuple[bool, int, int]) -> tuple[bool, int, NDArray[np.uint8]]:
        """(count, 3, SIZE, SIZE) of (whether of rooms, the first, count), and the first two again."""
        rooms, first, count = what
        if rooms:
            return rooms, first, make_room_pictures(self._renderer, count, SIZE, self.seed, first)
        return rooms, first, make_backgrounds(count, SIZE, self.seed, first)


def make_background_pool(path: pathlib.Path, count: int, seed: int) -> None:
    """Writes (count, 3, SIZE, SIZE) uint8, painted ones first (`.npy`); the same in one process or several."""
    rooms = count // 2
    parts = [
        (kind, first, min(_PART, total - first))
        for kind, total in ((False, count - rooms), (True, rooms))
        for first in range(0, total, _PART)
    ]
    pictures = np.empty((count, 3, SIZE, SIZE), np.uint8)
    processes = min(affordable(MEMORY), max(1, count // _PAYS))
    with Progress(transient=True) as progress:
        bar = progress.add_task("backgrounds", total=count)
        for kind, first, made in shared_out(_Backdrops(seed).part, parts, processes):
            start = first + (count - rooms) * kind
            pictures[start : start + len(made)] = made
            progress.update(bar, advance=len(made))
    with replacing(path) as temporary:
        np.save(temporary, pictures)
