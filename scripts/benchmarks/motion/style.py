"""Poses of held-out takes from a few goals, in the style of their own kind, of other kinds, and without a style.

    python -m scripts.benchmarks.motion.style [--data ../shared/data/motion] [--takes 6] [--seed 0] [--every 0.25]

All takes are put onto one body, without feet being planted, so that every prior sees the same joints. Of each kind the
last generated take is held out; of a recorded take, which is the only one of its kind, its last 40 %. Frames of what is
held out are then made from the root and the places of hands and feet alone, and joints that were no goal are compared
with the truth. Needs the `train` extra.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.ik import Goal, KinematicTree, PosePrior, load_prior, solve_ik, tree_of_skeleton
from muybridge.geometry.numerics.rotations import continuous_quat, matrix_from_quat, quat_from_matrix
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.formats import read_file
from muybridge.motion.retargeting.solver import RetargetOptions, retarget
from muybridge.motion.style import Style, examples_of, learn_style, solve_pose
from muybridge.motion.style.model import angles_about

KINDS = ("walk", "run", "reach", "dance")
RECORDED = {"recorded walk": "02_01.amc", "recorded run": "02_03.amc", "recorded play": "01_01.amc"}
SKELETON = BODY.skeleton(prior_shape(1.7))
ROLES = {name: j for j, name in enumerate(SKELETON.names)}
GOALS = {
    "hands and feet": ("left_hand", "right_hand", "left_foot", "right_foot"),
    "feet": ("left_foot", "right_foot"),
    "right hand": ("right_hand",),
}
HELD_OUT = 0.4  # of a recorded take


@dataclass(frozen=True, eq=False)
class Kind:
    """Takes of one kind: what is learned from, and what is held out."""

    name: str
    seen: list[Motion]
    held_out: Motion


def on_body(motion: Motion, roles: Mapping[str, int]) -> Motion:
    """The take on the one body."""
    rest = np.zeros((1, len(SKELETON), 4))
    rest[..., 0] = 1.0
    pose = Motion(SKELETON, motion.fps, np.zeros((1, 3)), rest)
    hero = Character(Path("body"), SKELETON, np.zeros(3), pose)
    return retarget(motion, roles, hero, ROLES, RetargetOptions(plant=False, touch=False)).motion


def generated(takes: int, seed: int) -> list[Kind]:
    """Kinds of generated takes of 5 s, each of another body."""
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.motions.rig import turn
    from muybridge.train.synthesis.motions.sampler import MotionSampler

    body, rng = BodyModel(seed), np.random.default_rng(seed)
    people = [body.skeleton(p) for p in body.sample_phenotypes(takes)]
    out = []
    for kind in KINDS:
        motions = []
        for person in people:
            clip = MotionSampler(person, rng).sample(5.0, 60.0, kind)
            quat = continuous_quat(quat_from_matrix(turn(clip.rotvec)))
            motions.append(on_body(Motion(person.joints, clip.fps, clip.root, quat), person.roles))
        out.append(Kind(kind, motions[:-1], motions[-1]))
    return out


def recorded(folder: Path) -> list[Kind]:
    """Kinds of one recorded take each, whose end is held out."""
    out = []
    for name, file in RECORDED.items():
        motion = read_file(folder / file).motion
        assert motion is not None
        moved = on_body(motion, find_motion_roles(motion).roles)
        cut = round(len(moved) * (1 - HELD_OUT))
        out.append(Kind(name, [moved.select(slice(0, cut))], moved.select(slice(cut, None))))
    return out


def styled(name: str, motions: list[Motion]) -> Style:
    """The style of takes."""
    examples = None
    for motion in motions:
        found = examples_of(name, motion, roles=ROLES)
        examples = found if examples is None else examples.merged(found)
    assert examples is not None
    return learn_style(examples, ROLES)


Solver = Callable[[Motion, tuple[str, ...]], FloatArray]  # from the truth and the goals to (J, 3) places


def goal_places(truth: Motion, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """The places of joints in the world, of one frame."""
    places = truth.joint_positions_world()[0]
    return {name: places[ROLES[name]] for name in names}


def by_style(style: Style) -> Solver:
    """The likeliest pose."""
    return lambda truth, names: solve_pose(style, truth, goal_places(truth, names)).motion.joint_positions_world()[0]


def nearest(seen: list[Motion]) -> tuple[Solver, Callable[[Motion, tuple[str, ...]], FloatArray]]:
    """The example whose joints are nearest to the goals, seen from the root; its places, and its rotations."""
    quat = np.concatenate([m.quat_wxyz for m in seen])
    local = _about_root(quat)

    def rotations(truth: Motion, names: tuple[str, ...]) -> FloatArray:
        joints = [ROLES[n] for n in names]
        away = ((local[:, joints] - _about_root(truth.quat_wxyz)[:, joints]) ** 2).sum(axis=(1, 2))
        return matrix_from_quat(quat[[int(np.argmin(away))]])

    def places(truth: Motion, names: tuple[str, ...]) -> FloatArray:
        return _placed(truth, rotations(truth, names))

    return places, rotations


def _about_root(quat: FloatArray) -> FloatArray:
    turns = matrix_from_quat(quat)
    turns[:, 0] = np.eye(3)
    return SKELETON.forward(np.zeros((len(turns), 3)), turns)[1]


def _placed(truth: Motion, rotations: FloatArray) -> FloatArray:
    turns = rotations.copy()
    turns[:, 0] = matrix_from_quat(truth.quat_wxyz[:, 0])
    return np.asarray(SKELETON.forward(truth.root_positions_world, turns)[1][0])


def by_angles(style: Style, start: Callable[[Motion, tuple[str, ...]], FloatArray] | None) -> Solver:
    """Damped least squares in the style's angles without its prior, from a pose, or from the mean of all takes."""
    tree, last, away = style.tree(SKELETON)
    mean = matrix_from_quat(style.mean_wxyz)

    def solve(truth: Motion, names: tuple[str, ...]) -> FloatArray:
        theta = np.zeros(len(tree))
        if start is not None:
            theta = _angles(style, mean, start(truth, names)[0])
        result = solve_ik(tree, _goals(truth, names, last, away), theta, "damped")
        return _placed(truth, style.rotations(result.theta[None]))

    return solve


