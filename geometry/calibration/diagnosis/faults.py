"""Which camera of a rig is the culprit: turned or moved, out of step, of a wrong focal length, or of a wrong file.

Each explanation is one change to one camera (or an exchange of cameras' files). The change is fitted to what
the other cameras know (leave-one-out points) in one part of the frames; then the whole rig is triangulated again
with it in the other part. An explanation is worth the gain in the take's robust likelihood over those held-out
frames, less a penalty for its parameters (Schwarz, "Estimating the dimension of a model", 1978), counted in
independent observations: errors of 2D networks persist from frame to frame. Comparing the whole rig, not the
camera's own residual, tells a wrong camera from those that it draws away: only the right change makes all agree.
The best explanation is applied, and the search goes on from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Literal

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.calibration.diagnosis.hypotheses import (
    Correction,
    alike,
    fit_camera,
    fit_shift,
    paired_score,
    student_scale,
)
from muybridge.geometry.calibration.diagnosis.setup import (
    Setup,
    Take,
    left_out,
    rig_errors,
    take_of,
    weighed,
    with_correction,
    with_files,
    with_shift,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import extent

Kind = Literal["turned", "moved", "focal", "shifted", "swapped", "unrelated"]
KINDS: tuple[Kind, ...] = ("turned", "moved", "focal", "shifted", "swapped")

_PARAMETERS = {"turned": 3, "moved": 6, "focal": 1, "shifted": 1, "swapped": 1}
# Of so many cameras all orders of their files are tried.
_ALL_ORDERS = 4
_TOO_MANY = (
    "The rest fits no better than that: with half of the cameras wrong, the others cannot be told from them. "
    "Calibrate all again, or run with --refine-cameras."
)
_FREE: dict[Kind, BoolArray] = {
    "turned": np.array([1, 1, 1, 0, 0, 0, 0], dtype=bool),
    "moved": np.array([1, 1, 1, 1, 1, 1, 0], dtype=bool),
    "focal": np.array([0, 0, 0, 0, 0, 0, 1], dtype=bool),
}


@dataclass(frozen=True)
class DiagnosisOptions:
    """What is called a fault.

    Attributes:
        max_frames: as many frames, evenly spread, take part at most.
        max_shift: shifts of up to this many frames are tried.
        max_faults: at most so many are named.
        min_evidence: log-likelihood (nats) that an explanation must gain.
        min_evidence_more: the same for a second and further fault.
        min_score: mean gain over the landmarks of all cameras, in standard deviations of that mean.
        min_score_shift: the same for a shift in time, which pairs every error with others by chance.
        min_effect: by how much a fault must displace the camera's 2D points, in standard deviations of their noise.
        min_effect_of_person: the same as a share of the person's size in the image: a network that puts hips higher
            from one side than from the other is as wrong as a camera that was moved, and by as much as this.
        min_turn_deg, min_move, min_shift, min_focal: what is smaller is no fault (degrees, metres, frames, share).
        farthest_turn_deg: a camera that is turned by more and wrong in other ways besides shows something else.
        unrelated: error against the other cameras, as a share of the image's longer side, from which a video that
            nothing puts right is taken to show something else.
        unrelated_of_person: the same as a share of the person's size in the image: somebody who fills the picture is
            misread by more pixels than somebody far off.
    """

    max_frames: int = 80
    max_shift: int = 30
    max_faults: int = 3
    min_evidence: float = 6.0
    min_evidence_more: float = 12.0
    min_score: float = 2.0
    min_score_shift: float = 3.0
    min_effect: float = 0.6
    min_effect_of_person: float = 0.01
    min_turn_deg: float = 0.2
    min_move: float = 0.02
    min_shift: float = 0.6
    min_focal: float = 0.008
    farthest_turn_deg: float = 6.0
    unrelated: float = 0.04
    unrelated_of_person: float = 0.15


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: what.
        cameras: the camera's name, or the names of all whose files are exchanged.
        amount: degrees, metres, frames (positive: the video is late), or share; 0 where it has none.
        turn_deg: of a camera that was turned or moved, degrees.
        effect_px: median displacement of the camera's 2D points by it.
        evidence: log-likelihood gained over the rig without this correction, nats.
        also: other kinds that explain it about as well.
        rivals: other cameras that could be it instead.
        sentence: all of this.
    """

    kind: Kind
    cameras: tuple[str, ...]
    amount: float
    turn_deg: float
    effect_px: float
    evidence: float
    also: tuple[Kind, ...]
    rivals: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class CalibrationDiagnosis:
    """What was found.

    Attributes:
        names: (C,) the cameras.
        faults: from the first found (the gravest) on; empty for a healthy rig.
        probability: (C,) how likely each camera is a culprit, 0..1.
        evidence: (C, len(KINDS)) log-likelihood by which each explanation betters the rig as it is, at least 0.
        order: (C,) cameras by falling evidence.
        noise_px: scale of the reprojection error of the rig as it is.
        corrected_px: with all faults corrected.
        cameras: corrected.
        shifts: (C,) frames by which each camera's video is late.
        files: (C,) index of the camera whose file is this camera's.
        note: what could not be told; empty where all could.
    """

    names: tuple[str, ...]
    faults: tuple[Fault, ...]
    probability: FloatArray
    evidence: FloatArray
    order: tuple[int, ...]
    noise_px: float
    corrected_px: float
    cameras: CameraGroup
    shifts: FloatArray
    files: tuple[int, ...]
    note: str = ""

    @property
    def sentence(self) -> str:
        """All faults in words."""
        if self.faults:
            return " ".join([*(f.sentence for f in self.faults), *([self.note] if self.note else [])])
        return self.note or "All cameras agree: none stands out as turned, out of step, of a wrong lens or file."


