"""A second process computes part of the gradients."""

import operator
import os
import time
from dataclasses import replace

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.models.keypoints.network import Block, ConvUnit, KeypointNet  # noqa: E402
from muybridge.train.engine import gradient_worker as second  # noqa: E402
from muybridge.train.engine import precision  # noqa: E402
from muybridge.train.engine.gradient_worker import CHUNKS, GradientWorker, is_worthwhile  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.export import load_keypoint_checkpoint  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.keypoints.train import losses_of  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_held_out")


class SmoothBlock(Block):
    def forward(self, x):
        return torch.nn.functional.softplus(x + self.second(self.first(x)))


class SmoothNet(KeypointNet):
    """Without ReLU, whose kink turns the rounding of a sum into a different gradient: of 30 batches two differed by
    0.2 and 2 % when the weights were changed by their last digit, and without it none by 0.001 %."""

    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        for module in list(self.modules()):
            if isinstance(module, Block):
                module.__class__ = SmoothBlock
            elif isinstance(module, ConvUnit):
                module[2] = torch.nn.Softplus()


def small_net(kind=KeypointNet):
    torch.manual_seed(0)
    return kind(95, (16, 16, 16, 24), (0, 1, 0, 1)).to(memory_format=torch.channels_last).train()


def some_batch(seed, side=64):
    torch.manual_seed(seed)
    image = torch.randint(0, 255, (8, 4, side, side), dtype=torch.uint8).contiguous(memory_format=torch.channels_last)
    return image, torch.rand(8, 95, 2) * 80 - 8, torch.rand(8, 95) > 0.3, torch.arange(8)


def of_one_process(net, batch):
    """The gradients of the mean of the chunks' losses, worked out here."""
    net.zero_grad()
    for part in zip(*(values.chunk(CHUNKS) for values in batch), strict=True):
        (losses_of(net, part)[0] / CHUNKS).backward()
    return [p.grad.clone() for p in net.parameters()]


def loss_of(net, batch):
    total, *_ = losses_of(net, batch)
    return total, total.detach()


def wait_until_ready(other):
    limit = time.monotonic() + 120
    while not other._pipe.poll():
        assert time.monotonic() < limit, "the second process never answered"
        time.sleep(0.1)


def test_gradients_of_both_processes_add_up_to_those_of_one(monkeypatch):
    # Both in float32: in bfloat16 sums taken in another order differ by more than what is looked for.
    monkeypatch.setattr(precision, "_measure", lambda: False)
    net, before = small_net(SmoothNet), second.processors()
    with GradientWorker(net, losses_of, 0.0) as other:
        for seed, (theirs, side) in enumerate(((0, 96), (1, 96), (3, 64), (2, 96))):
            batch = some_batch(seed, side)
            expected = of_one_process(net, batch)
            with monkeypatch.context() as patch:
                if theirs:
                    wait_until_ready(other)
                    assert other._count() == 1  # of what takes how long nothing is known yet
                    patch.setattr(other, "_count", lambda theirs=theirs: theirs)
                    other._own_seconds = 0.0
                net.zero_grad()
                figure = other.gradients(net, batch, loss_of)
            assert torch.isfinite(figure)
            for p, wanted in zip(net.parameters(), expected, strict=True):
                torch.testing.assert_close(p.grad, wanted, rtol=1e-4, atol=1e-4 * float(wanted.abs().max()) + 1e-6)
            with torch.no_grad():  # as a step would: the other process has to hear of it
                for p in net.parameters():
                    p.add_(0.01 * torch.randn_like(p))
            if theirs:
                other._second_seconds = 0.0
                other._hand_over(batch, 1)  # so that there is an answer to wait for again
                other._ready = False
        process = other._process
    assert not process.is_alive() and process.exitcode == 0
    assert second.processors() == before


def test_failure_of_the_second_process_is_reported():
    net = small_net()
    with GradientWorker(net, operator.matmul, 0.0) as other:
        other.gradients(net, some_batch(0), loss_of)
        wait_until_ready(other)
        with pytest.raises(RuntimeError, match="--no-second trains without it: TypeError"):
            other.gradients(net, some_batch(1), loss_of)


@pytest.mark.parametrize("answered", [False, True])
def test_killed_second_process_is_reported(answered):
    net = small_net()
    with GradientWorker(net, losses_of, 0.0) as other:
        other.gradients(net, some_batch(0), loss_of)
        if answered:  # then it is missed when the next batch is handed over
            wait_until_ready(other)
            assert other._count() == 1
        other._process.kill()
        other._process.join()
        with pytest.raises(RuntimeError, match="second training process ended"):
            other.gradients(net, some_batch(1), loss_of)


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="not on this system")
@pytest.mark.parametrize(("before", "idle"), [(0, False), (15, True)])
def test_second_process_has_lower_priority_than_a_nice_training(monkeypatch, before, idle):
    nice, scheduled = [before], []

    def change(by):
        nice[0] = min(nice[0] + by, 19)
        return nice[0]

    monkeypatch.setattr(os, "nice", change)
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, _: scheduled.append((pid, policy)))
    second._lower_priority()
    assert scheduled == ([(0, os.SCHED_IDLE)] if idle else [])
    assert nice == [min(before + 10, 19)]


@pytest.mark.parametrize(
    ("own", "theirs", "chunks"), [(0.16, 0.5, 1), (0.6, 0.65, 2), (0.6, 0.1, 3), (0.16, 3.0, 0), (0.16, 0.0, 1)]
)
def test_chunks_are_balanced_by_speed(own, theirs, chunks):
    other = GradientWorker(small_net(), losses_of, 0.0)
    other._ready, other._own_seconds, other._second_seconds = True, own, theirs
    assert other._count() == chunks
    if not chunks:  # and is tried again at times
        assert [other._count() for _ in range(120)].count(1) == 2


def test_second_process_is_used_only_with_a_spare_processor(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(second, "processors", lambda: [0, 1])
    assert is_worthwhile(64, 1, 60.0)
    assert not is_worthwhile(64, 2, 60.0) and not is_worthwhile(30, 1, 60.0) and not is_worthwhile(64, 1, 1.0)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert not is_worthwhile(64, 1, 60.0)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_training_with_a_second_process_resumes(store, tmp_path, monkeypatch):
    monkeypatch.setattr(second, "PAYS_AFTER_MINUTES", 0.0)
    taken = []
    hand_over = GradientWorker._hand_over
    monkeypatch.setattr(
        GradientWorker, "_hand_over", lambda self, batch, n: taken.append(n) or hand_over(self, batch, n)
    )

    def one_as_soon_as_it_is_ready(self):  # however busy the machine is
        if not self._ready:
            wait_until_ready(self)
            self._receive()
            self._ready = True
        return 1

    monkeypatch.setattr(GradientWorker, "_count", one_as_soon_as_it_is_ready)
    options = KeypointTraining(
        renders=store, out=tmp_path / "run", steps=8, size=64, batch=16, backgrounds=8, workers=1
    )
    first = load_keypoint_checkpoint(keypoints.train(options))
    assert first["state"]["images"] == 16 * first["state"]["step"] > 0
    assert taken == [1] * (first["state"]["step"] + 1)  # the first, whose gradients nobody wants, sets it up
    again = load_keypoint_checkpoint(keypoints.train(replace(options, steps=2, second=False)))
    assert again["state"]["step"] > first["state"]["step"]
    assert all(torch.isfinite(value).all() for value in again["net"].values())
