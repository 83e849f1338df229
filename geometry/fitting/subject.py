"""A person's body proportions and marker offsets, from a marker recording."""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting._kalman_kernel import settle
from muybridge.geometry.fitting.chain import Chain, make_chain
from muybridge.geometry.fitting.gauss_newton import (
    Pose,
    Problem,
    jacobian,
    landmark_positions,
    moved,
)
from muybridge.geometry.fitting.skeleton_fit import Rigging, SkeletonFitOptions, fit_online, solvable
from muybridge.geometry.numerics._numba import compiled
from muybridge.geometry.skeleton.joint_centres import JointCentres
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.geometry.skeleton.statistical_body import MarkerBody, marker_body

_CHI2_3_MEDIAN = 2.366
_FEWEST = 6
# Joints that motion locates; and metres, the error of a centre that is given from elsewhere.
_LIMBS = ("thigh", "shin", "foot", "upper_arm", "forearm")
_GIVEN = 0.04
_HINGED = ("forearm", "shin", "foot")
_ROUNDS = 15  # of Levenberg-Marquardt on one frame, from a pose that is near


@dataclass(frozen=True, eq=False)
class Person:
    """One person with markers.

    Attributes:
        skeleton: with the forearms' rolls.
        rigging: the markers on it.
        sigma: (L,) metres, what a coordinate of each is expected to be off.
        landmarks: (23, 3) metres, BODY23's on their joints.
        markers: index of each marker in SURFACE, -1 for a joint centre that was given.
    """

    skeleton: Skeleton
    rigging: Rigging
    sigma: FloatArray
    landmarks: FloatArray
    markers: IndexArray


