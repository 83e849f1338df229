"""All methods of inverse kinematics on the same poses: success, iterations, time, limits broken.

Usage: python -m scripts.benchmarks.geometry.ik [--poses 10000] [--methods damped fabrik ...]

Shares of the poses: 40 % have both hands at positions that some pose within the limits reaches; 20 % the same, with
every angle at one of its limits with a probability of one half; 10 % one hand with position and orientation; 15 % a
straight chain of six ball joints whose target is on its own line; 15 % such a chain with a target out of reach (success
is to come within 1 % of the reach of the least distance). Tolerances: 0.1 mm and 1 mrad. Times are processor times of
this thread. Finally, with `../shared/data`: hands, feet and head of every tenth frame of a real take are given, and the
error of the other joints is measured.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from muybridge.geometry.ik import (
    METHODS,
    Goal,
    IkOptions,
    KinematicTree,
    chain_of_balls,
    load_prior,
    solve_ik,
    tree_of_skeleton,
)
from muybridge.geometry.ik.tree import theta_of_rotations
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.body import BODY, prior_shape

SKELETON = BODY.skeleton(prior_shape(1.75))
TREE, LAST = tree_of_skeleton(SKELETON, BODY.rest)
CHAIN = chain_of_balls([0.3] * 6, 2.5)
TIP = np.array([0.0, 0, 0.3])
KINDS = {"random": 0.40, "at limits": 0.20, "orientation": 0.10, "straight": 0.15, "out of reach": 0.15}
Case = tuple[KinematicTree, list[Goal], np.ndarray, float]


def goal_at(tree: KinematicTree, theta: np.ndarray, joint: int, offset: np.ndarray, oriented: bool = False) -> Goal:
    """The goal that an effector meets in a pose."""
    turns, places = tree.forward(theta)
    position = places[joint] + turns[joint] @ offset
    return Goal(joint, offset, position, turns[joint] if oriented else None)


def hands() -> list[tuple[int, np.ndarray]]:
    """Hinge and offset of both wrists."""
    out = []
    for side in ("left", "right"):
        wrist = SKELETON.index(f"{side}_hand")
        out.append((int(LAST[wrist]), SKELETON.offsets[wrist]))
    return out


def make_case(kind: str, rng: np.random.Generator) -> Case:
    """A tree, goals, a start, and the least possible distance (0 if the goals can be met)."""
    if kind in ("random", "at limits", "orientation"):
        theta = rng.uniform(TREE.lower, TREE.upper)
        if kind == "at limits":
            end = np.where(rng.random(len(TREE)) < 0.5, TREE.lower, TREE.upper)
            theta = np.where(rng.random(len(TREE)) < 0.5, end, theta)
        wrists = hands()[:1] if kind == "orientation" else hands()
        goals = [goal_at(TREE, theta, joint, offset, kind == "orientation") for joint, offset in wrists]
        return TREE, goals, TREE.preferred, 0.0
    reach = 1.8
    if kind == "straight":
        place = np.array([0, 0, rng.uniform(0.3, 1.7)])
        return CHAIN, [Goal(17, TIP, place)], np.zeros(len(CHAIN)), 0.0
    way = rng.normal(size=3)
    far = rng.uniform(1.05, 2.0) * reach
    place = way / np.linalg.norm(way) * far
    return CHAIN, [Goal(17, TIP, place)], rng.uniform(-1, 1, len(CHAIN)), far - reach


def compare(method: str, cases: dict[str, list[Case]]) -> None:
    """Print one row of the table."""
    row, iterations, seconds, broken = f"| {method} ", [], [], 0
    prior = load_prior().for_tree(TREE) if method == "gmm_prior" else None
    for some in cases.values():
        if prior is not None and some[0][0] is not TREE:
            row += "| "
            continue
        solve_ik(some[0][0], some[0][1], method=method, prior=prior)  # compiles
        good = 0
        for tree, goals, start, left in some:
            begun = time.thread_time()
            found = solve_ik(tree, goals, start, method, IkOptions(), prior=prior)
            seconds.append(time.thread_time() - begun)
            broken += bool(((found.theta < tree.lower) | (found.theta > tree.upper)).any())
            good += found.success if left == 0 else found.position_error[0] <= left + 0.018
            if left == 0:
                iterations.append(found.iterations)
        row += f"| {100 * good / len(some):.1f} "
    print(f"{row}| {np.median(iterations):.0f} | {1e3 * np.median(seconds):.2f} | {broken} |", flush=True)


def real_poses() -> tuple[KinematicTree, np.ndarray, np.ndarray] | None:
    """The CMU take as angles of BODY's hinges; hinges of all joints."""
    from muybridge.geometry.fitting.body_fit import fit_body
    from scripts.benchmarks.common import DATA, as_points, cmu_landmarks

    if not (DATA / "motion").is_dir():
        return None
    truth, fps = cmu_landmarks()
    fit = fit_body(as_points(truth, fps, 0.01))
    tree, last = tree_of_skeleton(fit.motion.skeleton, BODY.rest)
    theta = theta_of_rotations(tree, fit.motion.skeleton, matrix_from_quat(fit.motion.quat_wxyz[::10]))
    return tree, theta, last


def naturalness(methods: list[str]) -> None:
    """Print the error of the joints that are not given, for every method."""
    found = real_poses()
    if found is None:
        return
    tree, poses, last = found
    ends = [SKELETON.index(n) for n in ("left_hand", "right_hand", "left_foot", "right_foot", "head")]
    prior = load_prior().for_tree(tree)
    print(f"\n{len(poses)} frames of a real take, five effectors: mean distance of all hinges, mm")
    for method in methods:
        off = []
        for theta in poses:
            goals = [goal_at(tree, theta, int(last[e]), np.zeros(3)) for e in ends]
            got = solve_ik(tree, goals, None, method, prior=prior if method == "gmm_prior" else None)
            off.append(np.linalg.norm(tree.forward(got.theta)[1] - tree.forward(theta)[1], axis=1).mean())
        print(f"| {method} | {1e3 * np.mean(off):.1f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10000)
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=METHODS)
    arguments = parser.parse_args()
    rng = np.random.default_rng(0)
    cases = {k: [make_case(k, rng) for _ in range(round(share * arguments.poses))] for k, share in KINDS.items()}
    print(f"| method | {' | '.join(f'{k} %' for k in KINDS)} | iterations | ms | limits broken |")
    print("| --- " * (len(KINDS) + 4) + "|")
    for method in arguments.methods:
        compare(method, cases)
    if Path(__file__).resolve().parents[3].parent.joinpath("shared", "data").is_dir():
        naturalness(arguments.methods)


if __name__ == "__main__":
    main()
