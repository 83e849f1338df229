"""Footwear, bands, bags and objects in hands."""

import numpy as np

from muybridge.train.synthesis.clothing import garments
from muybridge.train.synthesis.clothing.draft import Draft
from muybridge.train.synthesis.clothing.fabrics import fabric_colour
from muybridge.train.synthesis.clothing.garments import Accessory


def add_footwear(draft: Draft) -> None:
    """Add socks and shoes."""
    v = draft.values
    bare = {"clothed": 0.1, "sports": 0.1, "no_shirt": 0.55, "briefs": 0.9, "suit": 0.15}[draft.kind]
    if draft.chance(bare):
        return
    if draft.chance(0.6):
        v["sock_top"] = draft.between(-0.74, -0.60) if draft.chance(0.8) else draft.between(-0.60, -0.42)
    v["sock_colour"] = fabric_colour(draft.rng) if draft.chance(0.5) else (draft.between(0.5, 0.8),) * 3
    if draft.chance(0.06):
        return  # socks only
    boots = draft.chance(0.12)
    light = (draft.between(0.45, 0.8),) * 3
    v |= {
        "shoe_top": draft.between(-0.68, -0.48) if boots else draft.between(-0.775, -0.735),
        "shoe_bulk": draft.between(0.003, 0.010), "sole": draft.between(0.0, 0.016), "toe": draft.between(0, 0.014),
        "shoe_colour": fabric_colour(draft.rng), "sole_colour": light if draft.chance(0.5) else (0.03, 0.03, 0.03),
    }  # fmt: skip
    draft.parts.add("shoes")


def add_bands(draft: Draft) -> None:
    """Add watches and wristbands, knee braces, stockings."""
    watch = draft.rng.choice([-1.0, 0.0, 1.0], p=[0.05, 0.8, 0.15])
    brace = draft.rng.choice([-1.0, 0.0, 1.0], p=[0.03, 0.94, 0.03])
    low = draft.between(-0.50, -0.41)
    draft.values["bands"] = (float(watch), float(brace), low, low + draft.between(0.05, 0.2))
    draft.values["hat_b"] = fabric_colour(draft.rng)
    if draft.female and draft.kind == "clothed" and draft.chance(0.08):
        draft.values["sock_top"] = draft.between(-0.35, -0.15)


def add_luggage(draft: Draft) -> None:
    """Add bags and objects in hands."""
    v = draft.values
    colour = v["item_colour"]
    if draft.kind in ("clothed", "sports") and "shirt" in draft.parts:
        if draft.chance(0.07):
            half = (draft.between(0.12, 0.16), draft.between(0.05, 0.10), draft.between(0.15, 0.23))
            bag = garments.blob((0, 0.065 + half[1], 0.52 - half[2]), half, 0.45)
            draft.accessories.append(Accessory("back", bag, colour))
            v["straps"] = 1
        elif draft.chance(0.06):
            side = 1 if v["seed"] > 25 else -1
            half = (0.05, draft.between(0.09, 0.15), draft.between(0.07, 0.13))
            at = (side * 0.24, 0.0, 0.02 - half[2] * 0.5)
            anchor = "left_hip" if side > 0 else "right_hip"
            draft.accessories.append(Accessory(anchor, garments.blob(at, half, 0.5), colour))
            v["straps"] = 2
    if draft.chance(0.10):
        _add_hand_held(draft)


def _add_hand_held(draft: Draft) -> None:
    """Add an object in one hand."""
    side = 1 if draft.chance(0.5) else -1
    anchor = "left_hand" if side > 0 else "right_hand"
    colour = fabric_colour(draft.rng)
    palm = np.array([side * 0.435, -0.25, 0.175])
    thing = int(draft.rng.integers(4))
    if thing == 0:  # a ball
        size = draft.between(0.03, 0.12)
        shape = garments.blob(tuple(palm + [-side * (size + 0.01), 0, -0.2 * size]), (size,) * 3)
        draft.accessories.append(Accessory(anchor, shape, colour))
    elif thing == 1:  # a stick, a racket's shaft, a bottle
        long, thick = draft.between(0.1, 0.5), draft.between(0.008, 0.03)
        axis = np.array([0.35 * side, -0.55, 0.75])
        ends = np.stack([palm + axis * (k - 0.25) * long for k in (0, 0.5, 1.0)]) + [-side * 0.02, 0, 0]
        draft.accessories.append(Accessory(anchor, garments.tube(ends, np.full(3, thick)), colour))
    elif thing == 2:  # a hanging bag
        half = (draft.between(0.04, 0.08), draft.between(0.1, 0.18), draft.between(0.12, 0.2))
        at = tuple(palm + [0, 0, -0.05 - half[2]])
        draft.accessories.append(Accessory(anchor, garments.blob(at, half, 0.5), colour, frozen=1.0))
    else:  # a phone, a book
        half = (0.006, draft.between(0.035, 0.08), draft.between(0.06, 0.11))
        draft.accessories.append(
            Accessory(anchor, garments.blob(tuple(palm + [-side * 0.015, 0, 0]), half, 0.3), colour)
        )
