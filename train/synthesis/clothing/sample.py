"""Outfit and lighting of a synthetic person: shader uniforms and accessories, drawn at random."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from muybridge.train.synthesis.clothing.draft import Draft
from muybridge.train.synthesis.clothing.fabrics import colour_of, fabric_colour
from muybridge.train.synthesis.clothing.garments import SLOTS, Accessory
from muybridge.train.synthesis.clothing.outfits import dress

Values = dict[str, Any]

# Linear skin colours from light to dark.
SKIN = np.array(
    [[0.90, 0.66, 0.53], [0.82, 0.56, 0.43], [0.70, 0.45, 0.32], [0.55, 0.33, 0.22], [0.36, 0.20, 0.13],
     [0.26, 0.15, 0.10]]
)  # fmt: skip
# Shares of the kinds of outfit: everyday clothes, sportswear, athlete without a shirt, swimmer in briefs,
# motion-capture suit.
KINDS = {"clothed": 0.48, "sports": 0.17, "no_shirt": 0.15, "briefs": 0.07, "suit": 0.13}
# Linear value of a white card that faces the light; the shoulder of the camera's response lies above.
EXPOSURE, EXPOSURE_SD = 1.32, 0.27
NOWHERE = 9.0  # height of an edge that does not exist, metres


@dataclass(frozen=True)
class Outfit:
    """Inputs of the person's shaders; lengths are heights on the body at rest, metres.

    Attributes:
        kind: one of `KINDS`.
        parts: shells that are drawn over the body: trousers, shirt, shoes, skirt, long_hair, hair, hat.
        light: unit direction to the main light, world.
        values: uniforms by name.
        accessories: at most `garments.SLOTS` objects attached to the body.
        sky: unit direction from which most of the ambient light comes, world.
        dots: number of reflective dots on the body, and the seed of their positions.
    """

    kind: str
    parts: frozenset[str]
    light: tuple[float, float, float]
    values: Values
    accessories: tuple[Accessory, ...] = field(default=())
    dots: tuple[int, int] = (0, 0)
    sky: tuple[float, float, float] = (0.0, 0.1, 0.995)

    def uniforms(self) -> Values:
        """Names and values of the shader uniforms."""
        worn = {f"has_{p}": int(p in self.parts) for p in ("shirt", "trousers", "skirt", "hat")}
        return self.values | worn | {"light": self.light}


def _light(rng: np.random.Generator) -> tuple[tuple[float, float, float], Values]:
    """A main light, a fill light, sky and floor, with the exposure set for the person."""
    direction = np.array([rng.normal(), rng.normal(), abs(rng.normal()) + 0.6])
    direction /= np.linalg.norm(direction)
    fill = np.array([rng.normal(), rng.normal(), 0.5 * rng.normal() + 0.3])
    fill /= np.linalg.norm(fill)
    tint = 1 + rng.normal(0, 0.06, 3)
    hard = rng.beta(1.3, 1.6)  # share of the main light
    key, up, down = 1.5 * hard, (1 - hard) * rng.uniform(0.8, 1.3) + 0.12, (1 - hard) * rng.uniform(0.25, 0.8) + 0.06
    side = rng.uniform(0, 0.35) if rng.random() < 0.6 else 0.0
    white = 0.55 * key + 0.5 * (up + down) + 0.3 * side
    gain = EXPOSURE * float(np.exp(np.clip(rng.normal(0, EXPOSURE_SD), -0.5, 0.6))) / white
    return colour_of(direction), {
        "light_colour": colour_of(gain * key * tint), "fill": colour_of(fill),
        "fill_colour": colour_of(gain * side * (1 + rng.normal(0, 0.1, 3))),
        "ambient_up": colour_of(gain * up * tint * (1 + rng.normal(0, 0.05, 3))),
        "ambient_down": colour_of(gain * down * (1 + rng.normal(0, 0.08, 3))),
    }  # fmt: skip


def _bare(rng: np.random.Generator) -> Values:
    """Uniforms of a person without clothes."""
    dark = fabric_colour(rng)
    return {
        "sleeve": 0.0, "hem": 0.1, "neckline": 0.57, "v_neck": 0.0, "tank": 0.0, "waist": 0.13, "cuff": -0.7,
        "skirt_top": 0.16, "skirt_length": -0.3, "hair_length": 0.5, "hair_line": 0.70, "hair_low": 0.63, "bald": 0.0,
        "shoe_top": -NOWHERE, "sock_top": -NOWHERE, "glove": NOWHERE, "hat_line": NOWHERE, "hat_slope": 0.5,
        "ears_out": 1,
        "hooded": 0, "puff_shirt": 0.004, "puff_trousers": 0.004, "loose_shirt": 0.0, "loose_trousers": 0.0,
        "flare_hem": 0.0, "flare_sleeve": 0.0, "flare_leg": 0.0, "flare_skirt": 0.05, "pleats": 0.0, "bulge": 0.0,
        "drape_shirt": 0.0, "drape_trousers": 0.0,
        "shoe_bulk": 0.006, "sole": 0.006, "toe": 0.0, "hair_volume": 0.008, "hair_top": 1.0, "hair_lumps": 0.5,
        "hat_volume": 0.008, "seed": float(rng.uniform(0, 50)), "covered": 0, "beard": 0, "sheen": 0,
        "hair_colour": (0.02, 0.015, 0.01), "hair_paint": 0.0, "shoe_colour": dark, "sole_colour": dark,
        "sock_colour": dark, "hat_a": dark, "hat_b": dark, "cover_colour": (0.3, 0.5, 0.6), "glove_colour": dark,
        "shirt_a": dark, "shirt_b": dark, "shirt_c": dark, "trousers_a": dark, "trousers_b": dark,
        "trousers_c": dark, "skirt_a": dark, "skirt_b": dark, "item_colour": dark, "item_hair": 0,
        "pattern": (0, 0, 0), "pattern_size": (0.3, 0.3, 0.3), "fold_kind": (0, 2, 1), "print_layer": -1,
        "print_back": 0, "print_box": (0.0, 0.35, 0.1, 0.1), "shirt_style": 0, "trousers_style": 0, "straps": 0,
        "bands": (0.0, 0.0, 0.0, 0.0), "fold_depth": 0.5, "bodily": 1.0, "gloss_cloth": 0.03,
    }  # fmt: skip


def bare_outfit(rng: np.random.Generator) -> Outfit:
    """No clothes and no hair, for a plain rendering of the body."""
    light, lighting = _light(rng)
    return Outfit("briefs", frozenset(), light, _bare(rng) | lighting | {"skin": (0.45, 0.33, 0.27)})


def sample_outfit(rng: np.random.Generator, gender: float, kind: str | None = None) -> Outfit:
    """A random outfit and light; `gender` from 0 male to 1 female; `kind` is one of `KINDS`, drawn by default."""
    female = gender > 0.5
    if kind is None:
        kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
        if kind == "no_shirt" and female and rng.random() < 0.6:
            kind = "sports"
    light, lighting = _light(rng)
    sky = np.array([rng.normal(0, 0.35), rng.normal(0, 0.35), 1.0])
    tone = rng.uniform(0, 5)
    low = int(tone)
    skin = (SKIN[low] * (1 - tone % 1) + SKIN[min(low + 1, 5)] * (tone % 1)) ** 1.5
    draft = Draft(rng, female, kind, _bare(rng) | lighting | {"skin": colour_of(skin)})
    dress(draft)
    accessories = tuple(draft.accessories[:SLOTS])
    sky /= np.linalg.norm(sky)
    return Outfit(kind, frozenset(draft.parts), light, draft.values, accessories, draft.dots, colour_of(sky))
