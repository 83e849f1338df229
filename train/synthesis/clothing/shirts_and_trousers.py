"""Fabrics, tops and trousers of an outfit."""

import numpy as np

from muybridge.train.synthesis.clothing.draft import Draft
from muybridge.train.synthesis.clothing.fabrics import FOLDS, PATTERNS, PRINTS, fabric_colour

# Shares of the patterns of shirts and skirts, and of trousers; sizes of the tiles, metres, where they differ from the
# default.
SHIRTS = {"plain": 0.36, "melange": 0.08, "denim": 0.02, "knit": 0.06, "stripes": 0.05, "pinstripes": 0.05,
          "uneven_stripes": 0.04, "upright_stripes": 0.03, "tartan": 0.05, "gingham": 0.04, "dots": 0.03,
          "flowers": 0.04, "camouflage": 0.02, "batik": 0.03, "houndstooth": 0.01, "letters": 0.02,
          "triangles": 0.02, "leopard": 0.01, "quilted": 0.02, "discs": 0.02}  # fmt: skip
TROUSERS = {"plain": 0.50, "melange": 0.10, "denim": 0.24, "upright_stripes": 0.02, "tartan": 0.03,
            "camouflage": 0.04, "flowers": 0.02, "dots": 0.01, "gingham": 0.02, "batik": 0.02}  # fmt: skip
SIZES = {"plain": (0.2, 0.3), "melange": (0.15, 0.4), "denim": (0.15, 0.3), "knit": (0.08, 0.25),
         "quilted": (0.2, 0.5), "houndstooth": (0.08, 0.3), "dots": (0.08, 0.35)}  # fmt: skip


def _pick_pattern(draft: Draft, table: dict[str, float]) -> tuple[int, float]:
    """Index of a pattern, and the size of its tile, metres."""
    shares = np.array(list(table.values()))
    name = str(draft.rng.choice(list(table), p=shares / shares.sum()))
    low, high = SIZES.get(name, (0.12, 0.6))
    return PATTERNS.index(name), float(np.exp(draft.rng.uniform(np.log(low), np.log(high))))


def add_fabrics(draft: Draft) -> None:
    """Draw patterns, colours and folds of all garments."""
    shirt, trousers, skirt = _pick_pattern(draft, SHIRTS), _pick_pattern(draft, TROUSERS), _pick_pattern(draft, SHIRTS)
    colours = {f"{g}_{c}": fabric_colour(draft.rng) for g in ("shirt", "trousers", "skirt") for c in "abc"}
    if trousers[0] == PATTERNS.index("denim"):
        blue = np.array([0.10, 0.17, 0.33]) * draft.between(0.25, 1.8)
        colours["trousers_a"] = tuple(blue if draft.chance(0.8) else np.full(3, draft.between(0.02, 0.3)))
        colours["trousers_b"] = tuple(np.array(colours["trousers_a"]) * 1.7 + 0.03)
    del colours["skirt_c"]
    kinds = draft.rng.integers(0, len(FOLDS), 3)
    draft.values |= colours | {
        "pattern": (shirt[0], trousers[0], skirt[0]), "pattern_size": (shirt[1], trousers[1], skirt[1]),
        "fold_kind": tuple(int(k) for k in kinds), "fold_depth": draft.between(0.2, 1.1),
        "gloss_cloth": draft.between(0.0, 0.06), "bulge": draft.between(0.0, 0.03),
        "item_colour": fabric_colour(draft.rng),
    }  # fmt: skip


def add_shirt(draft: Draft, loose: float) -> None:
    """Add a top, from tight (`loose` 0) to wide (1)."""
    v, length = draft.values, draft.rng.random()
    sleeve = draft.between(0.07, 0.24) if length < 0.52 else draft.between(0.26, 0.4) if length < 0.62 else 0.46
    tucked = draft.chance(0.25)
    v |= {
        "sleeve": sleeve, "hem": v["waist"] - 0.035 if tucked else draft.between(-0.08, 0.06),
        "neckline": draft.between(0.54, 0.61), "v_neck": draft.between(0.03, 0.12) if draft.chance(0.25) else 0.0,
        "puff_shirt": 0.004 + 0.016 * loose, "loose_shirt": 0.25 + 0.75 * loose,
        "drape_shirt": loose * draft.between(0.6, 1.2),
        "flare_hem": 0.0 if tucked else draft.between(0, 0.05) * loose,
        "flare_sleeve": draft.between(0, 0.035) * loose if sleeve < 0.4 else draft.between(-0.006, 0.012),
    }  # fmt: skip
    style = 0
    for bit, share in ((1, 0.2), (2, 0.1), (4, 0.1), (16, 0.35), (32, 0.07), (64, 0.25)):
        style |= bit * draft.chance(share)
    if v["sleeve"] > 0.4 and draft.chance(0.3):
        style = (style | 8) & ~3
    v["shirt_style"] = style
    # A padded jacket, or a coat of wool, fleece or fur.
    if v["pattern"][0] == PATTERNS.index("quilted") or draft.chance(0.08):
        v |= {"sleeve": 0.46, "puff_shirt": draft.between(0.02, 0.042), "hem": draft.between(-0.1, 0.08),
              "bulge": 0.02, "flare_sleeve": 0.0, "loose_shirt": 1.0}  # fmt: skip
    if v["pattern"][0] < 4 and draft.chance(0.4):
        _add_print(draft)
    draft.parts.add("shirt")


def _add_print(draft: Draft) -> None:
    """Add a print on the chest."""
    kind = int(draft.rng.integers(len(PRINTS)))
    size = draft.between(0.06, 0.15)
    if PRINTS[kind] == "band":
        box = (0.0, draft.between(0.25, 0.42), 0.35, draft.between(0.06, 0.12))
    elif PRINTS[kind] == "small_logo":
        box = (0.0, 0.38, 0.14, 0.14)
    else:
        box = (draft.between(-0.02, 0.02), draft.between(0.28, 0.40), size * draft.between(0.8, 1.2), size)
    variant = int(draft.rng.integers(3))
    draft.values |= {"print_layer": variant * len(PRINTS) + kind, "print_box": box,
                    "print_back": int(PRINTS[kind] != "small_logo" and draft.chance(0.3))}  # fmt: skip


def add_trousers(draft: Draft, loose: float, shorts: float) -> None:
    """Add trousers; with the probability `shorts`, short ones."""
    v = draft.values
    short = draft.chance(shorts)
    cuff = draft.between(-0.42, -0.12) if short else draft.between(-0.78, -0.68)
    v |= {
        "waist": draft.between(0.09, 0.19), "cuff": cuff, "puff_trousers": 0.003 + 0.012 * loose,
        "loose_trousers": 0.2 + 0.8 * loose, "drape_trousers": loose * draft.between(0.5, 1.3),
        "flare_leg": (draft.between(0.0, 0.04) if short else draft.between(-0.004, 0.03)) * loose,
    }  # fmt: skip
    style = 0
    for bit, share in ((1, 0.1), (2, 0.5), (4, 0.25), (16, 0.3)):
        style |= bit * draft.chance(share)
    v["trousers_style"] = style | 8 * (v["pattern"][1] == PATTERNS.index("denim") and draft.chance(0.6))
    draft.parts.add("trousers")
