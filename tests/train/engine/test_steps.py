"""Training for a number of steps: it stops there, and equal seeds give equal weights."""

import itertools
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

import tyro  # noqa: E402

from muybridge.errors import SessionError  # noqa: E402
from muybridge.train import commands  # noqa: E402
from muybridge.train.engine import loop  # noqa: E402
from muybridge.train.engine.checkpoint import load_checkpoint  # noqa: E402
from muybridge.train.engine.options import Training  # noqa: E402


class _Line(torch.nn.Module):
    """One filter, which needs a few steps."""

    def __init__(self):
        super().__init__()
        self.filter, self.config = torch.nn.Conv2d(1, 1, 3), {}

    def forward(self, x):
        return self.filter(x)


def _trained(out: Path, seed: int, steps: int = 5) -> dict:
    options = Training(out=out, steps=steps, minutes=1e-9, seed=seed, batch=2)
    torch.manual_seed(options.seed)
    run = loop.TrainingRun(options, _Line(), lambda net: {})
    stream = (tuple(torch.randn(2, 2, 1, 6, 6)) for _ in itertools.count())

    def loss_of(net, batch):
        loss = ((net(batch[0]) - batch[1][..., 1:-1, 1:-1]) ** 2).mean()
        return loss, loss.detach()

    run.run(stream, loss_of)
    return load_checkpoint(run.checkpoint)


def test_training_stops_after_its_steps(tmp_path):
    saved = _trained(tmp_path / "a", 0)
    assert saved["state"]["step"] == 5 and saved["state"]["images"] == 10
    again = _trained(tmp_path / "a", 0, 3)  # of this call
    assert again["state"]["step"] == 8


def test_equal_seeds_give_equal_weights(tmp_path):
    one, same, other = (_trained(tmp_path / name, seed) for name, seed in (("a", 3), ("b", 3), ("c", 4)))
    for part in ("net", "average"):
        assert all(torch.equal(one[part][k], same[part][k]) for k in one[part])
        assert not all(torch.equal(one[part][k], other[part][k]) for k in one[part])


def test_the_rate_falls_with_the_steps(tmp_path, monkeypatch):
    rates = []
    monkeypatch.setattr(loop.Optimisers, "set_rate", lambda self, rate: rates.append(rate))
    monkeypatch.setattr(loop, "_WARM_UP_STEPS", 1)
    _trained(tmp_path, 0, 20)
    assert len(rates) == 20 and rates[0] == rates[15] == 2e-3 and rates[19] == pytest.approx(2e-3 / 4)


@pytest.mark.parametrize("network", ["keypoints", "people", "labels", "solver", "rigger", "skinning", "adapt"])
def test_every_training_takes_steps(tmp_path, network):
    given = [network, "--steps", "7", "--out", str(tmp_path)]
    options = tyro.cli(commands._Network, args=given + ["--footage", "x.npz"] * (network == "adapt"))
    assert options.steps == 7


def test_no_steps_are_refused(tmp_path):
    with pytest.raises(SessionError, match="--steps 0: must be at least 1"):
        Training(out=tmp_path, steps=0)
