"""The IK family: Jacobians by finite differences, every method on chains and the body, limits, degenerate cases."""

import numpy as np
import pytest
from scipy.optimize import LinearConstraint

from muybridge.geometry.ik import (
    METHODS,
    Goal,
    IkOptions,
    KinematicTree,
    chain_of_balls,
    fit_prior,
    load_prior,
    save_prior,
    solve_ik,
    tree_of_skeleton,
)
from muybridge.geometry.ik.nonlinear import goal_function
from muybridge.geometry.ik.pose_prior import PosePrior
from muybridge.geometry.ik.tree import goal_arrays, theta_of_rotations
from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.geometry.skeleton.body import BODY, prior_shape

SKELETON = BODY.skeleton(prior_shape(1.75))
TREE, LAST = tree_of_skeleton(SKELETON, BODY.rest)
CHAIN = chain_of_balls([0.3] * 6, 2.5)
TIP = np.array([0.0, 0, 0.3])
CLASSICAL = [m for m in METHODS if m != "gmm_prior"]


def wrist(side: str) -> tuple[int, np.ndarray]:
    j = SKELETON.index(f"{side}_hand")
    return int(LAST[j]), SKELETON.offsets[j]


def goal_at(tree: KinematicTree, theta: np.ndarray, joint: int, offset: np.ndarray, oriented: bool = False) -> Goal:
    turns, places = tree.forward(theta)
    return Goal(joint, offset, places[joint] + turns[joint] @ offset, turns[joint] if oriented else None)


def within(tree: KinematicTree, theta: np.ndarray) -> bool:
    return bool(((theta >= tree.lower) & (theta <= tree.upper)).all())


def test_a_skeleton_and_its_tree_agree():
    rng = np.random.default_rng(0)
    angles = np.zeros((5, len(SKELETON), 3))
    moves = (BODY.upper - BODY.lower > 1e-9) & np.isfinite(BODY.lower)
    angles[:, moves] = rng.uniform(0.3 * BODY.lower[moves], 0.3 * BODY.upper[moves], (5, moves.sum()))
    angles[:, 0] = 0.0
    rotations = SKELETON.rotations_from_angles(angles)
    theta = theta_of_rotations(TREE, SKELETON, rotations)
    _, places = SKELETON.forward(np.zeros((5, 3)), rotations)
    for name, near in (("left_foot", 1e-9), ("right_foot", 1e-9)):
        j = SKELETON.index(name)
        for t in range(5):
            _, at = TREE.forward(theta[t])
            assert np.linalg.norm(at[LAST[j]] - places[t, j]) < near


