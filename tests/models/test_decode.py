"""Decoding: sub-cell points, two hypotheses, variances, boxes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.arrays import Float32Array, FloatArray
from muybridge.models.keypoints.decode import decode_heatmaps
from muybridge.models.people.decode import box_overlap, decode_people, suppress_overlaps
from muybridge.models.uncertainty import SpreadCalibration

_PLAIN = SpreadCalibration(scale=1.0, floor_px2=0.5)


def _peak(u: float, v: float, sigma: float, size: int = 32) -> FloatArray:
    """Probability (size, size) of a Gaussian about cell (u, v)."""
    rows, columns = np.mgrid[:size, :size]
    p = np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * sigma**2)) + 1e-12
    return np.asarray(p / p.sum())


def _logits(*maps: FloatArray) -> Float32Array:
    return np.log(np.stack(maps)).astype(np.float32)[None]


@settings(max_examples=60, deadline=None)
@given(
    u=st.floats(6, 25), v=st.floats(6, 25), sigma=st.floats(0.6, 1.6), shift=st.floats(-80, 80),
    stride=st.sampled_from([4, 8]),
)  # fmt: skip
def test_a_peak_is_found_between_cells(u: float, v: float, sigma: float, shift: float, stride: int) -> None:
    decoded = decode_heatmaps(_logits(_peak(u, v, sigma)) + np.float32(shift), stride, _PLAIN)
    expected = np.array([u, v]) * stride + (stride - 1) / 2
    assert np.abs(decoded.points_crop_px[0, 0] - expected).max() < 0.1 * stride
    assert decoded.variance_crop_px2[0, 0] == pytest.approx(sigma**2 * stride**2 + 0.5, rel=0.1, abs=0.2)
    # The mass of a Gaussian within 2.5 cells, up to the cells that the circle cuts.
    assert decoded.score[0, 0] == pytest.approx(1 - np.exp(-(2.5**2) / (2 * sigma**2)), abs=0.12)


def test_two_hypotheses_are_not_averaged() -> None:
    two = 0.55 * _peak(10, 16, 1.0) + 0.45 * _peak(22, 16, 1.0)
    decoded = decode_heatmaps(_logits(two, _peak(10, 16, 1.0)), 4, _PLAIN)
    np.testing.assert_allclose(decoded.points_crop_px[0, 0], [41.5, 65.5], atol=0.2)
    # Half of the mass is 12 cells away: 0.45 * 144 / 2 cells^2 more.
    assert decoded.variance_crop_px2[0, 0] == pytest.approx((0.45 * 72 + 1) * 16 + 0.5, rel=0.02)
    assert decoded.score[0, 0] == pytest.approx(0.55 * decoded.score[0, 1], rel=0.01)


def test_flat_and_broken_maps() -> None:
    logits = np.zeros((2, 3, 32, 32), dtype=np.float32)
    logits[0, 1, 3, 4] = np.nan
    logits[1, 2] = -np.inf
    decoded = decode_heatmaps(logits, 4, _PLAIN)
    missing = np.zeros((2, 3), dtype=bool)
    missing[0, 1] = missing[1, 2] = True
    for values in (decoded.points_crop_px[..., 0], decoded.variance_crop_px2):
        np.testing.assert_array_equal(np.isnan(values), missing)
    assert (decoded.score[missing] == 0).all() and (decoded.score[~missing] < 0.05).all()
    # A map that knows nothing: the spread of the whole crop about wherever it points.
    assert decoded.variance_crop_px2[0, 0] > 16 * 32**2 / 12


@pytest.mark.parametrize("corner", [(0, 0), (31, 0), (0, 31), (31, 31)])
def test_peaks_at_the_border_stay_there(corner: tuple[int, int]) -> None:
    decoded = decode_heatmaps(_logits(_peak(*corner, 0.8)), 4, _PLAIN)
    cell = (decoded.points_crop_px[0, 0] - 1.5) / 4
    assert np.abs(cell - corner).max() <= 1.0 and (cell >= 0).all() and (cell <= 31).all()


def test_calibration_scales_the_variance() -> None:
    logits = _logits(_peak(12.3, 15.2, 1.2))
    plain = decode_heatmaps(logits, 4, SpreadCalibration(1.0, 0.0)).variance_crop_px2
    scaled = decode_heatmaps(logits, 4, SpreadCalibration(2.5, 3.0)).variance_crop_px2
    np.testing.assert_allclose(scaled, 2.5 * plain + 3.0)


def test_batches_and_single_maps_agree() -> None:
    logits = np.random.default_rng(0).normal(0, 3, (7, 5, 24, 32)).astype(np.float32)
    whole = decode_heatmaps(logits, 4, _PLAIN)
    for index in range(7):
        one = decode_heatmaps(logits[index : index + 1], 4, _PLAIN)
        np.testing.assert_allclose(one.points_crop_px[0], whole.points_crop_px[index], atol=1e-4)
        np.testing.assert_allclose(one.variance_crop_px2[0], whole.variance_crop_px2[index], rtol=1e-3)
    with pytest.raises(ValueError, match=r"\(N, J, h, w\)"):
        decode_heatmaps(logits[0], 4, _PLAIN)


def _detector_maps(
    people: list[tuple[float, float, float, float, float]], shape: tuple[int, int] = (24, 40)
) -> tuple[Float32Array, Float32Array]:
    """Maps as the detector gives them for people (left, top, right, bottom, logit)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    x, y = columns * 8 + 3.5, rows * 8 + 3.5
    heatmap, box = np.full((1, 1, *shape), -8.0), np.zeros((1, 4, *shape))
    for left, top, right, bottom, logit in people:
        away = np.hypot(x - (left + right) / 2, y - (top + bottom) / 2)
        bump = logit - 0.05 * away
        mine = bump > heatmap[0, 0]
        heatmap[0, 0][mine] = bump[mine]
        for channel, distance in enumerate((x - left, y - top, right - x, bottom - y)):
            box[0, channel][mine] = distance[mine]
    return heatmap.astype(np.float32), box.astype(np.float32)


