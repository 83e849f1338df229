"""Bicycles, also on rollers and trainers, and motorbikes; riders face -y."""

from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, Spot, spot, surface
from muybridge.train.synthesis.things.objects.mobility import wheel
from muybridge.train.synthesis.things.shapes import (
    Mesh,
    Surface,
    box,
    capsule,
    disc,
    ellipsoid,
    join,
    lathe,
    rod,
    strut,
    tube,
)


class Fit(NamedTuple):
    """How a bicycle fits its rider: from the bottom bracket up the seat tube to the saddle's top, ahead from the saddle
    to the bar, and the bar over the saddle; metres."""

    saddle: float
    reach: float
    drop: float
    size: float = 1.0


def bicycle(rng: np.random.Generator, fit: Fit | None = None) -> Built:
    """A road, mountain or city bicycle."""
    if fit is None:
        fit = Fit(rng.uniform(0.62, 0.8), rng.uniform(0.45, 0.65), rng.uniform(-0.05, 0.2))
    k = fit.size
    style = int(rng.integers(3))  # road, mountain, city
    paint, metal = surface(rng, "paint", "paint", "dark", "metal"), surface(rng, "metal", "dark")
    rubber = surface(rng, "rubber")
    r, tyre = rng.uniform(0.31, 0.36) * k, (0.025, 0.055, 0.04)[style]
    bracket = np.array([0, 0, r - 0.06 * k])
    rear, front = np.array([0, 0.43 * k, r]), np.array([0, -0.6 * k, r])
    up = np.array([0, np.cos(np.radians(73)), np.sin(np.radians(73))])
    saddle = bracket + up * fit.saddle
    bar = saddle + [0, -fit.reach, fit.drop]
    head = front + np.array([0, 0.33, 0.9]) * ((bar[2] - front[2]) * 0.62 / 0.9)
    top = bracket + up * min(fit.saddle - 0.1, max(head[2] - bracket[2], 0.3))
    t = rng.uniform(0.014, 0.024)
    parts = [
        rod(bracket, saddle - up * 0.03, 0.7 * t, metal),
        rod(bracket, top, t, paint),
        rod(bracket, head, 1.15 * t, paint),
        rod(head + (front - head) * 0.15, head + (bar - head) * 0.9, 1.1 * t, paint),
    ]
    parts.append(rod(top - up * (0.25 if style == 2 else 0.0), head, t, paint))
    for s in (-1, 1):
        parts += [
            rod(bracket + [0.02 * s, 0, 0], rear + [0.05 * s, 0, 0], 0.5 * t, paint),
            rod(top, rear + [0.05 * s, 0, 0], 0.45 * t, paint),
            rod(head + (front - head) * 0.1 + [0.04 * s, 0, 0], front + [0.05 * s, 0, 0], 0.6 * t, paint),
        ]
    parts += [wheel(r, tyre, (float(w[0]), float(w[1]), float(w[2])), rubber, metal, 14, rng.uniform(0, 90))
              for w in (rear, front)]  # fmt: skip
    parts.append(_saddle(saddle, rubber, 0.07 if style < 2 else 0.1))
    spots = {"saddle": spot(saddle, size=(0.12, 0.12))}
    _cranks(rng, parts, spots, bracket, 0.172 * k, metal)
    _handlebar(rng, parts, spots, bar, style, metal, rubber, head)
    if style == 2 and rng.random() < 0.6:
        angle = np.radians(np.linspace(-10, 120, 9))
        for w in (rear, front):
            guard = w + np.stack([0 * angle, np.cos(angle), np.sin(angle)], -1) * (r + 0.02)
            parts.append(tube(guard, 0.02, paint, 5))
    return Built("bicycle", join(*parts), spots)


def _saddle(at: FloatArray, cover: Surface, half: float) -> Mesh:
    nose = capsule(at + [0, -0.12, -0.03], at + [0, 0.06, -0.035], (0.02, 0.03), cover, 8)
    return join(nose, ellipsoid((half, 0.07, 0.03), at + [0, 0.07, -0.03], cover, 10))


