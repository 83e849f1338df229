"""A clip that repeats without a seam: where to cut it, and how to close what is left of the gap.

A closed clip ends with the pose that it begins with, as players that jump from the last key to the first expect. The
gap in pose is spread over the whole clip, and the gap in velocity over a short time at either end. A clip that goes
somewhere keeps its way: it repeats from where it got to.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    matrix_from_quat,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
    slerp,
)
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import check_editable, per_channel, placed
from muybridge.motion.editing.root_path import GroundPath, ground_path
from muybridge.wording import counted

Travel = Literal["auto", "keep", "close"]
_FEWEST = 5  # frames: two at either end, whose velocities are matched, and one between them
_MOST_COMPARED = 1500  # frames; of longer clips every n-th at first
_VELOCITY_WEIGHT = 0.1  # seconds: metres of difference that a metre per second counts for
_GOES = 0.05  # of the skeleton's size: a way that is kept
_TURNS = np.radians(15)  # a turn that is kept
_AT_ENDS = 0.4  # seconds over which velocities are matched


@dataclass(frozen=True)
class LoopCut:
    """Where a clip repeats best.

    Attributes:
        start: first frame.
        end: last frame, in which the pose of the first comes back.
        pose_gap: metres, root mean square over the joints, before anything is closed; without place and heading.
        speed_gap: metres per second, likewise.
    """

    start: int
    end: int
    pose_gap: float
    speed_gap: float


def loop(
    motion: Motion, shortest: float | None = None, longest: float | None = None, travel: Travel = "auto"
) -> Motion:
    """Cut a clip where it repeats best, and close it.

    Args:
        motion: Z up.
        shortest: seconds of the loop; None for half of the clip.
        longest: seconds of the loop; None for the whole clip.
        travel: see `close_loop`.

    Raises:
        MuybridgeError: the clip is too short, or the lengths are none of it.
    """
    cut = find_loop(motion, shortest, longest)
    return close_loop(motion.select(slice(cut.start, cut.end + 1)), travel)


def find_loop(motion: Motion, shortest: float | None = None, longest: float | None = None) -> LoopCut:
    """Find the two frames whose poses and velocities agree best, wherever the body is and faces.

    Args:
        motion: Z up.
        shortest: seconds between them; None for half of the clip.
        longest: seconds between them; None for the whole clip.

    Raises:
        MuybridgeError: the clip is too short, or the lengths are none of it.
    """
    check_editable(motion)
    for what, seconds in (("shortest", shortest), ("longest", longest)):
        if seconds is not None and not seconds > 0:
            raise MuybridgeError(f"the {what} loop must last longer than 0 s, not {seconds:g} s")
    last = len(motion) - 1
    low = last // 2 if shortest is None else round(shortest * motion.fps)
    high = last if longest is None else round(longest * motion.fps)
    low = max(low, _FEWEST - 1)
    if last < _FEWEST - 1:
        raise MuybridgeError(f"the clip has {counted(last + 1, 'frame')}, and a loop needs at least {_FEWEST}")
    if low > last:
        raise MuybridgeError(f"a loop of {low / motion.fps:g} s does not fit the clip of {last / motion.fps:g} s")
    if high < low:
        raise MuybridgeError(f"the longest loop ({high / motion.fps:g} s) is shorter than the shortest "
                             f"({low / motion.fps:g} s)")  # fmt: skip
    poses, speeds = _features(motion)
    stride = max(1, -(-len(motion) // _MOST_COMPARED))
    every = np.arange(0, last + 1, stride, dtype=np.intp)
    start, end = _best(poses, speeds, every, every, low, high)
    if stride > 1:
        around = np.arange(-stride, stride + 1, dtype=np.intp)
        start, end = _best(poses, speeds, np.unique(np.clip(start + around, 0, last)),
                           np.unique(np.clip(end + around, 0, last)), low, high)  # fmt: skip
    gaps = [float(np.linalg.norm(x[end] - x[start])) for x in (poses, speeds)]
    return LoopCut(start, end, *gaps)


def _features(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Joint positions and velocities (T, 3 J) seen from the body, over the root of the number of joints."""
    world = motion.joint_positions_world()
    path = ground_path(motion, smoothing=0.0)
    back = matrix_from_quat(quat_from_rotvec(-path.yaw[:, None] * np.array([0.0, 0.0, 1.0])))[:, None]
    seen = world - np.column_stack([path.places, np.zeros(len(motion))])[:, None]
    rates = np.gradient(world, axis=0) * motion.fps
    share = 1 / np.sqrt(world.shape[1])
    poses, speeds = ((back @ x[..., None])[..., 0].reshape(len(motion), -1) * share for x in (seen, rates))
    return poses, speeds


