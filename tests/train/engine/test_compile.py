"""The compiled loss equals the uncompiled one."""

import pytest

torch = pytest.importorskip("torch")

from muybridge.models.keypoints.batch_norm import BatchNorm  # noqa: E402
from muybridge.models.keypoints.network import KeypointNet, upsample  # noqa: E402
from muybridge.train.engine import compile as module  # noqa: E402
from muybridge.train.engine import precision  # noqa: E402
from muybridge.train.engine.compile import PAYS_AFTER_MINUTES, compile_for_training  # noqa: E402
from muybridge.train.keypoints.train import losses_of  # noqa: E402


# Compiling takes up to two minutes.
@pytest.mark.slow
@pytest.mark.parametrize("native", [True, False])
def test_compiled_gradients_are_as_precise_as_uncompiled_ones(monkeypatch, native):
    bfloat16 = (precision.name(torch.device("cpu")) == "bfloat16") == native
    monkeypatch.setattr(precision, "_measure", lambda: bfloat16)
    torch.compiler.reset()
    fused = compile_for_training(losses_of, PAYS_AFTER_MINUTES)
    if fused is losses_of:
        pytest.skip("torch.compile does not work here")
    torch.manual_seed(1)  # of 0 a unit lies so near ReLU's edge that weights a millionth apart pass it on and do not
    net = KeypointNet(95, (16, 16, 16, 24), (0, 1, 0, 1)).train()
    image, seen = torch.randint(0, 255, (8, 4, 64, 64), dtype=torch.uint8), torch.rand(8, 95) > 0.3
    batch = image, torch.rand(8, 95, 2) * 80 - 8, seen  # some lie outside

    def gradients(losses):
        net.zero_grad()
        total, each, count = losses(net, batch)
        total.backward()
        return {name: p.grad.clone() for name, p in net.named_parameters()}, total.detach(), each, count

    rough, _, rough_each, rough_count = gradients(losses_of)
    ours, total, each, count = gradients(fused)
    monkeypatch.setattr(precision, "_measure", lambda: False)
    precise, precise_total, *_ = gradients(losses_of)

    assert float(total) == pytest.approx(float(precise_total), rel=2e-3)
    torch.testing.assert_close(each, rough_each, rtol=2e-2 if bfloat16 else 1e-4, atol=0.0)
    assert torch.equal(count, rough_count)
    # That of the last bias is none: a softmax does not feel it.
    size = {name: float(truth.norm()) for name, truth in precise.items() if truth.norm() > 1e-5}
    off, usual = (
        {name: float((given[name] - precise[name]).norm()) / size[name] for name in size} for given in (ours, rough)
    )
    if not bfloat16:
        assert not any(usual.values()) and max(off.values()) < 1e-3
        return
    assert sum(usual.values()) > 0 and sum(off.values()) < 1.15 * sum(usual.values())
    # bfloat16 rounds at random: of a single layer the one is up to twice as far off as the other, either way.
    for name in size:
        assert off[name] < min(2.5 * usual[name] + 5e-3, 0.7), (name, off[name], usual[name])


@pytest.mark.slow
def test_compiled_batch_normalisation_matches_torch():
    if compile_for_training(losses_of, PAYS_AFTER_MINUTES) is losses_of:
        pytest.skip("torch.compile does not work here")
    torch.manual_seed(0)
    usual, ours = torch.nn.BatchNorm2d(24), BatchNorm(24)
    with torch.no_grad():
        for norm in (usual, ours):
            norm.weight.copy_(torch.linspace(0.2, 3, 24))
            norm.bias.copy_(torch.linspace(-1, 1, 24))
    fused = torch.compile(lambda x: ours(x))
    way = torch.randn(6, 24, 20, 20)
    for _ in range(3):
        # Far from zero beside its spread, in some channels, as after a bias.
        x = torch.randn(6, 24, 20, 20) * torch.linspace(0.5, 4, 24)[:, None, None] + torch.arange(24.0)[:, None, None]
        there, here = (x.clone().to(memory_format=torch.channels_last).requires_grad_() for _ in range(2))
        wanted, got = usual(there), fused(here)
        torch.testing.assert_close(got, wanted, rtol=1e-4, atol=1e-4)
        (wanted * way).sum().backward()
        (got * way).sum().backward()
        torch.testing.assert_close(here.grad, there.grad, rtol=1e-4, atol=1e-4)
    for name in ("weight", "bias"):
        torch.testing.assert_close(getattr(ours, name).grad, getattr(usual, name).grad, rtol=1e-4, atol=2e-3)
    torch.testing.assert_close(ours.running_mean, usual.running_mean)
    torch.testing.assert_close(ours.running_var, usual.running_var, rtol=1e-4, atol=1e-4)


def test_functions_stay_uncompiled_where_it_does_not_help_or_work(monkeypatch, capsys):
    assert compile_for_training(losses_of, PAYS_AFTER_MINUTES / 2) is losses_of

    def without_compiler(function):
        raise RuntimeError("backend='inductor' raised:\n\nno C++ compiler\nsearched everywhere")

    monkeypatch.setattr(module.torch, "compile", without_compiler)
    assert compile_for_training(losses_of, PAYS_AFTER_MINUTES) is losses_of
    assert "slower: no C++ compiler\n" in capsys.readouterr().out

    def without_a_word(function):
        raise NotImplementedError

    monkeypatch.setattr(module.torch, "compile", without_a_word)
    assert compile_for_training(losses_of, PAYS_AFTER_MINUTES) is losses_of
    assert "NotImplementedError" in capsys.readouterr().out


def test_upsampling_for_the_compiler_matches_torch(monkeypatch):
    x, weight = torch.randn(2, 3, 5, 7, requires_grad=True), torch.randn(2, 3, 10, 14)
    usual = upsample(x)
    (gradient,) = torch.autograd.grad((usual * weight).sum(), x)
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: True)
    ours = upsample(x)
    assert ours.shape == (2, 3, 10, 14) and torch.allclose(ours, usual, atol=1e-6)
    torch.testing.assert_close(torch.autograd.grad((ours * weight).sum(), x)[0], gradient, rtol=1e-5, atol=1e-5)
