"""Seats: chairs, office chairs, stools, benches, sofas, cushions, exercise balls."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, Spot, spot, surface
from muybridge.train.synthesis.things.shapes import (
    Mesh,
    Surface,
    box,
    disc,
    ellipsoid,
    join,
    lathe,
    rod,
    strut,
    tube,
)


def seat_spot(height: float, width: float, depth: float) -> Spot:
    """The place to sit on."""
    return spot((0, 0, height), size=(width, depth))


def back_spot(y: float, low: float, high: float, width: float, lean_deg: float = 0.0) -> Spot:
    """A back rest's front."""
    r = rot(0, -lean_deg)
    return spot((0, y, (low + high) / 2), axis=r @ [0, 0, 1], normal=r @ [0, -1, 0], size=(width, high - low))


def four_legs(
    rng: np.random.Generator, width: float, depth: float, top: float, finish: Surface, splay: float, thick: float
) -> Mesh:
    """Legs below a plate's corners, with stretchers now and then."""
    w, d = width / 2 - thick, depth / 2 - thick
    round_legs = rng.random() < 0.5
    parts = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            a, b = (sx * w, sy * d, top), (sx * (w + splay), sy * (d + splay), 0.0)
            parts.append(rod(b, a, thick / 2, finish) if round_legs else strut(b, a, thick, thick, finish))
    if rng.random() < 0.5:
        h, t = top * rng.uniform(0.25, 0.6), 0.6 * thick
        o = splay * (1 - h / top)
        parts += [strut((s * (w + o), -d - o, h), (s * (w + o), d + o, h), t, t, finish) for s in (-1, 1)]
        parts.append(strut((-w - o, 0, h), (w + o, 0, h), t, t, finish))
    return join(*parts)


def _back(rng: np.random.Generator, width: float, y: float, seat: float, high: float, lean: float,
          frame: Surface, pad: Surface) -> Mesh:  # fmt: skip
    """A back rest: a board, slats, spindles or a padded frame, leaning back."""
    style, t = rng.random(), rng.uniform(0.02, 0.035)
    posts = [strut((s * (width / 2 - t), y, seat - 0.02), (s * (width / 2 - t), y, seat + high), t, t, frame)
             for s in (-1, 1)]  # fmt: skip
    low = rng.uniform(0.12, 0.55) * high
    if style < 0.4:
        posts.append(box((width, t, high - low), (0, y, seat + (high + low) / 2), pad, 0.01))
    elif style < 0.7:
        for z in np.linspace(low, high - 0.03, int(rng.integers(2, 6))):
            posts.append(box((width - t, 0.6 * t, rng.uniform(0.03, 0.07)), (0, y, seat + z), frame))
    else:
        posts.append(box((width, t, 0.06), (0, y, seat + high), frame, 0.01))
        for x in np.linspace(-0.36, 0.36, int(rng.integers(3, 8))) * width:
            posts.append(rod((x, y, seat), (x, y, seat + high), 0.008, frame, 6))
    return join(*posts).turned(rot(0, -lean), (0, y, seat))


def chair(
    rng: np.random.Generator, seat: float | None = None, width: float | None = None, depth: float | None = None
) -> Built:
    """A chair with four legs; arm rests in one of three."""
    seat = rng.uniform(0.40, 0.5) if seat is None else seat
    width = rng.uniform(0.38, 0.52) if width is None else width
    depth = rng.uniform(0.37, 0.48) if depth is None else depth
    frame = surface(rng, "wood", "wood", "metal", "paint", "dark")
    pad = frame if rng.random() < 0.4 else surface(rng, "cloth", "leather", "plastic")
    thick, high, lean = rng.uniform(0.02, 0.07), rng.uniform(0.32, 0.58), rng.uniform(2, 16)
    legs = four_legs(rng, width, depth, seat - thick, frame, rng.uniform(0, 0.05), rng.uniform(0.022, 0.05))
    y = depth / 2 - 0.015
    parts = [legs, box((width, depth, thick), (0, 0, seat - thick / 2), pad, min(0.015, thick / 3)),
             _back(rng, width, y, seat, high, lean, frame, pad)]  # fmt: skip
    spots = {"seat": seat_spot(seat, width, depth), "back": back_spot(y - 0.015, seat, seat + high, width, lean)}
    if rng.random() < 0.35:
        _arm_rests(parts, spots, width / 2 + 0.02, seat, seat + rng.uniform(0.17, 0.25), depth, frame, pad)
    return Built("chair", join(*parts), spots)


