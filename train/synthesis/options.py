"""Options of `muybridge synth`. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass

from muybridge.errors import SessionError
from muybridge.train.engine.options import check_output_folder


@dataclass(frozen=True)
class Synthesis:
    """How the store of renders is made.

    Attributes:
        out: folder of the store; existing shards are kept.
        shards: total number of shards of 256 renders; the first four are held out from training.
        seed: random seed; shard k depends only on the seed and k.
        kinds: kinds of generated motion (stand, walk, sit, ...) to restrict new shards to. Default: all kinds, plus
            static poses, whose range is wider than that of motion.
        scenes: render scenes instead, of these kinds: `all`, `using` (people who use things), `together` (people in
            contact), `alone` (people alone, from unusual places), `things` (things without people), or the names of
            kinds. An unknown name lists them.
        close_ups: make new shards of parts of people seen from near, as cameras on a desk see them.
        processes: rendering processes, 0.9 GB each. Default: one per processor, within half of the memory.
        sheet: also composite a contact sheet of training images, `sheet.png`, into the folder.
    """

    out: pathlib.Path = pathlib.Path("runs/renders")
    shards: int = 60
    seed: int = 0
    kinds: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    close_ups: bool = False
    processes: int | None = None
    sheet: bool = True

    def __post_init__(self) -> None:
        if self.shards < 1:
            raise SessionError(f"--shards {self.shards}: must be at least 1")
        check_output_folder(self.out)