def test_people_are_sorted_by_score() -> None:
    people = [
        (40.0, 30.0, 100.0, 160.0, 2.0),
        (180.0, 20.0, 250.0, 180.0, 4.0),
        (280.0, 20.0, 300.0, 60.0, -3.0),
    ]
    (found,) = decode_people(*_detector_maps(people), stride=8, threshold=0.3)
    np.testing.assert_allclose(found.boxes_px, [people[1][:4], people[0][:4]], atol=1e-3)
    assert found.scores[0] > found.scores[1] > 0.8
    (one,) = decode_people(*_detector_maps(people), stride=8, threshold=0.3, max_people=1)
    np.testing.assert_allclose(one.boxes_px, [people[1][:4]], atol=1e-3)
    (nobody,) = decode_people(*_detector_maps([]), stride=8)
    assert nobody.boxes_px.shape == (0, 4) and nobody.scores.shape == (0,)


def test_two_peaks_of_one_person_become_one_detection() -> None:
    heatmap, box = _detector_maps([(40.0, 30.0, 100.0, 160.0, 2.0)])
    heatmap[0, 0, 14, 8] = 1.9  # a second peak, two cells below, with the same person's box
    (found,) = decode_people(heatmap, box, stride=8, threshold=0.3)
    assert len(found.scores) == 1
    box[:] = -1.0
    (found,) = decode_people(heatmap, box, stride=8, threshold=0.3)
    assert len(found.scores) == 0


def test_overlaps() -> None:
    boxes = np.array([[0.0, 0, 10, 10], [5, 0, 15, 10], [100, 100, 120, 120]])
    overlap = box_overlap(boxes, boxes)
    np.testing.assert_allclose(np.diag(overlap), 1)
    assert overlap[0, 1] == pytest.approx(1 / 3) and overlap[0, 2] == 0
    scores = np.array([0.5, 0.9, 0.1])
    assert suppress_overlaps(boxes, scores, 0.3).tolist() == [1, 2]
    assert suppress_overlaps(boxes, scores, 0.4).tolist() == [1, 0, 2]