@dataclass(frozen=True)
class _Trial:
    """A change, and what it is worth."""

    kind: Kind
    cameras: tuple[int, ...]
    setup: Setup
    gain: float
    effect_px: float
    correction: Correction | None = None
    shift: float = 0.0
    score: float = 0.0


def diagnose(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    options: DiagnosisOptions = DiagnosisOptions(),
) -> CalibrationDiagnosis:
    """Cameras ranked by how likely each is what is wrong with a rig, and what is wrong with it.

    Args:
        cameras: C cameras as calibrated.
        points_px: (C, T, J, 2) px of one person's landmarks (or any points that move), NaN where missing.
        variance_px2: (C, T, J) of each coordinate; its relative size counts.
        options: what is called a fault.

    Returns:
        A report; with fewer than three cameras, or too few shared points, it has no faults but a note.

    Raises:
        ValueError: arrays that do not match the cameras.
    """
    take, note = take_of(cameras, points_px, variance_px2, options.max_frames)
    count = len(cameras)
    setup = Setup(cameras, (0.0,) * count, tuple(range(count)))
    table, probability = np.zeros((count, len(KINDS))), np.zeros(count)
    if take is None:
        nothing = float("nan")
        return CalibrationDiagnosis(
            cameras.names, (), probability, table, tuple(range(count)), nothing, nothing, cameras,
            np.zeros(count), setup.files, note,
        )  # fmt: skip
    person_px = np.array([_person_px(px) for px in take.px])
    faults: list[Fault] = []
    first_noise = last_noise = np.nan
    for step in range(options.max_faults + 1):
        last_noise, trials = _search(take, setup, options)
        credible = [t for t in trials if _matters(t, last_noise, person_px[setup.files[t.cameras[0]]], options)]
        if step == 0:
            first_noise, table = last_noise, _table(trials, count)
            probability = _chances(credible, count)
        best = max(credible, key=lambda t: t.gain, default=None)
        least = options.min_evidence_more if faults else options.min_evidence
        if best is None or best.gain < least:
            faults += _unrelated(take, setup, faults, options)
            break
        if step == options.max_faults:
            break
        blamed = {n for f in faults for n in f.cameras} | {cameras.names[c] for c in best.cameras}
        if faults and len(blamed) > count // 2:
            note = _TOO_MANY
            break
        faults.append(_fault(best, credible, cameras.names))
        setup = best.setup
    faults = _one_camera_only(faults, cameras.names, options)
    for fault in faults:
        probability[[cameras.names.index(n) for n in fault.cameras]] = 1 - np.exp(-fault.evidence)
    order = sorted(range(count), key=lambda c: (-probability[c], -table[c].max()))
    return CalibrationDiagnosis(
        cameras.names, tuple(faults), probability, table, tuple(order), first_noise, last_noise,
        setup.cameras, np.array(setup.shifts), setup.files, note,
    )  # fmt: skip


