"""The networks for characters: what they promise whatever their weights are."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from muybridge.models.characters.rig_network import RigNet  # noqa: E402
from muybridge.models.characters.weight_network import WeightNet, mean_of_neighbours  # noqa: E402

POINTS, PLACES, FEATURES, NEIGHBOURS = 30, 4, 7, 5


def inputs(seed=0):
    rng = np.random.default_rng(seed)
    exists = (np.arange(PLACES) < rng.integers(1, PLACES + 1, (POINTS, 1))).astype(np.float32)
    arrays = (rng.normal(size=(POINTS, PLACES, FEATURES)).astype(np.float32),
              rng.normal(size=(POINTS, PLACES)).astype(np.float32), exists,
              rng.integers(0, PLACES + 1, (POINTS, PLACES)),
              rng.integers(0, POINTS * PLACES + 1, (POINTS, NEIGHBOURS, PLACES)))  # fmt: skip
    return tuple(torch.from_numpy(a) for a in arrays)


def test_weights_begin_with_those_given_and_their_sum_is_one():
    torch.manual_seed(0)
    net, given = WeightNet(FEATURES), inputs()
    base = torch.softmax(given[1] + (given[2] - 1) * 1e4, 1)
    torch.testing.assert_close(net(*given), base)
    torch.nn.init.normal_(net.out[1].weight)
    weights = net(*given)
    torch.testing.assert_close(weights.sum(1), torch.ones(POINTS))
    assert (weights - base).abs().max() > 0.1 and not weights[given[2] == 0].any()


def test_order_of_the_joints_does_not_matter():
    torch.manual_seed(0)
    net = WeightNet(FEATURES)
    torch.nn.init.normal_(net.out[1].weight)
    features, base, exists, parent, same = inputs(1)
    order = torch.tensor([2, 0, 3, 1])
    place = torch.argsort(order)
    moved = torch.cat([place, torch.tensor([PLACES])])[parent[:, order]]
    flat = torch.where(same < POINTS * PLACES, same // PLACES * PLACES + place[same % PLACES], same)[:, :, order]
    there = net(features[:, order], base[:, order], exists[:, order], moved, flat)
    torch.testing.assert_close(there, net(features, base, exists, parent, same)[:, order], atol=1e-5, rtol=1e-4)


def test_training_takes_the_same_mean_and_its_slope():
    torch.manual_seed(0)
    same = inputs()[4]
    sent = torch.randn(POINTS, PLACES, 3, requires_grad=True)
    plain = mean_of_neighbours(sent.detach(), same)
    fast = mean_of_neighbours(sent, same)
    torch.testing.assert_close(fast, plain)
    weight = torch.randn_like(plain)
    (slope,) = torch.autograd.grad((fast * weight).sum(), sent)
    moved = sent.detach().clone()
    moved[3, 1, 2] += 1.0  # the mean is linear
    change = ((mean_of_neighbours(moved, same) - plain) * weight).sum()
    assert float(slope[3, 1, 2]) == pytest.approx(float(change), abs=1e-4)


def test_joints_follow_the_first_points_and_the_order_of_the_others_does_not_matter():
    torch.manual_seed(0)
    net = RigNet(joints=5, tokens=16, near=4, width=16, layers=2, heads=2)
    points = torch.randn(2, 64, 6)
    places, spread = net(points)
    assert places.shape == (2, 5, 3) and spread.shape == (2, 5)
    order = torch.cat([torch.randperm(16), 16 + torch.randperm(48)])
    other = net(points[:, order])
    torch.testing.assert_close(other[0], places, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(other[1], spread, atol=1e-5, rtol=1e-4)


def test_networks_are_small():
    assert sum(p.numel() for p in WeightNet(29).parameters()) < 500_000
    assert sum(p.numel() for p in RigNet().parameters()) < 2_000_000
