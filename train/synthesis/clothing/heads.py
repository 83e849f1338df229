"""Hair, beards, glasses, face masks and hats."""

import numpy as np

from muybridge.train.synthesis.clothing import garments
from muybridge.train.synthesis.clothing.draft import Draft
from muybridge.train.synthesis.clothing.fabrics import Colour, fabric_colour
from muybridge.train.synthesis.clothing.garments import Accessory

HAIR: tuple[Colour, ...] = (
    (0.018, 0.014, 0.012), (0.03, 0.02, 0.014), (0.07, 0.035, 0.018), (0.16, 0.08, 0.03), (0.38, 0.25, 0.1),
    (0.22, 0.07, 0.025), (0.3, 0.3, 0.3), (0.6, 0.58, 0.55),
)  # fmt: skip


def add_head(draft: Draft) -> None:
    """Add hair, a beard, a face mask, glasses and a hat."""
    v, rng, female = draft.values, draft.rng, draft.female
    v["hair_colour"] = HAIR[int(rng.choice(len(HAIR), p=[0.24, 0.18, 0.18, 0.12, 0.09, 0.04, 0.09, 0.06]))]
    v |= {"hair_line": draft.between(0.685, 0.725), "hair_paint": 0.85, "hair_low": draft.between(0.615, 0.65)}
    style = str(rng.choice(["shaved", "short", "full", "afro", "tied", "long", "bald"],
                           p=[0.02, 0.1, 0.16, 0.06, 0.26, 0.38, 0.02] if female
                           else [0.14, 0.46, 0.16, 0.06, 0.03, 0.05, 0.10]))  # fmt: skip
    lumps = draft.between(0.3, 1.5)
    if style == "bald":
        v |= {"bald": draft.between(0.07, 0.12), "hair_volume": 0.004, "hair_line": 0.73}
        v["hair_paint"] = draft.between(0.0, 0.7)
    elif style == "shaved":
        v |= {"hair_paint": draft.between(0.3, 0.8), "hair_volume": 0.001}
    elif style == "short":
        v |= {"hair_volume": draft.between(0.006, 0.02), "hair_top": draft.between(1.0, 2.0), "hair_lumps": lumps}
    elif style == "full":
        v |= {"hair_volume": draft.between(0.018, 0.038), "ears_out": int(draft.chance(0.3)), "hair_lumps": lumps,
              "hair_top": draft.between(0.8, 1.2), "hair_low": draft.between(0.575, 0.63)}  # fmt: skip
    elif style == "afro":
        v |= {"hair_volume": draft.between(0.035, 0.08), "ears_out": 0, "hair_lumps": 0.8, "hair_top": 1.1,
              "hair_colour": HAIR[int(rng.integers(0, 3))]}  # fmt: skip
    elif style == "tied":
        v |= {"hair_volume": draft.between(0.004, 0.010), "hair_lumps": 0.3}
        _tie_hair(draft)
    else:
        v |= {"hair_volume": draft.between(0.008, 0.018), "hair_length": draft.between(0.35, 0.6), "ears_out": 0,
              "hair_lumps": lumps * 0.5, "hair_low": 0.6}  # fmt: skip
        draft.parts.add("long_hair")
    if style != "shaved":
        draft.parts.add("hair")
    if not female and draft.chance(0.4):
        v["beard"] = int(rng.integers(1, 3))
    if draft.chance(0.04):
        v |= {"covered": 1, "cover_colour": fabric_colour(rng) if draft.chance(0.4) else (0.35, 0.55, 0.65)}
    if draft.chance(0.10):
        dark = draft.chance(0.5)
        draft.accessories.append(Accessory("face", garments.glasses(0.036 if dark else 0.012), (0.015, 0.015, 0.018)))
    if draft.chance(0.2 if draft.kind != "briefs" else 0.35):
        _add_hat(draft)


def _tie_hair(draft: Draft) -> None:
    """Add a bun or a ponytail."""
    colour = draft.values["hair_colour"]
    if draft.chance(0.35):
        size, high = draft.between(0.03, 0.05), draft.between(0.72, 0.87)
        at = (0.0, 0.055 + 0.9 * size - 0.8 * max(0.0, high - 0.79), high)
        draft.accessories.append(Accessory("head", garments.blob(at, (size, size, size * 0.9)), colour, hair=True))
        return
    high, long = draft.between(0.70, 0.84), draft.between(0.12, 0.32)
    bend = np.array([[0, 0.04, high], [0, 0.10, high + 0.01], [0, 0.125, high - 0.06], [0, 0.12, high - long]])
    radii = np.array([0.012, 0.02, 0.028, 0.012]) * draft.between(0.8, 1.4)
    draft.accessories.append(Accessory("head", garments.tube(bend, radii), colour, hair=True, frozen=0.6))


def _add_hat(draft: Draft) -> None:
    """Add a hat, a helmet or a hood."""
    v, parts = draft.values, draft.parts
    kind = str(draft.rng.choice(["cap", "beanie", "swim", "helmet", "brimmed", "hood"],
                               p=[0.36, 0.18, 0.14, 0.1, 0.1, 0.12]))  # fmt: skip
    if draft.kind in ("briefs", "no_shirt"):
        kind = "swim" if draft.chance(0.6) else "cap"
    if kind == "hood" and not (draft.kind in ("clothed", "suit") and v["sleeve"] > 0.4):
        kind = "beanie"
    v |= {"hat_a": fabric_colour(draft.rng), "hat_slope": draft.between(0.35, 0.7),
          "hat_line": draft.between(0.735, 0.765), "hair_lumps": 0.3}  # fmt: skip
    v["hair_volume"] = min(v["hair_volume"], 0.016)
    parts.add("hat")
    if kind == "swim":
        v |= {"hat_volume": 0.005, "sheen": 1, "hat_slope": 0.75, "hat_line": draft.between(0.71, 0.74)}
        parts -= {"hair", "long_hair"}
        draft.accessories = [t for t in draft.accessories if not t.hair]
    elif kind == "beanie":
        v |= {"hat_volume": draft.between(0.010, 0.022)}
    elif kind == "helmet":
        v |= {"hat_volume": draft.between(0.028, 0.045), "sheen": 1}
    elif kind == "hood":
        v |= {"hooded": 1, "hat_volume": draft.between(0.016, 0.03), "hat_a": v["shirt_a"]}
        if draft.kind == "suit":
            v["hat_volume"] = 0.006
        parts -= {"long_hair"}
        draft.accessories = [t for t in draft.accessories if not t.hair]
    else:
        v |= {"hat_volume": draft.between(0.012, 0.018)}
        cap = kind == "cap"
        width = draft.between(0.06, 0.08) if cap else draft.between(0.05, 0.11)
        shape = garments.brim(v["hat_line"] + 0.006, width, 0.0 if cap else 0.8, draft.between(0, 0.4),
                              v["hat_slope"])  # fmt: skip
        if cap and draft.chance(0.15):
            shape = shape * [1, -1, 1] + [0, 2 * garments.SKULL[1], 0]
            shape[..., 2] = v["hat_line"] + 0.006 - v["hat_slope"] * (shape[..., 1] + 0.02)
        draft.accessories.append(Accessory("head", shape, v["hat_a"] if draft.chance(0.7) else v["hat_b"]))
