"""Options of the correction network's training. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass

from muybridge.train.engine.options import Training


@dataclass(frozen=True)
class SolverTraining(Training):
    """Train the network that corrects bodies fitted to markers, on synthetic people.

    Attributes:
        clips: folder of markers and joints under generated motion; generated if missing.
        shards: number of shards of 32 clips, each with as many clips of other people who follow the same motions; the
            first is held out from training.
        workers: processes that make fits before training begins.
    """

    out: pathlib.Path = pathlib.Path("runs/solver")
    clips: pathlib.Path = pathlib.Path("runs/solver/clips")
    shards: int = 24
    minutes: float = 40.0
    batch: int = 256
    rate: float = 2e-3
    decay: float = 0.4
    workers: int = 1