def _cranks(
    rng: np.random.Generator, parts: list[Mesh], spots: dict[str, Spot], at: FloatArray, length: float, metal: Surface
) -> None:
    parts += [disc(0.09, 0.008, at + [-0.05, 0, 0], metal, 18, (1, 0, 0)),
              rod(at - [0.06, 0, 0], at + [0.06, 0, 0], 0.02, metal)]  # fmt: skip
    angle = rng.uniform(0, 2 * np.pi)
    for side, s in (("L", 1), ("R", -1)):
        a = angle + (np.pi if s > 0 else 0.0)
        end = at + np.array([s * 0.075, -np.cos(a) * length, np.sin(a) * length])
        parts += [strut(tuple(at + [s * 0.06, 0, 0]), tuple(end), 0.02, 0.025, metal),
                  box((0.09, 0.08, 0.02), end + [s * 0.055, 0, 0], surface(rng, "dark", "metal"), 0.005)]  # fmt: skip
        spots["pedal" + side] = spot(end + [s * 0.06, 0, 0.012])


def _handlebar(rng: np.random.Generator, parts: list[Mesh], spots: dict[str, Spot], bar: FloatArray, style: int,
               metal: Surface, rubber: Surface, head: FloatArray) -> None:  # fmt: skip
    half = rng.uniform(0.19, 0.23) if style == 0 else rng.uniform(0.27, 0.36)
    parts.append(rod(head + (bar - head) * 0.85, bar, 0.016, metal))
    where = rng.random()
    for side, s in (("L", 1), ("R", -1)):
        if style == 0:
            curve = [(0.0, 0, 0), (0.9 * half, 0, 0), (half, -0.04, 0), (half, -0.09, 0.005), (half, -0.12, -0.04),
                     (half, -0.09, -0.1), (half, 0.0, -0.12)]  # fmt: skip
            hoods, drops = np.array([half, -0.1, 0.02]), np.array([half, -0.04, -0.115])
            parts.append(capsule(bar + [s * half, -0.06, 0.0], bar + [s * half, -0.13, 0.03], 0.018, rubber, 8))
            tops = np.array([0.6 * half, 0, 0.0])
            place = hoods if where < 0.55 else drops if where < 0.8 else tops
            axis = (1, 0, 0) if where >= 0.8 else (0, 1, 0)
        else:
            sweep = rng.uniform(0.0, 0.05) if style == 1 else rng.uniform(0.1, 0.2)
            curve = [(0.0, 0, 0), (0.35 * half, 0, 0.02), (half, sweep, 0.02)]
            place, axis = np.array([0.82 * half, 0.82 * sweep, 0.02]), (1.0, 2 * sweep, 0)  # type: ignore[assignment]
            end = bar + np.array([s * half, sweep, 0.02])
            parts.append(rod(bar + place * [0.75 * s, 1, 1], end, 0.017, rubber))
        line = np.array(curve) * [s, 1, 1] + bar
        parts.append(tube(line, 0.0125, metal))
        spots["grip" + side] = spot(place * [s, 1, 1] + bar, axis=np.array(axis) * [s, 1, 1])


def on_rollers(rng: np.random.Generator, bike: Built) -> Built:
    """A bicycle on three rollers, or in a trainer that holds its rear axle."""
    frame, drum = surface(rng, "dark", "metal"), surface(rng, "metal", "dark", "white")
    ys = bike.mesh.vertices[:, 1]
    rear, front = float(ys.max()), float(ys.min())
    r = 0.34
    if rng.random() < 0.55:
        rise = 0.09
        axles = (rear - r + 0.13, rear - r - 0.13, front + r + 0.02)
        parts = [rod((-0.22, y, 0.055), (0.22, y, 0.055), 0.05, drum, 14) for y in axles]
        parts += [box((0.04, axles[0] - axles[2] + 0.2, 0.05), (s * 0.24, (axles[0] + axles[2]) / 2, 0.05), frame)
                  for s in (-1, 1)]  # fmt: skip
    else:
        rise = 0.05
        y = rear - r
        parts = [tube([(s * 0.32, y + 0.3, 0.02), (s * 0.1, y, r + rise), (s * 0.3, y - 0.25, 0.02)], 0.017, frame)
                 for s in (-1, 1)]  # fmt: skip
        parts += [rod((-0.32, y + 0.3, 0.02), (0.32, y + 0.3, 0.02), 0.02, frame),
                  rod((-0.3, y - 0.25, 0.02), (0.3, y - 0.25, 0.02), 0.02, frame),
                  disc(0.13, 0.16, (0, y + 0.28, 0.2), drum, 16, (1, 0, 0)),
                  box((0.2, 0.3, rise), (0, front + r, rise / 2), surface(rng, "dark", "plastic"))]  # fmt: skip
    lifted = bike.placed(0.0, (0, 0, rise))
    return Built("bicycle on rollers", join(lifted.mesh, *parts), lifted.spots)


