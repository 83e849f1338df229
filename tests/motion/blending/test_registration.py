"""Which frames of two motions belong together."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import place_at, register
from muybridge.motion.blending.constraint_matches import blended_contacts, match_spans
from muybridge.motion.blending.time_warp import fit_warp, warp_path
from muybridge.motion.editing.resampling import motion_at
from tests.motion.editing.clips import walk


def warped(motion: Motion) -> tuple[Motion, np.ndarray]:
    """The motion at another, uneven pace, and the frame of it at each frame of the result."""
    last = len(motion) - 1
    x = np.linspace(0, 1, 161)
    at = last * (x + 0.06 * np.sin(2 * np.pi * x))
    return motion_at(motion, at), at


def test_a_path_through_a_grid_follows_its_valley() -> None:
    rows, columns = np.mgrid[:40, :60]
    way = warp_path(np.abs(rows - columns * 39 / 59.0) ** 2)
    assert tuple(way[0]) == (0, 0) and tuple(way[-1]) == (39, 59)
    assert np.abs(way[:, 0] - way[:, 1] * 39 / 59).max() < 1.0
    assert (np.diff(way, axis=0) >= 0).all()


def test_no_path_is_steeper_than_the_slope_allows() -> None:
    with pytest.raises(ValueError, match="no way with slopes of at most 3"):
        warp_path(np.ones((10, 40)))
    assert len(warp_path(np.ones((14, 40)), slope=3))


def test_a_fitted_warp_goes_forward_in_both_motions() -> None:
    way = np.array(
        [(i, i) for i in range(20)] + [(20, 20 + k) for k in range(15)] + [(21 + i, 35 + i) for i in range(20)]
    )
    warp = fit_warp(way, 6.0, 3.0)
    for frames in warp.frames(np.linspace(warp.start, warp.end, 200)):
        assert np.diff(frames).min() > 0


def test_an_uneven_pace_and_a_turn_are_found_again() -> None:
    motion = walk(150)
    other, at = warped(place_at(motion, 1.1, np.array([2.0, -3.0])))
    curve = register([motion, other], ["a", "b"])
    assert curve.reference == 0
    frames = curve.frames(np.linspace(curve.start, curve.end, 100))
    found = np.interp(frames[1], np.arange(len(at)), at)
    assert curve.end - curve.start > 0.9 * len(motion)
    assert np.abs(found - frames[0]).max() < 2.0
    assert np.abs(found - frames[0]).mean() < 1.0  # half a frame of those that are compared, 30 a second
    turn = np.angle(np.exp(1j * (curve.paths[1].yaw - curve.paths[0].yaw)))
    np.testing.assert_allclose(turn, 1.1, atol=0.03)
    assert curve.costs[1] < 0.05  # windows at another pace are not quite alike


def test_one_frame_and_lengths_that_do_not_fit_are_refused_by_name() -> None:
    motion = walk(150)
    with pytest.raises(MuybridgeError, match=r"b\.bvh has 1 frame, and a blend needs at least 3"):
        register([motion, motion.select(slice(0, 1))], ["a.bvh", "b.bvh"])
    with pytest.raises(MuybridgeError, match=r"b\.bvh \(10 frames\) and a\.bvh \(150 frames\) differ too much"):
        register([motion, motion.select(slice(0, 10))], ["a.bvh", "b.bvh"])


def test_contacts_that_overlap_match_and_stand_between_in_the_blend() -> None:
    u = np.arange(100.0)
    one, two = np.zeros(100, bool), np.zeros(100, bool)
    one[20:41], two[30:61] = True, True
    two[80:91] = True  # without a counterpart
    frames, weights = np.stack([u, u]), np.full((2, 100), 0.5)
    out = blended_contacts([one, two], frames, u, weights)
    assert np.flatnonzero(out).tolist() == list(range(25, 51))
    mostly = blended_contacts([one, two], frames, u, np.array([[0.25], [0.75]]) * np.ones((1, 100)))
    assert mostly[80:91].all() and not mostly[91:].any()
    matches, rest = match_spans([[(20, 40)], [(30, 60), (80, 90)]])
    assert len(matches) == 1 and len(rest) == 1


def test_the_reference_of_three_motions_is_the_one_between() -> None:
    motion = walk(100)

    def bent(by: float) -> Motion:
        shifted = motion.root_positions_world + np.array([0.0, 0.0, by])
        return replace(motion, root_positions_world=shifted)

    assert register([bent(0.1), bent(0.0), bent(-0.1)], ["a", "b", "c"]).reference == 1