def _search(take: Take, setup: Setup, options: DiagnosisOptions) -> tuple[float, list[_Trial]]:
    """All explanations of what is wrong with a setup; the scale of its errors, px, beside them."""
    cost, noise, errors = weighed([rig_errors(take, setup)])
    found: list[tuple[float, FloatArray, _Trial]] = []
    for trial, halves in _trials(take, setup, options):
        trial_cost, _, trial_errors = weighed(halves)
        found.append((trial_cost, trial_errors, trial))
    lowest = min(found, key=lambda f: f[0], default=(cost, errors, None))
    best_errors = lowest[1] if lowest[0] < cost else errors
    scale = student_scale((best_errors**2).sum(-1)[np.isfinite(best_errors[..., 0])])
    known = np.isfinite(errors[..., 0])
    views = known.sum() / max(known.any(axis=0).sum(), 1)
    # A point that was triangulated takes three of its errors' freedoms, and makes them smaller by as much.
    independent = max(float(known.sum() * (1 - 1.5 / views)) / alike(best_errors / scale), 2.0)
    order = np.argsort(np.concatenate([np.flatnonzero(take.held), np.flatnonzero(~take.held)]))
    trials = []
    for trial_cost, trial_errors, trial in found:
        gain = independent * (cost - trial_cost) - 0.5 * _PARAMETERS[trial.kind] * float(np.log(independent))
        in_order = trial_errors if trial.kind == "swapped" else trial_errors[:, order]
        trials.append(replace(trial, gain=gain, score=paired_score(errors, in_order)))
    return noise, trials


def _trials(take: Take, setup: Setup, options: DiagnosisOptions) -> Iterator[tuple[_Trial, list[FloatArray]]]:
    """Every explanation, and its errors in the two halves of the frames, each held out from its fit."""
    halves = (take.held, ~take.held)
    for c in range(len(setup.cameras)):
        points = left_out(take, setup, c)
        for kind, free in _FREE.items():
            both = _fit(take, setup, c, points, free, np.ones_like(take.held))
            one, two = (_fit(take, setup, c, points, free, rows, both) for rows in halves)
            if both is None or one is None or two is None:
                continue
            crossed = ((two, halves[0]), (one, halves[1]))
            errors = [rig_errors(take, with_correction(setup, c, f), rows) for f, rows in crossed]
            effect = _displacement(setup.cameras[c].project(points), both.camera.project(points))
            yield _Trial(kind, (c,), with_correction(setup, c, both), 0.0, effect, both), errors
        yield from _shift_trials(take, setup, c, points, options)
    for order in _rearranged(len(setup.cameras)):
        swapped = with_files(setup, order)
        moved = tuple(c for c, k in enumerate(order) if c != k)
        yield _Trial("swapped", moved, swapped, 0.0, np.inf), [rig_errors(take, swapped)]


def _rearranged(count: int) -> Iterator[tuple[int, ...]]:
    """Orders of the cameras' files but for the one that they have: all of a few cameras', else exchanges of two."""
    if count <= _ALL_ORDERS:
        yield from (order for order in permutations(range(count)) if order != tuple(range(count)))
        return
    for a, b in combinations(range(count), 2):
        yield tuple({a: b, b: a}.get(c, c) for c in range(count))


