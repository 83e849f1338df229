"""Options of the labelling network's training. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass
from typing import Literal

from muybridge.train.engine.options import Training


@dataclass(frozen=True)
class LabelTraining(Training):
    """Train the marker labelling network on synthetic marker clouds.

    Attributes:
        markerset: marker set that most examples use: `pig39`, `cmu41`, or `all` (both, and random sets).
        clips: folder of marker trajectories; generated if missing.
        shards: number of shards of 32 clips; the first four are held out from training.
    """

    out: pathlib.Path = pathlib.Path("runs/labels")
    clips: pathlib.Path = pathlib.Path("runs/labels/clips")
    shards: int = 96
    markerset: Literal["all", "pig39", "cmu41"] = "all"
    batch: int = 48
    rate: float = 3e-3
    decay: float = 0.3
    workers: int = 0
