"""An outfit while it is being drawn at random."""

from typing import Any

import numpy as np

from muybridge.train.synthesis.clothing.garments import Accessory


class Draft:
    """An outfit to which garments are added one after another.

    Args:
        rng: source of random numbers.
        female: whether a woman wears it.
        kind: of outfit, see `sample.KINDS`.
        values: shader uniforms by name, which the garments change.

    Attributes:
        parts: shells to draw, see `sample.Outfit`.
        accessories: objects attached to the body.
        dots: number of reflective dots on the body, and the seed of their positions.
    """

    def __init__(self, rng: np.random.Generator, female: bool, kind: str, values: dict[str, Any]) -> None:
        self.rng, self.female, self.kind, self.values = rng, female, kind, values
        self.parts: set[str] = set()
        self.accessories: list[Accessory] = []
        self.dots = (0, 0)

    def chance(self, share: float) -> bool:
        """True in `share` of the draws."""
        return bool(self.rng.random() < share)

    def between(self, low: float, high: float) -> float:
        """A uniform draw."""
        return float(self.rng.uniform(low, high))
