"""Horses, dogs and other four-legged animals, from ellipsoids and capsules."""

import numpy as np

from muybridge.train.synthesis.motions.rig import rot
from muybridge.train.synthesis.things.built import Built, spot, surface
from muybridge.train.synthesis.things.shapes import Mesh, Surface, box, capsule, ellipsoid, join, rod, tube


def _leg(rng: np.random.Generator, hip: np.ndarray, thick: float, coat: Surface, hoof: Surface, swing: float,
         hind: bool) -> Mesh:  # fmt: skip
    """A leg down to z = 0, bent at elbow and knee; `swing` degrees forward."""
    high, bend = float(hip[2]), (1 if hind else -1) * rng.uniform(2, 10)
    knee = hip + rot(0, swing) @ np.array([0, 0.04 * bend / 5 * high, -0.5 * high])
    foot = np.array([hip[0], hip[1] - np.tan(np.radians(swing)) * high * 0.9, 0.0])
    fetlock = foot + [0, 0.015 * high, 0.1 * high]
    return join(
        capsule(hip, knee, (1.5 * thick, 0.75 * thick), coat),
        capsule(knee, fetlock, (0.7 * thick, 0.45 * thick), coat, 8),
        capsule(fetlock, foot + [0, 0, 0.03 * high], (0.5 * thick, 0.62 * thick), hoof, 8),
    )


def _quadruped(
    rng: np.random.Generator, back: float, long: float, girth: float, neck: np.ndarray, head: float, coat: Surface
) -> tuple[list[Mesh], np.ndarray]:
    """Body, legs and head of an animal that faces -y; returns its parts and where the head begins."""
    dark = surface(rng, "dark")
    chest, rump = np.array([0, -0.36 * long, back - girth]), np.array([0, 0.36 * long, back - 0.92 * girth])
    parts = [ellipsoid((0.82 * girth, 0.46 * long, girth), (0, 0, back - girth), coat, 18),
             ellipsoid((0.84 * girth, 0.24 * long, 1.02 * girth), rump + [0, 0, -0.02], coat, 14),
             ellipsoid((0.7 * girth, 0.22 * long, 0.98 * girth), chest + [0, 0.04 * long, 0], coat, 14)]  # fmt: skip
    thick, walking = 0.2 * girth, rng.random() < 0.6
    for s in (-1, 1):
        for hind, y in ((False, -0.38 * long), (True, 0.4 * long)):
            hip = np.array([s * 0.48 * girth, y, back - 1.35 * girth])
            swing = rng.uniform(-18, 18) if walking else rng.uniform(-3, 3)
            parts.append(_leg(rng, hip, thick * (1.35 if hind else 1.1), coat, dark, swing, hind))
    poll = chest + [0, -0.1 * long, 0.35 * girth] + neck
    parts.append(capsule(chest + [0, -0.02 * long, 0.3 * girth], poll, (0.62 * girth, 0.36 * girth), coat, 12))
    nose = poll + rot(0, rng.uniform(-12, 14)) @ np.array([0, -0.75, -0.55]) * head
    parts.append(capsule(poll, nose, (0.36 * head, 0.2 * head), coat, 12))
    for s in (-1, 1):
        parts += [
            capsule(
                poll + [s * 0.18 * head, 0.05 * head, 0.25 * head],
                poll + [s * 0.24 * head, 0.02 * head, 0.6 * head],
                (0.1 * head, 0.03 * head),
                coat,
                8,
            ),
            ellipsoid((0.05 * head,) * 3, poll + [s * 0.33 * head, -0.2 * head, 0.02 * head], dark, 8),
        ]
    return parts, nose


