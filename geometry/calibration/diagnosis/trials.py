"""Explanations of what may be wrong with one camera of a rig, each fitted to the observations and scored."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions, Kind
from muybridge.geometry.calibration.diagnosis.hypotheses import (
    Correction,
    fit_camera,
    fit_shift,
    frames_per_observation,
    paired_score,
)
from muybridge.geometry.calibration.diagnosis.setup import (
    Setup,
    Take,
    leave_one_out_points,
    rig_errors,
    robust_cost,
    with_correction,
    with_files,
    with_shift,
)
from muybridge.geometry.numerics.robust import student_scale

_PARAMETERS = {"turned": 3, "moved": 6, "focal": 1, "shifted": 1, "swapped": 1}
# Up to this many cameras, all permutations of their files are tried.
_ALL_ORDERS = 4
_FREE: dict[Kind, BoolArray] = {
    "turned": np.array([1, 1, 1, 0, 0, 0, 0], dtype=bool),
    "moved": np.array([1, 1, 1, 1, 1, 1, 0], dtype=bool),
    "focal": np.array([0, 0, 0, 0, 0, 0, 1], dtype=bool),
}


@dataclass(frozen=True)
class Trial:
    """One explanation and its score.

    Attributes:
        kind: kind of fault.
        cameras: indices of the cameras that it changes.
        setup: the rig with the change applied.
        gain: log-likelihood gained over the rig without the change, less the penalty for its parameters, nats.
        effect_px: median displacement of the camera's 2D points.
        correction: the fitted change of pose or focal length.
        shift: delay of the video, frames.
        score: mean gain over its standard error.
    """

    kind: Kind
    cameras: tuple[int, ...]
    setup: Setup
    gain: float
    effect_px: float
    correction: Correction | None = None
    shift: float = 0.0
    score: float = 0.0


def fault_sizes(trial: Trial) -> tuple[float, float, float]:
    """Rotation (degrees), translation (metres) and relative focal length error of the fault, not of its correction."""
    if trial.correction is None:
        return 0.0, 0.0, 0.0
    fix = trial.correction
    return float(np.degrees(np.linalg.norm(fix.turn))), float(np.linalg.norm(fix.move)), 1 / fix.focal - 1


def search_trials(take: Take, setup: Setup, options: DiagnosisOptions) -> tuple[float, list[Trial]]:
    """All explanations for a setup, scored, and the scale of the setup's own errors in px (returned first)."""
    cost, noise, errors = robust_cost([rig_errors(take, setup)])
    found: list[tuple[float, FloatArray, Trial]] = []
    for trial, halves in _trials(take, setup, options):
        trial_cost, _, trial_errors = robust_cost(halves)
        found.append((trial_cost, trial_errors, trial))
    lowest = min(found, key=lambda f: f[0], default=(cost, errors, None))
    best_errors = lowest[1] if lowest[0] < cost else errors
    scale = student_scale((best_errors**2).sum(-1)[np.isfinite(best_errors[..., 0])])
    known = np.isfinite(errors[..., 0])
    views = known.sum() / max(known.any(axis=0).sum(), 1)
    # Triangulation fits three parameters per point, which reduces the residuals' degrees of freedom.
    independent = max(float(known.sum() * (1 - 1.5 / views)) / frames_per_observation(best_errors / scale), 2.0)
    order = np.argsort(np.concatenate([np.flatnonzero(take.held), np.flatnonzero(~take.held)]))
    trials = []
    for trial_cost, trial_errors, trial in found:
        gain = independent * (cost - trial_cost) - 0.5 * _PARAMETERS[trial.kind] * float(np.log(independent))
        in_order = trial_errors if trial.kind == "swapped" else trial_errors[:, order]
        trials.append(replace(trial, gain=gain, score=paired_score(errors, in_order)))
    return noise, trials