def _best(
    poses: FloatArray, speeds: FloatArray, starts: IndexArray, ends: IndexArray, low: int, high: int
) -> tuple[int, int]:
    features = np.concatenate([poses, _VELOCITY_WEIGHT * speeds], axis=1)
    a, b = features[starts], features[ends]
    cost = (a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2 * a @ b.T
    length = ends[None] - starts[:, None]
    allowed = (length >= low) & (length <= high)
    if not allowed.any():  # between two compared frames: the length nearest to what was asked
        allowed = np.abs(length - low) == np.abs(length - low).min()
    i, j = np.unravel_index(int(np.argmin(np.where(allowed, cost, np.inf))), cost.shape)
    return int(starts[i]), int(ends[j])


def kept_way(motion: Motion, travel: Travel = "auto") -> GroundPath:
    """The steady way over the ground that a loop of this clip keeps: a straight line or an arc from its first place.

    Args:
        motion: Z up.
        travel: see `close_loop`.
    """
    exact = ground_path(motion, smoothing=0.0)
    share = np.linspace(0, 1, len(motion))
    first, last = exact.places[0], exact.places[-1]
    # Whole turns come back by themselves; as part of the way they would be an arc about a centre far away.
    angle = float(np.angle(np.exp(1j * (exact.yaw[-1] - exact.yaw[0]))))
    size = float(np.ptp(motion.skeleton.rest_positions, axis=0).max())
    goes = travel == "keep" or (travel == "auto" and float(np.linalg.norm(last - first)) > _GOES * size)
    turns = travel != "close" and abs(angle) > _TURNS
    yaw = angle * share if turns else np.zeros(len(motion))
    if not turns:
        return GroundPath(first + share[:, None] * (last - first) * float(goes), yaw)
    # The centre about which the turn leads from the first place to the last.
    half = 0.5 * (last - first) * float(goes)
    centre = first + half + np.array([-half[1], half[0]]) / np.tan(angle / 2)
    arm = first - centre
    c, s = np.cos(yaw), np.sin(yaw)
    return GroundPath(centre + np.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]], axis=1), yaw)


def close_loop(motion: Motion, travel: Travel = "auto") -> Motion:
    """Make the last frame of a clip its first one again, and the velocity there one.

    Args:
        motion: Z up; its first and last pose should be much alike (`find_loop`).
        travel: "keep" keeps the way between the first and the last place, so that the clip repeats from where it got
            to; "close" brings the body back to where it began; "auto" keeps a way of more than 5 % of the skeleton's
            size. A turn of more than 15 degrees is kept unless it is "close".

    Raises:
        MuybridgeError: the clip has fewer than five frames.
    """
    check_editable(motion)
    if len(motion) < _FEWEST:
        raise MuybridgeError(f"the clip has {counted(len(motion), 'frame')}, and a loop needs at least {_FEWEST}")
    way = kept_way(motion, travel)
    c, s = np.cos(-way.yaw), np.sin(-way.yaw)
    x, y = way.places.T
    carried = placed(motion, -way.yaw, -np.stack([c * x - s * y, s * x + c * y, 0 * x], axis=1))
    reach = round(_AT_ENDS * motion.fps)
    closed = per_channel(carried, lambda v: _close(v, reach), lambda q: _close_rotations(q, reach))
    return placed(closed, way.yaw, np.column_stack([way.places, 0 * way.yaw]))


def _spread(
    start: FloatArray, second: FloatArray, last_but_one: FloatArray, end: FloatArray, count: int, reach: int
) -> FloatArray:
    """(count, ...) corrections with given values in the two frames at either end, from one end to the other."""
    frames = np.arange(count, dtype=np.float64).reshape(-1, *[1] * start.ndim)
    s = frames / (count - 1)
    out = start + (end - start) * s * s * (3 - 2 * s)
    reach = int(np.clip(reach, 2, (count - 1) // 2))

    def bump(away: FloatArray) -> FloatArray:
        """One in the first frame from the end, zero at the end and from `reach` on, without a corner there."""
        return np.where(away < reach, away * ((1 - away / reach) / (1 - 1 / reach)) ** 2, 0.0)

    return np.asarray(out + (second - out[1]) * bump(frames) + (last_but_one - out[-2]) * bump(count - 1 - frames))


def _close(values: FloatArray, reach: int) -> FloatArray:
    """(T, ...) with the same value, and the same step, at both ends."""
    meet = 0.5 * (values[0] + values[-1])
    step = 0.5 * (values[1] - values[0] + values[-1] - values[-2])
    out = values + _spread(meet - values[0], meet + step - values[1], meet - step - values[-2], meet - values[-1],
                           len(values), reach)  # fmt: skip
    return np.asarray(out)


def _close_rotations(quat: FloatArray, reach: int) -> FloatArray:
    """(T, J, 4) with the same rotation, and the same step, at both ends."""

    def way(a: FloatArray, b: FloatArray) -> FloatArray:
        return rotvec_from_quat(multiply_quat(conjugate_quat(a), b))

    meet = slerp(quat[0], quat[-1], np.full(quat.shape[1], 0.5))
    step = 0.5 * (way(quat[0], quat[1]) + way(quat[-2], quat[-1]))
    after, before = multiply_quat(meet, quat_from_rotvec(step)), multiply_quat(meet, quat_from_rotvec(-step))
    change = _spread(way(quat[0], meet), way(quat[1], after), way(quat[-2], before), way(quat[-1], meet),
                     len(quat), reach)  # fmt: skip
    return continuous_quat(multiply_quat(quat, quat_from_rotvec(change)))
