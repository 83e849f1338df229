"""Puts clothes on: what goes with what, garment by garment."""

from typing import Any

import numpy as np

from muybridge.train.synthesis.clothing import garments
from muybridge.train.synthesis.clothing.fabrics import FOLDS, PATTERNS, PRINTS, Colour, fabric_colour
from muybridge.train.synthesis.clothing.garments import Accessory

HAIR: tuple[Colour, ...] = (
    (0.018, 0.014, 0.012), (0.03, 0.02, 0.014), (0.07, 0.035, 0.018), (0.16, 0.08, 0.03), (0.38, 0.25, 0.1),
    (0.22, 0.07, 0.025), (0.3, 0.3, 0.3), (0.6, 0.58, 0.55),
)  # fmt: skip
# How often a fabric with each pattern is worn, as a shirt, as trousers and as a skirt.
SHIRTS = {"plain": 0.36, "melange": 0.08, "denim": 0.02, "knit": 0.06, "stripes": 0.05, "pinstripes": 0.05,
          "uneven_stripes": 0.04, "upright_stripes": 0.03, "tartan": 0.05, "gingham": 0.04, "dots": 0.03,
          "flowers": 0.04, "camouflage": 0.02, "batik": 0.03, "houndstooth": 0.01, "letters": 0.02,
          "triangles": 0.02, "leopard": 0.01, "quilted": 0.02, "discs": 0.02}  # fmt: skip
TROUSERS = {"plain": 0.50, "melange": 0.10, "denim": 0.24, "upright_stripes": 0.02, "tartan": 0.03,
            "camouflage": 0.04, "flowers": 0.02, "dots": 0.01, "gingham": 0.02, "batik": 0.02}  # fmt: skip
SIZES = {"plain": (0.2, 0.3), "melange": (0.15, 0.4), "denim": (0.15, 0.3), "knit": (0.08, 0.25),
         "quilted": (0.2, 0.5), "houndstooth": (0.08, 0.3), "dots": (0.08, 0.35)}  # fmt: skip


