"""Options of the person detector's training. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass
from typing import ClassVar

from muybridge.train.engine.options import ImageTraining


@dataclass(frozen=True)
class PeopleTraining(ImageTraining):
    """Train the person detector on scenes of synthetic people.

    Attributes:
        workers: processes that make images. Default: two, since making a scene takes twice as long as training on it;
            with a GPU, one per processor except one.
        model: muybridge detector to start from, such as the shipped one, if `out` has no run yet.
    """

    whole_people: ClassVar[bool] = True
    out: pathlib.Path = pathlib.Path("runs/people")
    minutes: float = 30.0
    batch: int = 32
    model: pathlib.Path | None = None
