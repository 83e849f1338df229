"""Explanations of what may be wrong with one camera of a rig, each fitted to the observations and scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.calibration.diagnosis.evidence import (
    Dependence,
    dependence_of,
    gain_scores,
    least_score,
    shift_sd,
    size_score,
    view_patterns,
    without_bias,
)
from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions, Kind
from muybridge.geometry.calibration.diagnosis.hypotheses import (
    Correction,
    carried_errors,
    fit_camera,
    fit_shift,
    frames_per_observation,
)
from muybridge.geometry.calibration.diagnosis.setup import (
    Part,
    Setup,
    Take,
    leave_one_out_points,
    rig_errors,
    robust_cost,
    with_correction,
    with_files,
    with_shift,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import student_scale
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate

_PARAMETERS = {"turned": 3, "moved": 6, "focal": 1, "shifted": 1, "swapped": 1}
# Changes that are less certain are not fitted to parts of the observations.
_WORTH_A_LOOK = 2.5
_FEW = 12  # frames
# Up to this many cameras, all permutations of their files are tried.
_ALL_ORDERS = 4
_FREE: dict[Kind, BoolArray] = {
    "turned": np.array([1, 1, 1, 0, 0, 0, 0], dtype=bool),
    "moved": np.array([1, 1, 1, 1, 1, 1, 0], dtype=bool),
    "focal": np.array([0, 0, 0, 0, 0, 0, 1], dtype=bool),
}


@dataclass(frozen=True, eq=False)
class Trial:
    """One explanation and its score.

    Attributes:
        kind: kind of fault.
        cameras: indices of the cameras that it changes.
        setup: the rig with the change applied.
        errors: (C, K, J, 2) of the rig, each part of the observations with the change fitted to another part.
        effect_px: median displacement of the camera's 2D points.
        spread: largest median distance between the 2D points displaced as fitted to one part of the observations and
            as fitted to all, as a share of `effect_px`.
        correction: the fitted change of pose or focal length.
        shift: delay of the video, frames.
        shift_sd: its standard deviation.
        gain: log-likelihood gained over the rig without the change, less the penalty for its parameters, nats.
        certainty: size of the change in its standard deviations, as a Gaussian deviate; infinite where it has no size.
        score: mean gain of the landmarks over its standard error.
        steady: the same of stretches of the take.
        agreed: share of the pairs of other cameras by which a time shift has the same sign and about the same size.
    """

    kind: Kind
    cameras: tuple[int, ...]
    setup: Setup
    errors: FloatArray
    effect_px: float
    spread: float = 0.0
    correction: Correction | None = None
    shift: float = 0.0
    shift_sd: float = 0.0
    certainty: float = np.inf
    gain: float = 0.0
    score: float = 0.0
    steady: float = 0.0
    agreed: float = 1.0


@dataclass(frozen=True)
class Trials:
    """All explanations for a setup.

    Attributes:
        trials: the explanations.
        noise: scale of the setup's own errors, px.
        tried: number of explanations of each kind that were compared.
    """

    trials: tuple[Trial, ...]
    noise: float
    tried: Mapping[Kind, int]


@dataclass(frozen=True)
class FaultSize:
    """Sizes of a fault, not of its correction, with standard deviations.

    Attributes:
        turn, turn_sd: degrees.
        move, move_sd: metres.
        focal, focal_sd: relative error of the focal length.
    """

    turn: float = 0.0
    turn_sd: float = 0.0
    move: float = 0.0
    move_sd: float = 0.0
    focal: float = 0.0
    focal_sd: float = 0.0

    def sizes(self, kind: Kind) -> list[tuple[float, float]]:
        """The sizes that make up a kind of fault, each with its standard deviation."""
        turn, move, focal = (self.turn, self.turn_sd), (self.move, self.move_sd), (self.focal, self.focal_sd)
        return {"turned": [turn], "moved": [turn, move], "focal": [focal]}.get(kind, [])


def fault_size(trial: Trial) -> FaultSize:
    """Rotation, translation and relative focal length error of a trial's fault."""
    if trial.correction is None:
        return FaultSize()
    fix = trial.correction
    (turn, turn_sd), (move, move_sd) = (
        _length(vector, fix.covariance[at, at]) for vector, at in ((fix.turn, slice(0, 3)), (fix.move, slice(3, 6)))
    )
    return FaultSize(
        float(np.degrees(turn)), float(np.degrees(turn_sd)), move, move_sd, 1 / fix.focal - 1, float(fix.sd[6])
    )