def horse(rng: np.random.Generator, back: float | None = None, stirrup: float = 0.75) -> Built:
    """A horse or a pony with saddle and bridle.

    Args:
        rng: source of random numbers.
        back: height of the back, metres.
        stirrup: metres from the saddle down to the stirrups.
    """
    back = rng.uniform(1.15, 1.65) if back is None else back
    coat, mane = surface(rng, "fur"), surface(rng, "fur", "dark")
    long, girth = back * rng.uniform(0.95, 1.08), back * rng.uniform(0.19, 0.225)
    neck = rot(0, rng.uniform(-20, 25)) @ np.array([0, -0.34, 0.3]) * back
    parts, nose = _quadruped(rng, back, long, girth, neck, 0.3 * back, coat)
    chest = np.array([0, -0.42 * long, back - 0.6 * girth])
    line = chest + np.linspace(0.1, 1, 6)[:, None] * neck + [0, 0.1, 0.16 * girth]
    parts.append(tube(line, np.linspace(0.05, 0.03, 6) * back, mane, 6, flat=0.4))
    rump = np.array([0, 0.5 * long, back - 0.5 * girth])
    tail = [rump, rump + [0, 0.12, -0.05], rump + [0, 0.17, -0.3], rump + [0, 0.13, -0.55 * back]]
    parts.append(tube(tail, [0.03, 0.05, 0.06, 0.02], mane, 7))
    leather = surface(rng, "leather", "dark")
    y, top = -0.06 * long, back + 0.03
    parts += [ellipsoid((0.8 * girth, 0.3, 0.1), (0, y + 0.04, back - 0.05), leather, 14),
              ellipsoid((0.5 * girth, 0.08, 0.06), (0, y + 0.28, top + 0.02), leather, 10)]  # fmt: skip
    cloth = surface(rng, "cloth", "white")
    spots = {"saddle": spot((0, y, top), size=(0.16, 0.25))}
    half = 0.84 * girth + 0.04
    for side, s in (("L", 1), ("R", -1)):
        flap = np.array([s * half * 0.96, y - 0.02, back - 0.5 * girth - 0.12])
        parts += [box((0.025, 0.4, 0.42), flap, leather, 0.01),
                  box((0.02, 0.55, 0.4), flap + [-s * 0.015, 0.05, 0.04], cloth, 0.01)]  # fmt: skip
        foot = np.array([s * (half + 0.09), y - 0.03, top - stirrup])
        parts += [rod((s * half, y - 0.03, back - 0.2), foot + [0, 0, 0.12], 0.008, leather, 5),
                  tube([foot + [-0.05, 0, 0], foot + [-0.045, 0, 0.08], foot + [0, 0, 0.12], foot + [0.045, 0, 0.08],
                        foot + [0.05, 0, 0]], 0.007, surface(rng, "metal"), 6, closed=True)]  # fmt: skip
        hand = np.array([s * 0.07, y - 0.38, top + 0.24])
        parts.append(tube([nose + [s * 0.07, 0.08, 0.02], (hand + nose) / 2 - [0, 0, 0.04], hand], 0.007, leather, 5))
        spots["stirrup" + side] = spot(foot)
        spots["rein" + side] = spot(hand, axis=(s * 0.4, 1, 0.3))
    spots["halter"] = spot(nose + [0, 0.06, -0.06])
    return Built("horse", join(*parts), spots)


def dog(rng: np.random.Generator) -> Built:
    """A dog of any size."""
    back = rng.uniform(0.28, 0.75)
    coat = surface(rng, "fur")
    girth = back * rng.uniform(0.16, 0.24)
    neck = rot(0, rng.uniform(-15, 25)) @ np.array([0, -0.18, 0.24]) * back
    long = back * rng.uniform(1.0, 1.35)
    parts, _ = _quadruped(rng, back, long, girth, neck, 0.32 * back, coat)
    rump = np.array([0, 0.5 * long, back - 0.5 * girth])
    tail = rump + rot(0, rng.uniform(-80, 60)) @ np.array([0, 0.42 * back, 0])
    parts.append(capsule(rump, tail, (0.04 * back, 0.02 * back), coat, 8))
    collar = np.array([0, -0.42 * long, back - 0.6 * girth]) + 0.5 * neck
    parts.append(ellipsoid((0.5 * girth, 0.5 * girth, 0.03), collar, surface(rng, "leather", "paint"), 10))
    return Built("dog", join(*parts), {"collar": spot(collar + [0, 0, 0.3 * girth])})
