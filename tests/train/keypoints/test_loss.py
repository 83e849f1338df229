"""The loss on heatmaps, and the learning rate and averages that training uses."""

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import SessionError  # noqa: E402
from muybridge.models.keypoints.decode import decode_heatmaps  # noqa: E402
from muybridge.models.uncertainty import SpreadCalibration  # noqa: E402
from muybridge.train.correction.options import SolverTraining  # noqa: E402
from muybridge.train.engine import loop  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.loss import OUTSIDE, heatmap_loss  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.labelling.options import LabelTraining  # noqa: E402
from muybridge.train.people.options import PeopleTraining  # noqa: E402


def test_heatmap_loss_is_least_at_the_truth():
    truth = torch.tensor([[[13.5, 21.5]]])
    scores = []
    for shift in range(-2, 3):
        logits = torch.full((1, 1, 16, 16), -8.0)
        logits[0, 0, 5, 3 + shift] = 8.0
        scores.append(float(heatmap_loss(logits, truth)))
    assert int(np.argmin(scores)) == 2
    outside = torch.tensor([[[200.0, 5.0]]])
    assert float(heatmap_loss(torch.zeros(1, 1, 16, 16), outside)) == 0.0


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_heatmap_loss_and_its_gradient_are_those_of_cross_entropy(layout):
    torch.manual_seed(1)
    logits = (3 * torch.randn(3, 5, 12, 16)).to(memory_format=layout).requires_grad_()
    landmarks = torch.rand(3, 5, 2) * torch.tensor([64.0, 48.0])
    landmarks[0, 0], landmarks[1, 1] = torch.nan, 300.0
    weight = torch.rand(3, 5)
    cell = (landmarks - 1.5) / 4
    x, y = (torch.exp(-((torch.arange(n) - cell[..., i, None]) ** 2) / (2 * 0.8**2)) for i, n in enumerate((16, 12)))
    target = torch.einsum("bjy,bjx->bjyx", y / y.sum(-1, keepdim=True), x / x.sum(-1, keepdim=True)).flatten(2)
    # The unknown one is no loss; of the one outside the best is to say nothing.
    target[0, 0], target[1, 1] = 0, OUTSIDE / (12 * 16)
    expected = -(target * logits.flatten(2).log_softmax(-1)).sum(-1)
    best = torch.zeros(3, 5)
    best[1, 1] = OUTSIDE * np.log(12 * 16)
    expected = expected - best
    loss = heatmap_loss(logits, landmarks)
    torch.testing.assert_close(loss, expected, atol=1e-4, rtol=1e-5)
    ours, theirs = (torch.autograd.grad((value * weight).sum(), logits)[0] for value in (loss, expected))
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-3)


def test_heatmap_loss_is_least_for_what_the_decoder_reads_back():
    """Loss, cells and decoder share one convention: the loss' own minimiser decodes to the label."""
    truth = torch.tensor([[[22.3, 41.9]]])
    logits = torch.zeros(1, 1, 16, 16, requires_grad=True)
    optimiser = torch.optim.Adam([logits], 0.5)
    for _ in range(300):
        optimiser.zero_grad()
        heatmap_loss(logits, truth).sum().backward()
        optimiser.step()
    decoded = decode_heatmaps(logits.detach().numpy(), 4, SpreadCalibration())
    np.testing.assert_allclose(decoded.points_crop_px[0, 0], truth[0, 0].numpy(), atol=0.2)


def test_learning_rate_warms_up_stays_and_falls():
    def rate(step, elapsed):
        return loop.learning_rate(1.0, step, elapsed, 100.0, 0.2)

    assert rate(0, 0.0) < 0.01
    assert rate(500, 50.0) == 1.0
    assert rate(500, 90.0) == pytest.approx(0.5)
    assert rate(500, 100.0) == pytest.approx(0.01)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_weights_are_averaged_over_the_last_steps_or_a_share_of_all(share):
    net = torch.nn.Linear(1, 1)
    average = loop.AveragedWeights(net, 0.9, share)
    for step in range(400):
        torch.nn.init.constant_(net.weight, float(step))
        average.update(net, step)
    # Of an exponential average the weights of a step fall by a tenth with every step after it.
    assert float(average.state["weight"]) == pytest.approx(399 - 9 if share == 0 else 399 / 2, abs=1)


def test_a_share_of_steps_that_is_none_is_refused(store, tmp_path):
    with pytest.raises(SessionError, match="--average 2"):
        keypoints.train(KeypointTraining(renders=store, out=tmp_path / "run", average=2.0, workers=0))
    for other in (PeopleTraining, LabelTraining, SolverTraining):
        with pytest.raises(SessionError, match="--average -1"):
            other(average=-1.0)