def _arm_rests(parts: list[Mesh], spots: dict[str, Spot], x: float, seat: float, top: float, depth: float,
               frame: Surface, pad: Surface) -> None:  # fmt: skip
    for side, sign in (("L", 1), ("R", -1)):
        front = -0.35 * depth
        parts.append(strut((sign * x, front, seat - 0.04), (sign * x, front, top), 0.025, 0.025, frame))
        parts.append(strut((sign * x, 0.45 * depth, seat - 0.04), (sign * x, 0.45 * depth, top), 0.025, 0.025, frame))
        parts.append(box((0.05, 0.9 * depth, 0.025), (sign * x, 0.03, top), pad, 0.008))
        spots["arm" + side] = spot((sign * x, front + 0.07, top + 0.0125), size=(0.05, 0.8 * depth))


def office_chair(
    rng: np.random.Generator, seat: float | None = None, width: float | None = None, depth: float | None = None
) -> Built:
    """A swivel chair on five castors."""
    seat = rng.uniform(0.40, 0.54) if seat is None else seat
    width = rng.uniform(0.44, 0.54) if width is None else width
    depth = rng.uniform(0.4, 0.5) if depth is None else depth
    frame, pad = surface(rng, "dark", "metal", "dark"), surface(rng, "cloth", "dark", "leather")
    lean, high = rng.uniform(3, 18), rng.uniform(0.4, 0.75)
    parts = [
        box((width, depth, 0.08), (0, 0, seat - 0.04), pad, 0.03),
        rod((0, 0, 0.1), (0, 0, seat - 0.08), 0.03, frame),
    ]
    spin = rng.uniform(0, 72)
    for angle in np.radians(spin + np.arange(5) * 72):
        way = np.array([np.cos(angle), np.sin(angle), 0])
        parts.append(strut((0, 0, 0.11), tuple(way * 0.3 + [0, 0, 0.07]), 0.05, 0.03, frame))
        parts.append(ellipsoid((0.025, 0.025, 0.03), way * 0.3 + [0, 0, 0.03], surface(rng, "rubber"), 8))
    y = depth / 2 - 0.01
    back = join(box((0.88 * width, 0.06, high - 0.1), (0, y + 0.02, seat + high / 2 + 0.05), pad, 0.025),
                strut((0, y + 0.06, seat - 0.06), (0, y + 0.06, seat + 0.4), 0.06, 0.02, frame))  # fmt: skip
    parts.append(back.turned(rot(0, -lean), (0, y, seat)))
    spots = {"seat": seat_spot(seat, width, depth), "back": back_spot(y - 0.01, seat + 0.08, seat + high, width, lean)}
    if rng.random() < 0.6:
        _arm_rests(parts, spots, width / 2 + 0.03, seat, seat + rng.uniform(0.18, 0.26), 0.7 * depth, frame, frame)
    return Built("office chair", join(*parts), spots)


def stool(rng: np.random.Generator, seat: float | None = None, width: float | None = None) -> Built:
    """A stool: round or square, on legs or a foot; high ones have a foot rest."""
    seat = rng.uniform(0.38, 0.8) if seat is None else seat
    width = rng.uniform(0.28, 0.42) if width is None else width
    frame, pad = surface(rng, "wood", "metal", "dark"), surface(rng, "wood", "leather", "cloth", "plastic")
    thick = rng.uniform(0.025, 0.09)
    round_seat = rng.random() < 0.65
    spots = {"seat": seat_spot(seat, 0.85 * width, 0.85 * width)}
    if round_seat:
        parts = [disc(width / 2, thick, (0, 0, seat - thick / 2), pad)]
    else:
        parts = [box((width, width, thick), (0, 0, seat - thick / 2), pad, 0.01)]
    rest = seat - rng.uniform(0.36, 0.44)
    if rng.random() < 0.55:
        parts.append(four_legs(rng, 0.8 * width, 0.8 * width, seat - thick, frame, rng.uniform(0.02, 0.08), 0.03))
        if rest > 0.12:
            parts.append(box((0.9 * width, 0.02, 0.02), (0, -0.47 * width, rest), frame))
    else:
        base = rng.uniform(0.18, 0.25)
        parts.append(lathe([(base, 0), (base, 0.012), (0.03, 0.04), (0.025, seat - thick)], (0, 0, 0), frame))
        if rest > 0.12:
            ring = np.radians(np.arange(0, 360, 20))
            loop = np.stack([0.6 * width * np.cos(ring), 0.6 * width * np.sin(ring), np.full(18, rest)], -1)
            parts += [tube(loop, 0.01, frame, 6, closed=True),
                      rod((-0.6 * width, 0, rest), (0.6 * width, 0, rest), 0.008, frame)]  # fmt: skip
    if rest > 0.12:
        for side, sign in (("L", 1), ("R", -1)):
            spots["foot" + side] = spot((sign * 0.25 * width, -0.5 * width, rest + 0.01))
    return Built("stool", join(*parts), spots)


