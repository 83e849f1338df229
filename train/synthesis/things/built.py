"""Things as they are built: a mesh in its own frame, and the places by which people use it.

A thing stands on z = 0 around the origin; who uses it faces -y and has x to the left, like a body at heading 0.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.scene import Thing
from muybridge.train.synthesis.things.shapes import FUR, METAL, MOTTLED, PLAIN, WOOD, WOVEN, Mesh, Surface


@dataclass(frozen=True, eq=False)
class Spot:
    """A place on a thing.

    Attributes:
        at: (3,) metres.
        axis: (3,) along a handle, or forward for who uses it.
        normal: (3,) out of the thing.
        size: metres along x and y, of a surface; radius and length of a handle.
    """

    at: FloatArray
    axis: FloatArray
    normal: FloatArray
    size: tuple[float, float] = (0.0, 0.0)


def spot(
    at: ArrayLike,
    axis: ArrayLike = (0, -1, 0),
    normal: ArrayLike = (0, 0, 1),
    size: tuple[float, float] = (0.0, 0.0),
) -> Spot:
    """A place from plain numbers."""
    a, b, c = (np.asarray(v, float) for v in (at, axis, normal))
    return Spot(a, b / np.linalg.norm(b), c / np.linalg.norm(c), size)


@dataclass(frozen=True, eq=False)
class Built:
    """A thing and its places by name; those of a side end in L and R."""

    kind: str
    mesh: Mesh
    spots: dict[str, Spot]

    def placed(self, heading: float = 0.0, at: ArrayLike = (0.0, 0.0, 0.0)) -> "Built":
        """The thing turned by `heading` degrees about the vertical, then moved to `at` (3,)."""
        return self.carried(rot(2, heading), at)

    def carried(self, turn: FloatArray, at: ArrayLike) -> "Built":
        """The thing turned by (3, 3) about its origin, then moved to `at` (3,)."""
        to = np.asarray(at, float)
        spots = {
            name: replace(s, at=turn @ s.at + to, axis=turn @ s.axis, normal=turn @ s.normal)
            for name, s in self.spots.items()
        }
        return replace(self, mesh=self.mesh.turned(turn).moved(to), spots=spots)

    def thing(self) -> Thing:
        """As the renderer draws it."""
        m = self.mesh
        return Thing(self.kind, m.vertices.astype(np.float32), m.faces.astype(np.int64), m.colour.astype(np.float32),
                     m.pattern, m.gloss.astype(np.float32))  # fmt: skip


def _hue(rng: np.random.Generator, saturation: tuple[float, float], value: tuple[float, float]) -> FloatArray:
    """Linear RGB of a random hue."""
    h, s, v = rng.random(), rng.uniform(*saturation), rng.uniform(*value)
    k = (np.array([5, 3, 1]) + 6 * h) % 6
    srgb = v - v * s * np.clip(np.minimum(k, 4 - k), 0, 1)
    return np.asarray(srgb**2.2)


# Materials: pattern, gloss, and colours (linear) to vary; those without colours take any hue.
_MATERIALS: dict[str, tuple[int, tuple[float, float], tuple[tuple[float, float, float], ...]]] = {
    "wood": (WOOD, (0.1, 0.5), ((0.35, 0.2, 0.09), (0.16, 0.08, 0.035), (0.55, 0.38, 0.2), (0.05, 0.028, 0.018))),
    "metal": (METAL, (0.45, 0.8), ((0.5, 0.5, 0.52), (0.25, 0.25, 0.26), (0.62, 0.6, 0.56))),
    "dark": (PLAIN, (0.2, 0.5), ((0.02, 0.02, 0.022), (0.05, 0.05, 0.055))),
    "rubber": (PLAIN, (0.05, 0.15), ((0.015, 0.015, 0.015), (0.04, 0.04, 0.04))),
    "leather": (MOTTLED, (0.25, 0.5), ((0.03, 0.02, 0.015), (0.15, 0.06, 0.03), (0.3, 0.16, 0.08), (0.5, 0.45, 0.4))),
    "white": (PLAIN, (0.1, 0.4), ((0.75, 0.75, 0.73), (0.6, 0.6, 0.6), (0.8, 0.76, 0.68))),
    "glass": (PLAIN, (0.8, 0.95), ((0.05, 0.06, 0.07), (0.12, 0.15, 0.17))),
    "brass": (METAL, (0.6, 0.9), ((0.6, 0.42, 0.12), (0.45, 0.3, 0.1))),
    "leaf": (MOTTLED, (0.1, 0.3), ((0.03, 0.12, 0.02), (0.08, 0.2, 0.03), (0.12, 0.16, 0.05))),
    "fur": (FUR, (0.02, 0.12), ((0.12, 0.055, 0.02), (0.03, 0.018, 0.01), (0.35, 0.22, 0.1), (0.5, 0.48, 0.44),
                               (0.02, 0.02, 0.02), (0.22, 0.1, 0.04))),
    "stone": (MOTTLED, (0.05, 0.2), ((0.4, 0.39, 0.37), (0.25, 0.24, 0.23), (0.6, 0.58, 0.54))),
    "skin": (MOTTLED, (0.15, 0.3), ((0.5, 0.27, 0.18), (0.25, 0.12, 0.07), (0.6, 0.36, 0.27))),
    "paint": (PLAIN, (0.3, 0.85), ()),
    "plastic": (PLAIN, (0.15, 0.5), ()),
    "cloth": (WOVEN, (0.02, 0.12), ()),
}  # fmt: skip
MATERIALS = tuple(_MATERIALS)


def surface(rng: np.random.Generator, *materials: str) -> Surface:
    """A surface of one of `materials` (names of `MATERIALS`) in a random colour of it."""
    name = materials[int(rng.integers(len(materials)))]
    pattern, gloss, colours = _MATERIALS[name]
    if colours:
        base = np.array(colours[int(rng.integers(len(colours)))]) * rng.uniform(0.7, 1.35)
        base = base * rng.normal(1, 0.06, 3).clip(0.8, 1.2)
    elif rng.random() < 0.35:
        base = np.full(3, rng.choice([0.02, 0.08, 0.2, 0.45, 0.75])) * rng.normal(1, 0.05, 3).clip(0.85, 1.15)
    else:
        base = _hue(rng, (0.2, 0.9), (0.2, 0.9))
    r, g, b = base.clip(0.004, 0.9).tolist()
    return Surface((r, g, b), pattern, float(rng.uniform(*gloss)))