def _length(vector: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Length of a (3,) vector, and its standard deviation along itself."""
    length = float(np.linalg.norm(vector))
    along = vector / max(length, 1e-12)
    return length, float(np.sqrt(max(float(along @ covariance @ along), 0.0)))


def search_trials(take: Take, setup: Setup, options: DiagnosisOptions) -> Trials:
    """All explanations for a setup, scored."""
    errors = rig_errors(take, setup)
    cost, noise = robust_cost(errors)
    found = list(_trials(take, setup, options))
    costs = [robust_cost(trial.errors)[0] for trial in found]
    best_errors = errors if not costs or min(costs) >= cost else found[int(np.argmin(costs))].errors
    scale = student_scale((best_errors**2).sum(-1)[np.isfinite(best_errors[..., 0])])
    known = np.isfinite(errors[..., 0])
    views = known.sum() / max(known.any(axis=0).sum(), 1)
    # Triangulation fits three parameters per point, which reduces the residuals' degrees of freedom.
    independent = max(float(known.sum() * (1 - 1.5 / views)) / frames_per_observation(best_errors / scale), 2.0)
    trials = []
    for trial, trial_cost in zip(found, costs, strict=True):
        gain = independent * (cost - trial_cost) - 0.5 * _PARAMETERS[trial.kind] * float(np.log(independent))
        score, steady = gain_scores(errors, trial.errors)
        if trial.kind == "shifted":  # biases hide the gain where the motion goes to and fro, and not where it goes on
            score, steady = max((score, steady), gain_scores(without_bias(errors), without_bias(trial.errors)))
        trials.append(replace(trial, gain=gain, score=score, steady=steady))
    count = len(setup.cameras)
    tried = {kind: count for kind in _FREE} | {
        "shifted": 2 * _most_shift(take, options) * count, "swapped": len(_permutations(count)),
    }  # fmt: skip
    return Trials(tuple(trials), noise, tried)


def _trials(take: Take, setup: Setup, options: DiagnosisOptions) -> Iterator[Trial]:
    """Every explanation with its errors in each part of the observations, held out from the fit."""
    for c in range(len(setup.cameras)):
        points = leave_one_out_points(take, setup, c)
        for kind in _FREE:
            trial = _pose_trial(take, setup, c, points, kind)
            if trial is not None:
                yield trial
        shifted = _shift_trial(take, setup, c, points, _most_shift(take, options))
        if shifted is not None:
            yield shifted
    # Most permutations are clearly worse already in a few frames.
    few = (np.arange(len(take.frames)) % max(1, len(take.frames) // _FEW) == 0, np.ones(take.variance.shape[2], bool))
    cost, _ = robust_cost(rig_errors(take, setup, few))
    for order in _permutations(len(setup.cameras)):
        swapped = with_files(setup, order)
        if robust_cost(rig_errors(take, swapped, few))[0] >= cost:
            continue
        moved = tuple(c for c, k in enumerate(order) if c != k)
        yield Trial("swapped", moved, swapped, rig_errors(take, swapped), np.inf)


def _most_shift(take: Take, options: DiagnosisOptions) -> int:
    """The largest time shift that is tried, frames."""
    return int(min(options.max_shift, take.px.shape[1] // 4))


def _permutations(count: int) -> list[tuple[int, ...]]:
    """Permutations of the cameras' files except the identity: all for few cameras, else all swaps of two."""
    if count <= _ALL_ORDERS:
        return [order for order in permutations(range(count)) if order != tuple(range(count))]
    return [tuple({a: b, b: a}.get(c, c) for c in range(count)) for a, b in combinations(range(count), 2)]


def _held_out_errors(take: Take, setups: list[Setup]) -> FloatArray:
    """(C, K, J, 2) errors of each part of the observations under the setup that was fitted to its opposite."""
    count, _, joints = take.variance.shape
    errors = np.full((count, len(take.frames), joints, 2), np.nan)
    for (_, judged), setup in zip(take.folds, setups, strict=True):
        errors[np.ix_(np.arange(count), *judged)] = rig_errors(take, setup, judged)
    return errors


def _dependence(take: Take, setup: Setup, c: int, points: FloatArray) -> Dependence:
    """How errors of camera c against the points (K, J, 3) of the others depend on each other, the others' included."""
    px, variance = take.all(setup)
    rest = [k for k in range(len(setup.cameras)) if k != c]
    patterns = np.stack([view_patterns(px[k]).reshape(3, -1, 2) for k in rest])
    weights = np.nan_to_num(1 / variance[rest].reshape(len(rest), -1))
    others = [setup.cameras[k] for k in rest]
    carried = carried_errors(setup.cameras[c], others, points.reshape(-1, 3), patterns, weights)
    return dependence_of(take.frames, px[c], carried)


def _pose_trial(take: Take, setup: Setup, c: int, points: FloatArray, kind: Kind) -> Trial | None:
    """One camera turned, moved or zoomed."""
    free = _FREE[kind]
    camera = setup.cameras[c]
    px, variance = take.of(setup, c)
    sigma = take.sigma(variance)

    def fit(part: Part, start: Correction | None, dependence: Dependence | None = None) -> Correction | None:
        use = np.ix_(*part)
        arrays = points[use].reshape(-1, 3), px[use].reshape(-1, 2), sigma[use].ravel()
        return fit_camera(camera, *arrays, free, start, dependence)

    everything = np.ones(len(px), dtype=bool), np.ones(px.shape[1], dtype=bool)
    both = fit(everything, None, dependence_of(take.frames, px))
    if both is None:
        return None
    before, after = camera.project(points), both.camera.project(points)
    effect = _displacement(before, after)
    seen = int(np.isfinite(sigma[np.isfinite(points[..., 0]).any(axis=1)]).any(axis=0).sum())
    trial = Trial(kind, (c,), with_correction(setup, c, both), np.empty(0), effect, correction=both)
    certainty = max(size_score(size, sd, seen) for size, sd in fault_size(trial).sizes(kind))
    if certainty < _WORTH_A_LOOK:
        return None
    fits = [one for part, _ in take.folds if (one := fit(part, both)) is not None]
    if len(fits) < len(take.folds):
        return None
    spread = max(_displacement(after, one.camera.project(points)) for one in fits) / max(effect, 1e-9)
    errors = _held_out_errors(take, [with_correction(setup, c, one) for one in fits])
    return replace(trial, errors=errors, spread=spread, certainty=certainty)


def _shift_trial(take: Take, setup: Setup, c: int, points: FloatArray, most: int) -> Trial | None:
    """The time shift of one camera, in whole frames, where it is not zero."""
    predicted = setup.cameras[c].project(points)

    def observed(part: Part | None) -> Callable[[float], tuple[FloatArray, FloatArray]]:
        def at(shift: float) -> tuple[FloatArray, FloatArray]:
            px, variance = take.of(setup, c, setup.shifts[c] + shift)
            if part is not None:
                px, variance = px[np.ix_(*part)], variance[np.ix_(*part)]
            return px, take.sigma(variance)

        return at

    shift = fit_shift(predicted, observed(None), most)
    if shift is None or round(shift) == 0:
        return None
    each = [fit_shift(predicted[np.ix_(*part)], observed(part), 2, round(shift)) for part, _ in take.folds]
    setups = [with_shift(setup, c, round(shift if s is None else s)) for s in each]
    both = with_shift(setup, c, round(shift))
    px, sigma = observed(None)(round(shift))
    motion = (observed(None)(round(shift) + 1)[0] - observed(None)(round(shift) - 1)[0]) / 2
    expected = np.gradient(predicted, take.frames, axis=0)
    unit = sigma[..., None]
    dependence = _dependence(take, setup, c, points)
    relative = replace(dependence, patterns=np.nan_to_num(dependence.patterns / unit.reshape(-1, 1)))
    sd = shift_sd((px - predicted) / unit, motion / unit, expected / unit, relative)
    effect = _displacement(*without_bias(np.stack([take.of(setup, c)[0] - px, 0 * px])))
    certainty = size_score(shift, sd, sigma.shape[1])
    errors = _held_out_errors(take, setups)
    agreed = 1.0
    if certainty >= _WORTH_A_LOOK:
        pairs = [fit_shift(p, observed(None), most) for p in _predictions_of_pairs(take, setup, c)]
        close = [s * shift > 0 and abs(s - shift) <= max(1.5, abs(shift) / 2) for s in pairs if s is not None]
        agreed = float(np.mean(close)) if close else 1.0
    return Trial(
        "shifted", (c,), both, errors, effect, shift=shift, shift_sd=sd, certainty=certainty, agreed=agreed
    )  # fmt: skip


def _predictions_of_pairs(take: Take, setup: Setup, c: int) -> list[FloatArray]:
    """(K, J, 2) projections into camera c of the points of neighbouring pairs of the others; none for one pair."""
    rest = [k for k in range(len(setup.cameras)) if k != c]
    if len(rest) < 3:
        return []
    px, variance = take.all(setup)
    out = []
    for pair in zip(rest, [*rest[1:], rest[0]], strict=True):
        two = CameraGroup(tuple(setup.cameras[k] for k in pair))
        found = triangulate(two, px[list(pair)], variance[list(pair)], TriangulateOptions(noise_px=take.noise_px))
        out.append(setup.cameras[c].project(found.points_world))
    return out


def _displacement(before: FloatArray, after: FloatArray) -> float:
    """Median distance between two sets of 2D points, px; 0 where there are none."""
    apart = np.linalg.norm(after - before, axis=-1)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) if known.size else 0.0


