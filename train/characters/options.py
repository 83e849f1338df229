"""Options of the trainings of characters' networks. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass

from muybridge.train.engine.options import Training


@dataclass(frozen=True)
class SkinningTraining(Training):
    """Train the network that weights skins, on generated characters with artists' weights.

    Attributes:
        shards: number of shards of 32 characters to make if there are fewer; the first is held out from training.
        batch: characters per step.
    """

    out: pathlib.Path = pathlib.Path("runs/skinning")
    shards: int = 18
    minutes: float = 20.0
    batch: int = 4
    rate: float = 2e-3
    decay: float = 0.4
    workers: int = 0


@dataclass(frozen=True)
class RiggerTraining(Training):
    """Train the network that finds joints in a mesh, on generated characters.

    Attributes:
        shards: number of shards of 64 characters to make if there are fewer; the first is held out from training.
        batch: characters per step.
    """

    out: pathlib.Path = pathlib.Path("runs/rigger")
    shards: int = 40
    minutes: float = 20.0
    batch: int = 16
    rate: float = 1.5e-3
    decay: float = 0.4
    workers: int = 0
