"""Tables, desks, counters, and what lies on them."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, spot, surface
from muybridge.train.synthesis.things.objects.seats import four_legs
from muybridge.train.synthesis.things.shapes import Mesh, box, disc, ellipsoid, join, lathe, rod, sheet, strut


def table(
    rng: np.random.Generator, top: float | None = None, width: float | None = None, depth: float | None = None
) -> Built:
    """A table or desk whose near edge is at y = 0; people sit at +y and their legs go below it."""
    top = rng.uniform(0.66, 0.8) if top is None else top
    width = rng.uniform(0.8, 1.8) if width is None else width
    depth = rng.uniform(0.55, 0.9) if depth is None else depth
    board, frame, t = surface(rng, "wood", "wood", "white", "paint"), surface(rng, "wood", "metal", "dark"), 0.03
    style = rng.random()
    y = -depth / 2
    if style < 0.25 and width < 1.3:
        parts = [disc(width / 2, t, (0, -width / 2, top - t / 2), board, 28)]
        y, depth = -width / 2, width
        parts.append(lathe([(0.3, 0), (0.28, 0.02), (0.05, 0.06), (0.045, top - t)], (0, y, 0), frame))
    else:
        parts = [box((width, depth, t), (0, y, top - t / 2), board, 0.006)]
    if len(parts) == 1 and style < 0.65:
        parts.append(four_legs(rng, width, depth, top - t, frame, 0.0, rng.uniform(0.035, 0.07)).moved((0, y, 0)))
    elif len(parts) == 1:
        parts += [box((0.035, 0.92 * depth, top - t), (s * (width / 2 - 0.04), y, (top - t) / 2), board)
                  for s in (-1, 1)]  # fmt: skip
        parts.append(box((width - 0.1, 0.02, 0.5 * top), (0, 0.06 - depth, 0.7 * top), board))
        if rng.random() < 0.5 and width > 1.1:
            parts.append(box((0.38, 0.85 * depth, top - t), (width / 2 - 0.22, y, (top - t) / 2), board))
    edge = spot((0, 0, top), axis=(1, 0, 0), size=(width, depth))
    return Built("table", join(*parts), {"edge": edge, "top": spot((0, y, top), size=(width, depth))})


def counter(rng: np.random.Generator, top: float | None = None) -> Built:
    """A counter, a bar or a kitchen block with a front; its near edge is at y = 0."""
    top = rng.uniform(0.85, 1.15) if top is None else top
    width, depth = rng.uniform(0.8, 2.2), rng.uniform(0.35, 0.65)
    front, board = surface(rng, "wood", "paint", "white", "stone"), surface(rng, "wood", "stone", "white", "metal")
    parts = [box((width, depth - 0.05, top - 0.04), (0, -depth / 2, (top - 0.04) / 2), front),
             box((width + 0.04, depth, 0.04), (0, -depth / 2, top - 0.02), board, 0.008)]  # fmt: skip
    for x in np.linspace(-0.5, 0.5, int(rng.integers(2, 5)))[:-1] * width:
        parts.append(box((0.012, depth - 0.045, 0.8 * top), (x, -depth / 2, 0.5 * top), board))
    spots = {"edge": spot((0, 0, top), axis=(1, 0, 0), size=(width, depth)),
             "top": spot((0, -depth / 2, top), size=(width, depth))}  # fmt: skip
    return Built("counter", join(*parts), spots)


def laptop(rng: np.random.Generator) -> Built:
    """A laptop whose keys face the person."""
    w, d, lid = rng.uniform(0.3, 0.4), rng.uniform(0.21, 0.27), surface(rng, "metal", "dark", "metal")
    base = box((w, d, 0.018), (0, -d / 2, 0.009), lid, 0.004)
    keys = box((0.88 * w, 0.45 * d, 0.003), (0, -0.62 * d, 0.019), surface(rng, "dark"))
    screen = join(
        box((w, 0.008, d), (0, 0, d / 2), lid),
        box((0.93 * w, 0.003, 0.88 * d), (0, 0.005, d / 2), surface(rng, "glass", "paint", "white")),
    )
    open_lid = screen.turned(rot(0, rng.uniform(5, 38))).moved((0, -d, 0.02))
    spots = {"keys": spot((0, -0.6 * d, 0.021), size=(w, d)), "edge": spot((0, 0, 0.018))}
    return Built("laptop", join(base, keys, open_lid), spots)


def monitor(rng: np.random.Generator) -> Built:
    """A screen on a foot, facing the person."""
    w, h, case = rng.uniform(0.4, 0.75), rng.uniform(0.28, 0.42), surface(rng, "dark", "metal")
    low = rng.uniform(0.1, 0.2)
    parts = [box((w, 0.03, h), (0, 0, low + h / 2), case, 0.008), disc(0.12, 0.015, (0, -0.03, 0.0075), case),
             box((0.94 * w, 0.004, 0.9 * h), (0, 0.017, low + h / 2), surface(rng, "glass", "paint", "white")),
             strut((0, -0.03, 0), (0, -0.03, low + h / 2), 0.05, 0.02, case)]  # fmt: skip
    return Built("monitor", join(*parts), {})


def keyboard(rng: np.random.Generator) -> Built:
    """A computer's keyboard."""
    w = rng.uniform(0.3, 0.45)
    return Built("keyboard", box((w, 0.13, 0.02), (0, 0, 0.01), surface(rng, "dark", "white", "metal"), 0.004),
                 {"keys": spot((0, 0, 0.021), size=(w, 0.13))})  # fmt: skip


