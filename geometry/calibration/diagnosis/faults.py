"""Diagnosis of a calibrated rig: which camera was turned or moved, is out of sync, or has a wrong lens or video file.

Each explanation is one change to one camera, or a permutation of the cameras' files. The change is fitted to the
points triangulated from the other cameras (leave one out) in one part of the frames; the whole rig is then triangulated
with the change in the other part. The score of an explanation is its gain in the robust likelihood of those held-out
frames minus a penalty for its parameters (Schwarz, "Estimating the dimension of a model", 1978), counted in
independent observations, because errors of 2D networks persist over frames. The comparison uses the residuals of the
whole rig, not of the changed camera alone: a wrong camera also displaces the points of the correct ones, and only the
right change makes all of them agree. The best explanation is applied, and the search continues with the changed rig.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.diagnosis.findings import (
    KINDS,
    CalibrationDiagnosis,
    DiagnosisOptions,
    Fault,
    Kind,
)
from muybridge.geometry.calibration.diagnosis.setup import Setup, Take, leave_one_out_points, take_of
from muybridge.geometry.calibration.diagnosis.trials import Trial, Trials, fault_size, is_significant, search_trials
from muybridge.geometry.calibration.diagnosis.wording import (
    TOO_MANY,
    doubt_sentence,
    focal_sentence,
    pose_sentence,
    rivals_sentence,
    shift_sentence,
    swap_sentence,
    unrelated_sentence,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import extent


def diagnose(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    options: DiagnosisOptions = DiagnosisOptions(),  # noqa: B008 - frozen
) -> CalibrationDiagnosis:
    """Rank the cameras of a rig by how probable a fault is, and identify the faults.

    Args:
        cameras: C cameras as calibrated.
        points_px: (C, T, J, 2) landmarks of one person, or any moving points, px; NaN where missing.
        variance_px2: (C, T, J) variance of each coordinate; only its relative size matters.
        options: limits and thresholds.

    Returns:
        The diagnosis; with fewer than three cameras, or too few shared points, it has no faults but a note.

    Raises:
        ValueError: arrays that do not match the cameras.
    """
    take, note = take_of(cameras, points_px, variance_px2, options.max_frames)
    count = len(cameras)
    setup = Setup(cameras, (0.0,) * count, tuple(range(count)))
    table, probability = np.zeros((count, len(KINDS))), np.zeros(count)
    if take is None:
        return CalibrationDiagnosis(
            cameras.names, (), probability, table, setup.files, np.nan, np.nan, cameras, np.zeros(count), setup.files,
            note,
        )  # fmt: skip
    person_px = np.array([_person_px(px) for px in take.px])
    faults: list[Fault] = []
    too_many, doubt = False, ""
    first_noise = last_noise = np.nan
    for step in range(options.max_faults + 1):
        found = search_trials(take, setup, options)
        last_noise = found.noise
        credible = _credible(found, person_px[list(setup.files)], options)
        if step == 0:
            first_noise, table = last_noise, _table(found.trials, count)
            probability = _fault_probability(credible, count)
        best = max(credible, key=lambda t: t.gain, default=None)
        if best is None or best.gain < (options.min_evidence_more if faults else options.min_evidence):
            faults += _find_unrelated(take, setup, faults, options)
            doubt = "" if faults else _doubt(found, person_px[list(setup.files)], take, setup, options)
            break
        blamed = {n for f in faults for n in f.cameras} | {cameras.names[c] for c in best.cameras}
        too_many = bool(faults) and step < options.max_faults and len(blamed) > count // 2
        if too_many or step == options.max_faults:
            note = TOO_MANY if too_many else note
            break
        faults.append(_fault(best, found.trials, cameras.names, options))
        setup = best.setup
    faults = _merge_unrelated(faults, cameras.names, options)
    for fault in faults:
        probability[[cameras.names.index(n) for n in fault.cameras]] = 1 - np.exp(-fault.evidence)
    order = sorted(range(count), key=lambda c: (-probability[c], -table[c].max()))
    return CalibrationDiagnosis(
        cameras.names, tuple(faults), probability, table, tuple(order), first_noise, last_noise,
        setup.cameras, np.array(setup.shifts), setup.files, note, too_many, doubt,
    )  # fmt: skip


def _credible(found: Trials, person_px: FloatArray, options: DiagnosisOptions) -> list[Trial]:
    """The explanations that are proven; none where even the best is weak and a change of another camera gains as much.

    Args:
        found: all explanations.
        person_px: (C,) size of the person in each camera's image.
        options: what counts as a fault.
    """
    credible = [t for t in found.trials if is_significant(t, found, person_px[t.cameras[0]], options)]
    best = max(credible, key=lambda t: t.gain, default=None)
    if best is None:
        return []
    small = 3 * max(options.min_effect * found.noise, options.min_effect_of_person * person_px[best.cameras[0]])
    if best.gain >= options.min_evidence_more and best.effect_px >= small:
        return credible
    others = [t.gain for t in found.trials if t not in credible and t.kind != "swapped" and t.cameras != best.cameras]
    return credible if best.gain >= max(others, default=0.0) + options.min_evidence else []


def _person_px(points_px: FloatArray) -> float:
    """Size of the person in one camera's image: median over frames of its box (T, J, 2), longer side, px."""
    sizes = extent(points_px)
    return float(np.median(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else 0.0


def _table(trials: Sequence[Trial], count: int) -> FloatArray:
    """(C, len(KINDS)) highest gain of each explanation for each camera, at least 0."""
    table = np.zeros((count, len(KINDS)))
    for trial in trials:
        for c in trial.cameras:
            k = KINDS.index(trial.kind)
            table[c, k] = max(table[c, k], trial.gain)
    return table


def _fault_probability(trials: list[Trial], count: int) -> FloatArray:
    """(C,) share of each camera in the likelihood of all explanations, the absence of a fault included."""
    gains = np.array([0.0, *(t.gain for t in trials)])
    weight = np.exp(gains - gains.max())
    out = np.zeros(count)
    for trial, w in zip(trials, weight[1:], strict=True):
        out[list(trial.cameras)] += w
    return np.asarray(np.minimum(out / weight.sum(), 1.0))


def _fault(best: Trial, trials: Sequence[Trial], names: tuple[str, ...], options: DiagnosisOptions) -> Fault:
    """The fault that the best trial describes, with the explanations that are about as good."""
    margin = max(options.min_evidence, 0.03 * best.gain)
    close = [t for t in trials if t is not best and best.gain - t.gain < margin and t.score >= options.min_score]
    also = tuple(t.kind for t in close if set(t.cameras) & set(best.cameras) and t.kind != best.kind)
    rivals = sorted({names[c] for t in close for c in t.cameras if c not in best.cameras})
    size = fault_size(best)
    amount, sd = {
        "turned": (size.turn, size.turn_sd), "moved": (size.move, size.move_sd), "focal": (size.focal, size.focal_sd),
        "shifted": (best.shift, best.shift_sd), "swapped": (0.0, 0.0),
    }[best.kind]  # fmt: skip
    blamed = tuple(names[c] for c in best.cameras)
    sentence = _sentence(best, blamed, also)
    if rivals:
        sentence = f"{rivals_sentence(' and '.join(blamed), rivals)} {sentence}"
    return Fault(best.kind, blamed, amount, sd, size.turn, best.effect_px, best.gain, also, tuple(rivals), sentence)


def _sentence(trial: Trial, names: tuple[str, ...], also: tuple[Kind, ...]) -> str:
    size = fault_size(trial)
    if trial.kind == "swapped":
        return swap_sentence(names, [trial.setup.cameras.names[trial.setup.files[c]] for c in trial.cameras])
    if trial.kind == "shifted":
        return shift_sentence(names[0], trial.shift, trial.shift_sd, trial.effect_px)
    if trial.kind == "focal":
        return focal_sentence(names[0], size.focal, size.focal_sd, trial.effect_px, also)
    move = (size.move, size.move_sd) if trial.kind == "moved" else None
    return pose_sentence(names[0], (size.turn, size.turn_sd), move, trial.effect_px, also)


def _doubt(found: Trials, person_px: FloatArray, take: Take, setup: Setup, options: DiagnosisOptions) -> str:
    """What the take gives signs of without proof; empty where there are none."""
    signs: dict[int, Trial] = {}
    for trial in sorted(found.trials, key=lambda t: -t.gain):
        c = trial.cameras[0]
        least = max(options.min_effect * found.noise, options.min_effect_of_person * person_px[c])
        if trial.gain >= 2 * options.min_evidence and trial.score >= 2.0 and trial.effect_px >= least:
            signs.setdefault(c, trial)
    named = [(setup.cameras.names[c], trial.kind) for c, trial in list(signs.items())[:2]]
    return doubt_sentence(named, take.px.shape[1]) if named else ""


def _unrelated_fault(name: str, px: float, evidence: float) -> Fault:
    return Fault("unrelated", (name,), 0.0, 0.0, 0.0, px, evidence, (), (), unrelated_sentence(name, px))


def _merge_unrelated(faults: list[Fault], names: tuple[str, ...], options: DiagnosisOptions) -> list[Fault]:
    """Replace several large faults of one camera by one: such a camera shows a different scene."""
    for name in names:
        own = [f for f in faults if f.cameras == (name,)]
        if len(own) >= 2 and max(f.turn_deg for f in own) > options.farthest_turn_deg:
            other = _unrelated_fault(name, max(f.effect_px for f in own), max(f.evidence for f in own))
            faults = [other if f is own[0] else f for f in faults if f is own[0] or f not in own]
    return faults


def _find_unrelated(take: Take, setup: Setup, faults: list[Fault], options: DiagnosisOptions) -> list[Fault]:
    """The camera that no explanation corrects, if there is one and no fault of it was found."""
    found = []
    for c, camera in enumerate(setup.cameras):
        px, _ = take.of(setup, c)
        error = np.linalg.norm(camera.project(leave_one_out_points(take, setup, c)) - px, axis=-1)
        known = error[np.isfinite(error)]
        typical = float(np.median(known)) if known.size >= 100 else 0.0
        least = max(options.unrelated * max(camera.width, camera.height), options.unrelated_of_person * _person_px(px))
        if typical >= least:
            found.append(_unrelated_fault(camera.name, typical, options.min_evidence))
    # One camera that does not fit displaces the points of the others, so only the worst is reported.
    worst = max(found, key=lambda f: f.effect_px, default=None)
    return [] if worst is None or any(set(worst.cameras) & set(f.cameras) for f in faults) else [worst]
