"""Steered figures go where they are wanted, without jumps."""

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.motion.matching import Ignored, MatchDatabase, Path, SteerOptions, Stick, build_database, steer
from tests.motion.matching.walks import walk, walks


@pytest.fixture(scope="module")
def database() -> MatchDatabase:
    return build_database(*walks()).database


def test_a_path_is_followed_to_its_end(database: MatchDatabase) -> None:
    path = Path(np.array([[0, 0], [3, 0], [5, 1], [6, 3]]), 1.2)
    done = steer(database, path, 20.0)
    assert done.arrived and len(done.motion) < 20 * 60
    assert np.linalg.norm(done.places[-1] - [6, 3]) < 0.3
    assert path.distance(done.places).max() < 0.35
    # The motion is where the figure is said to be.
    hips = done.motion.joint_positions_world()[:, database.roles["hips"], :2]
    assert np.linalg.norm(hips - done.places, axis=1).max() < 0.2


@pytest.mark.parametrize("turn", [-40.0, 40.0])
def test_a_stick_asks_for_speed_and_direction(database: MatchDatabase, turn: float) -> None:
    def velocity(t: float) -> np.ndarray:
        yaw = np.radians(turn) * min(t, 2.0)
        return 1.2 * np.array([np.cos(yaw), np.sin(yaw)])

    done = steer(database, Stick(velocity), 6.0)
    assert len(done.motion) == 361 and not done.arrived
    last = done.places[-1] - done.places[-61]
    assert np.linalg.norm(last) == pytest.approx(1.2, abs=0.15)
    assert np.degrees(np.arctan2(last[1], last[0])) == pytest.approx(2 * turn, abs=12)


def test_transitions_do_not_jump(database: MatchDatabase) -> None:
    done = steer(database, Path(np.array([[0, 0], [3, 0], [3, 3], [0, 3]]), 1.2), 20.0)
    assert len(done.jumps) > 2
    steps = np.linalg.norm(np.diff(done.motion.joint_positions_world(), axis=0), axis=-1).max(axis=1) * 60
    inside = [np.linalg.norm(np.diff(m.joint_positions_world(), axis=0), axis=-1).max() * 60 for m in walks()[0]]
    assert steps.max() < 1.5 * max(inside)


def test_what_is_ignored_is_not_played() -> None:
    motions, names = walks()
    database = build_database(motions, names, ignore=[Ignored(name, 1.5, 2.0) for name in names]).database
    done = steer(database, Stick(lambda t: np.array([1.2, 0.0])), 10.0)
    assert not database.ignored[done.frames].any()


def test_one_clip_is_played_again_and_again() -> None:
    database = build_database([walk(1.5)], ["short"]).database
    done = steer(database, Stick(lambda t: np.array([1.2, 0.0])), 10.0)
    assert len(done.motion) == 601 and len(done.jumps) > 3
    assert np.isfinite(done.motion.root_positions_world).all()
    assert done.places[-1][0] == pytest.approx(12.0, abs=0.5)


def test_the_same_goal_gives_the_same_motion(database: MatchDatabase) -> None:
    one, other = (steer(database, Path(np.array([[0, 0], [3, 1]])), 9.0) for _ in range(2))
    np.testing.assert_array_equal(one.motion.quat_wxyz, other.motion.quat_wxyz)


def test_bad_paths_and_options_are_refused() -> None:
    for points in (np.zeros((0, 2)), np.zeros((3, 2)), np.array([[0, 0], [np.nan, 1]]), np.zeros((2, 3))):
        with pytest.raises(MuybridgeError, match="path needs"):
            Path(points)
    with pytest.raises(MuybridgeError, match="speed must be above zero"):
        Path(np.eye(2), 0.0)
    for options in ({"search_every": 0.0}, {"blend": -1.0}, {"transition_cost": np.nan}):
        with pytest.raises(ValueError):
            SteerOptions(**options)