def _angles(style: Style, mean: FloatArray, rotations: FloatArray) -> FloatArray:
    theta = np.zeros(len(style.hinge_joints))
    for j in set(style.hinge_joints.tolist()):
        mine = np.flatnonzero(style.hinge_joints == j)
        axes = style.hinge_axes[mine]
        order = [int(style.prior.names[k].rsplit(".", 1)[1]) for k in mine]
        full = np.zeros((3, 3))
        full[order] = axes
        if len(mine) < 3:
            full = _completed(full, order)
        theta[mine] = angles_about(mean[j], full.T, rotations[None, j])[0, order]
    return theta


def _completed(rows: FloatArray, known: list[int]) -> FloatArray:
    """Three axes of which one or two rows are known."""
    if len(known) == 1:
        other = (known[0] + 1) % 3
        some = np.eye(3)[int(np.argmin(np.abs(rows[known[0]])))]
        rows[other] = np.cross(rows[known[0]], some)
        rows[other] /= np.linalg.norm(rows[other])
        known = [*known, other]
    lost = ({0, 1, 2} - set(known)).pop()
    rows[lost] = np.cross(rows[(lost + 1) % 3], rows[(lost + 2) % 3])
    return rows


def _goals(truth: Motion, names: tuple[str, ...], last: FloatArray, away: FloatArray) -> list[Goal]:
    local = _about_root(truth.quat_wxyz)[0]
    out = []
    for name in names:
        j = ROLES[name]
        # A joint's place is that of its first hinge, which its own angles do not move; of a joint without any, `away`.
        out.append(Goal(int(last[j]), away[j], local[j]))
    return out


