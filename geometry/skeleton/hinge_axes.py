"""Axes of knees and elbows over a take, and the joint centres behind a marker beside the hinge.

The centre is half a joint's width inward from the marker, at right angles to the line to the joint above: the chord
function of R. B. Davis and others, Human Movement Science 10, 1991 (Plug-in Gait's CHORD). Which way is inward, one
angle about the limb, is constant in the upper bone, which three points determine: the joint above, the marker, and a
marker on the bone (a wand on the thigh, the patella). That angle is found from the whole take: about the true axis the
lower bone flexes and hardly tilts sideways (R. Baker, L. Finney, J. Orr, Human Movement Science 18, 1999), it does not
hyperextend, and where the bone hangs from the pelvis it is near the pelvis' own side. A wand that was placed in the
plane of the axis, as Plug-in Gait asks, counts as well; one that clearly was not is left out.
"""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray

# Sines, standard deviations: of a frame's sideways tilt, and of hyperextension beyond 5 degrees.
_TILT, _BEYOND, _STRAIGHT = 0.05, 0.05, 0.087
# Frames of a take count as so many independent ones: skin moves alike in every stride.
_INDEPENDENT = 3.0
_MOST_FRAMES = 400
_LOOSE = np.radians(8.0)  # how far a thigh turns against the pelvis about its mean
_GRID = np.radians(np.arange(-180.0, 180.0, 2.0))
# Metres, the nearest that a marker may be to the line through the limb to tell how the bone turns, and how far a
# coordinate of it is usually from where it should be.
_OFF_LINE, _PLACED = 0.015, 0.006


@dataclass(frozen=True)
class Hinge:
    """What is known of a hinge before the take.

    Attributes:
        half_width: metres from the marker's middle to the joint's.
        half_width_below: the same of the joint below, whose marker is on the same side; 0 where that is a centre.
        flexes: 1 if the lower bone flexes towards (outward x down the limb), else -1.
        tilt: sine of the usual angle by which the lower bone deviates outward, and tilt_sd its standard deviation.
        wand_sd: radians, how far a marker on the bone usually is from the axis' plane, besides its own
            misplacement, which weighs more near the bone's line; infinite: anywhere.
        side_sd: radians, how far the axis usually is from `side`.
        torsion: radians, by which the axis of the joint below is turned against this one, its outer end towards where
            the lower bone flexes.
        slip: radians, how far skin turns the marker on the upper bone about it from frame to frame; 0: not at all.
    """

    half_width: float
    half_width_below: float
    flexes: float
    tilt: float
    tilt_sd: float
    wand_sd: float
    side_sd: float
    torsion: float = 0.0
    slip: float = 0.0


def unit(vectors: FloatArray) -> FloatArray:
    """(..., 3) of length one; zero stays zero."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def across(vectors: FloatArray, axis: FloatArray) -> FloatArray:
    """What of `vectors` is at right angles to the unit vectors `axis`."""
    return np.asarray(vectors - np.sum(vectors * axis, axis=-1, keepdims=True) * axis)


def chord(above: FloatArray, marker: FloatArray, outward: FloatArray, half_width: float) -> FloatArray:
    """The joint's centre: half a width inward from the marker, at right angles to the line to the joint above.

    Args:
        above, marker: (..., 3) metres: the joint above, and the marker beside this one.
        outward: (..., 3) from the centre towards the marker, roughly.
        half_width: metres.
    """
    reach = above - marker
    length = np.linalg.norm(reach, axis=-1, keepdims=True)
    along = reach / np.maximum(length, 1e-9)
    sine = np.minimum(half_width / np.maximum(length, 1e-9), 0.5)
    # The right angle is at the centre: it lies on the circle over the line from the marker to the joint above.
    return np.asarray(marker - half_width * (np.sqrt(1 - sine**2) * unit(across(outward, along)) - sine * along))


def outward_of(
    hinge: Hinge, above: FloatArray, marker: FloatArray, below: FloatArray, wands: tuple[FloatArray, ...] = (),
    side: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """The direction from a hinge's centre towards its marker, in every frame.

    Args:
        hinge: what is known of it.
        above, marker, below: (T, 3) metres: the joint above, the marker beside the hinge, the marker or joint below.
        wands: (T, 3) metres each, markers on the upper bone; the first that tells how it turns is used.
        side: (T, 3) a direction that is roughly outward, if there is one.

    Returns:
        (T, 3) unit vectors; NaN where nothing tells.
    """
    along = unit(marker - above)
    seen = np.isfinite(along).all(-1) & np.isfinite(below).all(-1)
    limb = above, marker, below
    found = np.full(marker.shape, np.nan)
    for wand in wands:
        far = np.linalg.norm(across(wand - above, along), axis=-1)
        use = seen & np.isfinite(far)
        if use.sum() >= max(3, 0.2 * seen.sum()) and np.median(far[use]) >= _OFF_LINE:
            found = _turned(hinge, limb, along, wand - above, use, side)
            break
    if side is not None and not np.isfinite(found).all():
        # The bone turns against what `side` belongs to, and no marker on it tells how far.
        loose = replace(hinge, wand_sd=np.inf, slip=_LOOSE)
        use = np.asarray(seen & np.isfinite(side).all(-1))
        found = np.where(np.isfinite(found), found, _turned(loose, limb, along, side, use, side))
    return np.where(np.isfinite(found), found, _by_plane(hinge, *limb))


def _turned(
    hinge: Hinge, limb: tuple[FloatArray, FloatArray, FloatArray], along: FloatArray, reference: FloatArray,
    use: BoolArray, side: FloatArray | None,
) -> FloatArray:  # fmt: skip
    """(T, 3) outward: at a constant angle about the limb from (T, 3) `reference`, but for `hinge.slip`."""
    if not use.any():
        return np.full(reference.shape, np.nan)
    off = across(reference, along)
    first = unit(off)
    second = np.cross(along, first)
    far = float(np.median(np.linalg.norm(off[use], axis=-1)))
    one, tilt = _angle(hinge, limb, first, second, far, use, side)
    angle = np.full(len(use), one)
    for start in range(0, len(use) if hinge.slip > 0 else 0, _MOST_FRAMES):
        part = slice(start, start + _MOST_FRAMES)
        here = limb[0][part], limb[1][part], limb[2][part]
        angle[part] += _slipped(hinge, here, first[part], second[part], one, tilt)
    return np.asarray(np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)


def twisted(hinge: Hinge, outward: FloatArray, down: FloatArray) -> FloatArray:
    """(..., 3) the direction outward of the joint below, given this one's and that along the lower bone."""
    return np.asarray(
        np.cos(hinge.torsion) * outward + np.sin(hinge.torsion) * hinge.flexes * np.cross(outward, unit(down))
    )


