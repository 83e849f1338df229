"""Sport and work: treadmills, barbells, bars, rackets, balls, boxes, hurdles, tools."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, Spot, spot, surface
from muybridge.train.synthesis.things.shapes import (
    Mesh,
    box,
    capsule,
    disc,
    ellipsoid,
    join,
    lathe,
    prism,
    rod,
    strut,
    tube,
)


def treadmill(rng: np.random.Generator, rail: float | None = None) -> Built:
    """A treadmill whose user faces -y, towards its console."""
    rail = rng.uniform(0.85, 1.05) if rail is None else rail
    deck, half, long = rng.uniform(0.12, 0.22), rng.uniform(0.33, 0.42), rng.uniform(1.4, 1.8)
    frame, belt = surface(rng, "dark", "metal", "white"), surface(rng, "rubber")
    parts = [box((2 * half, long, deck - 0.02), (0, 0, deck / 2 - 0.01), frame, 0.02),
             box((1.5 * half, long - 0.06, 0.012), (0, 0, deck - 0.006), belt)]  # fmt: skip
    front, spots = -long / 2 + 0.1, {"deck": spot((0, 0, deck), size=(1.5 * half, long))}
    for side, s in (("L", 1), ("R", -1)):
        x = s * (half - 0.03)
        parts.append(strut((x, front, deck), (x, front - 0.05, deck + rail + 0.1), 0.06, 0.08, frame))
        parts.append(
            tube(
                [(x, front, deck + rail), (x, front + 0.35, deck + rail), (x, front + 0.6, deck + 0.6 * rail)],
                0.02,
                belt,
            )
        )
        spots["rail" + side] = spot((x, front + 0.25, deck + rail), axis=(0, 1, 0))
    console = box((1.9 * half, 0.06, 0.3), (0, 0, 0.1), frame, 0.02)
    screen = box((1.2 * half, 0.004, 0.18), (0, 0.032, 0.12), surface(rng, "glass", "paint"))
    parts.append(join(console, screen).turned(rot(0, 20)).moved((0, front - 0.06, deck + rail + 0.1)))
    return Built("treadmill", join(*parts), spots)


def barbell(rng: np.random.Generator) -> Built:
    """A barbell around the origin, along x."""
    metal, plate, half = surface(rng, "metal"), surface(rng, "dark", "paint"), rng.uniform(0.8, 1.08)
    parts = [rod((-half, 0, 0), (half, 0, 0), 0.014, metal)]
    for s in (-1, 1):
        x = half - 0.36
        parts.append(rod((s * x, 0, 0), (s * half, 0, 0), 0.024, metal))
        for _ in range(int(rng.integers(1, 4))):
            t = rng.uniform(0.02, 0.06)
            parts.append(disc(rng.uniform(0.09, 0.225), t, (s * (x + t / 2), 0, 0), plate, 24, (1, 0, 0)))
            x += t + 0.004
    return Built("barbell", join(*parts), {"bar": spot((0, 0, 0), axis=(1, 0, 0), size=(0.014, 1.1))})


def dumbbell(rng: np.random.Generator) -> Built:
    """A dumbbell or a kettlebell around its grip, along x."""
    metal, weight = surface(rng, "metal", "dark"), surface(rng, "dark", "paint", "rubber")
    if rng.random() < 0.6:
        r = rng.uniform(0.03, 0.08)
        parts = [rod((-0.1, 0, 0), (0.1, 0, 0), 0.015, metal)]
        parts += [disc(r, 0.06, (s * 0.1, 0, 0), weight, 12, (1, 0, 0)) for s in (-1, 1)]
    else:
        r = rng.uniform(0.07, 0.12)
        parts = [ellipsoid((r, r, r), (0, 0, -0.07 - r), weight, 16),
                 tube([(-0.05, 0, -0.1), (-0.055, 0, -0.02), (0, 0, 0), (0.055, 0, -0.02), (0.05, 0, -0.1)], 0.015,
                      weight)]  # fmt: skip
    return Built("dumbbell", join(*parts), {"bar": spot((0, 0, 0), axis=(1, 0, 0))})


def pull_up_bar(rng: np.random.Generator, high: float | None = None) -> Built:
    """A bar between two posts; its middle is over the origin."""
    high = rng.uniform(1.9, 2.6) if high is None else high
    frame, half = surface(rng, "metal", "paint", "dark"), rng.uniform(0.55, 0.9)
    parts = [rod((-half, 0, high), (half, 0, high), 0.018, frame)]
    for s in (-1, 1):
        parts += [strut((s * half, 0, 0), (s * half, 0, high + 0.03), 0.07, 0.07, frame),
                  box((0.08, 0.7, 0.05), (s * half, 0, 0.025), frame)]  # fmt: skip
    return Built("pull-up bar", join(*parts), {"bar": spot((0, 0, high), axis=(1, 0, 0))})


def ball(rng: np.random.Generator) -> Built:
    """A ball around the origin, from a tennis ball to a beach ball, now and then in two colours."""
    r = float(rng.choice([0.034, 0.11, 0.12, 0.17]) * rng.uniform(0.9, 1.15))
    parts = [ellipsoid((r, r, r), (0, 0, 0), surface(rng, "plastic", "paint", "leather"), 20)]
    if rng.random() < 0.5:
        parts.append(lathe([(r * 0.98, -0.3 * r), (r * 1.01, 0), (r * 0.98, 0.3 * r)], (0, 0, 0),
                           surface(rng, "paint", "white"), 20, rng.normal(size=3)))  # fmt: skip
    return Built("ball", join(*parts), {"middle": spot((0, 0, 0), size=(r, r))})


def racket(rng: np.random.Generator) -> Built:
    """A racket or a bat, its grip around the origin, along y; it points to -y."""
    frame, grip = surface(rng, "paint", "dark", "metal"), surface(rng, "rubber", "leather", "cloth")
    style, parts = rng.random(), [rod((0, 0.12, 0), (0, -0.12, 0), 0.016, grip)]
    if style < 0.6:
        a, b, shaft = rng.uniform(0.1, 0.13), rng.uniform(0.13, 0.17), rng.uniform(0.1, 0.25)
        angle = np.radians(np.arange(0, 360, 15))
        y = -0.12 - shaft - b
        loop = np.stack([a * np.sin(angle), y + b * np.cos(angle), 0 * angle], -1)
        parts += [tube(loop, 0.011, frame, 6, closed=True), rod((0, -0.12, 0), (0, y + b, 0), 0.012, frame)]
        strings = surface(rng, "white", "paint")
        for t in np.linspace(-0.8, 0.8, 8):
            h = np.sqrt(1 - t**2)
            parts += [rod((t * a, y - h * b, 0), (t * a, y + h * b, 0), 0.0012, strings, 3),
                      rod((-h * a, y + t * b, 0), (h * a, y + t * b, 0), 0.0012, strings, 3)]  # fmt: skip
    elif style < 0.8:
        parts.append(tube([(0, -0.1, 0), (0, -0.35, 0), (0, -0.75, 0)], [0.015, 0.022, 0.035],
                          surface(rng, "wood", "metal")))  # fmt: skip
    else:
        parts.append(disc(0.08, 0.012, (0, -0.19, 0), surface(rng, "paint", "wood")))
    return Built("racket", join(*parts), {"grip": spot((0, 0, 0), axis=(0, 1, 0))})


def carton(rng: np.random.Generator, size: float = 1.0) -> Built:
    """A box, a crate or a suitcase, standing on the floor."""
    w, d, h = rng.uniform(0.25, 0.6) * size, rng.uniform(0.2, 0.45) * size, rng.uniform(0.15, 0.45) * size
    cover = surface(rng, "wood", "plastic", "leather", "white")
    parts = [box((w, d, h), (0, 0, h / 2), cover, rng.uniform(0, 0.03))]
    if rng.random() < 0.5:
        parts.append(box((0.06, d + 0.004, h + 0.003), (0, 0, h / 2), surface(rng, "wood", "paint")))
    elif rng.random() < 0.5:
        parts += [box((w + 0.02, d + 0.02, 0.03), (0, 0, z), surface(rng, "wood", "metal")) for z in (0.02, h - 0.02)]
    spots: dict[str, Spot] = {"top": spot((0, 0, h), size=(w, d))}
    for side, s in (("L", 1), ("R", -1)):
        spots["side" + side] = spot((s * w / 2, 0, 0.35 * h), axis=(0, -1, 0), normal=(s, 0, 0))
        spots["under" + side] = spot((s * 0.3 * w, -0.2 * d, 0.0), normal=(0, 0, -1))
    return Built("box", join(*parts), spots)


def hurdle(rng: np.random.Generator) -> Built:
    """A hurdle, or a barrier in a street."""
    high, half = rng.uniform(0.5, 1.1), rng.uniform(0.4, 1.0)
    frame, board = surface(rng, "metal", "dark"), surface(rng, "white", "paint", "wood")
    parts = [box((2 * half, 0.03, rng.uniform(0.07, 0.2)), (0, 0, high - 0.06), board, 0.005)]
    for s in (-1, 1):
        parts += [rod((s * 0.9 * half, 0, 0), (s * 0.9 * half, 0, high), 0.018, frame),
                  rod((s * 0.9 * half, -0.3, 0.02), (s * 0.9 * half, 0.3, 0.02), 0.018, frame)]  # fmt: skip
        parts.append(box((0.16, 0.034, 0.075), (s * 0.5 * half, 0, high - 0.06), surface(rng, "paint")))
    return Built("hurdle", join(*parts), {"bar": spot((0, 0, high), axis=(1, 0, 0))})


def tool(rng: np.random.Generator) -> Built:
    """A broom, spade, rake or pole: its shaft along z from the floor; or a hammer, drill or pan, its grip along z."""
    wood, metal = surface(rng, "wood", "metal", "paint"), surface(rng, "metal", "dark")
    style = int(rng.integers(5))
    if style >= 3:
        parts: list[Mesh] = [rod((0, 0, -0.12), (0, 0, 0.18), 0.014, wood)]
        if style == 3:
            parts.append(capsule((0, 0.05, 0.19), (0, -0.08, 0.19), 0.018, metal))
        else:
            parts.append(disc(rng.uniform(0.1, 0.14), 0.04, (0, 0, 0.29), metal, 20, (0, 1, 0)))
        return Built("hand tool", join(*parts), {"grip": spot((0, 0, 0), axis=(0, 0, 1))})
    long = rng.uniform(1.15, 1.6)
    parts = [rod((0, 0, 0.1), (0, 0, long), 0.015, wood)]
    if style == 0:
        parts += [box((0.36, 0.07, 0.05), (0, 0, 0.12), wood, 0.01),
                  box((0.36, 0.06, 0.1), (0, 0, 0.05), surface(rng, "fur", "plastic"))]  # fmt: skip
    elif style == 1:
        blade = [(-0.1, 0.3), (-0.1, 0.08), (0, 0.0), (0.1, 0.08), (0.1, 0.3)]
        parts += [prism(blade, 0.008, metal, "xz"), rod((-0.06, 0, long), (0.06, 0, long), 0.015, wood)]
    else:
        parts.append(rod((-0.22, 0, 0.1), (0.22, 0, 0.1), 0.012, metal))
        parts += [rod((x, 0, 0.1), (x, -0.03, 0.0), 0.005, metal, 5) for x in np.linspace(-0.21, 0.21, 9)]
    spots = {"upper": spot((0, 0, 0.86 * long), axis=(0, 0, 1)), "lower": spot((0, 0, 0.52 * long), axis=(0, 0, 1))}
    return Built("long tool", join(*parts), spots)