def test_jacobian_by_finite_differences():
    rng = np.random.default_rng(1)
    for tree in (TREE, CHAIN):
        goals = [Goal(len(tree) - 1, rng.normal(size=3), np.zeros(3)), Goal(len(tree) // 2, rng.normal(size=3), None)]
        for _ in range(5):
            theta = tree.clipped(rng.uniform(-1, 1, len(tree)))
            jacobian = tree.jacobian(theta, goals)
            step = rng.normal(size=len(tree))
            ahead, back = (tree.forward(theta + s * 1e-6 * step) for s in (1, -1))
            for e, goal in enumerate(goals):
                (r1, p1), (r0, p0) = ((t[goal.joint], p[goal.joint]) for t, p in (ahead, back))
                moved = (p1 + r1 @ goal.offset - p0 - r0 @ goal.offset) / 2e-6
                turned = log_so3((r1 @ r0.T)[None])[0] / 2e-6
                np.testing.assert_allclose(jacobian[6 * e : 6 * e + 3] @ step, moved, atol=1e-6)
                np.testing.assert_allclose(jacobian[6 * e + 3 : 6 * e + 6] @ step, turned, atol=1e-6)


def test_gradient_of_the_goal_function_by_finite_differences():
    rng = np.random.default_rng(2)
    goals = [
        Goal(*wrist("left"), rng.normal(size=3), exp_so3(rng.normal(size=3))),
        Goal(*wrist("right"), None, None, (np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))),
    ]
    targets = goal_arrays(TREE, goals)
    theta, step = rng.uniform(TREE.lower, TREE.upper), rng.normal(size=len(TREE))
    gradient, other = np.empty(len(TREE)), np.empty(len(TREE))
    goal_function(TREE.links, targets, theta, gradient)
    values = [goal_function(TREE.links, targets, theta + s * 1e-6 * step, other) for s in (1, -1)]
    assert gradient @ step == pytest.approx((values[0] - values[1]) / 2e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("method", "least"),
    [("transpose", 0.6), ("pseudo_inverse", 0.95), ("damped", 0.95), ("null_space", 0.95), ("ccd", 0.85),
     ("fabrik", 0.75), ("nonlinear", 0.95), ("gmm_prior", 0.8)],
)  # fmt: skip
def test_both_hands_of_the_body(method, least):
    rng = np.random.default_rng(3)
    prior = load_prior() if method == "gmm_prior" else None
    good = 0
    for k in range(40):
        theta = rng.uniform(TREE.lower, TREE.upper)
        if k % 2:
            end = np.where(rng.random(len(TREE)) < 0.5, TREE.lower, TREE.upper)
            theta = np.where(rng.random(len(TREE)) < 0.5, end, theta)
        goals = [goal_at(TREE, theta, *wrist(s)) for s in ("left", "right")]
        found = solve_ik(TREE, goals, method=method, prior=prior)
        assert within(TREE, found.theta)
        if found.success:
            turns, places = TREE.forward(found.theta)
            for goal in goals:
                assert np.linalg.norm(places[goal.joint] + turns[goal.joint] @ goal.offset - goal.position) < 1.1e-4
        good += found.success
    assert good >= least * 40


@pytest.mark.parametrize("method", ["damped", "null_space", "nonlinear", "pseudo_inverse"])
def test_orientation_and_direction(method):
    rng = np.random.default_rng(4)
    good = 0
    for _ in range(15):
        theta = rng.uniform(TREE.lower, TREE.upper)
        full = goal_at(TREE, theta, *wrist("left"), oriented=True)
        joint, offset = wrist("right")
        turns, _ = TREE.forward(theta)
        pointing = Goal(joint, offset, None, None, (np.array([1.0, 0, 0]), turns[joint][:, 0]))
        found = solve_ik(TREE, [full, pointing], method=method)
        turns, _ = TREE.forward(found.theta)
        if found.success:
            assert np.abs(turns[full.joint] - full.orientation).max() < 2e-3
            assert turns[joint][:, 0] @ pointing.direction[1] > 1 - 1e-6
        good += found.success
        assert within(TREE, found.theta)
    assert good >= 12


@pytest.mark.parametrize("method", CLASSICAL)
def test_a_straight_chain_leaves_its_line(method):
    rng = np.random.default_rng(5)
    for _ in range(30):
        place = np.array([0, 0, rng.uniform(0.3, 1.7)])
        found = solve_ik(CHAIN, [Goal(17, TIP, place)], np.zeros(len(CHAIN)), method)
        assert found.success and within(CHAIN, found.theta)


def test_fabrik_always_escapes_the_collinear_case():
    rng = np.random.default_rng(6)
    for k in range(200):
        links = rng.uniform(0.1, 0.5, rng.integers(2, 8))
        limit = np.inf if k % 2 else 2.5
        along = rng.normal(size=3)
        along /= np.linalg.norm(along)
        tree = chain_of_balls(links, limit, along)
        shortest = max(2 * links.max() - links.sum(), 0)
        place = along * rng.uniform(shortest + 0.15 * links.sum(), 0.95 * links.sum())
        goal = Goal(len(tree) - 1, along * links[-1], place)
        assert solve_ik(tree, [goal], np.zeros(len(tree)), "fabrik").success, (k, links, place)


@pytest.mark.parametrize("method", ["damped", "fabrik", "null_space"])
def test_out_of_reach_it_stretches_there(method):
    rng = np.random.default_rng(7)
    good = 0
    for _ in range(20):
        way = rng.normal(size=3)
        place = way / np.linalg.norm(way) * 2.5
        found = solve_ik(CHAIN, [Goal(17, TIP, place)], rng.uniform(-1, 1, len(CHAIN)), method)
        assert not found.success and within(CHAIN, found.theta)
        good += found.position_error[0] < 2.5 - 1.8 + 0.018
    assert good >= 15


def test_null_space_nears_the_preferred_angles_and_keeps_the_goal():
    rng = np.random.default_rng(8)
    nearer = []
    for _ in range(15):
        theta = rng.uniform(TREE.lower, TREE.upper)
        goals = [goal_at(TREE, theta, *wrist("left"))]
        start = rng.uniform(TREE.lower, TREE.upper)
        plain, held = (solve_ik(TREE, goals, start, m) for m in ("damped", "null_space"))
        assert held.success
        nearer.append(np.linalg.norm(held.theta - TREE.preferred) / np.linalg.norm(plain.theta - TREE.preferred))
    assert np.mean(nearer) < 0.8
    gains = np.zeros(len(TREE))
    still = solve_ik(TREE, goals, start, "null_space", IkOptions(gains=gains))
    np.testing.assert_allclose(still.theta, plain.theta, atol=0.2)


def test_linear_constraints_couple_joints():
    spine, chest = TREE.names.index("spine.x"), TREE.names.index("chest.x")
    row = np.zeros((1, len(TREE)))
    row[0, spine], row[0, chest] = 1.0, -1.0
    theta = TREE.preferred.copy()
    theta[[spine, chest]] = 0.4
    goals = [goal_at(TREE, theta, *wrist("left"))]
    found = solve_ik(TREE, goals, method="nonlinear", constraint=LinearConstraint(row, 0, 0))
    assert found.success and abs(found.theta[spine] - found.theta[chest]) < 1e-6 and within(TREE, found.theta)


def test_a_prior_learned_from_examples(tmp_path):
    rng = np.random.default_rng(9)
    centre = TREE.clipped(TREE.preferred + 0.4)
    examples = np.clip(centre + 0.1 * rng.normal(size=(400, len(TREE))), TREE.lower, TREE.upper)
    prior = fit_prior(TREE.names, examples, 2)
    far = rng.uniform(TREE.lower, TREE.upper, (50, len(TREE)))
    assert prior.log_density(examples).mean() > prior.log_density(far).max()
    save_prior(tmp_path / "prior.npz", prior)
    again = load_prior(tmp_path / "prior.npz")
    np.testing.assert_allclose(again.log_density(examples), prior.log_density(examples), rtol=1e-3, atol=0.05)
    goals = [goal_at(TREE, examples[0], *wrist("left"))]
    likely = solve_ik(TREE, goals, method="gmm_prior", prior=prior)
    plain = solve_ik(TREE, goals, method="damped")
    assert likely.success
    assert np.linalg.norm(likely.theta - centre) < 0.7 * np.linalg.norm(plain.theta - centre)


def test_a_part_of_the_prior_is_its_marginal():
    prior = PosePrior(("a", "b"), np.zeros((1, 2)), np.linalg.inv(np.array([[[1.0, 0.5], [0.5, 2.0]]])), np.zeros(1))
    tree = KinematicTree(("b",), (-1,), np.zeros((1, 3)), np.eye(3)[:1], np.array([-3.0]), np.array([3.0]), np.zeros(1))
    np.testing.assert_allclose(prior.for_tree(tree).precisions, [[[0.5]]])
    with pytest.raises(ValueError, match="none of the tree's hinges"):
        prior.for_tree(CHAIN)


def test_what_does_not_fit_is_said():
    goal = Goal(17, TIP, np.zeros(3))
    with pytest.raises(ValueError, match="unknown method 'newton': choose one of transpose"):
        solve_ik(CHAIN, [goal], method="newton")
    with pytest.raises(ValueError, match="only 'nonlinear'"):
        solve_ik(CHAIN, [goal], method="ccd", constraint=LinearConstraint(np.zeros((1, 18)), 0, 0))
    with pytest.raises(ValueError, match="at least one goal"):
        solve_ik(CHAIN, [])
    with pytest.raises(ValueError, match="joint 99"):
        solve_ik(CHAIN, [Goal(99, TIP, np.zeros(3))])
    with pytest.raises(ValueError, match="a prior goes with"):
        solve_ik(CHAIN, [goal], method="gmm_prior")
    with pytest.raises(ValueError, match="one parent a joint"):
        KinematicTree(("a",), (0,), np.zeros((1, 3)), np.eye(3)[:1], np.zeros(1), np.zeros(1), np.zeros(1))


def test_former_names_of_methods_still_work():
    goal = Goal(joint=len(CHAIN) - 1, offset=np.zeros(3), position=np.array([0.2, 0.1, 0.4]))
    with pytest.warns(DeprecationWarning, match="'programme' is now called 'nonlinear'"):
        old = solve_ik(CHAIN, [goal], method="programme")
    assert np.array_equal(old.theta, solve_ik(CHAIN, [goal], method="nonlinear").theta)
