"""Networks are trained in the faster precision."""

import pytest

torch = pytest.importorskip("torch")

from muybridge.train.engine import precision  # noqa: E402
from muybridge.train.engine.muon import orthogonalise  # noqa: E402

CPU = torch.device("cpu")


@pytest.fixture
def unmeasured():
    """Nothing measured before, and nothing of the test's measurement afterwards."""
    precision._measure.cache_clear()
    yield
    precision._measure.cache_clear()


@pytest.mark.parametrize(("seconds", "wanted"), [(0.5, True), (0.9, False), (8.0, False)])
def test_bfloat16_is_used_where_it_is_clearly_faster(unmeasured, monkeypatch, seconds, wanted):
    monkeypatch.setattr(precision, "_seconds", lambda layer, image, rough: seconds if rough else 1.0)
    assert precision.bfloat16_is_faster("cpu") is wanted
    x = torch.rand(4, 4)
    with precision.autocast(CPU):
        assert (x @ x).dtype == (torch.bfloat16 if wanted else torch.float32)
    assert precision.name(CPU) == ("bfloat16" if wanted else "float32")


def test_precision_is_measured_once_without_changing_the_seed(unmeasured, monkeypatch):
    kinds = set()
    layer_of = torch.nn.Conv2d.forward

    def watched(self, image):
        out = layer_of(self, image)
        kinds.add(out.dtype)
        return out

    monkeypatch.setattr(torch.nn.Conv2d, "forward", watched)
    torch.manual_seed(3)
    wanted = torch.rand(3)
    torch.manual_seed(3)
    with torch.no_grad():
        precision.bfloat16_is_faster("cpu")
    assert kinds == {torch.bfloat16, torch.float32}
    assert torch.equal(torch.rand(3), wanted)
    kinds.clear()
    precision.bfloat16_is_faster("cpu")
    assert not kinds


@pytest.mark.parametrize("rough", [True, False])
def test_steps_are_orthogonal_in_both_precisions(monkeypatch, rough):
    monkeypatch.setattr(precision, "_measure", lambda: rough)
    torch.manual_seed(0)
    for shape in ((24, 60), (60, 24)):
        matrix = torch.randn(shape)
        out = orthogonalise(matrix)
        assert out.dtype == matrix.dtype and out.shape == matrix.shape
        values = torch.linalg.svdvals(out)
        assert 0.6 < values.min() and values.max() < 1.3
