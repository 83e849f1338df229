"""How a body lies in its file: its plane of symmetry, which way is up, which way it faces.

The plane of symmetry is the one that maps most of the volume onto itself. Upwards is the direction at whose start the
plane is free (between the legs) and at whose end it is not (in the head); forwards is where the feet point. Where the
shape says little, the axes of the file's format decide.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.volume import Volume

_SNAP = np.radians(7.0)  # a direction that is nearer to an axis is that axis
_POINTS = 4000
_TRIED = (-9, -6, -3, -1.5, 0, 1.5, 3, 6, 9)  # cells from the middle of all where the plane may lie
_HABIT_UP, _HABIT_FRONT, _HABIT_SIDE = 0.35, 0.6, 0.04  # what the axes of the format are worth against the shape


@dataclass(frozen=True, eq=False)
class Orientation:
    """Where a body's own axes are.

    Attributes:
        body_from_world: (4, 4) to a frame in which it stands on z = 0, faces -Y and is symmetric about x = 0.
        symmetry: share of the volume that the plane maps onto itself.
        notes: what differs from the axes of the format, one sentence each.
    """

    body_from_world: FloatArray
    symmetry: float
    notes: tuple[str, ...]

    @property
    def is_usual(self) -> bool:
        """Whether the body stands and faces as the axes say."""
        return bool(np.allclose(self.body_from_world[:3, :3], np.eye(3)))


def find_orientation(volume: Volume, side: FloatArray | None = None) -> Orientation:
    """The axes of a body, human or animal.

    Args:
        volume: of the body; a coarse one is enough.
        side: (3,) unit normal of the plane of symmetry, where it is known.
    """
    cells = np.argwhere(volume.inside)
    rng = np.random.default_rng(0)
    chosen = cells[rng.permutation(len(cells))[:_POINTS]]
    near = ndimage.binary_dilation(volume.inside)
    points = volume.centres(chosen)
    middle = (volume.centres(cells.min(axis=0)) + volume.centres(cells.max(axis=0))) / 2
    side = _plane(volume, near, points, points.mean(axis=0)) if side is None else side
    every = volume.centres(cells)
    candidates = _ups(side)
    scores = [_upright(every - middle, side, up) + _HABIT_UP * float(up[2]) for up in candidates]
    up = candidates[int(np.argmax(scores))]
    ahead = np.cross(side, up)
    if _ahead(every, side, up, ahead) + _HABIT_FRONT * float(-ahead[1]) < 0:
        ahead = -ahead
    turn = np.stack([np.cross(up, -ahead) * -1.0, -ahead, up])
    turn = np.stack([np.cross(turn[1], turn[2]), turn[1], turn[2]])
    out = np.eye(4)
    out[:3, :3] = turn
    shape = every @ turn.T
    out[2, 3] = -(shape[:, 2].min() - volume.cell / 2)
    offset, symmetry = _offset(volume, near, points, turn[0])
    out[0, 3] = -offset
    return Orientation(out, symmetry, _notes(turn))


def refine_offset(volume: Volume) -> float:
    """Metres, x of the plane of symmetry of a body in its own frame, on a fine volume."""
    cells = np.argwhere(volume.inside)
    points = volume.centres(cells[np.random.default_rng(0).permutation(len(cells))[: 5 * _POINTS]])
    return _offset(volume, volume.inside, points, np.array([1.0, 0.0, 0.0]))[0]


def _mirrored(volume: Volume, near: np.ndarray, points: FloatArray, side: FloatArray, offset: float) -> float:
    """Share of points whose mirror images are inside."""
    image = points - 2 * ((points @ side) - offset)[:, None] * side
    at = np.round((image - volume.origin) / volume.cell).astype(np.int64)
    good = ((at >= 0) & (at < np.array(near.shape))).all(axis=1)
    return float(near[tuple(at[good].T)].sum()) / len(points)


def _plane(volume: Volume, near: np.ndarray, points: FloatArray, middle: FloatArray) -> FloatArray:
    """(3,) unit normal of the plane of symmetry, among directions that are level in some axis."""
    best, out = -1.0, np.array([1.0, 0.0, 0.0])
    for axis in (2, 1, 0):
        first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for degrees in np.arange(0.0, 180.0, 6.0):
            side = np.cos(np.radians(degrees)) * first + np.sin(np.radians(degrees)) * second
            other = np.cross(side, np.eye(3)[axis])
            broad = float(np.tanh(np.log(np.ptp(points @ side) / max(np.ptp(points @ other), 1e-9))))
            score = max(_mirrored(volume, near, points, side, float(middle @ side) + k * volume.cell) for k in _TRIED)
            score += 0.02 * (degrees % 90 == 0)
            score += _HABIT_SIDE * abs(side[0]) ** 4 + 0.03 * broad
            if score > best + 1e-9:
                best, out, plane = score, side, (first, second, degrees)
    first, second, degrees = plane
    fine = np.radians(degrees + np.arange(-6.0, 6.5, 1.0))
    sides = [np.cos(a) * first + np.sin(a) * second for a in fine]
    out = sides[int(np.argmax([_mirrored(volume, near, points, s, float(middle @ s)) for s in sides]))]
    axis_near = int(np.argmax(np.abs(out)))
    if abs(out[axis_near]) > np.cos(_SNAP):
        out = np.eye(3)[axis_near]
    return np.asarray(out / np.linalg.norm(out))


def _ups(side: FloatArray) -> list[FloatArray]:
    """Directions in the plane of symmetry that may be up: an axis of the file and what is square to it."""
    axis = int(np.argmin(np.abs(side) + [0.02, 0.01, 0.0]))
    first = np.eye(3)[axis] - side[axis] * side
    first /= np.linalg.norm(first)
    second = np.cross(side, first)
    return [first, -first, second, -second]


def _upright(points: FloatArray, side: FloatArray, up: FloatArray) -> float:
    """How much a direction looks like upwards: legs apart below, a head above, taller than deep."""
    height, across = points @ up, points @ side
    low, high = np.quantile(height, [0.004, 0.996])
    share = (height - low) / max(float(high - low), 1e-9)
    tall, deep = float(height.std()), float((points @ np.cross(side, up)).std())
    thin = 0.025 * float(np.ptp(points, axis=0).max())
    central = np.abs(across - np.median(across)) < thin
    bins = np.clip((share * 20).astype(int), 0, 19)
    count, free = np.bincount(bins, minlength=20), np.bincount(bins, central, minlength=20)
    empty = free < 0.02 * count
    legs, head = float(empty[0:5].mean()), float((~empty)[17:].mean())
    down = float(empty[15:].mean())
    width = np.array([np.ptp(across[bins == k]) if (bins == k).any() else 0.0 for k in range(20)])
    narrow = float(np.tanh(np.log((width[:2].mean() + 1e-6) / (width[18:].mean() + 1e-6))))
    arms = float(np.tanh((np.argmax(width) / 19 - 0.45) / 0.2))
    return (1.5 * legs + 0.5 * head - down + 0.4 * float(np.tanh(np.log(tall / max(deep, 1e-9))))
            + 0.5 * narrow + 0.3 * arms)  # fmt: skip


def _ahead(points: FloatArray, side: FloatArray, up: FloatArray, ahead: FloatArray) -> float:
    """Evidence above zero where the feet, and the head of a body that is longer than tall, point ahead."""
    height = points @ up
    share = (height - height.min()) / max(float(np.ptp(height)), 1e-9)
    along = points @ ahead
    tall, deep = float(np.ptp(height)), float(np.ptp(along))
    feet, shins = along[share < 0.035], along[(share > 0.05) & (share < 0.1)]
    out = 0.0
    if len(feet) and len(shins):
        out += float(np.tanh((feet.mean() - shins.mean()) / (0.015 * tall)))
    if deep > 1.1 * tall:
        out += 2.0 * float(np.tanh((along[share > 0.85].mean() - along.mean()) / (0.1 * deep)))
    return out


def _offset(volume: Volume, near: np.ndarray, points: FloatArray, side: FloatArray) -> tuple[float, float]:
    """Where the plane of symmetry lies along its normal, and the share that it maps onto the volume."""
    centre, cell = float(np.median(points @ side)), volume.cell
    offsets = centre + np.arange(-10, 10.25, 0.5) * cell
    scores = np.array([_mirrored(volume, near, points, side, o) for o in offsets])
    good = scores >= scores.max() - 1e-3
    return float(offsets[good].mean()), float(scores.max())


def _notes(turn: FloatArray) -> tuple[str, ...]:
    up, ahead = turn[2], -turn[1]
    out = []
    if up[2] < 0.99:
        out.append(f"the body's head points along {_named(up)} of the file, so it was stood up")
    elif ahead[1] > -0.99:
        out.append(f"the body faces {_named(ahead)} of the file, so it was turned to the front")
    return tuple(out)


def _named(direction: FloatArray) -> str:
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0 else "+") + "XYZ"[axis]
