"""Where one motion goes over into another best: the frames at which they are most alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.alignment import PlanarTransform, place_at, planar_alignment, point_cloud
from muybridge.motion.blending.distances import dof_distances, point_weights, window_alignments
from muybridge.motion.blending.joins.planting import Feet
from muybridge.motion.contacts.find import Contacts
from muybridge.wording import counted

Measure = Literal["clouds", "dofs"]
_FEWEST = 3  # frames of a motion
_FOOT_M = 0.06  # metres of distance that a foot counts for that stands in one motion alone
_PLANTED = 100.0  # times as much as the whole body a foot counts that stands in both
_TOGETHER_M = 0.03  # of an adult: feet are as far apart in one motion as in the other
_APART_S = 0.15


@dataclass(frozen=True)
class JoinPlace:
    """Where a motion goes over into the next one.

    Attributes:
        leave: the last frame of the first motion.
        enter: the frame of the second one that is at the same time.
        yaw: radians, by which the second one is turned about the world's Z axis.
        shift: metres, by which it is then moved over the ground.
        gap: metres, root mean square distance of the points of both about the join.
    """

    leave: int
    enter: int
    yaw: float
    shift: tuple[float, float]
    gap: float

    def placed(self, motion: Motion) -> Motion:
        """The second motion where it continues the first one."""
        return place_at(motion, self.yaw, np.array(self.shift))


def check_long_enough(motions: Sequence[Motion], names: Sequence[str]) -> None:
    """MuybridgeError where a motion is too short to be joined; the message names it."""
    for motion, name in zip(motions, names, strict=True):
        if len(motion) < _FEWEST:
            raise MuybridgeError(f"{name} has {counted(len(motion), 'frame')}, and a join needs at least {_FEWEST}")


def find_joins(
    first: Motion, second: Motion, overlap: float = 1.0, measure: Measure = "clouds", window: float = 0.2,
    feet: Feet | None = None, contacts: tuple[Contacts, Contacts] | None = None,
    at: tuple[float | None, float | None] = (None, None), margin: int = 0, count: int = 1,
) -> list[JoinPlace]:  # fmt: skip
    """Find the frames at which two motions are most alike, and lay the second one over the first there.

    Args:
        first: which ends with the join.
        second: which goes on from there; the same skeleton and frame rate.
        overlap: seconds at the end of the first motion, and at the beginning of the second, in which the join may be;
            at most half of either.
        measure: "clouds" compares windows of frames as clouds of points, and so velocities too; "dofs" compares single
            frames by the sum over all degrees of freedom.
        window: seconds of such a window.
        feet: of the skeleton, where known.
        contacts: of both motions, where known: a foot should stand in both or in neither, and where it stands in both
            it should stand in one place.
        at: seconds from the beginning of either motion where the join must be; None is free.
        margin: frames that both motions must have on either side of the join, where the overlap has such.
        count: of places, at least 0.15 s apart in one of the motions.

    Returns:
        The best place, and the next best ones.

    Raises:
        MuybridgeError: the overlap is not above zero, or a time is outside of its motion.
    """
    if not overlap > 0:
        raise MuybridgeError(f"the overlap must be longer than 0 s, not {overlap:g} s: nothing would overlap")
    rows = _frames(first, at[0], "first", overlap, margin, from_end=True)
    columns = _frames(second, at[1], "second", overlap, margin, from_end=False)
    half = max(round(0.5 * window * first.fps), 1)
    # Frames beside the overlap belong to the windows of those in it.
    wide = [_widened(f, half, len(m)) for f, m in ((rows, first), (columns, second))]
    pieces = first.select(wide[0]), second.select(wide[1])
    weights = point_weights(first.skeleton)
    inner = np.ix_(np.isin(wide[0], rows), np.isin(wide[1], columns))
    distance = window_alignments(point_cloud(pieces[0]), point_cloud(pieces[1]), half, weights).distance[inner]
    cost = distance
    if measure == "dofs":
        cost = dof_distances(*pieces)[inner]
        cost = cost * (float(distance.mean()) / max(float(cost.mean()), 1e-12))
    if contacts is not None:
        stands = [c.feet[f].astype(np.float64) for c, f in zip(contacts, (rows, columns), strict=True)]
        cost = cost + _FOOT_M**2 * np.abs(stands[0][:, None] - stands[1][None]).sum(axis=-1)
    places = []
    for i, j in _least(cost, max(round(_APART_S * first.fps), 1), count):
        leave, enter = int(rows[i]), int(columns[j])
        yaw, shift = _laid((first, second), (leave, enter), half, weights, feet, contacts)
        gap = float(np.sqrt(distance[i, j]))
        places.append(JoinPlace(leave, enter, yaw, (float(shift[0]), float(shift[1])), gap))
    return places


def _least(cost: FloatArray, apart: int, count: int) -> list[tuple[int, int]]:
    """The cells with the least cost, each so many rows or columns away from those before."""
    left, out = cost.copy(), []
    for _ in range(count):
        i, j = (int(k) for k in np.unravel_index(int(np.argmin(left)), left.shape))
        if not np.isfinite(left[i, j]):
            break
        out.append((i, j))
        left[max(i - apart, 0) : i + apart + 1, max(j - apart, 0) : j + apart + 1] = np.inf
    return out


def _frames(motion: Motion, at: float | None, which: str, overlap: float, margin: int, from_end: bool) -> IndexArray:
    """The frames at which a join may be."""
    last = len(motion) - 1
    if at is not None:
        frame = round(at * motion.fps) if np.isfinite(at) else -1
        if not 0 <= frame <= last:
            raise MuybridgeError(f"the {which} motion of a join lasts from 0 to {last / motion.fps:g} s, and has no "
                                 f"frame at {at:g} s")  # fmt: skip
        return np.array([frame], dtype=np.intp)
    count = int(np.clip(round(overlap * motion.fps), 1, last // 2))
    margin = min(margin, count)
    return np.arange(last - count, last + 1 - margin) if from_end else np.arange(margin, count + 1)


def _widened(frames: IndexArray, half: int, count: int) -> IndexArray:
    return np.arange(max(int(frames[0]) - half, 0), min(int(frames[-1]) + half + 1, count))


def _laid(
    motions: tuple[Motion, Motion], frames: tuple[int, int], half: int, weights: FloatArray,
    feet: Feet | None, contacts: tuple[Contacts, Contacts] | None,
) -> tuple[float, FloatArray]:  # fmt: skip
    """The turn and shift that lay the second motion over the first.

    Where feet stand in both motions, they are laid over each other: both if they are equally far apart, else one, and
    the other one has to take a step.
    """
    before = min(half, *frames)
    after = min(half, *(len(m) - 1 - f for m, f in zip(motions, frames, strict=True)))
    clouds = [
        point_cloud(m.select(slice(f - before, f + after + 1))).reshape(-1, 3)
        for m, f in zip(motions, frames, strict=True)
    ]
    of_points = np.tile(weights, before + after + 1) / (before + after + 1)
    best = planar_alignment(clouds[0], clouds[1], of_points)
    if feet is None or contacts is None:
        return float(best.yaw), best.shift
    poses = [m.select(slice(f, f + 1)) for m, f in zip(motions, frames, strict=True)]
    places = [feet.places(pose)[0].mean(axis=1) for pose in poses]  # (2, 3) of the middle of each foot
    both = np.flatnonzero(contacts[0].feet[frames[0]] & contacts[1].feet[frames[1]])
    least = np.inf
    for chosen in ([both] if len(both) else []) + ([both[:1], both[1:]] if len(both) == 2 else []):
        found = planar_alignment(
            np.concatenate([clouds[0], places[0][chosen]]), np.concatenate([clouds[1], places[1][chosen]]),
            np.append(of_points, np.full(len(chosen), _PLANTED)),
        )  # fmt: skip
        apart = float(np.linalg.norm((places[0] - _moved(places[1], found))[both, :2], axis=1).max())
        if apart < least:
            least, best = apart, found
        if apart < _TOGETHER_M * feet.size:
            break
    return float(best.yaw), best.shift


def _moved(points: FloatArray, by: PlanarTransform) -> FloatArray:
    c, s = np.cos(by.yaw), np.sin(by.yaw)
    x, y = points[:, 0], points[:, 1]
    return np.stack([c * x - s * y + by.shift[0], s * x + c * y + by.shift[1], points[:, 2]], axis=1)
