"""Instruments: guitars, violins, cellos, drums, pianos, and what stands before the player."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, spot, surface
from muybridge.train.synthesis.things.shapes import box, disc, join, prism, rod, strut


def _waisted(half: float, long: float, waist: float) -> FloatArray:
    """(N, 2) outline of a body with a waist, along y, its upper end at y = 0."""
    t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    y = -0.5 * long + 0.5 * long * np.cos(t)
    share = -y / long
    wide = half * (0.78 + 0.22 * share) * np.sqrt(np.clip(1 - (2 * share - 1) ** 8, 0, 1))
    wide = wide * (1 - waist * np.exp(-(((share - 0.42) / 0.14) ** 2)))
    return np.stack([np.where(np.sin(t) > 0, -wide, wide), y], -1)


def fiddle(rng: np.random.Generator, kind: str) -> Built:
    """A `guitar`, `violin` or `cello` in its own frame: the body's upper end is at the origin, the neck along +y, the
    strings towards +z."""
    long, half, deep, neck, waist = {
        "guitar": (0.48, 0.19, 0.09, 0.52, 0.28), "violin": (0.355, 0.1, 0.04, 0.28, 0.42),
        "cello": (0.75, 0.21, 0.13, 0.62, 0.36),
    }[kind]  # fmt: skip
    k = rng.uniform(0.9, 1.05)
    long, half, deep, neck = long * k, half * k, deep * k, neck * k
    electric = kind == "guitar" and rng.random() < 0.4
    body, dark = surface(rng, "paint", "wood") if electric else surface(rng, "wood"), surface(rng, "dark")
    outline = _waisted(half * (0.85 if electric else 1), long, waist)
    parts = [prism(outline[::-1] if _clockwise(outline) else outline, 0.04 if electric else deep, body)]
    top = (0.04 if electric else deep) / 2
    parts += [
        box(
            (0.05 * (k if kind != "violin" else 0.5), neck + 0.1, 0.02), (0, neck / 2 - 0.05, top + 0.008), dark, 0.004
        ),
        box((0.075 if kind == "guitar" else 0.045, 0.14, 0.025), (0, neck + 0.07, top - 0.005), body, 0.005),
        box((0.6 * half, 0.02, 0.02), (0, -0.68 * long, top + 0.01), dark),
    ]
    if kind == "guitar" and not electric:
        parts.append(disc(0.048, 0.003, (0, -0.28 * long, top + 0.001), dark))
    if kind == "cello":
        parts.append(rod((0, -long, 0), (0, -long - 0.15, 0), 0.006, surface(rng, "metal"), 6))
    spots = {
        "neck": spot((0, rng.uniform(0.35, 0.9) * neck, top - 0.005), axis=(0, 1, 0)),
        "strings": spot((0, -0.42 * long, top + 0.02), axis=(1, 0, 0)),
        "tail": spot((0, -long, 0)), "foot": spot((0, -long - 0.15, 0)),
        "rib": spot((half * 0.9, -0.7 * long, 0)),
    }  # fmt: skip
    return Built(kind, join(*parts), spots)


def _clockwise(outline: FloatArray) -> bool:
    x, y = outline.T
    return bool((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0)


def bow(rng: np.random.Generator) -> Built:
    """A bow, its grip at the origin, along -x."""
    parts = [rod((0.03, 0, 0), (-0.7, 0, 0), 0.005, surface(rng, "wood"), 6),
             box((0.68, 0.006, 0.002), (-0.33, 0, -0.02), surface(rng, "white"))]  # fmt: skip
    return Built("bow", join(*parts), {"grip": spot((0, 0, 0), axis=(1, 0, 0))})


def drum(rng: np.random.Generator, top: float) -> Built:
    """Drums and a cymbal on stands before the player, who faces -y from y = 0."""
    shell, metal, head = surface(rng, "paint", "wood", "metal"), surface(rng, "metal"), surface(rng, "white")
    parts, spots = [], {}
    count = int(rng.integers(1, 4))
    for i, x in enumerate((np.arange(count) - (count - 1) / 2) * 0.36):
        r, deep, y = rng.uniform(0.15, 0.2), rng.uniform(0.12, 0.3), -0.26 - 0.1 * abs(x)
        z = top + rng.uniform(-0.03, 0.08) * (i > 0)
        parts += [disc(r, deep, (x, y, z - deep / 2), shell, 22), disc(0.97 * r, 0.01, (x, y, z + 0.002), head, 22)]
        parts += [rod((x, y, z - deep), (x + 0.25 * c, y + 0.25 * s, 0), 0.01, metal, 6)
                  for c, s in ((1, 0), (-0.5, 0.87), (-0.5, -0.87))]  # fmt: skip
        spots[f"head{i}"] = spot((x, y, z))
    if rng.random() < 0.6:
        x = float(rng.choice([-0.5, 0.5]))
        parts += [disc(0.2, 0.006, (x, -0.5, top + 0.35), surface(rng, "brass"), 22, (0.1, 0.2, 1)),
                  rod((x, -0.5, 0), (x, -0.5, top + 0.36), 0.01, metal)]  # fmt: skip
    return Built("drum", join(*parts), spots)


def piano(rng: np.random.Generator, top: float) -> Built:
    """A keyboard on a stand, or an upright piano; the player faces -y from y = 0."""
    case, white, black = surface(rng, "dark", "wood"), surface(rng, "white"), surface(rng, "dark")
    wide = rng.uniform(0.9, 1.4)
    parts = [box((wide, 0.14, 0.02), (0, -0.08, top - 0.01), white)]
    for x in np.arange(-wide / 2 + 0.05, wide / 2 - 0.03, 0.047):
        parts.append(box((0.012, 0.09, 0.012), (x, -0.105, top + 0.005), black))
    if rng.random() < 0.5:
        parts += [box((wide + 0.12, 0.45, top * 1.7), (0, -0.38, 0.85 * top), case, 0.01),
                  box((wide + 0.12, 0.2, 0.1), (0, -0.1, top - 0.075), case)]  # fmt: skip
        parts += [box((0.06, 0.08, top - 0.1), (s * wide * 0.5, -0.04, (top - 0.1) / 2), case) for s in (-1, 1)]
    else:
        parts.append(box((wide + 0.1, 0.3, 0.07), (0, -0.16, top - 0.05), case, 0.01))
        parts += [strut((s * 0.3, -0.3, 0.0), (-s * 0.3, -0.02, top - 0.08), 0.04, 0.03, black) for s in (-1, 1)]
        parts += [rod((-0.35, y, 0.02), (0.35, y, 0.02), 0.015, black) for y in (-0.3, -0.02)]
    return Built("piano", join(*parts), {"keys": spot((0, -0.09, top), size=(wide, 0.14))})


def music_stand(rng: np.random.Generator) -> Built:
    """A stand with sheets, facing +y."""
    high, dark = rng.uniform(0.9, 1.3), surface(rng, "dark", "metal")
    desk = join(
        box((0.5, 0.01, 0.33), (0, 0, 0.12), dark), box((0.4, 0.004, 0.28), (0, 0.008, 0.13), surface(rng, "white"))
    )
    parts = [rod((0, 0, 0.02), (0, 0, high), 0.01, dark), desk.turned(rot(0, 22)).moved((0, 0, high))]
    parts += [
        rod((0, 0, 0.25), (0.3 * c, 0.3 * s, 0), 0.008, dark, 6) for c, s in ((1, 0), (-0.5, 0.87), (-0.5, -0.87))
    ]
    return Built("music stand", join(*parts), {})
