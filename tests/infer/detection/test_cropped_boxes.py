"""Boxes are rounded to a grid before they are cropped, so that their last digits change no pixel."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from muybridge.infer.detection.crop_reader import _cropped_boxes


@given(st.floats(-500, 4000), st.floats(-500, 4000), st.floats(0.5, 3000), st.floats(0.5, 3000))
def test_edges_move_by_less_than_a_sixtieth_of_the_side(left: float, top: float, width: float, height: float) -> None:
    box = np.array([[left, top, left + width, top + height]])
    (found,) = _cropped_boxes(box)
    side = max(width, height, 8.0)
    center = np.array([left + width / 2, top + height / 2])
    half = np.maximum([width, height], max(8.0, side / 32)) / 2
    np.testing.assert_allclose(found, [*(center - half), *(center + half)], rtol=0, atol=side / 60)
    assert (found[2:] > found[:2]).all()


def test_the_last_digits_of_boxes_hardly_ever_show() -> None:
    rng = np.random.default_rng(0)
    low = rng.uniform(0, 1000, (20_000, 2))
    boxes = np.concatenate([low, low + rng.uniform(20, 1000, (20_000, 2))], axis=1)
    noisy = boxes + rng.normal(0, 1e-4, boxes.shape)
    assert (_cropped_boxes(boxes) != _cropped_boxes(noisy)).any(axis=1).mean() < 5e-4
