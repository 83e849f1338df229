"""Images warped and scaled down in whole numbers."""

import hashlib
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.cameras.sampling import scaled_down, warp

HOMOGRAPHY = np.array([[0.8, 0.05, 3.3], [-0.04, 0.9, -5.2], [1e-4, -2e-4, 1.0]])


def picture(width: int = 150, height: int = 110, channels: int = 3) -> ByteArray:
    """A smooth picture, in which a wrong place shows as a wrong value."""
    noise = np.random.default_rng(0).normal(128, 400, (height, width, channels))
    return cv2.GaussianBlur(noise, (0, 0), 3.0).reshape(height, width, channels).clip(0, 255).astype(np.uint8)


def bilinear(image: ByteArray, out_from_image: FloatArray, size: tuple[int, int]) -> FloatArray:
    """The same in floating point, black outside."""
    u, v = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    mapped = np.linalg.inv(out_from_image) @ np.stack([u, v, np.ones_like(u)]).reshape(3, -1).astype(float)
    x, y = mapped[:2] / mapped[2] + 1
    padded = np.pad(image.astype(float), ((1, 1), (1, 1), (0, 0)))
    x, y = np.clip(x, 0, padded.shape[1] - 1.001), np.clip(y, 0, padded.shape[0] - 1.001)
    left, top = x.astype(int), y.astype(int)
    across, down = (x - left)[:, None], (y - top)[:, None]
    above = (1 - across) * padded[top, left] + across * padded[top, left + 1]
    below = (1 - across) * padded[top + 1, left] + across * padded[top + 1, left + 1]
    return np.asarray(((1 - down) * above + down * below).reshape(size[1], size[0], -1))


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_warped_as_by_the_homography(channels: int) -> None:
    image = picture(channels=channels)
    found = warp(image, HOMOGRAPHY, (128, 96)).reshape(96, 128, channels)
    away = np.abs(found - bilinear(image, HOMOGRAPHY, (128, 96)))
    # Places are rounded to 32nds of a pixel, which shows most at the edges to black.
    assert away.max() <= 1 + 2 * 255 / 64
    assert np.quantile(away, 0.95) <= 1


def test_a_shift_by_whole_pixels_is_exact_and_black_outside() -> None:
    image = picture()
    shifted = warp(image, np.array([[1.0, 0, 20], [0, 1, -10]]), (150, 110))
    np.testing.assert_array_equal(shifted[:100, 20:], image[10:, :-20])
    assert not shifted[:, :20].any() and not shifted[100:].any()


def test_far_away_is_black() -> None:
    assert not warp(picture(), np.array([[1e-7, 0, 0], [0, 1e-7, 0], [0, 0, 1.0]]), (8, 8))[1:, 1:].any()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 60), st.integers(1, 60), st.integers(60, 130), st.integers(60, 130), st.integers(0, 255))
def test_scaled_down_is_the_mean_over_areas(few_x: int, few_y: int, width: int, height: int, value: int) -> None:
    plain = np.full((height, width, 3), value, np.uint8)
    assert (scaled_down(plain, (few_x, few_y)) == value).all()
    image = picture(width, height)
    found = scaled_down(image, (few_x, few_y))
    assert found.shape == (few_y, few_x, 3)
    expected = cv2.resize(image.astype(np.float32), (few_x, few_y), interpolation=cv2.INTER_AREA)
    assert np.abs(found - expected).max() < 1.6


def test_other_types_and_larger_sizes_are_opencvs() -> None:
    image = picture().astype(np.float32)
    np.testing.assert_array_equal(warp(image, HOMOGRAPHY, (40, 30)), cv2.warpPerspective(image, HOMOGRAPHY, (40, 30)))
    area = cv2.resize(image, (40, 30), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(scaled_down(image, (40, 30)), area)
    assert scaled_down(picture(), (200, 120)).shape == (120, 200, 3)


def drawn() -> str:
    """A digest of pictures as `muybridge run` draws them."""
    image = picture()
    shrunk = [scaled_down(image, size) for size in ((140, 103), (96, 96), (75, 55), (31, 17))]
    warped = [warp(image, HOMOGRAPHY, (160, 160)), warp(image, HOMOGRAPHY[:2] * [[1], [1.1]], (192, 192))]
    return hashlib.sha256(b"".join(each.tobytes() for each in (*shrunk, *warped))).hexdigest()


def test_the_same_without_avx2() -> None:
    older = {"OPENCV_CPU_DISABLE": "AVX2,FP16,AVX", "NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": "",
             "NUMBA_DISABLE_JIT": "0", "OPENBLAS_CORETYPE": "Nehalem"}  # fmt: skip
    code = "from tests.geometry.cameras.test_sampling import drawn; print(drawn())"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **older}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-1] == drawn()
