"""A style from examples: the axes that joints move about, how far they go, and a mixture of Gaussians of the angles."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.ik.pose_prior import PosePrior, fit_prior
from muybridge.geometry.numerics.rotations import exp_so3, log_so3, matrix_from_quat, quat_from_matrix
from muybridge.motion.style.examples import PARTS, Examples
from muybridge.motion.style.model import Style, angles_about
from muybridge.wording import counted

_FEWEST = 8  # different poses
_STILL = 2e-3  # radians: an angle that ranges over less does not move
_COUNTS = (1, 2, 4, 8, 12)  # of components that are tried
_FLOORS = (0.05, 0.1, 0.15)  # radians
_FOLDS = 3
_PER_COMPONENT = 20  # examples, at least
# Hinges of a bending joint stop where the limb is straight, since no example shows what lies beyond.
_BENDS = {"forearm": ("upper_arm", "hand"), "shin": ("thigh", "foot")}
# Ball joints that turn a limb toward its goal, about whatever axis: a take of a walk straight ahead does not show all.
_BALLS = ("thigh", "upper_arm", "spine", "chest", "upper_chest")
_NEARLY_STRAIGHT = np.radians(12)


@dataclass(frozen=True)
class StyleOptions:
    """How a style is learned.

    Attributes:
        components: Gaussians of the mixture; None chooses by the likelihood of takes that are left out, or of parts
            where there are fewer than three takes.
        floor: radians, added in square to every variance, since examples never cover everything; None chooses it in
            the same way.
        margin: radians beyond the examples' range that an angle may take to meet a goal.
        seed: of the mixture's first centres.
    """

    components: int | None = None
    floor: float | None = None
    margin: float = 1.0
    seed: int = 0


def learn_style(
    examples: Examples, roles: Mapping[str, int] | None = None, options: StyleOptions | None = None
) -> Style:
    """The style of examples.

    Args:
        examples: of one skeleton.
        roles: role -> joint: by these names goals can be given, and elbows and knees do not bend backward.
        options: see StyleOptions.

    Raises:
        MuybridgeError: too few different poses, or none in which a joint turns.
    """
    options, roles = options or StyleOptions(), dict(roles or {})
    skeleton = examples.skeleton
    if len(examples) < _FEWEST:
        raise MuybridgeError(f"{', '.join(examples.takes)}: {counted(len(examples), 'different pose')}; a style needs "
                             f"at least {_FEWEST}")  # fmt: skip
    turns = matrix_from_quat(examples.quat_wxyz)
    balls = {j for role, j in roles.items() if role.removeprefix("left_").removeprefix("right_") in _BALLS}
    joints: list[int] = []
    axes, angles, names = [], [], []
    means = np.tile(np.eye(3), (len(skeleton), 1, 1))
    for j in range(1, len(skeleton)):
        means[j], own = _principal_axes(turns[:, j])
        theta = angles_about(means[j], own, turns[:, j])
        for k in np.flatnonzero((np.ptp(theta, axis=0) > _STILL) | (j in balls)):
            joints.append(j)
            axes.append(own[:, k])
            angles.append(theta[:, k])
            names.append(f"{skeleton.names[j]}.{k}")
    if not joints:
        raise MuybridgeError(f"{', '.join(examples.takes)}: no joint turns")
    theta = np.stack(angles, axis=1)
    prior = _fitted(tuple(names), theta, examples, options)
    style = Style(
        skeleton.names, skeleton.parents, skeleton.offsets, roles, quat_from_matrix(means),
        np.array(joints, dtype=np.intp), np.array(axes), theta.min(axis=0) - options.margin,
        theta.max(axis=0) + options.margin, prior, examples.takes, len(examples),
    )  # fmt: skip
    _stop_at_straight(style, theta)
    return style


def _principal_axes(turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean (3, 3) of rotations (T, 3, 3), and the axes (3, 3, columns) that they turn about, relative to it.

    The second axis is that of least movement: the second of three angles is the one that must stay within 90 degrees.
    """
    u, _, v = np.linalg.svd(turns.sum(axis=0))
    mean = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    vectors = log_so3(mean.T @ turns)
    _, columns = np.linalg.eigh(vectors.T @ vectors)
    first, second = columns[:, 2], columns[:, 0]
    return mean, np.stack([first, second, np.cross(first, second)], axis=1)


def _fitted(names: tuple[str, ...], theta: FloatArray, examples: Examples, options: StyleOptions) -> PosePrior:
    """The mixture; of all counts of components and floors those that make left-out examples likeliest."""
    fold = examples.part // PARTS % _FOLDS if len(examples.takes) >= _FOLDS else examples.part % _FOLDS

    def likely(count: int, floor: float) -> float:
        total = 0.0
        for k in np.unique(fold):
            seen = theta[fold != k]
            if len(seen) >= count:
                total += fit_prior(names, seen, count, floor, options.seed).log_density(theta[fold == k]).sum()
        return total

    count, floor = options.components, options.floor
    if count is None:
        most = max(1, len(theta) // _PER_COMPONENT)
        count = max((c for c in _COUNTS if c <= most), key=lambda c: likely(c, floor or _FLOORS[1]))
    count = min(count, len(theta))
    if floor is None:
        floor = max(_FLOORS, key=lambda f: likely(count, f))
    return fit_prior(names, theta, count, floor, options.seed)


def _stop_at_straight(style: Style, theta: FloatArray) -> None:
    """Narrow the limits of elbows and knees to where the limb is straight, but never into the examples' range."""
    for role, joint in style.roles.items():
        side, _, part = role.partition("_")
        before, behind = (style.roles.get(f"{side}_{p}") for p in _BENDS.get(part, ("", "")))
        hinges = np.flatnonzero(style.hinge_joints == joint)
        if before is None or behind is None or not len(hinges):
            continue
        k = int(hinges[0])
        at = np.radians(np.arange(-180, 180))
        bend = _bend(style, joint, behind, k, at)
        straight = int(np.argmin(bend))
        if bend[straight] > _NEARLY_STRAIGHT:
            continue
        if at[straight] > theta[:, k].mean():
            style.upper[k] = min(style.upper[k], max(at[straight], theta[:, k].max()))
        else:
            style.lower[k] = max(style.lower[k], min(at[straight], theta[:, k].min()))


def _bend(style: Style, joint: int, behind: int, hinge: int, angles: FloatArray) -> FloatArray:
    """(A,) radians between the two bones of a limb, with one angle as given and the others at the mean."""
    mean = matrix_from_quat(style.mean_wxyz)
    turned = mean[joint] @ exp_so3(angles[:, None] * style.hinge_axes[hinge])
    bone, chain = np.zeros(3), []
    j = behind
    while j != joint:
        chain.append(j)
        j = style.parents[j]
    for j in chain:
        bone = style.offsets[j] + mean[j] @ bone if j != behind else style.offsets[j]
    upper = style.offsets[joint] / np.linalg.norm(style.offsets[joint])
    lower = (turned @ bone) / np.linalg.norm(bone)
    return np.asarray(np.arccos(np.clip(lower @ upper, -1.0, 1.0)))
