"""Aids for walking and sitting: wheelchairs, walkers, crutches, canes; and prams."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, spot, surface
from muybridge.train.synthesis.things.objects.seats import back_spot, seat_spot
from muybridge.train.synthesis.things.shapes import (
    Mesh,
    Surface,
    box,
    disc,
    ellipsoid,
    join,
    rod,
    sheet,
    strut,
    tube,
)


def wheel(radius: float, width: float, at: tuple[float, float, float], tyre: Surface, rim: Surface,
          spokes: int = 12, spin_deg: float = 0.0) -> Mesh:  # fmt: skip
    """A wheel about the x axis: tyre, rim, hub and spokes; without spokes a plate."""
    angle = np.radians(np.arange(0, 360, 15 if radius > 0.15 else 30))
    circle = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], -1)
    parts = [tube(circle * (radius - width / 2), width / 2, tyre, 6, closed=True)]
    if spokes == 0:
        parts.append(disc(radius - width / 2, 0.5 * width, (0, 0, 0), rim, 16, (1, 0, 0)))
    else:
        parts.append(tube(circle * (radius - width), 0.3 * width, rim, 4, closed=True))
        parts.append(rod((-0.035, 0, 0), (0.035, 0, 0), 0.02, rim))
        for a in np.radians(spin_deg) + np.arange(spokes) * 2 * np.pi / spokes:
            end = np.array([0, np.cos(a), np.sin(a)]) * (radius - width)
            parts.append(rod((0.02 * (-1) ** int(a * 100), 0, 0), end, 0.0025, rim, 4))
    return join(*parts).moved(at)


def wheelchair(
    rng: np.random.Generator, seat: float | None = None, width: float | None = None, depth: float | None = None
) -> Built:
    """A wheelchair: of a hospital, with arm and high foot rests, or an active one with a low back."""
    seat = rng.uniform(0.45, 0.54) if seat is None else seat
    width = rng.uniform(0.38, 0.48) if width is None else width
    depth = rng.uniform(0.4, 0.46) if depth is None else depth
    frame, pad = surface(rng, "metal", "paint", "dark"), surface(rng, "dark", "cloth", "leather")
    tyre, active = surface(rng, "rubber"), rng.random() < 0.45
    r = rng.uniform(0.28, 0.32)
    y, x, camber = depth / 2 - rng.uniform(0.02, 0.14), width / 2 + 0.05, rng.uniform(0, 8) if active else 0.0
    high, lean = rng.uniform(0.22, 0.34) if active else rng.uniform(0.38, 0.48), rng.uniform(3, 12)
    t = 0.013
    parts = [box((width, depth, 0.05), (0, 0, seat - 0.025), pad, 0.015)]
    back = [sheet(np.stack(np.meshgrid([-width / 2, 0, width / 2], [0.02, high], indexing="ij"), -1)[..., [0, 0, 1]]
                  * [1, 0, 1] + [0, depth / 2, seat], 0.015, pad)]  # fmt: skip
    front, foot = -depth / 2 - rng.uniform(0.02, 0.22), seat - rng.uniform(0.36, 0.42)
    foot = max(foot, 0.06)
    spots = {"seat": seat_spot(seat, width, depth), "back": back_spot(depth / 2 - 0.01, seat, seat + high, width, lean)}
    for side, s in (("L", 1), ("R", -1)):
        w = wheel(r, 0.03, (0, 0, 0), tyre, frame, int(rng.integers(8, 18)))
        w = join(w, tube(_ring(r - 0.03, 0.035 * s), 0.009, frame, 5, closed=True))
        parts.append(w.turned(rot(1, -s * camber)).moved((s * x, y, r)))
        parts.append(wheel(0.07, 0.03, (s * (x - 0.07), front + 0.12, 0.07), tyre, frame, 0))
        parts.append(rod((s * (x - 0.07), front + 0.14, 0.07), (s * (x - 0.05), front + 0.14, seat - 0.06), t, frame))
        parts += [rod((s * width / 2, depth / 2, seat - 0.03), (s * width / 2, -depth / 2, seat - 0.03), t, frame),
                  rod((s * width / 2, -depth / 2, seat - 0.03), (s * (width / 2 - 0.05), front, foot), t, frame),
                  rod((s * width / 2, y, seat - 0.03), (s * x, y, r), t, frame),
                  rod((s * width / 2, y, r), (s * (x - 0.05), front + 0.14, 0.2), t, frame)]  # fmt: skip
        back.append(rod((s * width / 2, depth / 2, seat - 0.2), (s * width / 2, depth / 2, seat + high), t, frame))
        if not active or rng.random() < 0.4:
            grip = rod((s * width / 2, depth / 2, seat + high), (s * width / 2, depth / 2 + 0.1, seat + high), 0.016,
                       surface(rng, "rubber"))  # fmt: skip
            back.append(grip)
            push = np.array([s * width / 2, depth / 2 + 0.07, seat + high])
            push = rot(0, -lean) @ (push - [0, depth / 2, seat]) + [0, depth / 2, seat]
            spots["push" + side] = spot(push, axis=(0, 1, 0))
        if not active:
            top = seat + rng.uniform(0.2, 0.25)
            parts.append(box((0.05, 0.75 * depth, 0.035), (s * (width / 2 + 0.01), 0.03, top), pad, 0.01))
            parts.append(rod((s * (width / 2 + 0.01), -0.28 * depth, seat - 0.04),
                             (s * (width / 2 + 0.01), -0.28 * depth, top), 0.012, frame))  # fmt: skip
            spots["arm" + side] = spot((s * (width / 2 + 0.01), -0.16 * depth, top + 0.018), size=(0.05, 0.6 * depth))
        parts.append(box((width / 2 - 0.03, 0.13, 0.012), (s * (width / 4 - 0.02), front - 0.03, foot), frame, 0.003))
        spots["foot" + side] = spot((s * (width / 4 - 0.01), front - 0.05, foot + 0.006))
        a = np.radians(rng.uniform(35, 105))
        rim = rot(1, -s * camber) @ np.array([0.035 * s, -np.cos(a) * (r - 0.03), np.sin(a) * (r - 0.03)])
        along = np.array([0.0, np.sin(a), np.cos(a)])
        spots["rim" + side] = spot(rim + [s * x, y, r], axis=along, normal=(0, -np.cos(a), np.sin(a)))
    parts.append(join(*back).turned(rot(0, -lean), (0, depth / 2, seat)))
    parts += [rod((-width / 2, y, seat - 0.06), (width / 2, y, 0.25), t, frame),
              rod((width / 2, y, seat - 0.06), (-width / 2, y, 0.25), t, frame)]  # fmt: skip
    return Built("wheelchair", join(*parts), spots)


def _ring(radius: float, x: float) -> np.ndarray:
    angle = np.radians(np.arange(0, 360, 15))
    return np.stack([np.full(24, x), radius * np.cos(angle), radius * np.sin(angle)], -1)


def walker(rng: np.random.Generator, grip: float | None = None) -> Built:
    """A walking frame or a rollator around the origin, where its user stands behind at +y."""
    grip = rng.uniform(0.78, 0.98) if grip is None else grip
    half, frame, t = rng.uniform(0.22, 0.3), surface(rng, "metal", "metal", "paint"), 0.013
    rubber, spots, parts = surface(rng, "rubber"), {}, list[Mesh]()
    front, rear = -0.32, 0.16
    rolls = rng.random() < 0.6
    foot = 0.1 if rolls else 0.0
    for side, s in (("L", 1), ("R", -1)):
        top = [(s * half, front - 0.04, foot), (s * half, front + 0.1, grip - 0.06), (s * half, front + 0.16, grip),
               (s * half, rear - 0.02, grip)]  # fmt: skip
        parts += [
            tube(top, t, frame),
            rod((s * half, rear - 0.1, grip), (s * half, rear + 0.02, grip), 0.018, rubber),
            rod((s * half, rear - 0.08, grip - 0.02), (s * (half + 0.02), rear + 0.02, foot), t, frame),
        ]
        spots["grip" + side] = spot((s * half, rear - 0.04, grip), axis=(0, 1, 0))
        for y in (front - 0.04, rear + 0.02):
            if rolls:
                parts.append(wheel(0.1, 0.03, (s * (half + 0.01), y, 0.1), rubber, frame, 0))
            else:
                parts.append(rod((s * (half + 0.01), y, 0), (s * (half + 0.01), y, 0.05), 0.018, rubber))
    parts += [rod((-half, front, grip * k), (half, front, grip * k), t, frame) for k in (0.45, 0.8)]
    if rolls and rng.random() < 0.7:
        parts.append(box((2 * half, 0.22, 0.03), (0, front + 0.2, 0.55), surface(rng, "dark", "cloth"), 0.01))
    return Built("walker", join(*parts), spots)


def crutch(rng: np.random.Generator, grip: float) -> Built:
    """A forearm or an underarm crutch, or a cane, its handle above the origin."""
    metal, rubber, style = surface(rng, "metal", "wood", "paint"), surface(rng, "rubber"), rng.random()
    parts = [rod((0, 0, 0), (0, 0, grip), 0.012, metal), rod((0, 0, 0), (0, 0, 0.05), 0.02, rubber, 8),
             rod((0, 0.03, grip), (0, -0.08, grip), 0.017, rubber)]  # fmt: skip
    kind = "cane"
    if style < 0.5:
        kind = "crutch"
        angle = np.radians(np.linspace(-20, 200, 9))
        cuff = np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle) + 0.02, np.full(9, grip + 0.22)], -1)
        grid = np.stack([cuff, cuff + [0, 0, 0.05]], 1)
        parts += [rod((0, 0.0, grip), (0, 0.06, grip + 0.24), 0.011, metal), sheet(grid, 0.005, rubber)]
    elif style < 0.7:
        kind = "crutch"
        parts += [rod((0, -0.07, grip - 0.05), (0, -0.09, grip + 0.42), 0.011, metal),
                  rod((0, 0.05, grip - 0.05), (0, 0.07, grip + 0.42), 0.011, metal),
                  rod((0, -0.12, grip + 0.43), (0, 0.1, grip + 0.43), 0.025, rubber)]  # fmt: skip
    return Built(kind, join(*parts), {"grip": spot((0, -0.035, grip), axis=(0, 1, 0))})


def pram(rng: np.random.Generator, grip: float | None = None) -> Built:
    """A pram or a push chair; its handle is at y = 0 and it is pushed towards -y."""
    grip = rng.uniform(0.9, 1.1) if grip is None else grip
    cover, frame, rubber = surface(rng, "cloth", "dark"), surface(rng, "metal", "dark"), surface(rng, "rubber")
    half, r, big = rng.uniform(0.2, 0.28), rng.uniform(0.08, 0.16), rng.random() < 0.5
    parts = [rod((-half, 0, grip), (half, 0, grip), 0.016, rubber)]
    spots = {side: spot((s * 0.7 * half, 0, grip), axis=(1, 0, 0)) for side, s in (("gripL", 1), ("gripR", -1))}
    for s in (-1, 1):
        parts += [tube([(s * half, 0, grip), (s * half, -0.3, 0.7), (s * half, -0.85, r)], 0.013, frame),
                  rod((s * half, -0.35, 0.65), (s * half, -0.3, r), 0.013, frame),
                  wheel(r, 0.04, (s * (half + 0.03), -0.3, r), rubber, frame, 8),
                  wheel(r, 0.04, (s * (half + 0.03), -0.85, r), rubber, frame, 8)]  # fmt: skip
    if big:
        parts.append(box((2 * half, 0.75, 0.22), (0, -0.65, 0.62), cover, 0.08))
        hood = ellipsoid((half, 0.28, 0.26), (0, -0.45, 0.72), cover, 14)
    else:
        parts += [box((2 * half, 0.35, 0.05), (0, -0.65, 0.5), cover, 0.02),
                  box((2 * half, 0.05, 0.5), (0, -0.44, 0.72), cover, 0.02).turned(rot(0, -18), (0, -0.45, 0.5)),
                  strut((0, -0.85, 0.48), (0, -0.98, 0.2), 2 * half, 0.03, cover)]  # fmt: skip
        hood = ellipsoid((half, 0.25, 0.2), (0, -0.4, 0.9), cover, 14)
    return Built("pram", join(*parts, hood), spots)