@dataclass(frozen=True)
class MarkerFitOptions:
    """How a body is fitted to markers.

    Attributes:
        noise_m: metres, standard deviation of a measured coordinate.
        slack_m: metres, the same of what skin does beyond the table's `soft`.
        student_dof: of Student's t.
        length_m: metres, how far a joint may be from where the statistical body has it.
        limb_m: the same of hips, knees, ankles, shoulders and elbows, which motion locates.
        placement: factor on the table's tolerance of markers' places.
        root_acceleration: metres per second squared, standard deviation of the root's acceleration.
        angular_acceleration: radians per second squared, of every angle's.
        root_velocity: metres per second, holds the root back across gaps.
        angular_velocity: radians per second, the same for angles.
        prior_weight: of the weak prior on angles, against a marker's standard deviation.
        calibration_frames: number of frames that the subject is calibrated on.
        shape_frames: they count as so many independent ones: what skin does is alike in all of them.
        rounds: how often robust weights are taken anew for the whole take.
        steps: Gauss-Newton steps a round.
    """

    noise_m: float = 0.002
    slack_m: float = 0.003
    student_dof: float = 3.0
    length_m: float = 0.0015
    limb_m: float = 0.0015
    placement: float = 0.5
    root_acceleration: float = 12.0
    angular_acceleration: float = 70.0
    root_velocity: float = 3.0
    angular_velocity: float = 12.0
    prior_weight: float = 3.0
    calibration_frames: int = 160
    shape_frames: int = 12
    rounds: int = 3
    steps: int = 2

    def __post_init__(self) -> None:
        for name in ("calibration_frames", "shape_frames", "rounds"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, not {getattr(self, name)}")


class _Shape:
    """The person's unknowns: components, offsets of joints beyond them, places of markers beyond them."""

    def __init__(self, table: MarkerBody, person: Person, centres: JointCentres, options: MarkerFitOptions) -> None:
        self.table, self.person, self.options = table, person, options
        k, j, given = len(table.basis), len(table.names), len(person.markers)
        markers = person.markers
        of_joints, of_markers, _ = table.parts(table.basis)
        size = k + 3 * j + 3 * given
        self.joint_basis, self.marker_basis = np.zeros((j, 3, size)), np.zeros((given, 3, size))
        self.joint_basis[..., :k] = np.moveaxis(of_joints, 0, -1)
        self.marker_basis[markers >= 0, :, :k] = np.moveaxis(of_markers[:, markers[markers >= 0]], 0, -1)
        self.joint_basis[..., k : k + 3 * j] = np.eye(3 * j).reshape(j, 3, 3 * j)
        self.marker_basis[..., k + 3 * j :] = np.eye(3 * given).reshape(given, 3, 3 * given)
        free = np.full((j, 3), options.length_m)
        for i, name in enumerate(table.names):
            if i == 0 or name.endswith(("toe", "roll")):
                free[i] = 1e-6
            elif name.endswith("hand"):
                free[i, 1:] = 1e-6  # the forearm's roll is about the line to the hand
            elif name in centres.names:
                free[i] = _GIVEN
                if name.endswith(_HINGED):
                    # Off the bone's line, a length would count as an angle of the joint above.
                    free[i, np.abs(table.mean[3 * i : 3 * i + 3]) < 1e-3] = 1e-6
            elif name.endswith(_LIMBS):
                free[i] = options.limb_m
        moves = np.where(markers >= 0, options.placement * table.tolerance[markers], 1e-6)
        self.certain = 1.0 / np.concatenate([np.ones(k), free.ravel(), np.repeat(moves, 3)]) ** 2
        # Beyond the two standard deviations that most people are within, sizes grow freely: children and giants.
        self.certain[0] = 0.1
        self.value = np.zeros(size)

    def person_of(self, value: FloatArray) -> Person:
        k, j = len(self.table.basis), len(self.table.names)
        offsets, places, landmarks = self.table.parts(self.table.mean + value[:k] @ self.table.basis)
        offsets = offsets + value[k : k + 3 * j].reshape(j, 3)
        markers = self.person.markers
        on = np.where(markers[:, None] >= 0, places[markers], 0.0) + value[k + 3 * j :].reshape(-1, 3)
        rigging = Rigging(self.person.rigging.joints, on)
        return replace(self.person, skeleton=self.table.skeleton(offsets), rigging=rigging, landmarks=landmarks)

    def fit(self, points: FloatArray, start: Pose, chosen: IndexArray, rounds: int = 10) -> Person:
        """The person by Gauss-Newton on shape and poses together."""
        value = self._first(self.person)
        person = self.person_of(value)
        pose = Pose(start.root[chosen], start.turn[chosen], start.angles[chosen])
        share = min(1.0, self.options.shape_frames / len(chosen))
        scale = 4.0
        for k in range(rounds):
            pose = settle_frames(person, points, pose, self.options)
            problem = fitting_problem(
                person, points, np.isfinite(points[..., 0]).astype(float), scale, 1.0, self.options
            )
            scale, weight = weights(problem, pose, person, points, scale, self.options)
            problem = fitting_problem(person, points, weight, scale, 1.0, self.options)
            step, shift = self._step(problem, pose, value, share)
            value = value + step
            person = self.person_of(value)
            pose = moved(problem, pose, shift)
            if k > 2 and np.abs(step * np.sqrt(self.certain)).max() < 0.02:
                break
        return person

    def _first(self, person: Person) -> FloatArray:
        """The components that scale the mean to the person."""
        k = len(self.table.basis)
        offsets = person.skeleton.offsets.ravel()
        basis = self.table.basis[:, : offsets.size]
        mean = self.table.mean[: offsets.size]
        out = np.zeros(len(self.value))
        out[:k] = np.linalg.solve(basis @ basis.T + 1e-3 * np.eye(k), basis @ (offsets - mean))
        return out

    def _step(self, problem: Problem, pose: Pose, value: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Steps of the shape (S,) and of the poses (T, N)."""
        at, by_pose = jacobian(problem, pose)
        rotations = problem.skeleton.rotations_from_angles(pose.angles)
        rotations[:, 0] = pose.turn
        turns, _ = problem.skeleton.forward(pose.root, rotations)
        carrier, t = problem.landmark_joints, len(pose)
        of_joint = np.zeros((t, len(problem.skeleton), 3, len(value)))
        for j, parent in enumerate(problem.skeleton.parents):
            if parent >= 0:
                of_joint[:, j] = of_joint[:, parent] + turns[:, parent] @ self.joint_basis[j]
        by_shape = (of_joint[:, carrier] + turns[:, carrier] @ self.marker_basis).reshape(t, -1, len(value))
        root_weight = np.sqrt(problem.information[..., 0, 0] * share)
        w = np.repeat(root_weight, 3, axis=1)[..., None]
        a, b = by_pose.reshape(t, w.shape[1], -1) * w, by_shape * w
        off = (problem.targets - at).reshape(t, -1, 1) * w
        n = a.shape[-1]
        prior = np.r_[np.full(6, 1e-6), (problem.prior.ravel() * share)[problem.open_angles]]
        pull = np.zeros((t, n, 1))
        flat = (problem.rest - pose.angles).reshape(t, -1)[:, problem.open_angles]
        pull[:, 6:, 0] = flat * prior[6:]
        at_, ab = np.swapaxes(a, 1, 2), np.swapaxes(a, 1, 2) @ b
        own = at_ @ a + np.eye(n) * prior + np.eye(n) * 1e-3
        gradient = at_ @ off + pull
        both = np.linalg.solve(own, np.concatenate([ab, gradient], 2))
        shape = np.einsum("tis,tir->sr", b, b, optimize=True)
        shape -= np.einsum("tis,tir->sr", ab, both[..., :-1], optimize=True)
        right = np.einsum("tis,ti->s", b, off[..., 0]) - np.einsum("tis,ti->s", ab, both[..., -1])
        step = np.linalg.solve(shape + np.diag(self.certain), right - self.certain * value)
        return step, both[..., -1] - both[..., :-1] @ step


def calibrate_person(
    points: FloatArray, markers: IndexArray, fps: float, options: MarkerFitOptions | None = None,
    centres: JointCentres | None = None,
) -> Person:  # fmt: skip
    """Build, bones and markers' places of the person who wears them; arguments as of `fit_markers`, with the points of
    `centres` behind the markers."""
    options, centres = options or MarkerFitOptions(), centres or JointCentres()
    table = marker_body()
    seen = np.isfinite(points[..., 0])
    if seen.sum(1).max(initial=0) < _FEWEST:
        raise MuybridgeError(
            f"no frame has more than {seen.sum(1).max(initial=0)} known markers; a body needs at least {_FEWEST}"
        )
    person = scaled_person(points, markers, options, centres)
    chosen = _frames(seen, options.calibration_frames)
    start = follow_take(person, points, fps, options)
    shape = _Shape(table, person, centres, options)
    return shape.fit(points[chosen], start, chosen)


def scaled_person(
    points: FloatArray, markers: IndexArray, options: MarkerFitOptions | None = None,
    centres: JointCentres | None = None,
) -> Person:  # fmt: skip
    """The mean body, scaled to the markers; arguments as of `calibrate_person`."""
    table, options, centres = marker_body(), options or MarkerFitOptions(), centres or JointCentres()
    return _person(table, markers, centres, table.mean * _size(table, points, markers), options)


def follow_take(person: Person, points: FloatArray, fps: float, options: MarkerFitOptions) -> Pose:
    """An initial pose of every frame, tracked frame by frame."""
    sigma = float(np.median(person.sigma)) + 0.006
    o = SkeletonFitOptions(sigma, options.student_dof, 20.0, 130.0, options.root_velocity, options.angular_velocity)
    fit = fit_online(person.skeleton, points, fps, person.rigging, o)
    return Pose(fit.motion.root_positions_world.copy(), fit.motion.forward()[:, 0, :3, :3].copy(), fit.angles.copy())


def settle_frames(
    person: Person, points: FloatArray, start: Pose, options: MarkerFitOptions, robust: bool = True
) -> Pose:
    """Every frame independently, from `start`; least squares if not `robust`."""
    skeleton = solvable(person.skeleton, person.rigging)
    table = marker_body()
    chain = make_chain(skeleton, person.rigging.joints, person.rigging.offsets, table.rest, _prior(table, options))
    points = np.ascontiguousarray(points)  # of one layout, or everything is compiled for each
    information = np.where(np.isfinite(points[..., 0]), 1.0 / person.sigma**2, 0.0)
    pose = Pose(start.root.copy(), start.turn.copy(), np.clip(start.angles, skeleton.lower, skeleton.upper))
    pose.angles[:, 0] = start.angles[:, 0]
    _settle_all(chain, pose.root, pose.turn, pose.angles, np.nan_to_num(points), information,
                options.student_dof if robust else 0.0, _ROUNDS)  # fmt: skip
    return pose


@compiled
def _settle_all(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    student_dof: float, rounds: int,
) -> None:  # fmt: skip
    for t in range(len(root)):
        settle(chain, root[t], turn[t], angles[t], targets[t], information[t], student_dof, rounds)


def _prior(table: MarkerBody, options: MarkerFitOptions) -> FloatArray:
    return np.asarray(options.prior_weight / np.maximum(table.spread, 1e-3) ** 2)


def _person(
    table: MarkerBody, markers: IndexArray, centres: JointCentres, vector: FloatArray, options: MarkerFitOptions
) -> Person:
    offsets, places, landmarks = table.parts(vector)
    joints = [table.names.index(n) for n in centres.names]
    rigging = Rigging(
        np.concatenate([table.carrier[markers], joints]).astype(np.intp),
        np.concatenate([places[markers], np.zeros((len(joints), 3))]),
    )
    sigma = np.sqrt(options.noise_m**2 + options.slack_m**2 + table.soft[markers] ** 2)
    order = np.concatenate([markers, np.full(len(joints), -1)]).astype(np.intp)
    return Person(table.skeleton(offsets), rigging, np.concatenate([sigma, centres.sigma]), landmarks, order)


def _size(table: MarkerBody, points: FloatArray, markers: IndexArray) -> float:
    """Size relative to the mean: median over pairs of markers on one bone or on two that meet."""
    offsets, places, _ = table.parts(table.mean)
    joints = table.carrier[markers]
    at = table.skeleton(offsets).rest_positions[joints] + places[markers]
    ratios = []
    for a in range(len(markers)):
        for b in range(a):
            near = joints[a] == joints[b] or joints[b] in (table.parents[joints[a]],)
            near |= table.parents[joints[b]] == joints[a]
            length = float(np.linalg.norm(at[a] - at[b]))
            if not near or length < 0.1:
                continue
            apart = np.linalg.norm(points[:, a] - points[:, b], axis=-1)
            if np.isfinite(apart).sum() >= max(3, len(apart) // 20):
                ratios.append(float(np.nanmedian(apart)) / length)
    return float(np.clip(np.median(ratios), 0.3, 1.6)) if ratios else 1.0


def _frames(seen: BoolArray, most: int) -> IndexArray:
    """At most `most` frames spread over the take, the fullest of each stretch."""
    count = seen.sum(1)
    edges = np.linspace(0, len(seen), min(most, len(seen)) + 1).astype(int)
    chosen = [a + int(np.argmax(count[a:b])) for a, b in zip(edges, edges[1:], strict=False) if b > a]
    return np.array([t for t in chosen if count[t] >= _FEWEST], dtype=np.intp)


def fitting_problem(
    person: Person, points: FloatArray, weight: FloatArray, scale: float, fps: float, options: MarkerFitOptions
) -> Problem:
    table = marker_body()
    skeleton = solvable(person.skeleton, person.rigging)
    size = 6 + 3 * len(skeleton)
    acceleration = np.full(size, (fps**2 / options.angular_acceleration) ** 2)
    acceleration[:3] = (fps**2 / options.root_acceleration) ** 2
    velocity = np.full(size, (fps / options.angular_velocity) ** 2)
    velocity[:3] = (fps / options.root_velocity) ** 2
    known = np.isfinite(points[..., 0])
    information = np.where(known, weight / (scale * person.sigma**2), 0.0)
    return Problem(
        skeleton, person.rigging.joints, person.rigging.offsets, np.where(known[..., None], points, 0.0),
        information[..., None, None] * np.eye(3), np.clip(table.rest, skeleton.lower, skeleton.upper),
        _prior(table, options), acceleration, velocity,
    )  # fmt: skip


def weights(
    problem: Problem, pose: Pose, person: Person, points: FloatArray, scale: float, options: MarkerFitOptions
) -> tuple[float, FloatArray]:
    """Factor on the variances by the median squared distance, and Student's t weights (T, L)."""
    known = np.isfinite(points[..., 0])
    square = np.sum((landmark_positions(problem, pose) - problem.targets) ** 2, axis=-1) / person.sigma**2
    scale = float(np.clip(np.median(square[known]) / _CHI2_3_MEDIAN, 0.1, 400.0))
    weight = (options.student_dof + 3) / (options.student_dof + square / scale)
    return scale, np.where(known, np.minimum(weight, 1.0), 0.0)
