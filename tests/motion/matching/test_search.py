"""The tree of boxes finds what comparing with every frame finds; springs are those of their differential equation."""

import numpy as np
import pytest

from muybridge.motion.matching import BoxTree
from muybridge.motion.matching.springs import Spring, spring_rate


def _clips(seed: int, frames: int = 3000, width: int = 27) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    scaled = np.cumsum(rng.normal(0, 0.1, (frames, width)), axis=0).astype(np.float32)
    return scaled, rng.random(frames) > 0.02


@pytest.mark.parametrize("seed", range(3))
def test_the_tree_finds_the_distance_of_every_frame(seed: int) -> None:
    scaled, searchable = _clips(seed)
    tree = BoxTree.build(scaled, searchable)
    assert len(tree) == searchable.sum()
    rng = np.random.default_rng(100 + seed)
    for query in scaled[rng.integers(len(scaled), size=200)] + rng.normal(0, 0.5, (200, 27)):
        found, distance = tree.search(query)
        assert distance == tree.search_all(query)[1]
        plain = ((scaled[searchable].astype(np.float64) - query) ** 2).sum(axis=1)
        assert distance == pytest.approx(plain.min(), rel=1e-5)
        assert found is not None and searchable[found]
        assert ((scaled[found] - query) ** 2).sum() == pytest.approx(distance, rel=1e-5)


def test_bounds_and_frames_that_do_not_count() -> None:
    scaled, searchable = _clips(5)
    searchable[:] = True
    tree = BoxTree.build(scaled, searchable)
    assert tree.search(scaled[700]) == (700, 0.0)
    assert tree.search(scaled[700], bound=0.0)[0] is None
    found, distance = tree.search(scaled[700], skip=(690, 711))
    assert found is not None and not 690 <= found < 711 and distance > 0
    assert (found, distance) == tree.search_all(scaled[700], skip=(690, 711))


@pytest.mark.parametrize("count", [1, 15, 16, 17, 1025])
def test_few_frames_fill_no_box(count: int) -> None:
    scaled = np.random.default_rng(0).normal(size=(count, 5)).astype(np.float32)
    tree = BoxTree.build(scaled, np.ones(count, np.bool_))
    assert [tree.search(row)[0] for row in scaled] == list(range(count))


def test_nothing_that_may_be_found_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="no frame is searchable"):
        BoxTree.build(np.zeros((4, 2), np.float32), np.zeros(4, np.bool_))


def test_springs_obey_their_equation() -> None:
    goal, halflife = np.array([1.5]), 0.3
    spring, d, step = Spring(np.array([-1.0]), np.array([4.0])), spring_rate(0.3), 1e-5
    value, rate, way = spring.value.copy(), spring.rate.copy(), 0.0
    for _ in range(40_000):
        way += step * float(value[0])
        rate = rate + step * (d * d * (goal - value) - 2 * d * rate)
        value = value + step * rate
    after = spring.after(goal, 0.4, halflife)
    np.testing.assert_allclose([after.value, after.rate], [value, rate], atol=2e-4)
    np.testing.assert_allclose(spring.values(goal, np.array([0.4]), halflife)[0], value, atol=2e-4)
    np.testing.assert_allclose(spring.sums(goal, np.array([0.4]), halflife)[0], way, atol=2e-4)