def _motion(
    hinge: Hinge, above: FloatArray, marker: FloatArray, below: FloatArray, outward: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sines of the lower bone's deviation outward and of its flexion, for outward directions (..., T, 3)."""
    centre = chord(above, marker, outward, hinge.half_width)
    upper = unit(centre - above)
    lower = unit(below - hinge.half_width_below * twisted(hinge, outward, below - centre) - centre)
    axis = unit(across(outward, upper))
    return np.sum(lower * axis, -1), hinge.flexes * np.sum(lower * np.cross(axis, upper), -1)


def _slipped(
    hinge: Hinge, limb: tuple[FloatArray, FloatArray, FloatArray], first: FloatArray, second: FloatArray, angle: float,
    tilt: float,
) -> FloatArray:  # fmt: skip
    """(T,) radians that the marker on the bone has slipped about it: what makes the forearm's tilt that of the take."""
    slips = hinge.slip * np.linspace(-3, 3, 121)[:, None]
    turned = (slips + angle)[..., None]
    tilts, flexion = _motion(hinge, *limb, np.cos(turned) * first + np.sin(turned) * second)
    cost = _robust((tilts - tilt) / _TILT) + (np.maximum(-flexion - _STRAIGHT, 0) / _BEYOND) ** 2
    usual = (slips / hinge.slip) ** 2
    best = np.argmin(np.where(np.isfinite(cost), cost + usual, usual), 0)
    return np.asarray(slips[best, 0])


def _angle(
    hinge: Hinge, limb: tuple[FloatArray, FloatArray, FloatArray], first: FloatArray, second: FloatArray, far: float,
    use: BoolArray, side: FloatArray | None,
) -> tuple[float, float]:  # fmt: skip
    """The angle from `first` to the outward direction, one for the take: the least of a cost over all angles; and the
    sine of the lower bone's usual deviation."""
    frames = np.flatnonzero(use)
    frames = frames[:: max(1, len(frames) // _MOST_FRAMES)]
    a, m, b, x, y = (v[frames] for v in (*limb, first, second))
    out = np.cos(_GRID)[:, None, None] * x + np.sin(_GRID)[:, None, None] * y
    tilt, flexion = _motion(hinge, a, m, b, out)
    independent = min(_INDEPENDENT, float(len(frames)))
    # The usual tilt of this person, between what the take and what other people show.
    trust = independent / _TILT**2
    own = (trust * np.median(tilt, 1) + hinge.tilt / hinge.tilt_sd**2) / (trust + 1 / hinge.tilt_sd**2)
    cost = ((own - hinge.tilt) / hinge.tilt_sd) ** 2
    cost += independent * np.mean(_robust((tilt - own[:, None]) / _TILT), 1)
    cost += independent * np.mean((np.maximum(-flexion - _STRAIGHT, 0) / _BEYOND) ** 2, 1)
    if np.isfinite(hinge.wand_sd):
        cost += _robust(_GRID / np.hypot(hinge.wand_sd, _PLACED / far))
    if side is not None:
        given = side[frames]
        angles = np.arctan2(np.sum(given * y, -1), np.sum(given * x, -1))
        angles = angles[np.isfinite(angles)]
        if angles.size:
            middle = np.arctan2(np.mean(np.sin(angles)), np.mean(np.cos(angles)))
            cost += (_wrapped(_GRID - middle) / hinge.side_sd) ** 2
    best = int(np.argmin(cost))
    before, here, after = cost[best - 1], cost[best], cost[(best + 1) % len(cost)]
    bend = before - 2 * here + after
    part = 0.5 * (before - after) / bend if bend > 0 else 0.0
    return float(_GRID[best] + part * (_GRID[1] - _GRID[0])), float(own[best])


def _robust(ratio: FloatArray, dof: float = 4.0) -> FloatArray:
    """Squared ratio whose growth slows beyond two standard deviations (Student's t)."""
    return np.asarray(dof * np.log1p(ratio**2 / dof))


def _wrapped(angles: FloatArray) -> FloatArray:
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


def _by_plane(hinge: Hinge, above: FloatArray, marker: FloatArray, below: FloatArray) -> FloatArray:
    """Frame by frame: the normal of the limb's plane, NaN where the limb is straight."""
    normal = -hinge.flexes * np.cross(unit(below - marker), unit(marker - above))
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(sine > 2 * _STRAIGHT, unit(normal), np.nan)
