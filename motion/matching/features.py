"""What is compared in motion matching: where a body goes next, its feet, and its velocities.

Clavet 2016, "Motion Matching and The Road to Next-Gen Animation" (GDC); the choice of features is that of Holden,
Kanoun, Perepichka and Popa 2020, "Learned Motion Matching", section 3. All are in the facing frame of their own frame:
its origin is on the floor under the hips, x points where the body faces, y to its left, z up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.material import facing_frames
from muybridge.motion.editing.root_path import GroundPath

NEEDED_ROLES = ("hips", "left_thigh", "right_thigh", "left_foot", "right_foot")
_FEET = ("left_foot", "right_foot")
_LEAST_SPREAD = 0.01  # metres, metres per second or radians: what spreads less is not blown up to count like the rest


@dataclass(frozen=True)
class FeatureOptions:
    """What is compared, and how much it counts.

    Attributes:
        horizons: seconds ahead at which the trajectory is compared, ascending.
        smoothing: seconds, standard deviation of the Gaussian that takes the sway of each step out of the trajectory.
        places: weight of where the trajectory goes.
        facings: weight of where the body faces along it.
        feet: weight of where the feet are.
        foot_velocities: weight of how the feet move.
        hip_velocity: weight of how the hips move.
    """

    horizons: tuple[float, ...] = (0.33, 0.67, 1.0)
    smoothing: float = 0.2
    places: float = 1.0
    facings: float = 1.5
    feet: float = 0.75
    foot_velocities: float = 1.0
    hip_velocity: float = 1.0

    def __post_init__(self) -> None:
        ahead = np.array(self.horizons, dtype=np.float64)
        if not len(ahead) or not np.isfinite(ahead).all() or (np.diff(ahead, prepend=0.0) <= 0).any():
            raise ValueError(f"the horizons must be ascending seconds above zero, not {self.horizons}")
        for name, value in (("smoothing", self.smoothing), *((g.name, g.weight) for g in self.groups)):
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} must be zero or more, not {value:g}")
        if not any(group.weight for group in self.groups):
            raise ValueError("a weight must be above zero")

    @property
    def groups(self) -> tuple["FeatureGroup", ...]:
        """What the columns of the features are, in their order."""
        h = len(self.horizons)
        sizes = (2 * h, 2 * h, 6, 6, 3)
        names = ("places", "facings", "feet", "foot_velocities", "hip_velocity")
        ends = np.cumsum(sizes).tolist()
        return tuple(FeatureGroup(name, slice(end - size, end), float(getattr(self, name)))
                     for name, size, end in zip(names, sizes, ends, strict=True))  # fmt: skip

    @property
    def trajectory(self) -> slice:
        """The columns that say where the body goes; all others say how it is."""
        return slice(0, 4 * len(self.horizons))

    @property
    def width(self) -> int:
        """Columns of the features, `F`."""
        return 4 * len(self.horizons) + 15


@dataclass(frozen=True)
class FeatureGroup:
    """Features of one unit, which are scaled alike.

    Attributes:
        name: of the field of `FeatureOptions` that is its weight.
        columns: of the features.
        weight: how much it counts.
    """

    name: str
    columns: slice
    weight: float


@dataclass(frozen=True, eq=False)
class Scaling:
    """From features as they are to those whose squared distance is compared.

    Attributes:
        mean: (F,) of each column.
        factor: (F,) that a column's difference from the mean is multiplied by: its group's weight over the mean
            standard deviation of the group's columns.
    """

    mean: FloatArray
    factor: FloatArray

    def apply(self, features: FloatArray) -> Float32Array:
        """(..., F) scaled features; float32, as the search compares them."""
        return np.ascontiguousarray((features - self.mean) * self.factor, dtype=np.float32)


def root_frames(
    motions: Sequence[Motion], roles: Mapping[str, int], smoothing: float
) -> tuple[list[GroundPath], float]:
    """The facing frames of motions of one skeleton, smoothed, and how the rest pose faces.

    Args:
        motions: Z up.
        roles: role -> joint; `NEEDED_ROLES` are in it.
        smoothing: seconds.

    Returns:
        The paths, whose yaw is the direction in the world that the body faces (radians from the X axis towards Y); and
        the direction that it faces where the yaw of `facing_frames` is zero.
    """
    paths = [facing_frames(motion, smoothing, roles) for motion in motions]
    rest = 0.0 + 0.0j
    for motion, path in zip(motions, paths, strict=True):
        places = motion.joint_positions_world()
        left = places[:, roles["left_thigh"]] - places[:, roles["right_thigh"]]
        # Ahead is a quarter turn clockwise of the left.
        ahead = np.arctan2(-left[:, 0], left[:, 1])
        rest += np.exp(1j * (ahead - path.yaw)).sum()
    facing = float(np.angle(rest))
    return [GroundPath(path.places, path.yaw + facing) for path in paths], facing


def motion_features(motion: Motion, path: GroundPath, roles: Mapping[str, int], options: FeatureOptions) -> FloatArray:
    """(T, F) the features of every frame, unscaled.

    Behind the last frame, the path goes on as it ends.

    Args:
        motion: Z up.
        path: its facing frames, as `root_frames` gives them.
        roles: role -> joint; `NEEDED_ROLES` are in it.
        options: what is compared.
    """
    ahead = [_ahead(path, horizon * motion.fps) for horizon in options.horizons]
    joints = motion.joint_positions_world()
    down = np.column_stack([path.places, np.zeros(len(motion))])
    parts = [trajectory_features(path.places, path.yaw, np.stack([a.places for a in ahead], axis=1),
                                 np.stack([a.yaw for a in ahead], axis=1))]  # fmt: skip
    feet = [joints[:, roles[foot]] for foot in _FEET]
    parts += [to_facing(place - down, path.yaw) for place in feet]
    parts += [to_facing(_velocity(place, motion.fps), path.yaw) for place in (*feet, joints[:, roles["hips"]])]
    return np.concatenate(parts, axis=1)


def trajectory_features(places: FloatArray, yaw: FloatArray, ahead: FloatArray, ahead_yaw: FloatArray) -> FloatArray:
    """(..., 4H) the first features: places ahead, and cosine and sine of turns ahead, both in the facing frame.

    Args:
        places: (..., 2) metres, of the facing frame.
        yaw: (...) radians, of the facing frame.
        ahead: (..., H, 2) metres in the world, at the horizons.
        ahead_yaw: (..., H) radians.
    """
    away = to_facing(ahead - np.asarray(places)[..., None, :], np.asarray(yaw)[..., None])
    turn = np.asarray(ahead_yaw) - np.asarray(yaw)[..., None]
    facings = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    flat = (*turn.shape[:-1], 2 * turn.shape[-1])
    return np.concatenate([away.reshape(flat), facings.reshape(flat)], axis=-1)


def to_facing(vectors: FloatArray, yaw: FloatArray) -> FloatArray:
    """(..., 2 or 3) vectors of the world in facing frames of the yaw (...)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x, *np.moveaxis(vectors[..., 2:], -1, 0)], axis=-1)


def fit_scaling(features: FloatArray, options: FeatureOptions) -> Scaling:
    """How features (N, F) are scaled: each group by the mean standard deviation of its columns, times its weight."""
    mean, spread = features.mean(axis=0), features.std(axis=0)
    factor = np.empty(features.shape[1])
    for group in options.groups:
        factor[group.columns] = group.weight / max(float(spread[group.columns].mean()), _LEAST_SPREAD)
    return Scaling(mean, factor)


def _ahead(path: GroundPath, frames: float) -> GroundPath:
    """The path so many frames later; behind its end it goes on at the pace of its last frames."""
    count = len(path.yaw)
    at = np.arange(count) + frames
    last = np.column_stack([path.places, path.yaw])
    pace = last[-1] - last[-2] if count > 1 else np.zeros(3)
    known = np.minimum(at, count - 1)
    inside = np.stack([np.interp(known, np.arange(count), column) for column in last.T], axis=1)
    out = inside + np.maximum(at - (count - 1), 0.0)[:, None] * pace
    return GroundPath(out[:, :2], out[:, 2])


def _velocity(places: FloatArray, fps: float) -> FloatArray:
    return np.asarray(np.gradient(places, axis=0) * fps) if len(places) > 1 else np.zeros_like(places)