def book(rng: np.random.Generator) -> Built:
    """An open book or a paper."""
    w, d = rng.uniform(0.12, 0.2), rng.uniform(0.18, 0.3)
    x, y = np.meshgrid(np.linspace(-w, w, 9), np.linspace(-d / 2, d / 2, 2), indexing="ij")
    z = 0.008 + 0.02 * np.abs(np.sin(np.pi * x / w)) * (1 - np.abs(x) / w * 0.5)
    return Built("book", sheet(np.stack([x, y, z], -1), 0.006, surface(rng, "white", "white", "paint")), {})


def crockery(rng: np.random.Generator) -> Built:
    """A cup, a glass, a bottle or a bowl."""
    s, r = surface(rng, "white", "paint", "glass", "brass", "metal"), rng.uniform(0.03, 0.045)
    shapes: tuple[list[tuple[float, float]], ...] = (
        [(0.8 * r, 0), (r, 0.01), (r, 0.09), (0.85 * r, 0.09), (0.8 * r, 0.02)],
        [(r, 0), (r, 0.17), (0.35 * r, 0.22), (0.35 * r, 0.28)],
        [(r, 0), (1.3 * r, 0.01), (2.2 * r, 0.06), (2.1 * r, 0.06), (1.2 * r, 0.02)],
    )
    return Built("crockery", lathe(shapes[int(rng.integers(3))], (0, 0, 0), s, 14), {})


def clutter(rng: np.random.Generator, width: float, depth: float, count: int) -> Mesh | None:
    """Small things that lie about on a surface around the origin."""
    parts = []
    for _ in range(count):
        made = (book, crockery, crockery, keyboard)[int(rng.integers(4))](rng)
        at = (rng.uniform(-0.45, 0.45) * width, rng.uniform(-0.4, 0.4) * depth, 0)
        parts.append(made.placed(rng.uniform(-180, 180), at).mesh)
    return join(*parts) if parts else None


def treatment_table(rng: np.random.Generator, top: float | None = None) -> Built:
    """A physiotherapist's table along y: the head is at +y."""
    top = rng.uniform(0.55, 0.85) if top is None else top
    long, wide = rng.uniform(1.85, 2.05), rng.uniform(0.6, 0.75)
    pad, frame = surface(rng, "leather", "plastic", "dark"), surface(rng, "wood", "metal", "white")
    parts = [box((wide, long, 0.08), (0, 0, top - 0.04), pad, 0.025),
             box((wide - 0.06, long - 0.1, 0.05), (0, 0, top - 0.105), frame)]  # fmt: skip
    if rng.random() < 0.5:
        parts += [strut((sx * wide * 0.4, sy * long * 0.4, 0), (sx * wide * 0.4, sy * long * 0.36, top - 0.1), 0.05,
                        0.05, frame) for sx in (-1, 1) for sy in (-1, 1)]  # fmt: skip
    else:
        parts += [box((wide * 0.9, long * 0.7, 0.08), (0, 0, 0.06), frame, 0.01),
                  box((0.3, 0.4, top - 0.2), (0, 0, top / 2 - 0.03), surface(rng, "dark", "metal"))]  # fmt: skip
    if rng.random() < 0.6:
        pillow = box((0.45, 0.28, 0.08), (0, long / 2 - 0.2, top + 0.04), surface(rng, "white", "cloth"), 0.03)
        parts.append(pillow)
    return Built("treatment table", join(*parts), {"top": spot((0, 0, top), size=(wide, long))})


def bed(rng: np.random.Generator, top: float | None = None) -> Built:
    """A bed along y: the head is at +y."""
    top = rng.uniform(0.35, 0.6) if top is None else top
    long, wide, back = rng.uniform(1.95, 2.15), rng.uniform(0.85, 1.7), top + rng.uniform(0.2, 0.7)
    frame, sheets = surface(rng, "wood", "metal", "white", "cloth"), surface(rng, "white", "cloth")
    parts = [box((wide, long, 0.18), (0, 0, top - 0.09), sheets, 0.05),
             box((wide + 0.06, long + 0.06, 0.14), (0, 0, top - 0.22), frame, 0.01),
             box((wide + 0.06, 0.05, back), (0, long / 2 + 0.05, back / 2), frame)]  # fmt: skip
    parts += [box((0.06, 0.06, top - 0.25), (sx * wide * 0.48, sy * long * 0.48, (top - 0.25) / 2), frame)
              for sx in (-1, 1) for sy in (-1, 1)]  # fmt: skip
    for x in (-0.25, 0.25) if wide > 1.2 else (0.0,):
        parts.append(ellipsoid((0.3, 0.2, 0.06), (x * wide, long / 2 - 0.25, top + 0.03), surface(rng, "white"), 12))
    if rng.random() < 0.5:
        parts.append(rod((-wide / 2, -long / 2, 0), (-wide / 2, -long / 2, top + 0.3), 0.02, frame))
    return Built("bed", join(*parts), {"top": spot((0, 0, top), size=(wide, long))})