def by_shipped_prior(prior: PosePrior, tree: KinematicTree, last: FloatArray) -> Solver:
    """The prior that muybridge ships, of generated motions of all kinds, for the angles of its body."""
    mine = prior.for_tree(tree)

    def solve(truth: Motion, names: tuple[str, ...]) -> FloatArray:
        local = _about_root(truth.quat_wxyz)[0]
        goals = [Goal(int(last[ROLES[n]]), np.zeros(3), local[ROLES[n]]) if SKELETON_HAS[n] else
                 Goal(int(last[SKELETON.parents[ROLES[n]]]), SKELETON.offsets[ROLES[n]], local[ROLES[n]])
                 for n in names]  # fmt: skip
        theta = solve_ik(tree, goals, method="gmm_prior", prior=mine).theta
        places = tree.forward(theta)
        out = np.zeros((len(SKELETON), 3))
        for j in range(1, len(SKELETON)):
            up = SKELETON.parents[j]
            h = int(last[up])
            first = int(last[j]) if SKELETON_HAS[SKELETON.names[j]] else -1
            out[j] = (places[1][first] if first >= 0 else
                      places[1][h] + places[0][h] @ SKELETON.offsets[j] if h >= 0 else SKELETON.offsets[j])  # fmt: skip
        root = matrix_from_quat(truth.quat_wxyz[:, 0])[0]
        return truth.root_positions_world[0] + out @ root.T

    return solve


SKELETON_HAS = {n: bool((SKELETON.upper[j] - SKELETON.lower[j] > 1e-9).any()) for j, n in enumerate(SKELETON.names)}


def measured(kind: Kind, solve: Solver, names: tuple[str, ...], every: float) -> tuple[float, float, float]:
    """Millimetres: mean error of the open joints, mean and worst error of the goals."""
    step = max(1, round(every * kind.held_out.fps))
    goal = [ROLES[n] for n in names]
    # Thighs hang at the hips, and toes follow the feet: where no goal can move them nothing is open.
    open_joints = [j for j in range(1, len(SKELETON)) if j not in goal and "thigh" not in SKELETON.names[j]]
    errors, reached = [], []
    for k in range(0, len(kind.held_out), step):
        truth = kind.held_out.select([k])
        away = np.linalg.norm(solve(truth, names) - truth.joint_positions_world()[0], axis=1) * 1e3
        errors.append(away[open_joints].mean())
        reached.append(away[goal])
    return float(np.mean(errors)), float(np.mean(reached)), float(np.max(reached))


def table(kinds: list[Kind], every: float) -> None:
    """Learn, measure and print."""
    styles = {kind.name: styled(kind.name, kind.seen) for kind in kinds}
    every_kind = styled("all", [m for kind in kinds for m in kind.seen])
    tree, last = tree_of_skeleton(SKELETON, BODY.rest)
    shipped = by_shipped_prior(load_prior(), tree, last)
    for name, style in styles.items():
        angles, gaussians = len(style.hinge_joints), len(style.prior.means)
        print(f"{name}: {style.examples} examples, {angles} angles, {gaussians} Gaussians")
    for given, names in GOALS.items():
        for kind in kinds:
            copy, start = nearest(kind.seen)
            rows = {"own style": [by_style(styles[kind.name])],
                    "other styles": [by_style(s) for n, s in styles.items() if n != kind.name],
                    "all kinds": [by_style(every_kind)], "shipped prior": [shipped],
                    "no prior": [by_angles(every_kind, None)], "nearest": [copy],
                    "nearest, then IK": [by_angles(styles[kind.name], start)]}  # fmt: skip
            for label, solvers in rows.items():
                found = np.array([measured(kind, s, names, every) for s in solvers])
                each = "" if len(found) == 1 else f"   each {' '.join(f'{v:.1f}' for v in found[:, 0])}"
                print(f"{given:15s} {kind.name:14s} {label:17s} open {found[:, 0].mean():6.1f} mm   goals "
                      f"{found[:, 1].mean():7.2f} mean {found[:, 2].max():7.1f} worst{each}", flush=True)  # fmt: skip


def main() -> None:
    """Measure generated kinds among themselves, and recorded ones."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/motion"))
    parser.add_argument("--takes", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every", type=float, default=0.25)
    arguments = parser.parse_args()
    if arguments.takes:
        table(generated(arguments.takes, arguments.seed), arguments.every)
    if arguments.data.is_dir():
        table(recorded(arguments.data), arguments.every)


if __name__ == "__main__":
    main()
