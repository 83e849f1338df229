"""Whether the certainty of marker names holds, on trials with markers beyond the set, missing ones and turned heads.

Usage: python -m scripts.benchmarks.markers.label_reliability [--people 14] [--trials 4] [--only made|recorded] [--fit]

People of our own synthesis, whose markers are placed as one laboratory would (needs the training packages), and the
recordings beside the checkout. Prints the share of visible markers that got their name, the share of names that are
right, and, for bins of certainty, its mean and the share of names that are right. The seeds are others than those that
the certainty was fitted to; `--fit` fits it to those and prints the weights.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.marker_sets import SETS
from muybridge.infer.labelling.label import Labelled, label_points
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.models.shipped import shipped_model
from scripts.benchmarks.common import DATA, print_header
from scripts.benchmarks.markers.label_trials import Person, Trial, made_people, make_trial, recorded_person

ASKED = ("pig39", "lower16", "pig39", "pig35", "cmu41", "lower22", "set61")
BINS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.0)
FITTED, TESTED = (31, 32), (41,)
_NAMES_OF_A_TRIAL = 1500


def recordings() -> list[tuple[str, Person]]:
    """The recordings beside the checkout that are there; cases come with the true names in a file of their own."""
    serve, walk = DATA / "markers" / "tennis_serve_pig39.c3d", DATA / "markers" / "walk_force_plates.c3d"
    out = []
    if serve.is_file():
        whole = recorded_person(serve, SETS["pig39"])
        out.append(("serve", Person(whole.points[300:700], whole.labels, whole.fps, whole.markers)))
    if walk.is_file():
        out.append(("walk", recorded_person(walk, SETS["lower16"])))
    for name, asked, fps in (("label_head_turned/pf", "pig39", 250.0),
                             ("label_extra_markers_up_axis/rbwh21_as_lower16", "lower16", 100.0)):  # fmt: skip
        file = DATA / "cases" / f"{name}.npz"
        if file.is_file():
            with np.load(file) as true:
                points, labels = true["points_mm"] / 1000, tuple(str(n) for n in true["names"])
            out.append((Path(name).name, Person(points, labels, fps, SETS[asked])))
    return out


def labelled_trials(people: list[Person], trials: int, seed: int,
                    network: LabelNetwork) -> Iterator[tuple[Trial, Labelled]]:  # fmt: skip
    """Trials of people, labelled."""
    for i, person in enumerate(people):
        for r in range(trials):
            trial = make_trial(person, np.random.default_rng([seed, i, r]))
            yield trial, label_points(trial.cloud, trial.fps, trial.markers, network, up=trial.up)
            print(f"\r{i * trials + r + 1} of {len(people) * trials} trials", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


def right_names(trial: Trial, done: Labelled) -> tuple[BoolArray, BoolArray, BoolArray]:
    """(T, M) markers that are visible, names that were given, names that are right."""
    good = np.linalg.norm(done.points - trial.truth, axis=-1) < 1e-3
    return np.isfinite(trial.truth[..., 0]), np.isfinite(done.points[..., 0]), good


def report(name: str, people: list[Person], trials: int, seed: int, network: LabelNetwork) -> None:
    """Print the figures of some people."""
    recall, precision, sure, right, upright = [], [], [], [], []
    for trial, done in labelled_trials(people, trials, seed, network):
        seen, said, good = right_names(trial, done)
        recall.append(good.sum() / seen.sum())
        precision.append(good.sum() / max(said.sum(), 1))
        sure.append(done.confidence[said])
        right.append(good[said])
        axis = next(k for k in trial.kind if k[0] in "+-")
        up = np.eye(3)["XYZ".index(axis[1])] * (-1 if axis[0] == "-" else 1)
        upright.append(float(done.turn[2] @ up) > 0.9)
    print(f"\n{name}: {len(recall)} trials, recall {np.mean(recall):.1%} (median {np.median(recall):.1%}), precision "
          f"{np.mean(precision):.1%}, vertical axis right in {np.mean(upright):.1%}\n")  # fmt: skip
    print_header(("certainty", "names", "mean certainty", "right"))
    p, ok = np.concatenate(sure), np.concatenate(right)
    for low, high in zip(BINS, BINS[1:], strict=False):
        here = (p >= low) & (p < high)
        if here.any():
            print(f"| {low:g} to {high:g} | {here.sum()} | {p[here].mean():.3f} | {ok[here].mean():.3f} |")


def fitted(evidence: FloatArray, right: BoolArray, weight: FloatArray, decay: float = 1e-3) -> FloatArray:
    """Weights (E,) of a logistic regression of `right` (N,) on `evidence` (N, E), with weights (N,) of the samples."""
    scale = evidence.std(0) + 1e-9
    scale[evidence.std(0) < 1e-9] = 1.0
    x, weight = evidence / scale, weight / weight.sum()

    def loss(w: FloatArray) -> tuple[float, FloatArray]:
        z = x @ w
        p = 1 / (1 + np.exp(-np.clip(z, -30, 30)))
        value = float((weight * (np.logaddexp(0, z) - right * z)).sum() + decay * (w @ w))
        return value, x.T @ (weight * (p - right)) + 2 * decay * w

    done = minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return np.asarray(done.x / scale)


def fit(groups: list[list[Person]], trials: int, network: LabelNetwork) -> None:
    """Print the weights that fit the trials; every trial counts alike."""
    evidence, right, weight = [], [], []
    for seed, people in zip(FITTED, groups, strict=False):
        for trial, done in labelled_trials(people, trials, seed, network):
            _, said, good = right_names(trial, done)
            if done.evidence is not None and said.any():
                picked = np.random.default_rng(0).permutation(np.flatnonzero(said))[:_NAMES_OF_A_TRIAL]
                evidence.append(done.evidence.reshape(-1, done.evidence.shape[-1])[picked])
                right.append(good.ravel()[picked])
                weight.append(np.full(len(picked), 1 / len(picked)))
    print(np.round(fitted(np.concatenate(evidence), np.concatenate(right), np.concatenate(weight)), 3).tolist())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=14)
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--only", choices=("made", "recorded"))
    parser.add_argument("--fit", action="store_true")
    a = parser.parse_args()
    network = LabelNetwork(shipped_model("labels"))
    real = [person for _, person in recordings()] if a.only != "made" else []
    card = network.card
    made = (
        []
        if a.only == "recorded"
        else made_people(a.people, 11 if a.fit else 21, card.distance_m, card.motion_m, ASKED)
    )
    if a.fit:
        fit([made, real], a.trials, network)
        return
    for name, people in (("made", made), ("recorded", real)):
        if people:
            report(name, people, a.trials, TESTED[0], network)


if __name__ == "__main__":
    main()