def test_one_of_two_twins_in_one_place_moves_to_its_second_place() -> None:
    sure, torn = _peak(10, 16, 1.0), 0.55 * _peak(11, 16, 1.0) + 0.45 * _peak(22, 9, 1.0)
    alone = 0.55 * _peak(10, 16, 1.0) + 0.45 * _peak(20, 20, 1.0)  # without a twin
    logits, twins = _logits(sure, torn, alone), np.array([1, 0, 2])
    plain, told = decode_heatmaps(logits, 4, _PLAIN), decode_heatmaps(logits, 4, _PLAIN, twins)
    np.testing.assert_allclose(plain.points_crop_px[0, 1], [45.5, 65.5], atol=0.4)
    np.testing.assert_allclose(told.points_crop_px[0, 1], [89.5, 37.5], atol=0.4)
    # It is as unsure as where it was, by what the other place weighs more.
    assert told.score[0, 1] == pytest.approx(plain.score[0, 1] * 45 / 55, rel=0.02)
    assert told.variance_crop_px2[0, 1] == pytest.approx((0.55 * (11**2 + 7**2) / 2 + 1) * 16 + 0.5, rel=0.03)
    for values, before in zip(told, plain, strict=True):
        np.testing.assert_array_equal(values[0, [0, 2]], before[0, [0, 2]])
    # Whichever comes first; and each crop for itself, to the rounding of sums taken in another order.
    flipped = decode_heatmaps(logits[:, [1, 0, 2]], 4, _PLAIN, twins).points_crop_px
    np.testing.assert_allclose(flipped[0, [1, 0, 2]], told.points_crop_px[0], atol=1e-5)
    both = decode_heatmaps(np.concatenate([_logits(sure, sure, alone), logits]), 4, _PLAIN, twins).points_crop_px
    np.testing.assert_allclose(both[1], told.points_crop_px[0], atol=1e-5)
    np.testing.assert_allclose(both[0, 0], both[0, 1])


@pytest.mark.parametrize(
    ("second", "apart", "moves"), [(0.4, 11, True), (0.3, 11, False), (0.45, 2, False), (0.0, 11, False)]
)
def test_twins_stay_without_a_likely_second_place(second: float, apart: float, moves: bool) -> None:
    one = (1 - second) * _peak(10, 16, 0.8) + second * _peak(10 + apart, 16, 0.8)
    logits = _logits(_peak(10, 15, 0.8), one)
    twins = np.array([1, 0])
    at = decode_heatmaps(logits, 4, _PLAIN, twins).points_crop_px[0, 1, 0] / 4
    assert (at > 16) == moves
    # Of what hardly anything is known no other place is either.
    vague = 0.2 * one + 0.8 / one.size
    at = decode_heatmaps(_logits(_peak(10, 15, 0.8), vague), 4, _PLAIN, twins).points_crop_px[0, 1, 0] / 4
    assert at < 16
    # Twins that are apart as it is are left alone.
    logits = _logits(_peak(20, 15, 0.8), one)
    np.testing.assert_array_equal(
        decode_heatmaps(logits, 4, _PLAIN, twins).points_crop_px, decode_heatmaps(logits, 4, _PLAIN).points_crop_px
    )


def test_twins_at_the_edge_and_on_broken_maps() -> None:
    corner = 0.55 * _peak(0, 0, 0.8) / _peak(0, 0, 0.8).sum() + 0.45 * _peak(31, 31, 0.8) / _peak(31, 31, 0.8).sum()
    logits = _logits(_peak(0, 0, 0.8), corner, _peak(5, 5, 1.0), _peak(5, 5, 1.0))
    logits[0, 2, 3, 3] = np.nan
    found = decode_heatmaps(logits, 4, _PLAIN, np.array([1, 0, 3, 2]))
    np.testing.assert_allclose(found.points_crop_px[0, 1], 31 * 4 + 1.5, atol=2)
    assert np.isnan(found.points_crop_px[0, 2]).all() and np.isfinite(found.points_crop_px[0, 3]).all()
