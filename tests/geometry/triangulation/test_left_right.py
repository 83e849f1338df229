"""Left-right flips: corrected where the other cameras contradict, kept otherwise."""

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.triangulation.left_right import repair_flips
from tests.geometry.association.test_association import ring, walker

MIRROR = list(BODY23.mirror)


def views(count: int, frames: int, noise_px: float) -> tuple[CameraGroup, FloatArray]:
    cameras: CameraGroup = ring(count)
    truth = cameras.project(walker(frames, (0.2, 0.0), 0.4))
    return cameras, truth + np.random.default_rng(0).normal(0, noise_px, truth.shape)


@pytest.mark.parametrize("count", [3, 4, 8])
def test_flips_of_whole_views_are_corrected(count: int) -> None:
    cameras, px = views(count, 80, 6.0)
    rng = np.random.default_rng(1)
    wrong = rng.random((count, 80)) < 0.15
    wrong[1, 20:40] = True  # a whole stretch
    given = np.where(wrong[..., None, None], px[:, :, MIRROR], px)
    variance = np.full(px.shape[:-1], 36.0)
    fixed, fixed_variance, flipped = repair_flips(cameras, given, variance, BODY23)
    twin = np.array(MIRROR) != np.arange(len(BODY23))
    # Seen from the side, left and right coincide, so that flips are neither visible nor harmful.
    right = flipped == (wrong[..., None] & twin)
    assert right[..., twin].mean() > 0.97
    before = np.median(np.linalg.norm(given - px, axis=-1)[wrong][:, twin])
    after = np.quantile(np.linalg.norm(fixed - px, axis=-1)[wrong][:, twin], 0.9)
    assert before > 30 and after < 0.5 * before
    np.testing.assert_array_equal(flipped.any(axis=-1) & ~wrong, np.zeros_like(wrong))


def test_flips_of_legs_alone_are_corrected() -> None:
    cameras, px = views(4, 60, 6.0)
    legs = [i for i, n in enumerate(BODY23.names) if n.split("_", 1)[-1] in ("hip", "knee", "ankle", "heel")
            or "toe" in n]  # fmt: skip
    given = px.copy()
    given[2, 10:30][:, legs] = px[2, 10:30][:, [MIRROR[i] for i in legs]]
    fixed, _, flipped = repair_flips(cameras, given, np.full(px.shape[:-1], 36.0), BODY23)
    expected = np.zeros_like(flipped)
    expected[2, 10:30, legs] = True
    np.testing.assert_array_equal(flipped, expected)
    np.testing.assert_array_equal(fixed, px)


def test_correct_labels_are_kept_with_noise_and_gaps() -> None:
    cameras, px = views(4, 60, 20.0)
    px[3] = np.nan
    px[0, 20:30] = np.nan
    px[:, 40:43] = np.nan
    variance = np.full(px.shape[:-1], 25.0)
    fixed, fixed_variance, flipped = repair_flips(cameras, px, variance, BODY23)
    assert not flipped.any()
    np.testing.assert_array_equal(fixed, px)
    np.testing.assert_array_equal(np.isnan(fixed_variance), np.isnan(px[..., 0]))


def test_variance_goes_with_its_point() -> None:
    cameras, px = views(4, 10, 3.0)
    variance = np.random.default_rng(3).uniform(4, 16, px.shape[:-1])
    given, given_variance = px.copy(), variance.copy()
    given[0], given_variance[0] = px[0][:, MIRROR], variance[0][:, MIRROR]
    fixed, fixed_variance, flipped = repair_flips(cameras, given, given_variance, BODY23)
    assert flipped[0].any(axis=-1).all() and not flipped[1:].any()
    np.testing.assert_array_equal(fixed, px)
    np.testing.assert_array_equal(fixed_variance, variance)


def test_shapes_are_checked() -> None:
    cameras, px = views(3, 2, 1.0)
    with pytest.raises(ValueError, match=r"must be \(3, T, 23, 2\)"):
        repair_flips(cameras, px[:, :, :5], np.ones((3, 2, 5)), BODY23)


@pytest.mark.parametrize("step", [3, 8, 12])
def test_low_frame_rates_have_large_displacements(step: int) -> None:
    """Every n-th frame of a runner at 60 frames per second: each foot is where the other one was."""
    cameras: CameraGroup = ring(4)
    frames = np.arange(0, 240, step)
    world = walker(240, (0.2, 0.0), 0.4)[frames]
    swing = 0.45 * np.sin(2 * np.pi * 1.4 * frames / 60)
    for j, name in enumerate(BODY23.names):
        reach = {"knee": 0.5, "ankle": 1.0, "heel": 1.0, "toe": 1.0}.get(name.split("_")[-1], 0.0)
        world[:, j, 0] += reach * swing * (name.startswith("left_") - name.startswith("right_"))
    px = cameras.project(world)
    px += np.random.default_rng(2).normal(0, 4.0, px.shape)
    _, _, flipped = repair_flips(cameras, px, np.full(px.shape[:-1], 16.0), BODY23)
    assert not flipped.any()


def test_a_single_frame() -> None:
    cameras, px = views(4, 1, 3.0)
    given = px.copy()
    given[1] = px[1][:, MIRROR]
    fixed, _, flipped = repair_flips(cameras, given, np.full(px.shape[:-1], 9.0), BODY23)
    assert flipped[1].any()
    np.testing.assert_array_equal(fixed, px)