def bench(rng: np.random.Generator, seat: float | None = None, width: float | None = None) -> Built:
    """A bench without a back, or a park bench with one."""
    seat = rng.uniform(0.36, 0.5) if seat is None else seat
    width = rng.uniform(0.9, 2.0) if width is None else width
    depth, t = rng.uniform(0.26, 0.45), rng.uniform(0.025, 0.05)
    top, frame = surface(rng, "wood", "wood", "leather", "stone"), surface(rng, "wood", "metal", "dark", "stone")
    parts = []
    slats = int(rng.integers(1, 6))
    for y in (np.arange(slats) + 0.5) / slats * depth - depth / 2:
        parts.append(box((width, depth / slats - 0.012 * (slats > 1), t), (0, y, seat - t / 2), top, 0.006))
    for s in (-1, 1):
        x = s * width * 0.38
        if rng.random() < 0.5:
            parts.append(box((0.06, 0.9 * depth, seat - t), (x, 0, (seat - t) / 2), frame))
        else:
            parts += [strut((x, sy * depth * 0.45, 0), (x, sy * depth * 0.3, seat - t), 0.04, 0.04, frame)
                      for sy in (-1, 1)]  # fmt: skip
    spots = {"seat": seat_spot(seat, width, depth)}
    if rng.random() < 0.4:
        high, lean, y = rng.uniform(0.35, 0.5), rng.uniform(6, 18), depth / 2
        boards = [box((width, 0.025, 0.1), (0, y, seat + z), top, 0.005) for z in np.linspace(0.14, high - 0.05, 3)]
        boards += [strut((s * width * 0.38, y + 0.02, seat - t), (s * width * 0.38, y + 0.02, seat + high), 0.04,
                         0.03, frame) for s in (-1, 1)]  # fmt: skip
        parts.append(join(*boards).turned(rot(0, -lean), (0, y, seat)))
        spots["back"] = back_spot(y - 0.012, seat, seat + high, width, lean)
    return Built("bench", join(*parts), spots)


def sofa(rng: np.random.Generator, seat: float | None = None, width: float | None = None) -> Built:
    """A sofa or an armchair."""
    seat = rng.uniform(0.36, 0.47) if seat is None else seat
    width = rng.choice([rng.uniform(0.55, 0.7), rng.uniform(1.1, 1.9)]) if width is None else width
    depth, high = rng.uniform(0.5, 0.62), rng.uniform(0.36, 0.65)
    cover, arm, lean = surface(rng, "cloth", "leather"), rng.uniform(0.1, 0.22), rng.uniform(6, 16)
    parts = [box((width, depth + 0.1, seat - 0.16), (0, 0.04, (seat - 0.16) / 2 + 0.04), cover, 0.02)]
    cushions = max(1, round(width / 0.65))
    for x in (np.arange(cushions) + 0.5) / cushions * width - width / 2:
        parts.append(box((width / cushions - 0.008, depth, 0.14), (x, 0, seat - 0.07), cover, 0.04))
    y, top = depth / 2, seat + rng.uniform(0.14, 0.24)
    back = box((width + 2 * arm, 0.2, high + 0.1), (0, y + 0.1, seat + high / 2 - 0.05), cover, 0.06)
    parts.append(back.turned(rot(0, -lean), (0, y, seat)))
    spots = {"seat": seat_spot(seat, width, depth), "back": back_spot(y, seat, seat + high, width, lean)}
    for side, sign in (("L", 1), ("R", -1)):
        x = sign * (width + arm) / 2
        parts.append(box((arm, depth + 0.15, top - 0.05), (x, 0.06, top / 2 + 0.025), cover, 0.04))
        spots["arm" + side] = spot((x, -0.22 * depth, top), size=(arm, depth))
    feet = surface(rng, "wood", "metal")
    parts += [box((0.05, 0.05, 0.05), (sx * (width / 2 - 0.03), sy * depth * 0.4 + 0.04, 0.025), feet)
              for sx in (-1, 1) for sy in (-1, 1)]  # fmt: skip
    return Built("sofa", join(*parts), spots)


def cushion(rng: np.random.Generator) -> Built:
    """A cushion, a pouffe or a low block on the floor."""
    size, high = rng.uniform(0.3, 0.5), rng.uniform(0.06, 0.3)
    cover = surface(rng, "cloth", "leather", "plastic")
    if rng.random() < 0.5:
        body = box((size, 0.9 * size, high), (0, 0, high / 2), cover, 0.35 * high)
    else:
        body = disc(size / 2, high, (0, 0, high / 2), cover)
    return Built("cushion", body, {"seat": seat_spot(high - 0.01, 0.8 * size, 0.8 * size)})


def exercise_ball(rng: np.random.Generator, seat: float | None = None) -> Built:
    """A large ball to sit on, or to exercise with."""
    high = rng.uniform(0.4, 0.7) if seat is None else seat
    ball = ellipsoid((0.52 * high, 0.52 * high, high / 2), (0, 0, high / 2), surface(rng, "plastic", "paint"), 26)
    return Built("exercise ball", ball, {"seat": seat_spot(high - 0.012, 0.3 * high, 0.3 * high)})