def _shift_trials(
    take: Take, setup: Setup, c: int, points: FloatArray, options: DiagnosisOptions
) -> Iterator[tuple[_Trial, list[FloatArray]]]:
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
    yield _Trial("shifted", (c,), both, 0.0, effect, shift=shift), errors


def _fit(
    take: Take,
    setup: Setup,
    c: int,
    points: FloatArray,
    free: BoolArray,
    rows: BoolArray,
    start: Correction | None = None,
) -> Correction | None:
    px, variance = take.of(setup, c)
    return fit_camera(
        setup.cameras[c], points[rows].reshape(-1, 3), px[rows].reshape(-1, 2),
        take.sigma(variance[rows]).ravel(), free, start,
    )  # fmt: skip


def _displacement(before: FloatArray, after: FloatArray) -> float:
    apart = np.linalg.norm(after - before, axis=-1)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) if known.size else 0.0


def _person_px(points_px: FloatArray) -> float:
    """The person's size in one camera's image: longer side of the landmarks' box (T, J, 2), median over frames."""
    sizes = extent(points_px)
    return float(np.median(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else 0.0


def _matters(trial: _Trial, noise_px: float, person_px: float, options: DiagnosisOptions) -> bool:
    """Whether a change is large enough to be called a fault."""
    least = options.min_score_shift if trial.kind == "shifted" else options.min_score
    if trial.gain <= 0 or trial.score < least:
        return False
    if trial.kind == "swapped":
        return True
    if trial.kind == "shifted":  # errors of 2D networks look like a turn or a zoom, but not like a delay
        return abs(trial.shift) >= options.min_shift and trial.effect_px >= 0.25 * options.min_effect * noise_px
    if trial.effect_px < max(options.min_effect * noise_px, options.min_effect_of_person * person_px):
        return False
    turn, move, focal = _sizes(trial)
    if trial.kind == "focal":
        return abs(focal) >= options.min_focal
    return turn >= options.min_turn_deg or move >= options.min_move


def _sizes(trial: _Trial) -> tuple[float, float, float]:
    """Degrees turned, metres moved, share of the focal length; of the fault, not its correction."""
    if trial.correction is None:
        return 0.0, 0.0, 0.0
    fix = trial.correction
    return float(np.degrees(np.linalg.norm(fix.turn))), float(np.linalg.norm(fix.move)), 1 / fix.focal - 1


def _table(trials: list[_Trial], count: int) -> FloatArray:
    table = np.zeros((count, len(KINDS)))
    for trial in trials:
        for c in trial.cameras:
            k = KINDS.index(trial.kind)
            table[c, k] = max(table[c, k], trial.gain)
    return table


def _chances(trials: list[_Trial], count: int) -> FloatArray:
    """(C,) share of the likelihood of all explanations, no fault among them, that blames each camera."""
    gains = np.array([0.0, *(t.gain for t in trials)])
    weight = np.exp(gains - gains.max())
    out = np.zeros(count)
    for trial, w in zip(trials, weight[1:], strict=True):
        out[list(trial.cameras)] += w
    return np.asarray(np.minimum(out / weight.sum(), 1.0))


def _fault(best: _Trial, trials: list[_Trial], names: tuple[str, ...]) -> Fault:
    close = [t for t in trials if t is not best and best.gain - t.gain < max(3.0, 0.03 * best.gain)]
    also = tuple(t.kind for t in close if set(t.cameras) & set(best.cameras) and t.kind != best.kind)
    rivals = sorted({names[c] for t in close for c in t.cameras if c not in best.cameras})
    turn, move, focal = _sizes(best)
    amount = {"turned": turn, "moved": move, "focal": focal, "shifted": best.shift, "swapped": 0.0}[best.kind]
    blamed = tuple(names[c] for c in best.cameras)
    sentence = _sentence(best, blamed, also)
    if rivals:
        sentence += f" It could also be {' or '.join(rivals)}: these landmarks cannot tell them apart."
    return Fault(best.kind, blamed, amount, turn, best.effect_px, best.gain, also, tuple(rivals), sentence)


def _sentence(trial: _Trial, names: tuple[str, ...], also: tuple[Kind, ...]) -> str:
    turn, move, focal = _sizes(trial)
    name, effect = names[0], f"{trial.effect_px:.0f} px in its image"
    if trial.kind == "swapped":
        if len(names) == 2:
            return f"The video files of {name} and {names[1]} are exchanged: with the other's file each fits the rig."
        whose = [trial.setup.cameras.names[trial.setup.files[c]] for c in trial.cameras]
        taken = ", ".join(f"{n} has that of {w}" for n, w in zip(names, whose, strict=True))
        return f"The video files of {', '.join(names)} are exchanged: the rig fits where {taken}."
    if trial.kind == "shifted":
        late = "late" if trial.shift > 0 else "early"
        return (
            f"{name} is {abs(trial.shift):.1f} frames {late} ({effect}): what the others see at a frame it shows "
            f"{'after' if trial.shift > 0 else 'before'} that; put the videos in step with: muybridge sync."
        )
    if trial.kind == "focal":
        text = (
            f"The focal length of {name} is {abs(focal):.1%} too {'large' if focal > 0 else 'small'} ({effect}): "
            "was it zoomed or refocused, or is its lens that of another camera?"
        )
        if {"moved", "turned"} & set(also):
            text += " That it was moved instead explains it nearly as well."
        return text
    what = f"turned by {turn:.1f} degrees" if trial.kind == "turned" else _moved(turn, move)
    if trial.kind == "turned" and "moved" in also:
        what = f"turned by about {turn:.1f} degrees, and perhaps moved,"
    return (
        f"{name} was {what} since it was calibrated ({effect}), or its picture is cropped otherwise; "
        "calibrate it again, or run with --refine-cameras."
    )


def _moved(turn: float, move: float) -> str:
    return f"moved by {move * 100:.0f} cm and turned by {turn:.1f} degrees"


def _other(name: str, px: float, evidence: float) -> Fault:
    sentence = (
        f"{name} shows something else than the others ({px:.0f} px apart), and no turn or move, shift in time, other "
        "focal length nor exchange of files mends it: is it a video of another take, or a calibration of another place?"
    )
    return Fault("unrelated", (name,), 0.0, 0.0, px, evidence, (), (), sentence)


def _one_camera_only(faults: list[Fault], names: tuple[str, ...], options: DiagnosisOptions) -> list[Fault]:
    """Several grave faults of one camera are none of them: it shows something else."""
    for name in names:
        own = [f for f in faults if f.cameras == (name,)]
        if len(own) >= 2 and max(f.turn_deg for f in own) > options.farthest_turn_deg:
            other = _other(name, max(f.effect_px for f in own), max(f.evidence for f in own))
            faults = [other if f is own[0] else f for f in faults if f is own[0] or f not in own]
    return faults


def _unrelated(take: Take, setup: Setup, faults: list[Fault], options: DiagnosisOptions) -> list[Fault]:
    """The camera that nothing puts right, if there is one and nothing was found to be wrong with it."""
    found = []
    for c, camera in enumerate(setup.cameras):
        px, _ = take.of(setup, c)
        error = np.linalg.norm(camera.project(left_out(take, setup, c)) - px, axis=-1)
        known = error[np.isfinite(error)]
        typical = float(np.median(known)) if known.size >= 100 else 0.0
        least = max(options.unrelated * max(camera.width, camera.height), options.unrelated_of_person * _person_px(px))
        if typical >= least:
            found.append(_other(camera.name, typical, options.min_evidence))
    # Where one does not fit, it draws the others away from each other: only the worst is named.
    worst = max(found, key=lambda f: f.effect_px, default=None)
    return [] if worst is None or any(set(worst.cameras) & set(f.cameras) for f in faults) else [worst]