class Dresser:
    """Fills in `values`, `parts`, `things` and `dots` of an outfit."""

    def __init__(self, rng: np.random.Generator, female: bool, kind: str, values: dict[str, Any]) -> None:
        self.rng, self.female, self.kind, self.values = rng, female, kind, values
        self.parts: set[str] = set()
        self.things: list[Accessory] = []
        self.dots = (0, 0)

    def chance(self, share: float) -> bool:
        """True in `share` of the draws."""
        return bool(self.rng.random() < share)

    def between(self, low: float, high: float) -> float:
        """A uniform draw."""
        return float(self.rng.uniform(low, high))

    def _pick(self, table: dict[str, float]) -> tuple[int, float]:
        """Index of a pattern and the size of its tile, metres."""
        shares = np.array(list(table.values()))
        name = str(self.rng.choice(list(table), p=shares / shares.sum()))
        low, high = SIZES.get(name, (0.12, 0.6))
        return PATTERNS.index(name), float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def dress(self) -> None:
        """Everything, in the order in which one thing depends on another."""
        self._cloth()
        {"clothed": self._clothed, "sports": self._sports, "no_shirt": self._undressed, "briefs": self._undressed,
         "suit": self._suit}[self.kind]()  # fmt: skip
        self._feet()
        self._bands()
        self._head()
        self._carry()

    def _cloth(self) -> None:
        shirt, trousers, skirt = self._pick(SHIRTS), self._pick(TROUSERS), self._pick(SHIRTS)
        colours = {f"{g}_{c}": fabric_colour(self.rng) for g in ("shirt", "trousers", "skirt") for c in "abc"}
        if trousers[0] == PATTERNS.index("denim"):
            blue = np.array([0.10, 0.17, 0.33]) * self.between(0.25, 1.8)
            colours["trousers_a"] = tuple(blue if self.chance(0.8) else np.full(3, self.between(0.02, 0.3)))
            colours["trousers_b"] = tuple(np.array(colours["trousers_a"]) * 1.7 + 0.03)
        del colours["skirt_c"]
        kinds = self.rng.integers(0, len(FOLDS), 3)
        self.values |= colours | {
            "pattern": (shirt[0], trousers[0], skirt[0]), "pattern_size": (shirt[1], trousers[1], skirt[1]),
            "fold_kind": tuple(int(k) for k in kinds), "fold_depth": self.between(0.2, 1.1),
            "gloss_cloth": self.between(0.0, 0.06), "bulge": self.between(0.0, 0.03),
            "item_colour": fabric_colour(self.rng),
        }  # fmt: skip

    def _shirt(self, loose: float) -> None:
        """A top; `loose` 0 tight .. 1 wide."""
        v, length = self.values, self.rng.random()
        sleeve = self.between(0.07, 0.24) if length < 0.52 else self.between(0.26, 0.4) if length < 0.62 else 0.46
        tucked = self.chance(0.25)
        v |= {
            "sleeve": sleeve, "hem": v["waist"] - 0.035 if tucked else self.between(-0.08, 0.06),
            "neckline": self.between(0.54, 0.61), "v_neck": self.between(0.03, 0.12) if self.chance(0.25) else 0.0,
            "puff_shirt": 0.004 + 0.016 * loose, "loose_shirt": 0.25 + 0.75 * loose,
            "drape_shirt": loose * self.between(0.6, 1.2),
            "flare_hem": 0.0 if tucked else self.between(0, 0.05) * loose,
            "flare_sleeve": self.between(0, 0.035) * loose if sleeve < 0.4 else self.between(-0.006, 0.012),
        }  # fmt: skip
        style = 0
        for bit, share in ((1, 0.2), (2, 0.1), (4, 0.1), (16, 0.35), (32, 0.07), (64, 0.25)):
            style |= bit * self.chance(share)
        if v["sleeve"] > 0.4 and self.chance(0.3):
            style = (style | 8) & ~3
        v["shirt_style"] = style
        # A padded jacket, or a coat of wool, fleece or fur.
        if v["pattern"][0] == PATTERNS.index("quilted") or self.chance(0.08):
            v |= {"sleeve": 0.46, "puff_shirt": self.between(0.02, 0.042), "hem": self.between(-0.1, 0.08),
                  "bulge": 0.02, "flare_sleeve": 0.0, "loose_shirt": 1.0}  # fmt: skip
        if v["pattern"][0] < 4 and self.chance(0.4):
            self._print()
        self.parts.add("shirt")

    def _print(self) -> None:
        kind = int(self.rng.integers(len(PRINTS)))
        size = self.between(0.06, 0.15)
        if PRINTS[kind] == "band":
            box = (0.0, self.between(0.25, 0.42), 0.35, self.between(0.06, 0.12))
        elif PRINTS[kind] == "small_logo":
            box = (0.0, 0.38, 0.14, 0.14)
        else:
            box = (self.between(-0.02, 0.02), self.between(0.28, 0.40), size * self.between(0.8, 1.2), size)
        variant = int(self.rng.integers(3))
        self.values |= {"print_layer": variant * len(PRINTS) + kind, "print_box": box,
                        "print_back": int(PRINTS[kind] != "small_logo" and self.chance(0.3))}  # fmt: skip

    def _trousers(self, loose: float, shorts: float) -> None:
        """Trousers, or with the chance `shorts` short ones."""
        v = self.values
        short = self.chance(shorts)
        cuff = self.between(-0.42, -0.12) if short else self.between(-0.78, -0.68)
        v |= {
            "waist": self.between(0.09, 0.19), "cuff": cuff, "puff_trousers": 0.003 + 0.012 * loose,
            "loose_trousers": 0.2 + 0.8 * loose, "drape_trousers": loose * self.between(0.5, 1.3),
            "flare_leg": (self.between(0.0, 0.04) if short else self.between(-0.004, 0.03)) * loose,
        }  # fmt: skip
        style = 0
        for bit, share in ((1, 0.1), (2, 0.5), (4, 0.25), (16, 0.3)):
            style |= bit * self.chance(share)
        v["trousers_style"] = style | 8 * (v["pattern"][1] == PATTERNS.index("denim") and self.chance(0.6))
        self.parts.add("trousers")

    def _clothed(self) -> None:
        v, rng = self.values, self.rng
        self._trousers(rng.beta(1.2, 1.4), 0.25)
        self._shirt(rng.beta(1.4, 1.2))
        robe = self.chance(0.30 if self.female else 0.06)
        if not robe:
            return
        dress = self.chance(0.5 if self.female else 0.9)
        length = self.between(-0.62, -0.18)
        v |= {"skirt_top": 0.18, "skirt_length": length, "flare_skirt": self.between(0.0, 0.22),
              "pleats": self.between(0, 0.05) if self.chance(0.4) else 0.0}  # fmt: skip
        if dress:  # or a coat: the skirt goes on where the shirt ends
            v |= {"skirt_a": v["shirt_a"], "skirt_b": v["shirt_b"], "hem": 0.13,
                  "pattern": (*v["pattern"][:2], v["pattern"][0]), "flare_hem": 0.0,
                  "pattern_size": (*v["pattern_size"][:2], v["pattern_size"][0])}  # fmt: skip
        else:
            v["hem"] = self.between(0.10, 0.14) if self.chance(0.6) else self.between(-0.04, 0.06)
        if self.female and self.chance(0.75):  # bare legs or tights
            tights = self.chance(0.3)
            v |= {"cuff": -0.79 if tights else v["skirt_length"] + 0.1, "puff_trousers": 0.002, "bulge": 0.01,
                  "loose_trousers": 0.0, "drape_trousers": 0.0, "flare_leg": 0.0, "trousers_style": 0}  # fmt: skip
            if not tights:
                v |= {"trousers_a": v["skirt_a"], "trousers_b": v["skirt_b"], "cuff": max(v["cuff"], -0.05)}
        self.parts.add("skirt")

    def _sports(self) -> None:
        v, rng = self.values, self.rng
        loose = rng.beta(1.0, 1.6)
        self._trousers(loose, 0.65)
        self._shirt(rng.beta(1.0, 1.6))
        v["fold_depth"] *= 0.7
        cut = rng.random()
        if self.female and cut < 0.35:  # sports bra, crop top
            v |= {"hem": self.between(0.24, 0.32), "neckline": self.between(0.46, 0.54), "sleeve": 0.0,
                  "tank": self.between(0.10, 0.13), "puff_shirt": 0.003, "loose_shirt": 0.0, "drape_shirt": 0.0,
                  "bulge": 0.004, "flare_hem": 0.0, "shirt_style": 0, "v_neck": 0.0}  # fmt: skip
        elif cut < 0.65:  # tank top
            v |= {"sleeve": 0.0, "tank": self.between(0.09, 0.14), "neckline": self.between(0.48, 0.56),
                  "flare_sleeve": 0.0}  # fmt: skip
        if self.chance(0.3):
            v["trousers_style"] |= 1

    def _undressed(self) -> None:
        v = self.values
        short = self.kind == "briefs"
        self._trousers(0.0 if short else self.rng.beta(0.8, 1.6), 1.0)
        v["bulge"] = min(v["bulge"], 0.008)
        if short:
            v |= {"cuff": self.between(-0.15, -0.055), "waist": self.between(0.08, 0.14), "puff_trousers": 0.002,
                  "loose_trousers": 0.0, "drape_trousers": 0.0, "flare_leg": 0.0, "trousers_style": 0}  # fmt: skip
        if self.female:
            swimsuit = short and self.chance(0.5)
            v |= {"hem": 0.02 if swimsuit else self.between(0.26, 0.33), "neckline": self.between(0.44, 0.50),
                  "sleeve": 0.0, "tank": self.between(0.08, 0.12), "puff_shirt": 0.002, "shirt_style": 0,
                  "loose_shirt": 0.0, "drape_shirt": 0.0}  # fmt: skip
            if swimsuit:
                v |= {"trousers_a": v["shirt_a"], "trousers_b": v["shirt_b"], "trousers_c": v["shirt_c"],
                      "pattern": (v["pattern"][0],) * 2 + v["pattern"][2:],
                      "pattern_size": (v["pattern_size"][0],) * 2 + v["pattern_size"][2:]}  # fmt: skip
            self.parts.add("shirt")
        if self.chance(0.4):
            self.dots = (int(self.rng.integers(20, 70)), int(self.rng.integers(1 << 30)))

    def _suit(self) -> None:
        v = self.values
        dark = self.chance(0.85)
        colour = tuple(np.exp(self.rng.uniform(np.log(0.026), np.log(0.07))) * self.rng.uniform(0.9, 1.2, 3))
        colour = tuple(float(c) for c in colour) if dark else fabric_colour(self.rng)
        second = v["trousers_b"] if self.chance(0.35) else colour
        v |= {
            "sleeve": 0.47, "hem": 0.02, "neckline": 0.61, "waist": 0.14, "cuff": -0.79, "puff_shirt": 0.003,
            "puff_trousers": 0.002, "shirt_a": colour, "trousers_a": colour, "shirt_b": second, "trousers_b": second,
            "pattern": (0, 0, 0), "shirt_style": 4 * self.chance(0.4) + 2 * self.chance(0.4),
            "trousers_style": 16 * self.chance(0.5) + self.chance(0.3), "fold_depth": self.between(0.05, 0.4),
            "fold_kind": (1, 2, 2), "bulge": 0.004, "gloss_cloth": self.between(0.02, 0.12), "loose_shirt": 0.1,
        }  # fmt: skip
        self.parts |= {"shirt", "trousers"}
        if self.chance(0.4):
            v |= {"glove": self.between(0.43, 0.52), "glove_colour": colour}
        if self.chance(0.75):
            self.dots = (int(self.rng.integers(35, 75)), int(self.rng.integers(1 << 30)))

    def _feet(self) -> None:
        v = self.values
        bare = {"clothed": 0.1, "sports": 0.1, "no_shirt": 0.55, "briefs": 0.9, "suit": 0.15}[self.kind]
        if self.chance(bare):
            return
        if self.chance(0.6):
            v["sock_top"] = self.between(-0.74, -0.60) if self.chance(0.8) else self.between(-0.60, -0.42)
        v["sock_colour"] = fabric_colour(self.rng) if self.chance(0.5) else (self.between(0.5, 0.8),) * 3
        if self.chance(0.06):
            return  # socks alone
        boots = self.chance(0.12)
        light = (self.between(0.45, 0.8),) * 3
        v |= {
            "shoe_top": self.between(-0.68, -0.48) if boots else self.between(-0.775, -0.735),
            "shoe_bulk": self.between(0.003, 0.010), "sole": self.between(0.0, 0.016), "toe": self.between(0, 0.014),
            "shoe_colour": fabric_colour(self.rng), "sole_colour": light if self.chance(0.5) else (0.03, 0.03, 0.03),
        }  # fmt: skip
        self.parts.add("shoes")

    def _bands(self) -> None:
        """Watches and wristbands, knee braces, stockings."""
        watch = self.rng.choice([-1.0, 0.0, 1.0], p=[0.05, 0.8, 0.15])
        brace = self.rng.choice([-1.0, 0.0, 1.0], p=[0.03, 0.94, 0.03])
        low = self.between(-0.50, -0.41)
        self.values["bands"] = (float(watch), float(brace), low, low + self.between(0.05, 0.2))
        self.values["hat_b"] = fabric_colour(self.rng)
        if self.female and self.kind == "clothed" and self.chance(0.08):
            self.values["sock_top"] = self.between(-0.35, -0.15)

    def _head(self) -> None:
        v, rng, female = self.values, self.rng, self.female
        v["hair_colour"] = HAIR[int(rng.choice(len(HAIR), p=[0.24, 0.18, 0.18, 0.12, 0.09, 0.04, 0.09, 0.06]))]
        v |= {"hair_line": self.between(0.685, 0.725), "hair_paint": 0.85, "hair_low": self.between(0.615, 0.65)}
        style = str(rng.choice(["shaved", "short", "full", "afro", "tied", "long", "bald"],
                               p=[0.02, 0.1, 0.16, 0.06, 0.26, 0.38, 0.02] if female
                               else [0.14, 0.46, 0.16, 0.06, 0.03, 0.05, 0.10]))  # fmt: skip
        lumps = self.between(0.3, 1.5)
        if style == "bald":
            v |= {"bald": self.between(0.07, 0.12), "hair_volume": 0.004, "hair_line": 0.73}
            v["hair_paint"] = self.between(0.0, 0.7)
        elif style == "shaved":
            v |= {"hair_paint": self.between(0.3, 0.8), "hair_volume": 0.001}
        elif style == "short":
            v |= {"hair_volume": self.between(0.006, 0.02), "hair_top": self.between(1.0, 2.0), "hair_lumps": lumps}
        elif style == "full":
            v |= {"hair_volume": self.between(0.018, 0.038), "ears_out": int(self.chance(0.3)), "hair_lumps": lumps,
                  "hair_top": self.between(0.8, 1.2), "hair_low": self.between(0.575, 0.63)}  # fmt: skip
        elif style == "afro":
            v |= {"hair_volume": self.between(0.035, 0.08), "ears_out": 0, "hair_lumps": 0.8, "hair_top": 1.1,
                  "hair_colour": HAIR[int(rng.integers(0, 3))]}  # fmt: skip
        elif style == "tied":
            v |= {"hair_volume": self.between(0.004, 0.010), "hair_lumps": 0.3}
            self._tied()
        else:
            v |= {"hair_volume": self.between(0.008, 0.018), "hair_length": self.between(0.35, 0.6), "ears_out": 0,
                  "hair_lumps": lumps * 0.5, "hair_low": 0.6}  # fmt: skip
            self.parts.add("long_hair")
        if style != "shaved":
            self.parts.add("hair")
        if not female and self.chance(0.4):
            v["beard"] = int(rng.integers(1, 3))
        if self.chance(0.04):
            v |= {"covered": 1, "cover_colour": fabric_colour(rng) if self.chance(0.4) else (0.35, 0.55, 0.65)}
        if self.chance(0.10):
            dark = self.chance(0.5)
            self.things.append(Accessory("face", garments.glasses(0.036 if dark else 0.012), (0.015, 0.015, 0.018)))
        if self.chance(0.2 if self.kind != "briefs" else 0.35):
            self._hat()

    def _tied(self) -> None:
        """A bun or a ponytail."""
        colour = self.values["hair_colour"]
        if self.chance(0.35):
            size, high = self.between(0.03, 0.05), self.between(0.72, 0.87)
            at = (0.0, 0.055 + 0.9 * size - 0.8 * max(0.0, high - 0.79), high)
            self.things.append(Accessory("head", garments.blob(at, (size, size, size * 0.9)), colour, hair=True))
            return
        high, long = self.between(0.70, 0.84), self.between(0.12, 0.32)
        bend = np.array([[0, 0.04, high], [0, 0.10, high + 0.01], [0, 0.125, high - 0.06], [0, 0.12, high - long]])
        radii = np.array([0.012, 0.02, 0.028, 0.012]) * self.between(0.8, 1.4)
        self.things.append(Accessory("head", garments.tube(bend, radii), colour, hair=True, frozen=0.6))

    def _hat(self) -> None:
        v, parts = self.values, self.parts
        kind = str(self.rng.choice(["cap", "beanie", "swim", "helmet", "brimmed", "hood"],
                                   p=[0.36, 0.18, 0.14, 0.1, 0.1, 0.12]))  # fmt: skip
        if self.kind in ("briefs", "no_shirt"):
            kind = "swim" if self.chance(0.6) else "cap"
        if kind == "hood" and not (self.kind in ("clothed", "suit") and v["sleeve"] > 0.4):
            kind = "beanie"
        v |= {"hat_a": fabric_colour(self.rng), "hat_slope": self.between(0.35, 0.7),
              "hat_line": self.between(0.735, 0.765), "hair_lumps": 0.3}  # fmt: skip
        v["hair_volume"] = min(v["hair_volume"], 0.016)
        parts.add("hat")
        if kind == "swim":
            v |= {"hat_volume": 0.005, "sheen": 1, "hat_slope": 0.75, "hat_line": self.between(0.71, 0.74)}
            parts -= {"hair", "long_hair"}
            self.things = [t for t in self.things if not t.hair]
        elif kind == "beanie":
            v |= {"hat_volume": self.between(0.010, 0.022)}
        elif kind == "helmet":
            v |= {"hat_volume": self.between(0.028, 0.045), "sheen": 1}
        elif kind == "hood":
            v |= {"hooded": 1, "hat_volume": self.between(0.016, 0.03), "hat_a": v["shirt_a"]}
            if self.kind == "suit":
                v["hat_volume"] = 0.006
            parts -= {"long_hair"}
            self.things = [t for t in self.things if not t.hair]
        else:
            v |= {"hat_volume": self.between(0.012, 0.018)}
            cap = kind == "cap"
            width = self.between(0.06, 0.08) if cap else self.between(0.05, 0.11)
            shape = garments.brim(v["hat_line"] + 0.006, width, 0.0 if cap else 0.8, self.between(0, 0.4),
                                  v["hat_slope"])  # fmt: skip
            if cap and self.chance(0.15):
                shape = shape * [1, -1, 1] + [0, 2 * garments.SKULL[1], 0]
                shape[..., 2] = v["hat_line"] + 0.006 - v["hat_slope"] * (shape[..., 1] + 0.02)
            self.things.append(Accessory("head", shape, v["hat_a"] if self.chance(0.7) else v["hat_b"]))

    def _carry(self) -> None:
        """Bags and things in hands."""
        v = self.values
        colour = v["item_colour"]
        if self.kind in ("clothed", "sports") and "shirt" in self.parts:
            if self.chance(0.07):
                half = (self.between(0.12, 0.16), self.between(0.05, 0.10), self.between(0.15, 0.23))
                bag = garments.blob((0, 0.065 + half[1], 0.52 - half[2]), half, 0.45)
                self.things.append(Accessory("back", bag, colour))
                v["straps"] = 1
            elif self.chance(0.06):
                side = 1 if v["seed"] > 25 else -1
                half = (0.05, self.between(0.09, 0.15), self.between(0.07, 0.13))
                at = (side * 0.24, 0.0, 0.02 - half[2] * 0.5)
                anchor = "left_hip" if side > 0 else "right_hip"
                self.things.append(Accessory(anchor, garments.blob(at, half, 0.5), colour))
                v["straps"] = 2
        if self.chance(0.10):
            self._in_hand()

    def _in_hand(self) -> None:
        side = 1 if self.chance(0.5) else -1
        anchor = "left_hand" if side > 0 else "right_hand"
        colour = fabric_colour(self.rng)
        palm = np.array([side * 0.435, -0.25, 0.175])
        thing = int(self.rng.integers(4))
        if thing == 0:  # a ball
            size = self.between(0.03, 0.12)
            shape = garments.blob(tuple(palm + [-side * (size + 0.01), 0, -0.2 * size]), (size,) * 3)
            self.things.append(Accessory(anchor, shape, colour))
        elif thing == 1:  # a stick, a racket's shaft, a bottle
            long, thick = self.between(0.1, 0.5), self.between(0.008, 0.03)
            axis = np.array([0.35 * side, -0.55, 0.75])
            ends = np.stack([palm + axis * (k - 0.25) * long for k in (0, 0.5, 1.0)]) + [-side * 0.02, 0, 0]
            self.things.append(Accessory(anchor, garments.tube(ends, np.full(3, thick)), colour))
        elif thing == 2:  # a bag that hangs
            half = (self.between(0.04, 0.08), self.between(0.1, 0.18), self.between(0.12, 0.2))
            at = tuple(palm + [0, 0, -0.05 - half[2]])
            self.things.append(Accessory(anchor, garments.blob(at, half, 0.5), colour, frozen=1.0))
        else:  # a phone, a book
            half = (0.006, self.between(0.035, 0.08), self.between(0.06, 0.11))
            self.things.append(Accessory(anchor, garments.blob(tuple(palm + [-side * 0.015, 0, 0]), half, 0.3), colour))
