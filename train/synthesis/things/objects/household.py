"""What stands about in rooms and streets and a detector may take for a person."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, spot, surface
from muybridge.train.synthesis.things.shapes import (
    Mesh,
    Surface,
    box,
    capsule,
    disc,
    ellipsoid,
    join,
    lathe,
    prism,
    rod,
    sheet,
    strut,
    tube,
)


def lamp(rng: np.random.Generator) -> Built:
    """A floor lamp, a table lamp or a street lamp."""
    high, metal = float(rng.choice([0.5, 1.6, 3.2])) * rng.uniform(0.85, 1.15), surface(rng, "metal", "dark", "wood")
    r, shade = rng.uniform(0.1, 0.24), surface(rng, "white", "cloth", "paint")
    parts = [
        disc(0.6 * r + 0.06, 0.025, (0, 0, 0.0125), metal),
        rod((0, 0, 0), (0, 0, high), 0.012 + 0.008 * high, metal),
    ]
    if high > 2.5 or rng.random() < 0.25:
        end = (0, -0.4, high + 0.05)
        parts += [
            tube([(0, 0, high - 0.2), (0, -0.1, high), end], 0.015, metal),
            ellipsoid((r, 0.8 * r, 0.07), end, shade),
        ]
    else:
        top = rng.uniform(0.4, 1.0) * r
        outside = [(r, high - 0.28), (top, high), (top - 0.006, high), (r - 0.006, high - 0.27)]
        parts.append(lathe(outside, (0, 0, 0), shade, 20))
    return Built("lamp", join(*parts), {})


def cloth(rng: np.random.Generator, wide: float, high: float, waves: float) -> Mesh:
    """A hanging cloth in the x-z plane, its upper edge at z = 0, in folds."""
    x, z = np.meshgrid(np.linspace(-0.5, 0.5, 17), np.linspace(0, 1, 7), indexing="ij")
    fold = waves * wide * np.sin(2 * np.pi * x * rng.uniform(1.5, 4) + rng.uniform(0, 6) + z) * (0.4 + z)
    return sheet(np.stack([x * wide * (1 - 0.2 * z), fold, -z * high], -1), 0.006, surface(rng, "cloth", "paint"))


def coat(rng: np.random.Generator) -> Mesh:
    """A coat on a hanger, its collar at the origin: shoulders, sleeves that hang and a flared body."""
    fabric, long = surface(rng, "cloth", "dark", "leather", "fur"), rng.uniform(0.55, 1.1)
    t = np.linspace(0, 1, 9)
    wide = np.interp(t, [0, 0.08, 0.2, 1], [0.07, 0.19, 0.18, rng.uniform(0.16, 0.28)])
    angle = np.radians(np.arange(0, 360, 20))
    ripple = 1 + 0.12 * np.sin(4 * angle + rng.uniform(0, 6))[None] * t[:, None]
    rings = np.stack([wide[:, None] * np.cos(angle) * ripple, 0.45 * wide[:, None] * np.sin(angle) * ripple,
                      np.broadcast_to(-t[:, None] * long, ripple.shape)], -1)  # fmt: skip
    closed = np.concatenate([rings[::-1], rings[::-1][:, :1]], 1)
    parts = [sheet(closed, 0.008, fabric)]
    for s in (-1, 1):
        parts.append(
            capsule(
                (s * 0.19, 0, -0.1),
                (s * rng.uniform(0.2, 0.28), rng.uniform(-0.05, 0.05), -0.62),
                (0.06, 0.05),
                fabric,
                9,
            )
        )
    return join(*parts)


def coat_stand(rng: np.random.Generator) -> Built:
    """A coat stand with coats, a scarf and a hat, or none."""
    high, wood = rng.uniform(1.5, 1.9), surface(rng, "wood", "metal", "dark")
    parts = [rod((0, 0, 0.02), (0, 0, high), 0.022, wood)]
    for a in np.radians(np.arange(4) * 90 + 20):
        way = np.array([np.cos(a), np.sin(a), 0])
        parts += [rod((0, 0, high - 0.12), way * 0.17 + [0, 0, high], 0.011, wood, 6),
                  rod((0, 0, 0.22), way * 0.27, 0.015, wood, 6)]  # fmt: skip
    for _ in range(int(rng.integers(0, 4))):
        turned = rot(2, rng.uniform(-180, 180))
        parts.append(coat(rng).turned(turned).moved(turned @ np.array([0, -0.12, high - 0.05])))
    if rng.random() < 0.5:
        hat = [(0.16, 0.0), (0.17, 0.01), (0.1, 0.02), (0.09, 0.11), (0.02, 0.13)]
        parts.append(lathe(hat, (0, 0, high), surface(rng, "cloth", "dark", "leather")))
    return Built("coat stand", join(*parts), {})


def clothes_rack(rng: np.random.Generator) -> Built:
    """Coats and shirts on a rail."""
    high, half, metal = rng.uniform(1.3, 1.7), rng.uniform(0.4, 0.8), surface(rng, "metal", "dark", "wood")
    parts = [rod((-half, 0, high), (half, 0, high), 0.014, metal)]
    parts += [strut((s * half, 0, 0), (s * half, 0, high), 0.03, 0.03, metal) for s in (-1, 1)]
    parts += [box((0.05, 0.45, 0.03), (s * half, 0, 0.015), metal) for s in (-1, 1)]
    for x in np.linspace(-0.8, 0.8, int(rng.integers(1, 7))) * half:
        parts.append(coat(rng).turned(rot(2, rng.normal(90, 30))).moved((x, 0, high - 0.08)))
    return Built("clothes rack", join(*parts), {})


def flag(rng: np.random.Generator) -> Built:
    """A flag on a pole, a banner, or washing."""
    high, metal = rng.uniform(1.8, 4.0), surface(rng, "metal", "wood", "white")
    wide, deep = rng.uniform(0.4, 1.4), rng.uniform(0.5, 1.1)
    parts = [rod((0, 0, 0), (0, 0, high), 0.018, metal), disc(0.2, 0.05, (0, 0, 0.025), metal)]
    for z in (0, -deep / 2):
        stripe = cloth(rng, wide, deep / 2, rng.uniform(0.02, 0.08))
        parts.append(stripe.moved((wide / 2 + 0.02, 0, high + z - 0.03)))
    return Built("flag", join(*parts), {})


def plant(rng: np.random.Generator) -> Built:
    """A potted plant, a shrub or a small tree."""
    high, leaf, wood = rng.uniform(0.4, 2.2), surface(rng, "leaf"), surface(rng, "wood")
    r = rng.uniform(0.1, 0.22)
    pot = [(0.75 * r, 0), (r, 1.6 * r), (0.9 * r, 1.6 * r), (0.85 * r, 1.5 * r)]
    parts = [
        lathe(pot, (0, 0, 0), surface(rng, "stone", "plastic", "wood")),
        rod((0, 0, r), (0, 0, 0.7 * high + r), 0.02, wood),
    ]
    if rng.random() < 0.5:
        for _ in range(int(rng.integers(10, 24))):
            a, rise = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.2)
            way = np.array([np.cos(a) * np.cos(rise), np.sin(a) * np.cos(rise), np.sin(rise)])
            base, long = np.array([0, 0, rng.uniform(0.3, 0.75) * high + r]), rng.uniform(0.15, 0.4) * high
            line = [base, base + way * long * 0.6, base + way * long - [0, 0, 0.25 * long]]
            parts.append(tube(line, [0.006, 0.05, 0.004], leaf, 6, flat=0.15))
    else:
        for _ in range(int(rng.integers(5, 12))):
            at = rng.normal(0, 0.13 * high, 3) * [1, 1, 0.7] + [0, 0, 0.75 * high + r]
            at[2] = max(at[2], 0.12 * high + r)
            parts.append(ellipsoid(rng.uniform(0.06, 0.17, 3) * high, at, leaf, 10))
    return Built("plant", join(*parts), {})


def statue(rng: np.random.Generator) -> Built:
    """A dummy, a bust or a post of the height and outline of a person, without limbs that could be labelled."""
    high, style = rng.uniform(1.1, 1.9), rng.random()
    stone = surface(rng, "stone", "wood", "white", "brass", "cloth")
    if style < 0.4:
        profile = np.array(
            [
                (0.17, 0),
                (0.17, 0.05),
                (0.03, 0.07),
                (0.03, 0.45),
                (0.16, 0.47),
                (0.17, 0.55),
                (0.12, 0.65),
                (0.18, 0.8),
                (0.05, 0.84),
                (0.045, 0.87),
            ]
        )
        parts = [lathe(profile * [1, high], (0, 0, 0), stone, 18)]
        if rng.random() < 0.5:
            parts.append(ellipsoid((0.075, 0.09, 0.11), (0, 0, high * 0.87 + 0.1), stone, 12))
    elif style < 0.7:
        base = rng.uniform(0.45, 0.65) * high
        parts = [box((0.34, 0.34, base), (0, 0, base / 2), surface(rng, "stone", "wood"), 0.01),
                 ellipsoid((0.2, 0.12, 0.16), (0, 0, base + 0.12), stone, 14),
                 capsule((0, 0, base + 0.2), (0, -0.02, base + 0.34), 0.055, stone),
                 ellipsoid((0.08, 0.1, 0.125), (0, -0.03, base + 0.46), stone, 14)]  # fmt: skip
    else:
        r = rng.uniform(0.06, 0.2)
        parts = [lathe([(r, 0), (r, 0.75 * high), (0.7 * r, 0.8 * high), (r, 0.84 * high), (0.9 * r, 0.95 * high),
                        (0.3 * r, high)], (0, 0, 0), stone, 16)]  # fmt: skip
    return Built("statue", join(*parts), {})


def door(rng: np.random.Generator) -> Built:
    """A door in its frame, ajar, or a wardrobe."""
    high, wide = rng.uniform(1.9, 2.15), rng.uniform(0.7, 0.95)
    leaf, frame = surface(rng, "wood", "white", "paint"), surface(rng, "wood", "white", "metal")
    panel = [box((wide, 0.04, high), (wide / 2, 0, high / 2), leaf)]
    panel += [box((0.6 * wide, 0.05, 0.32 * high), (wide / 2, 0, z * high), leaf, 0.01) for z in (0.28, 0.72)]
    panel.append(
        rod((0.92 * wide, -0.06, 0.5 * high), (0.8 * wide, -0.06, 0.5 * high), 0.012, surface(rng, "metal", "brass"))
    )
    parts = [join(*panel).turned(rot(2, rng.uniform(-100, 10))).moved((-wide / 2, 0, 0))]
    parts += [box((0.08, 0.12, high + 0.06), (s * (wide / 2 + 0.05), 0, high / 2 + 0.03), frame) for s in (-1, 1)]
    parts.append(box((wide + 0.18, 0.12, 0.08), (0, 0, high + 0.05), frame))
    return Built("door", join(*parts), {})


def street_sign(rng: np.random.Generator) -> Built:
    """A sign on a post: round, square or three-cornered; or a traffic light."""
    high, metal = rng.uniform(1.6, 2.6), surface(rng, "metal", "dark")
    parts = [rod((0, 0, 0), (0, 0, high), 0.03, metal)]
    if rng.random() < 0.25:
        parts.append(box((0.25, 0.2, 0.8), (0, -0.1, high), surface(rng, "dark"), 0.03))
        for z, c in ((0.25, (0.6, 0.02, 0.02)), (0, (0.6, 0.35, 0.02)), (-0.25, (0.02, 0.4, 0.1))):
            parts.append(disc(0.09, 0.02, (0, -0.2, high + z), Surface(c, 0, 0.5), 16, (0, 1, 0)))
    else:
        corners, r = int(rng.choice([3, 4, 8, 24])), rng.uniform(0.2, 0.4)
        angle = np.arange(corners) * 2 * np.pi / corners + (np.pi / 2 if corners == 3 else np.pi / corners)
        for k, y in ((1.0, -0.04), (0.8, -0.05)):
            shape = prism(
                np.stack([np.cos(angle), np.sin(angle)], -1) * r * k, 0.012, surface(rng, "paint", "white"), "xz"
            )
            parts.append(shape.moved((0, y, high - 0.1)))
    return Built("street sign", join(*parts), {})


def fence(rng: np.random.Generator) -> Built:
    """A fence or a railing along x."""
    high, half = rng.uniform(0.7, 1.2), rng.uniform(0.7, 1.6)
    paint = surface(rng, "wood", "metal", "white", "paint")
    parts = [box((2 * half, 0.04, 0.06), (0, 0, z), paint) for z in (high - 0.05, 0.3 * high)]
    wide = rng.uniform(0.02, 0.1)
    parts += [
        box((wide, 0.03, high), (x, -0.02, high / 2), paint)
        for x in np.linspace(-half, half, int(half / (0.06 + wide)))
    ]
    return Built("fence", join(*parts), {"top": spot((0, 0, high - 0.02), axis=(1, 0, 0), size=(2 * half, 0.06))})


def wall(rng: np.random.Generator) -> Built:
    """A piece of wall along x, its front at y = 0, facing +y."""
    wide, high = rng.uniform(0.8, 2.0), rng.uniform(1.9, 2.4)
    plaster = surface(rng, "stone", "white", "wood", "paint")
    return Built(
        "wall", box((wide, 0.15, high), (0, -0.075, high / 2), plaster), {"front": spot((0, 0, 1.2), normal=(0, 1, 0))}
    )


def shelf(rng: np.random.Generator) -> Built:
    """A shelf with things."""
    wide, high, wood = rng.uniform(0.5, 1.0), rng.uniform(0.8, 1.9), surface(rng, "wood", "white", "metal")
    parts = [box((0.025, 0.3, high), (s * wide / 2, 0, high / 2), wood) for s in (-1, 1)]
    for z in np.arange(0.08, high, 0.34):
        parts.append(box((wide, 0.3, 0.022), (0, 0, z), wood))
        x = -wide / 2 + 0.03
        while x < wide / 2 - 0.12 and rng.random() < 0.9:
            w, h = rng.uniform(0.02, 0.12), rng.uniform(0.1, 0.26)
            parts.append(
                box((w, 0.2, h), (x + w / 2, 0, z + 0.011 + h / 2), surface(rng, "paint", "cloth", "leather", "white"))
            )
            x += w + float(rng.choice([0.002, 0.06]))
    return Built("shelf", join(*parts), {})
