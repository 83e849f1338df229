"""Kinds of outfit: which garments go together."""

import numpy as np

from muybridge.train.synthesis.clothing.draft import Draft
from muybridge.train.synthesis.clothing.extras import add_bands, add_footwear, add_luggage
from muybridge.train.synthesis.clothing.fabrics import fabric_colour
from muybridge.train.synthesis.clothing.heads import add_head
from muybridge.train.synthesis.clothing.shirts_and_trousers import add_fabrics, add_shirt, add_trousers


def dress(draft: Draft) -> None:
    """Add everything that a person wears, in order of dependence."""
    add_fabrics(draft)
    _GARMENTS[draft.kind](draft)
    add_footwear(draft)
    add_bands(draft)
    add_head(draft)
    add_luggage(draft)


def _everyday(draft: Draft) -> None:
    """Everyday clothes, with a skirt, a dress or a coat for some."""
    v, rng = draft.values, draft.rng
    add_trousers(draft, rng.beta(1.2, 1.4), 0.25)
    add_shirt(draft, rng.beta(1.4, 1.2))
    robe = draft.chance(0.30 if draft.female else 0.06)
    if not robe:
        return
    dress = draft.chance(0.5 if draft.female else 0.9)
    length = draft.between(-0.62, -0.18)
    v |= {"skirt_top": 0.18, "skirt_length": length, "flare_skirt": draft.between(0.0, 0.22),
          "pleats": draft.between(0, 0.05) if draft.chance(0.4) else 0.0}  # fmt: skip
    if dress:  # or a coat: the skirt continues the shirt
        v |= {"skirt_a": v["shirt_a"], "skirt_b": v["shirt_b"], "hem": 0.13,
              "pattern": (*v["pattern"][:2], v["pattern"][0]), "flare_hem": 0.0,
              "pattern_size": (*v["pattern_size"][:2], v["pattern_size"][0])}  # fmt: skip
    else:
        v["hem"] = draft.between(0.10, 0.14) if draft.chance(0.6) else draft.between(-0.04, 0.06)
    if draft.female and draft.chance(0.75):  # bare legs or tights
        tights = draft.chance(0.3)
        v |= {"cuff": -0.79 if tights else v["skirt_length"] + 0.1, "puff_trousers": 0.002, "bulge": 0.01,
              "loose_trousers": 0.0, "drape_trousers": 0.0, "flare_leg": 0.0, "trousers_style": 0}  # fmt: skip
        if not tights:
            v |= {"trousers_a": v["skirt_a"], "trousers_b": v["skirt_b"], "cuff": max(v["cuff"], -0.05)}
    draft.parts.add("skirt")


def _sports(draft: Draft) -> None:
    """Sportswear."""
    v, rng = draft.values, draft.rng
    loose = rng.beta(1.0, 1.6)
    add_trousers(draft, loose, 0.65)
    add_shirt(draft, rng.beta(1.0, 1.6))
    v["fold_depth"] *= 0.7
    cut = rng.random()
    if draft.female and cut < 0.35:  # sports bra, crop top
        v |= {"hem": draft.between(0.24, 0.32), "neckline": draft.between(0.46, 0.54), "sleeve": 0.0,
              "tank": draft.between(0.10, 0.13), "puff_shirt": 0.003, "loose_shirt": 0.0, "drape_shirt": 0.0,
              "bulge": 0.004, "flare_hem": 0.0, "shirt_style": 0, "v_neck": 0.0}  # fmt: skip
    elif cut < 0.65:  # tank top
        v |= {"sleeve": 0.0, "tank": draft.between(0.09, 0.14), "neckline": draft.between(0.48, 0.56),
              "flare_sleeve": 0.0}  # fmt: skip
    if draft.chance(0.3):
        v["trousers_style"] |= 1


def _undressed(draft: Draft) -> None:
    """An athlete without a shirt, or a swimmer."""
    v = draft.values
    short = draft.kind == "briefs"
    add_trousers(draft, 0.0 if short else draft.rng.beta(0.8, 1.6), 1.0)
    v["bulge"] = min(v["bulge"], 0.008)
    if short:
        v |= {"cuff": draft.between(-0.15, -0.055), "waist": draft.between(0.08, 0.14), "puff_trousers": 0.002,
              "loose_trousers": 0.0, "drape_trousers": 0.0, "flare_leg": 0.0, "trousers_style": 0}  # fmt: skip
    if draft.female:
        swimsuit = short and draft.chance(0.5)
        v |= {"hem": 0.02 if swimsuit else draft.between(0.26, 0.33), "neckline": draft.between(0.44, 0.50),
              "sleeve": 0.0, "tank": draft.between(0.08, 0.12), "puff_shirt": 0.002, "shirt_style": 0,
              "loose_shirt": 0.0, "drape_shirt": 0.0}  # fmt: skip
        if swimsuit:
            v |= {"trousers_a": v["shirt_a"], "trousers_b": v["shirt_b"], "trousers_c": v["shirt_c"],
                  "pattern": (v["pattern"][0],) * 2 + v["pattern"][2:],
                  "pattern_size": (v["pattern_size"][0],) * 2 + v["pattern_size"][2:]}  # fmt: skip
        draft.parts.add("shirt")
    if draft.chance(0.4):
        draft.dots = (int(draft.rng.integers(20, 70)), int(draft.rng.integers(1 << 30)))


def _suit(draft: Draft) -> None:
    """A motion-capture suit."""
    v = draft.values
    dark = draft.chance(0.85)
    colour = tuple(np.exp(draft.rng.uniform(np.log(0.026), np.log(0.07))) * draft.rng.uniform(0.9, 1.2, 3))
    colour = tuple(float(c) for c in colour) if dark else fabric_colour(draft.rng)
    second = v["trousers_b"] if draft.chance(0.35) else colour
    v |= {
        "sleeve": 0.47, "hem": 0.02, "neckline": 0.61, "waist": 0.14, "cuff": -0.79, "puff_shirt": 0.003,
        "puff_trousers": 0.002, "shirt_a": colour, "trousers_a": colour, "shirt_b": second, "trousers_b": second,
        "pattern": (0, 0, 0), "shirt_style": 4 * draft.chance(0.4) + 2 * draft.chance(0.4),
        "trousers_style": 16 * draft.chance(0.5) + draft.chance(0.3), "fold_depth": draft.between(0.05, 0.4),
        "fold_kind": (1, 2, 2), "bulge": 0.004, "gloss_cloth": draft.between(0.02, 0.12), "loose_shirt": 0.1,
    }  # fmt: skip
    draft.parts |= {"shirt", "trousers"}
    if draft.chance(0.4):
        v |= {"glove": draft.between(0.43, 0.52), "glove_colour": colour}
    if draft.chance(0.75):
        draft.dots = (int(draft.rng.integers(35, 75)), int(draft.rng.integers(1 << 30)))


_GARMENTS = {"clothed": _everyday, "sports": _sports, "no_shirt": _undressed, "briefs": _undressed, "suit": _suit}