def motorbike(rng: np.random.Generator, saddle: float | None = None, size: float = 1.0) -> Built:
    """A motorbike or a scooter."""
    saddle = rng.uniform(0.7, 0.86) if saddle is None else saddle
    paint, dark, metal = surface(rng, "paint", "dark"), surface(rng, "dark"), surface(rng, "metal")
    rubber, r, k = surface(rng, "rubber"), rng.uniform(0.26, 0.33) * size, size
    scooter = rng.random() < 0.25
    rear, front = 0.6 * k, -0.78 * k
    bar = np.array([0, -0.52 * k, saddle + rng.uniform(0.1, 0.32)])
    parts = [wheel(r, rng.uniform(0.09, 0.14), (0, y, r), rubber, metal, 0) for y in (rear, front)]
    parts += [capsule((0, 0.02, saddle - 0.06), (0, rear, saddle - 0.03), (0.1, 0.12), dark, 10),
              capsule((0, 0.1, 0.55 * saddle), (0, rear + 0.15, saddle - 0.1), (0.09, 0.07), paint, 10),
              rod((0, front, r), bar - [0, 0.02, 0.02], 0.03, metal),
              capsule((0, front + 0.05, 2 * r + 0.02), (0, front - 0.2, r + 0.22), 0.06, paint, 8),
              ellipsoid((0.09, 0.09, 0.09), bar + [0, -0.12, -0.12], metal, 12)]  # fmt: skip
    if scooter:
        parts += [box((0.36, 0.45, 0.05), (0, -0.25, 0.3), paint, 0.02),
                  box((0.42, 0.05, 0.55), (0, -0.5, 0.6), paint, 0.02).turned(rot(0, 12), (0, -0.5, 0.35))]  # fmt: skip
        pegs, foot_z = -0.25, 0.33
    else:
        parts += [ellipsoid((0.16, 0.27, 0.14), (0, -0.24 * k, saddle + 0.02), paint, 14),
                  box((0.3, 0.4, 0.3), (0, -0.1, 0.42), metal, 0.06),
                  rod((-0.13, -0.1, 0.3), (-0.15, rear + 0.1, 0.38), 0.045, metal, 10),
                  strut((0.1, 0.0, 0.35), (0.1, rear, r), 0.05, 0.06, metal)]  # fmt: skip
        pegs, foot_z = rng.uniform(-0.3, 0.15), rng.uniform(0.28, 0.36)
        if rng.random() < 0.3:
            parts.append(box((0.34, 0.03, 0.3), bar + [0, -0.12, 0.1], surface(rng, "glass"), 0.01))
    spots = {"saddle": spot((0, 0.18, saddle + 0.05), size=(0.2, 0.25))}
    half = rng.uniform(0.3, 0.4)
    for side, s in (("L", 1), ("R", -1)):
        end = bar + np.array([s * half, 0.08, 0])
        parts += [tube([bar, bar + [s * 0.5 * half, 0, 0.02], end], 0.013, metal),
                  rod(bar + (end - bar) * 0.68, end, 0.019, rubber),
                  rod((0, pegs, foot_z), (s * 0.27, pegs, foot_z), 0.014, metal)]  # fmt: skip
        spots["grip" + side] = spot(bar + (end - bar) * 0.85, axis=end - bar)
        spots["foot" + side] = spot((s * 0.2, pegs, foot_z + 0.014))
        if rng.random() < 0.4:
            parts += [rod(bar + [s * 0.2, 0, 0], bar + [s * 0.28, 0, 0.14], 0.006, metal),
                      disc(0.05, 0.015, bar + [s * 0.28, 0, 0.16], dark, 12, (0, 1, 0))]  # fmt: skip
    stand = lathe([(0.02, 0), (0.015, 0.25)], (0.12, 0.1, 0), metal, 6)
    return Built("motorbike", join(*parts, stand), spots)
