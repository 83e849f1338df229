"""Cars and trucks: simple ones to stand about, and the inside of one around a driver."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, Spot, spot, surface
from muybridge.train.synthesis.things.objects.mobility import wheel
from muybridge.train.synthesis.things.objects.seats import back_spot, seat_spot
from muybridge.train.synthesis.things.shapes import Mesh, box, disc, join, prism, rod, strut, tube


def car(rng: np.random.Generator) -> Built:
    """A car that faces -y, from outside."""
    long, wide, high = rng.uniform(3.4, 4.8), rng.uniform(1.6, 1.85), rng.uniform(1.35, 1.75)
    paint, glass, dark = surface(rng, "paint"), surface(rng, "glass"), surface(rng, "dark")
    belt, floor, r = 0.58 * high, 0.2, rng.uniform(0.29, 0.35)
    a, b = -long / 2, long / 2
    hood, rear = rng.uniform(0.22, 0.3), rng.uniform(0.0, 0.2)
    side = [(a, floor), (b, floor), (b, belt), (a + hood * long, belt + 0.02), (a + 0.05, 0.85 * belt)]
    roof = [(a + hood * long, belt), (b - 0.05, belt), (b - rear * long - 0.15, high), (a + (hood + 0.14) * long, high)]
    inner = [(a + (hood + 0.04) * long, belt + 0.03), (b - 0.2, belt + 0.03), (b - rear * long - 0.25, high - 0.09),
             (a + (hood + 0.15) * long, high - 0.09)]  # fmt: skip
    parts = [
        prism(side, wide, paint, "yz"),
        prism(roof, 0.86 * wide, paint, "yz"),
        prism(inner, 0.865 * wide, glass, "yz"),
    ]
    front = strut(
        (0, a + hood * long + 0.04, belt + 0.04), (0, a + (hood + 0.13) * long, high - 0.05), 0.78 * wide, 0.03, glass
    )
    parts.append(front)
    for y in (a + 0.19 * long, b - 0.2 * long):
        parts += [wheel(r, 0.2, (s * (wide / 2 - 0.08), y, r), surface(rng, "rubber"), surface(rng, "metal"), 0)
                  for s in (-1, 1)]  # fmt: skip
    parts += [box((wide * 0.96, 0.1, 0.16), (0, y, floor + 0.15), dark, 0.03) for y in (a, b)]
    parts += [disc(0.09, 0.05, (s * wide * 0.37, a - 0.01, 0.6 * belt), surface(rng, "white", "glass"), 14, (0, 1, 0))
              for s in (-1, 1)]  # fmt: skip
    edge = spot((wide / 2, 0, 0.9 * belt), axis=(0, 1, 0), normal=(1, 0, 0), size=(wide, long))
    return Built("car", join(*parts), {"side": edge})


def truck(rng: np.random.Generator) -> Built:
    """A truck or a van that faces -y."""
    long, wide, high = rng.uniform(4.5, 6.5), rng.uniform(1.8, 2.3), rng.uniform(2.1, 2.9)
    paint, glass, load = (
        surface(rng, "paint", "white"),
        surface(rng, "glass"),
        surface(rng, "white", "paint", "metal", "cloth"),
    )
    cab, r = rng.uniform(1.4, 1.9), 0.42
    a = -long / 2
    parts = [box((wide, cab, 0.8 * high - 0.4), (0, a + cab / 2, 0.4 * high + 0.2), paint, 0.1),
             box((0.86 * wide, 0.03, 0.27 * high), (0, a - 0.005, 0.6 * high), glass),
             box((wide + 0.01, 0.5 * cab, 0.22 * high), (0, a + 0.45 * cab, 0.62 * high), glass),
             box((wide, long - cab - 0.08, high - 0.6), (0, a + cab + (long - cab) / 2, high / 2 + 0.3), load, 0.02),
             box((0.9 * wide, long, 0.2), (0, 0, 0.5), surface(rng, "dark"))]  # fmt: skip
    for y in (a + 0.5 * cab, long / 2 - 0.9):
        parts += [wheel(r, 0.24, (s * (wide / 2 - 0.12), y, r), surface(rng, "rubber"), surface(rng, "metal"), 0)
                  for s in (-1, 1)]  # fmt: skip
    return Built("truck", join(*parts), {"side": spot((wide / 2, 0, 1.0), normal=(1, 0, 0), size=(wide, long))})


def car_inside(rng: np.random.Generator, size: float, seat: float) -> Built:
    """A seat with belt, wheel, dashboard, door and pillars around a driver; the roof and the other side are open.

    Args:
        rng: source of random numbers.
        size: height of the driver relative to 1.7 m.
        seat: height of the seat over the floor, metres.
    """
    pad, dark, paint = surface(rng, "cloth", "leather", "dark"), surface(rng, "dark"), surface(rng, "paint")
    trim, lean = surface(rng, "dark", "leather", "plastic"), rng.uniform(14, 26)
    w, d, high = 0.5, 0.5, rng.uniform(0.58, 0.68) * max(size, 0.8)
    back = [box((w, 0.12, high), (0, d / 2 + 0.06, seat + high / 2), pad, 0.05),
            box((0.28, 0.09, 0.2), (0, d / 2 + 0.05, seat + high + 0.13), pad, 0.04)]  # fmt: skip
    parts = [
        box((w, d + 0.08, 0.16), (0, 0.0, seat - 0.08), pad, 0.05),
        join(*back).turned(rot(0, -lean), (0, d / 2, seat)),
        box((0.42, 0.45, max(seat - 0.16, 0.04)), (0, 0, max(seat - 0.16, 0.04) / 2), dark),
    ]
    spots: dict[str, Spot] = {"seat": seat_spot(seat, w, d), "back": back_spot(d / 2, seat, seat + high, w, lean)}
    wheel_at = np.array([0, -0.2 - 0.24 * size, seat + rng.uniform(0.3, 0.38) * size])
    tilt, r = rot(0, rng.uniform(15, 35)), rng.uniform(0.17, 0.2)
    angle = np.radians(np.arange(0, 360, 15))
    ring = np.stack([r * np.cos(angle), 0 * angle, r * np.sin(angle)], -1)
    turn = rng.uniform(0, 60)
    steering: list[Mesh] = [
        tube(ring, 0.014, trim, 7, closed=True),
        disc(0.06, 0.04, (0, -0.02, 0), trim, 14, (0, 1, 0)),
    ]
    steering += [rod((0, -0.01, 0), r * np.array([np.cos(q), 0, np.sin(q)]), 0.012, trim, 6)
                 for q in np.radians(turn + np.array([0, 180, 270]))]  # fmt: skip
    parts += [m.turned(tilt.T).moved(wheel_at) for m in steering]
    parts.append(rod(wheel_at, wheel_at + tilt.T @ [0, -0.35, 0], 0.03, dark))
    for side, s in (("L", 1), ("R", -1)):
        q = np.radians(rng.uniform(-10, 65))
        at = np.array([s * r * np.cos(q), 0, r * np.sin(q)])
        along = tilt.T @ np.array([-s * np.sin(q), 0, np.cos(q)])
        spots["wheel" + side] = spot(wheel_at + tilt.T @ at, axis=along, normal=tilt.T @ [0, 1, 0])
        spots["foot" + side] = spot((s * 0.12, -0.42 - 0.36 * size, 0.06))
    dash = wheel_at[1] - 0.25
    parts += [box((1.35, 0.3, 0.25), (-0.35, dash, wheel_at[2] - 0.05), trim, 0.06),
              box((1.5, 1.9, 0.05), (-0.35, -0.25, -0.03), dark)]  # fmt: skip
    out = 0.42
    door = [(dash - 0.1, 0.02), (0.5, 0.02), (0.55, wheel_at[2] - 0.02), (dash - 0.1, wheel_at[2] + 0.02)]
    parts.append(prism(door, 0.06, paint, "yz").moved((out, 0, 0)))
    top = seat + 0.98 * max(size, 0.9)
    parts += [strut((out, dash - 0.15, wheel_at[2]), (out - 0.06, dash + 0.35, top), 0.06, 0.08, paint),
              strut((out, 0.5, wheel_at[2]), (out - 0.06, 0.42, top), 0.06, 0.14, paint),
              strut((out - 0.06, dash + 0.33, top), (out - 0.06, 0.5, top), 0.05, 0.08, paint)]  # fmt: skip
    parts.append(box((0.16, 0.08, 0.11), (out + 0.12, dash, wheel_at[2] + 0.1), paint, 0.03))
    if rng.random() < 0.5:
        parts.append(box((0.9, 1.2, 0.04), (out - 0.5, 0.5, top + 0.02), paint, 0.01))
    spots["sill"] = spot((out, -0.1, wheel_at[2] + 0.01))
    mesh = join(*parts)
    return Built(
        "car seat",
        mesh.moved((0, 0, 0.06)),
        {k: Spot(v.at + [0, 0, 0.06], v.axis, v.normal, v.size) for k, v in spots.items()},
    )
