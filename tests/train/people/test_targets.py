"""Targets of the person detector, and the overlap that its loss is made of."""

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.train.images.scenes import SceneBatch  # noqa: E402
from muybridge.train.people.train import as_tensors, generalised_iou, make_targets  # noqa: E402


def test_detector_targets_say_where_the_box_is():
    import torch

    box = np.array([[40.0, 30.0, 99.0, 150.0]], np.float32)
    batch = SceneBatch(torch.zeros(1, 4, 192, 320, dtype=torch.uint8), [box], [np.zeros((0, 4), np.float32)])
    targets = make_targets(batch)
    row, column = np.unravel_index(targets.heat[0].argmax(), targets.heat[0].shape)
    center = np.array([column, row]) * 8 + 3.5
    left, top, right, bottom = targets.box[0][:, row, column]
    found = [center[0] - left, center[1] - top, center[0] + right, center[1] + bottom]
    np.testing.assert_allclose(found, box[0], atol=1e-4)
    assert targets.has_box[0].sum() > 1 and targets.weight.min() == 1
    assert as_tensors(batch)[1].shape == (1, 24, 40)


def test_generalised_iou():
    import torch

    a = torch.tensor([1.0, 1.0, 1.0, 1.0])
    assert float(generalised_iou(a, a)) == pytest.approx(1, abs=1e-5)
    half = torch.tensor([1.0, 1.0, 0.0, 1.0])
    assert float(generalised_iou(a, half)) == pytest.approx(0.5, abs=1e-5)
