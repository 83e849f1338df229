"""Joints as a network sees them, and what becomes of two opinions."""

import numpy as np
import pytest

from muybridge.motion.character.rigging.placement.learned import ROLES, Opinion, agreed, learned_places, mirrored_roles
from muybridge.motion.character.rigging.points import POINTS, TOKENS, surface_points, upright_points
from tests.motion.character.skinning.tubes import tube


def test_points_are_spread_on_the_surface_of_a_body_of_height_one() -> None:
    vertices, triangles = tube()
    standing = vertices[:, [1, 2, 0]] * 1.7 + [0.0, 0.3, 0.4]
    drawn = surface_points(standing, triangles[:, ::-1], POINTS, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(drawn[:, 3:], axis=1), 1, atol=1e-5)
    points, origin, height = upright_points(drawn)
    assert len(points) == POINTS and points[:, 2].min() == 0 and points[:, 2].max() == pytest.approx(1)
    back = points[:, :3] * height + origin
    assert np.sort(back[:, 2]) == pytest.approx(np.sort(drawn[:, 2]), abs=1e-5)
    gaps = np.linalg.norm(points[:TOKENS, None, :3] - points[None, :TOKENS, :3], axis=2) + np.eye(TOKENS)
    others = points[TOKENS : 2 * TOKENS, :3]
    random = np.linalg.norm(others[:, None] - others[None], axis=2) + np.eye(TOKENS)
    assert gaps.min() > 2 * random.min()


def test_answers_are_put_back_into_the_body_and_mirrored_ones_turned_round() -> None:
    vertices, triangles = tube()
    standing = vertices[:, [1, 2, 0]] * 1.7 + [0.0, 0.3, 0.4]
    left = ROLES.index("left_hand")

    def network(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The left hand at the left, whichever way the body is given; all else in the middle."""
        places = np.tile([0.0, 0.0, 0.5], (len(points), len(ROLES), 1))
        places[:, left], places[:, mirrored_roles()[left]] = [0.3, 0.0, 0.5], [-0.3, 0.0, 0.5]
        return places, np.full(places.shape[:2], 0.01)

    seen = learned_places(standing, triangles[:, ::-1], network)
    size = float(np.ptp(standing[:, 2]))
    assert seen.height == pytest.approx(size, rel=0.01)
    assert seen.places["left_hand"][0] == pytest.approx(0.3 * size, rel=0.02)
    assert seen.places["right_hand"][0] == pytest.approx(-0.3 * size, rel=0.02)
    assert seen.places["hips"][2] == pytest.approx(standing[:, 2].mean(), abs=0.01)
    assert seen.expected["head"] == pytest.approx(0.01 * size, rel=0.02)


def test_near_opinions_are_averaged_and_far_ones_are_the_networks() -> None:
    seen = Opinion({"head": np.array([0, 0, 1.6]), "hips": np.array([0, 0, 0.9])}, {"head": 0.02, "hips": 0.02}, 1.7)
    measured = {"head": np.array([0, 0, 1.63]), "hips": np.array([0, 0, 1.0]), "left_index_1": np.array([0.5, 0, 1])}
    out = agreed(measured, seen)
    assert 1.6 < out["head"][2] < 1.63 and out["hips"][2] == 0.9
    assert out["left_index_1"] is measured["left_index_1"]
