"""Muon for filters, AdamW for the rest."""

import copy

import pytest

torch = pytest.importorskip("torch")

from muybridge.models.keypoints.network import KeypointNet  # noqa: E402
from muybridge.train.engine import precision  # noqa: E402
from muybridge.train.engine.muon import FASTER, Muon, Optimisers, orthogonalise  # noqa: E402


@pytest.mark.parametrize("shape", [(24, 200), (200, 24), (64, 64)])
def test_orthogonalised_steps_have_equal_singular_values(shape: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(0)
    u, _, v = torch.linalg.svd(torch.randn(shape, generator=generator), full_matrices=False)
    matrix = u @ torch.diag(torch.logspace(0, -1.5, len(v))) @ v
    out = orthogonalise(matrix)
    assert out.shape == matrix.shape and out.dtype == matrix.dtype
    singular = torch.linalg.svdvals(out)
    assert singular.min() > 0.5 and singular.max() < 1.4
    # It is the matrix's own directions that are kept.
    inner = u.T @ out @ v.T
    assert (inner - torch.diag(inner.diag())).abs().max() < 0.15 and inner.diag().min() > 0.5


def test_muon_trains_filters_and_adamw_everything_else() -> None:
    net = KeypointNet(23)
    adam, muon = Optimisers(net, 1e-3).parts
    names = {id(p): name for name, p in net.named_parameters()}
    of_muon = {names[id(p)] for group in muon.param_groups for p in group["params"]}
    of_adam = {names[id(p)] for group in adam.param_groups for p in group["params"]}
    assert isinstance(muon, Muon) and not of_muon & of_adam and of_muon | of_adam == set(names.values())
    assert {"stem.0.0.weight", "head.fine.weight", "visibility.weight", "stem.0.1.weight"} <= of_adam
    assert {"stem.1.0.weight", "levels.3.1.second.0.weight", "laterals.0.block.first.0.weight"} <= of_muon
    assert len(Optimisers(torch.nn.Linear(20, 20), 1e-3).parts) == 1
    (alone,) = Optimisers(net, 1e-3, muon=False).parts
    assert sum(len(group["params"]) for group in alone.param_groups) == len(names)


def test_resumed_optimisers_take_the_same_steps() -> None:
    def step(net: torch.nn.Module, optimiser: Optimisers, seed: int) -> None:
        image = torch.rand((2, 16, 8, 8), generator=torch.Generator().manual_seed(seed))
        net.zero_grad(set_to_none=True)
        net(image).square().mean().backward()
        optimiser.step()

    def made() -> tuple[torch.nn.Module, Optimisers]:
        torch.manual_seed(0)
        net = torch.nn.Sequential(torch.nn.Conv2d(16, 16, 3), torch.nn.BatchNorm2d(16), torch.nn.Conv2d(16, 4, 1))
        return net, Optimisers(net, 1e-3)

    net, optimiser = made()
    step(net, optimiser, 1)
    weights = {k: v.clone() for k, v in net.state_dict().items()}
    again, resumed = made()
    again.load_state_dict(weights)
    assert resumed.accepts(optimiser.state_dict()) and not Optimisers(net, 1e-3, muon=False).accepts(
        optimiser.state_dict()
    )
    resumed.load_state_dict(copy.deepcopy(optimiser.state_dict()))  # as from a file
    for one in ((net, optimiser), (again, resumed)):
        step(*one, 2)
    for name, value in net.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], value, rtol=0, atol=0)
    assert not torch.equal(net.state_dict()["0.weight"], weights["0.weight"])


def test_step_size_follows_the_learning_rate() -> None:
    p = torch.nn.Parameter(torch.zeros(32, 16, 3, 3))
    muon = Muon([p], lr=1e-3, weight_decay=0.0)
    p.grad = torch.randn(p.shape, generator=torch.Generator().manual_seed(0))
    muon.step()
    # AdamW's steps have an RMS of 0.2 to 0.4 of its rate; Muon's 0.2, times how much faster it goes.
    assert 0.15e-3 * 2.5 < p.detach().square().mean().sqrt() < 0.25e-3 * 2.5


@pytest.mark.skipif(not hasattr(torch.optim, "Muon"), reason="torch has Muon from 2.9 on")
@pytest.mark.parametrize("shape", [(32, 16, 3, 3), (64, 64, 3, 3), (96, 128, 3, 3), (160, 160, 3, 3), (160, 48, 3, 3)])
@pytest.mark.parametrize(("bfloat16", "tolerance"), [(True, 0.0), (False, 0.02)])
def test_steps_match_torch_muon(monkeypatch, shape, bfloat16, tolerance):
    """Torch iterates in bfloat16, in which both agree to the last bit."""
    monkeypatch.setattr(precision, "_measure", lambda: bfloat16)
    generator = torch.Generator().manual_seed(0)
    start = torch.randn(shape, generator=generator).contiguous(memory_format=torch.channels_last)
    ours = torch.nn.Parameter(start.clone(memory_format=torch.preserve_format))
    theirs = torch.nn.Parameter(start.flatten(1).clone())
    muon = Muon([ours], 1e-3, 0.02)
    reference = torch.optim.Muon([theirs], FASTER * 1e-3, 0.02, adjust_lr_fn="match_rms_adamw")
    for _ in range(3):
        gradient = torch.randn(shape, generator=generator)
        ours.grad, theirs.grad = gradient.contiguous(memory_format=torch.channels_last), gradient.flatten(1).clone()
        muon.step()
        reference.step()
    step = theirs.detach() - start.flatten(1)
    assert (ours.detach().flatten(1) - theirs.detach()).norm() <= tolerance * step.norm()
    assert step.norm() > 1e-3
