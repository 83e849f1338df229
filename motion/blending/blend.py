"""One motion between several: registered in time and on the ground, and averaged by weights that may change.

Kovar and Gleicher 2003, "Flexible Automatic Motion Blending with Registration Curves", section 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.constraint_matches import blended_contacts
from muybridge.motion.blending.registration import RegistrationCurve
from muybridge.motion.contacts.find import Contacts, find_contacts
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.planting import Planted, plant_feet
from muybridge.motion.editing.resampling import motion_at
from muybridge.motion.editing.root_path import GroundPath, with_path, without_path

_SUM = 1e-3  # by which weights may miss one: thirds are written as 0.333


@dataclass(frozen=True, eq=False)
class Weights:
    """How much each motion counts, over the blend.

    Attributes:
        values: (K, N) not negative, each row sums to one.
        seconds: (K,) of the blend, at which they hold; None spreads them evenly over the whole of it. Between two they
            change smoothly, before the first and behind the last they stay.
    """

    values: FloatArray
    seconds: FloatArray | None = None

    @classmethod
    def checked(cls, values: Sequence[float] | FloatArray, motions: int, seconds: Sequence[float] = ()) -> "Weights":
        """Weights as a user gives them.

        Args:
            values: a number for each motion, or such numbers for one time after the other.
            motions: how many there are.
            seconds: the times; none spreads several evenly over the blend.

        Raises:
            MuybridgeError: there are more or fewer than the motions and times need, one is negative or not a number,
                they do not sum to one, or the times do not increase.
        """
        flat = np.asarray(values, dtype=np.float64).ravel()
        if not len(flat) or len(flat) % motions:
            raise MuybridgeError(f"{len(flat)} weights do not fit {motions} motions: give one for each, or one for "
                                 "each at several times")  # fmt: skip
        rows = flat.reshape(-1, motions)
        if (bad := ~np.isfinite(flat) | (flat < 0)).any():
            raise MuybridgeError(f"a weight must be a number from 0 to 1, not {flat[bad][0]:g}")
        for row in rows:
            shown = " ".join(f"{w:g}" for w in row)
            if not row.sum() > 0:
                raise MuybridgeError(f"the weights {shown} are all zero; at least one must be above zero")
            if abs(row.sum() - 1) > _SUM:
                right = " ".join(f"{w:.4g}" for w in row / row.sum())
                raise MuybridgeError(f"the weights {shown} sum to {row.sum():g}, not to 1; {right} do")
        times = np.asarray(seconds, dtype=np.float64)
        if len(times) and (len(times) != len(rows) or (np.diff(times) <= 0).any() or not np.isfinite(times).all()):
            raise MuybridgeError(f"{len(rows)} sets of weights need as many times, each later than the one before; "
                                 f"there are {', '.join(f'{t:g}' for t in times)} s")  # fmt: skip
        return cls(rows / rows.sum(axis=1, keepdims=True), times if len(times) else None)

    def at(self, seconds: float, share: float) -> FloatArray:
        """(N,) the weights after some seconds, `share` of the way through the blend."""
        if len(self.values) == 1:
            return np.asarray(self.values[0])
        known = np.linspace(0, 1, len(self.values)) if self.seconds is None else self.seconds
        x = share if self.seconds is None else seconds
        k = int(np.clip(np.searchsorted(known, x, side="right") - 1, 0, len(known) - 2))
        s = float(np.clip((x - known[k]) / (known[k + 1] - known[k]), 0, 1))
        s = s**3 * (10 - 15 * s + 6 * s * s)
        return np.asarray((1 - s) * self.values[k] + s * self.values[k + 1])


@dataclass(frozen=True, eq=False)
class Blended:
    """A blend.

    Attributes:
        motion: the blend, before feet are planted.
        u: (T,) the curve's parameter at each frame.
        weights: (T, N) of the motions.
        frames: (N, T) of the motions.
    """

    motion: Motion
    u: FloatArray
    weights: FloatArray
    frames: FloatArray


def blend_motions(curve: RegistrationCurve, weights: Weights) -> Blended:
    """Average registered motions.

    The blend begins where the first motion does, goes as fast through the curve as the weighted motions do, and its
    way over the ground is made of their weighted steps.

    Args:
        curve: as `register` makes it.
        weights: of its motions.
    """
    u, w = _course(curve, weights)
    frames = curve.frames(u)
    poses, steps = [], []
    for k, motion in enumerate(curve.motions):
        path = curve.path(k, u)
        poses.append(without_path(motion_at(motion, frames[k]), path))
        steps.append(_steps(path))
    shares = 0.5 * (w[1:] + w[:-1])
    step = np.einsum("tn,ntk->tk", shares, np.stack(steps))
    path = _path_of_steps(step, curve.path(0, u[:1]))
    return Blended(with_path(_average(poses, w), path), u, w, frames)


def _course(curve: RegistrationCurve, weights: Weights) -> tuple[FloatArray, FloatArray]:
    """(T,) parameters and (T, N) weights of the frames: while one frame of the blend goes by, so does one of the
    weighted mean of the motions."""
    fps = curve.motions[0].fps
    u, us, rows = curve.start, [], []

    def pace(u: float, n: float) -> float:
        share = (u - curve.start) / (curve.end - curve.start)
        rate = float(weights.at(n / fps, share) @ curve.rates(np.array(min(u, curve.end))))
        return 1 / max(rate, 1e-3)

    while u <= curve.end + 1e-6:
        us.append(min(u, curve.end))
        rows.append(weights.at((len(us) - 1) / fps, (u - curve.start) / (curve.end - curve.start)))
        half = u + 0.5 * pace(u, len(us) - 1)
        u = u + pace(half, len(us) - 0.5)
    return np.array(us), np.stack(rows)


def _steps(path: GroundPath) -> FloatArray:
    """(T - 1, 3) metres ahead and aside, and radians, from each frame of a path to the next one, as seen from it."""
    c, s = np.cos(path.yaw[:-1]), np.sin(path.yaw[:-1])
    x, y = np.diff(path.places, axis=0).T
    return np.stack([c * x + s * y, c * y - s * x, np.diff(path.yaw)], axis=1)


def _path_of_steps(steps: FloatArray, first: GroundPath) -> GroundPath:
    """The inverse of `_steps`."""
    yaw = first.yaw[0] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    moved = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], axis=1)
    return GroundPath(first.places[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)]), yaw)


def _average(poses: Sequence[Motion], weights: FloatArray) -> Motion:
    """The weighted mean (T, N) of motions: of quaternions the normalised one, all in the first one's hemisphere."""
    first = poses[0]
    turns = np.stack([p.quat_wxyz for p in poses])
    turns = turns * np.where((turns * turns[:1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    mean = np.einsum("tn,ntjk->tjk", weights, turns)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=-1, keepdims=True), 1e-12)
    places = np.einsum("tn,ntk->tk", weights, np.stack([p.root_positions_world for p in poses]))
    slides = None
    if first.translations is not None:
        slides = np.einsum("tn,ntsk->tsk", weights, np.stack([np.asarray(p.translations) for p in poses]))
    return replace(first, root_positions_world=places, quat_wxyz=continuous_quat(mean), translations=slides)


def plant_blend(blended: Blended, curve: RegistrationCurve, contacts: Sequence[Contacts] | None = None) -> Planted:
    """Plant the feet of a blend where they stand in the motions that were blended.

    Args:
        blended: the blend.
        curve: the motions.
        contacts: of the motions; None finds them.

    Raises:
        ValueError: legs are not known.
    """
    found = [find_contacts(m) for m in curve.motions] if contacts is None else list(contacts)
    mean = blended.weights.mean(axis=0)
    standing = np.zeros((len(blended.motion), 2, 2), np.bool_)
    for foot in range(2):
        for point in range(2):
            of_motions: list[BoolArray] = [c.contact[:, foot, point] for c in found]
            standing[:, foot, point] = blended_contacts(of_motions, blended.frames, blended.u, blended.weights.T)
    heights = np.array([c.floor.height for c in found])
    clearance = np.einsum("n,nfp->fp", mean, np.stack([c.clearance for c in found]))
    floor = Floor(float(mean @ heights), found[int(np.argmax(mean))].floor.normal)
    return plant_feet(blended.motion, Contacts.of_feet(standing, blended.motion.fps, floor, clearance))