def is_significant(trial: Trial, found: Trials, person_px: float, options: DiagnosisOptions) -> bool:
    """Whether a change is large enough, and known well enough, to count as a fault."""
    proof = least_score(options.chance, len(_PARAMETERS) * found.tried[trial.kind])
    if trial.kind == "swapped":
        return trial.gain > 0 and trial.score >= proof
    if trial.gain <= 0 or trial.certainty < proof or trial.steady < options.min_steady:
        return False
    times, noise = options.min_deviations, found.noise
    least_px = max(options.min_effect * noise, options.min_effect_of_person * person_px)
    if trial.kind == "shifted":  # errors of 2D networks resemble a rotation or a zoom, but not a delay
        least = max(options.min_shift, times * trial.shift_sd)
        # Landmarks differ in how much they move, so the variation of their gains is not that of chance. The proof is
        # the certainty of the estimate, and that pairs of other cameras lead to the same.
        same = trial.score >= options.min_score and trial.agreed >= options.min_agreed
        return same and abs(trial.shift) >= least and trial.effect_px >= 0.25 * least_px
    if trial.effect_px < least_px or trial.spread > options.max_spread or trial.score < options.min_score:
        return False
    size = fault_size(trial)
    if trial.kind == "focal":
        return abs(size.focal) >= max(options.min_focal, times * size.focal_sd)
    turned = size.turn >= max(options.min_turn_deg, times * size.turn_sd)
    return turned or (trial.kind == "moved" and size.move >= max(options.min_move, times * size.move_sd))