def _trials(take: Take, setup: Setup, options: DiagnosisOptions) -> Iterator[tuple[Trial, list[FloatArray]]]:
    """Every explanation with its errors in the two halves of the frames, each half held out from the fit."""
    halves = (take.held, ~take.held)
    for c in range(len(setup.cameras)):
        points = leave_one_out_points(take, setup, c)
        for kind, free in _FREE.items():
            both = _fit(take, setup, c, points, free, np.ones_like(take.held))
            one, two = (_fit(take, setup, c, points, free, rows, both) for rows in halves)
            if both is None or one is None or two is None:
                continue
            crossed = ((two, halves[0]), (one, halves[1]))
            errors = [rig_errors(take, with_correction(setup, c, f), rows) for f, rows in crossed]
            effect = _displacement(setup.cameras[c].project(points), both.camera.project(points))
            yield Trial(kind, (c,), with_correction(setup, c, both), 0.0, effect, both), errors
        yield from _shift_trials(take, setup, c, points, options)
    for order in _permutations(len(setup.cameras)):
        swapped = with_files(setup, order)
        moved = tuple(c for c, k in enumerate(order) if c != k)
        yield Trial("swapped", moved, swapped, 0.0, np.inf), [rig_errors(take, swapped)]


def _permutations(count: int) -> Iterator[tuple[int, ...]]:
    """Permutations of the cameras' files except the identity: all for few cameras, else all swaps of two."""
    if count <= _ALL_ORDERS:
        yield from (order for order in permutations(range(count)) if order != tuple(range(count)))
        return
    for a, b in combinations(range(count), 2):
        yield tuple({a: b, b: a}.get(c, c) for c in range(count))


def _shift_trials(
    take: Take, setup: Setup, c: int, points: FloatArray, options: DiagnosisOptions
) -> Iterator[tuple[Trial, list[FloatArray]]]:
    """The time shift of one camera, in whole frames, where it is not zero."""
    predicted = setup.cameras[c].project(points)
    most = int(min(options.max_shift, take.px.shape[1] // 4))
    halves = (take.held, ~take.held)

    def shift_of(rows: BoolArray, most: int, about: float) -> float | None:
        def observed(shift: float) -> tuple[FloatArray, FloatArray]:
            px, variance = take.of(setup, c, setup.shifts[c] + shift)
            return px[rows], take.sigma(variance[rows])

        return fit_shift(predicted[rows], observed, most, about)

    shift = shift_of(np.ones_like(take.held), most, 0.0)
    if shift is None or round(shift) == 0:
        return
    each = [shift_of(rows, 2, round(shift)) for rows in halves]
    one, two, both = (with_shift(setup, c, round(shift if s is None else s)) for s in (*each, shift))
    errors = [rig_errors(take, two, halves[0]), rig_errors(take, one, halves[1])]
    effect = _displacement(take.of(setup, c)[0], take.of(both, c)[0])
    yield Trial("shifted", (c,), both, 0.0, effect, shift=shift), errors


def _fit(
    take: Take,
    setup: Setup,
    c: int,
    points: FloatArray,
    free: BoolArray,
    rows: BoolArray,
    start: Correction | None = None,
) -> Correction | None:
    """Pose or focal length of camera c, fitted to (K, J, 3) points in the given rows."""
    px, variance = take.of(setup, c)
    return fit_camera(
        setup.cameras[c], points[rows].reshape(-1, 3), px[rows].reshape(-1, 2),
        take.sigma(variance[rows]).ravel(), free, start,
    )  # fmt: skip


def _displacement(before: FloatArray, after: FloatArray) -> float:
    """Median distance between two sets of 2D points, px; 0 where there are none."""
    apart = np.linalg.norm(after - before, axis=-1)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) if known.size else 0.0


def is_significant(trial: Trial, noise_px: float, person_px: float, options: DiagnosisOptions) -> bool:
    """Whether a change is large enough and certain enough to count as a fault."""
    least = options.min_score_shift if trial.kind == "shifted" else options.min_score
    if trial.gain <= 0 or trial.score < least:
        return False
    if trial.kind == "swapped":
        return True
    if trial.kind == "shifted":  # errors of 2D networks resemble a rotation or a zoom, but not a delay
        return abs(trial.shift) >= options.min_shift and trial.effect_px >= 0.25 * options.min_effect * noise_px
    if trial.effect_px < max(options.min_effect * noise_px, options.min_effect_of_person * person_px):
        return False
    turn, move, focal = fault_sizes(trial)
    if trial.kind == "focal":
        return abs(focal) >= options.min_focal
    return turn >= options.min_turn_deg or move >= options.min_move
