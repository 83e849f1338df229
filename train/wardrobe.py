"""What a synthetic person wears and how they are lit: the renderer's uniforms, drawn at random."""

import colorsys
from dataclasses import dataclass

import numpy as np

Colour = tuple[float, float, float]

# Linear skin colours from light to dark.
SKIN = np.array(
    [[0.90, 0.66, 0.53], [0.82, 0.56, 0.43], [0.70, 0.45, 0.32], [0.55, 0.33, 0.22], [0.36, 0.20, 0.13],
     [0.22, 0.12, 0.08]]
)  # fmt: skip
HAIR: tuple[Colour, ...] = (
    (0.02, 0.015, 0.01), (0.06, 0.03, 0.015), (0.16, 0.08, 0.03), (0.4, 0.27, 0.1), (0.3, 0.3, 0.3)
)  # fmt: skip
# Kinds of outfit: clothed, athlete without a shirt, swimmer in briefs, motion-capture suit.
KINDS = {"clothed": 0.62, "no_shirt": 0.18, "briefs": 0.07, "suit": 0.13}


@dataclass(frozen=True)
class Outfit:
    """Uniforms of the person's shaders; lengths are heights in the body at rest, metres."""

    kind: str
    skirt: bool
    long_hair: bool
    light: tuple[float, float, float]
    values: dict[str, object]

    def uniforms(self) -> dict[str, object]:
        """Names and values as the shaders have them."""
        return self.values | {"light": self.light, "has_skirt": int(self.skirt)}


def fabric_colour(rng: np.random.Generator) -> Colour:
    """Fabrics as they are worn: dark and grey ones over-sampled, saturated ones rare."""
    if rng.random() < 0.3:
        value = rng.uniform(0.005, 0.05)
        return tuple(float(c) for c in value * rng.uniform(0.8, 1.2, 3))  # type: ignore[return-value]
    return colorsys.hsv_to_rgb(rng.random(), rng.beta(1.0, 1.8), rng.uniform(0.03, 0.9))


def _light(rng: np.random.Generator) -> tuple[tuple[float, float, float], dict[str, object]]:
    direction = np.array([rng.normal(), rng.normal(), abs(rng.normal()) + 0.6])
    direction /= np.linalg.norm(direction)
    tint = 1 + rng.normal(0, 0.06, 3)
    key = rng.uniform(0.15, 1.3)
    return tuple(float(x) for x in direction), {  # type: ignore[return-value]
        "light_colour": tuple(key * tint),
        "ambient_up": tuple(rng.uniform(0.2, 0.75) * tint * (1 + rng.normal(0, 0.05, 3))),
        "ambient_down": tuple(rng.uniform(0.08, 0.4) * (1 + rng.normal(0, 0.08, 3))),
    }


def sample_outfit(rng: np.random.Generator, gender: float) -> Outfit:
    """A random outfit and light; `gender` 0 male .. 1 female."""
    female = gender > 0.5
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    if kind == "no_shirt" and female and rng.random() < 0.7:
        kind = "briefs"
    skirt = kind == "clothed" and female and rng.random() < 0.3
    light, lighting = _light(rng)
    tone = rng.uniform(0, 5)
    low = int(tone)
    skin = (SKIN[low] * (1 - tone % 1) + SKIN[min(low + 1, 5)] * (tone % 1)) ** 1.6
    sleeve = rng.uniform(0.40, 0.50) if rng.random() < 0.4 else rng.uniform(0.18, 0.32)
    cuff = rng.uniform(-0.80, -0.70) if rng.random() < 0.6 else rng.uniform(-0.45, -0.15)
    shoe = rng.uniform(-0.80, -0.72) if rng.random() < 0.8 else -2.0
    puff_shirt, puff_trousers = rng.uniform(0.002, 0.026, 2)
    shirt, trousers = fabric_colour(rng), fabric_colour(rng)
    has_shirt = True
    if kind in ("no_shirt", "briefs"):
        has_shirt = female
        sleeve = 0.0 if female else sleeve
        cuff = rng.uniform(-0.42, -0.12) if kind == "no_shirt" else -0.07
        shoe = -2.0 if rng.random() < 0.6 else shoe
        puff_trousers = rng.uniform(0.001, 0.012)
    elif kind == "suit":
        sleeve, cuff, puff_shirt, puff_trousers = 0.50, -0.80, 0.003, 0.003
        trousers = shirt if rng.random() < 0.6 else trousers
    cap = rng.random() < 0.12
    hair = fabric_colour(rng) if cap else HAIR[rng.integers(len(HAIR))]
    long_hair = not cap and rng.random() < (0.65 if female else 0.08)
    values: dict[str, object] = lighting | {
        "sleeve": float(sleeve), "hem": float(rng.uniform(-0.06, 0.08)), "neckline": float(rng.uniform(0.53, 0.61)),
        "cuff": float(cuff), "skirt_length": float(rng.uniform(-0.65, -0.2)),
        "hair_length": float(rng.uniform(0.35, 0.62)), "shoe_top": float(shoe),
        "has_shirt": int(has_shirt), "has_trousers": 1, "puff_shirt": float(puff_shirt),
        "puff_trousers": float(puff_trousers), "skin": tuple(skin), "shirt_a": shirt,
        "shirt_b": fabric_colour(rng), "trousers_a": trousers, "trousers_b": fabric_colour(rng),
        "hair_colour": hair, "shoe_colour": fabric_colour(rng),
        "pattern": (int(rng.choice(7, p=[0.46, 0.12, 0.05, 0.07, 0.12, 0.06, 0.12])),
                    int(rng.choice([0, 0, 0, 0, 3, 4]))),
        "pattern_scale": (float(rng.uniform(6, 40)), float(rng.uniform(6, 40))),
        "seed": float(rng.uniform(0, 50)), "fold_depth": float(rng.uniform(0.3, 2.2)),
        "hair_line": float(rng.uniform(0.685, 0.72)) if rng.random() < 0.9 else -1.0,
    }  # fmt: skip
    return Outfit(kind, bool(skirt), bool(long_hair), light, values)
