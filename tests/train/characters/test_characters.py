"""Generated characters, and the trainings of the networks that rig and weight them."""

import json
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.errors import ModelError, SessionError  # noqa: E402
from muybridge.infer.networks.characters import RiggerNetwork, SkinningNetwork  # noqa: E402
from muybridge.models.characters.rig_network import RigNet  # noqa: E402
from muybridge.models.characters.weight_network import WeightNet  # noqa: E402
from muybridge.motion.character.rigging.placement.learned import ROLES, mirrored_roles  # noqa: E402
from muybridge.motion.character.weights.graph import FEATURES, FLOOR  # noqa: E402
from muybridge.train.characters import (  # noqa: E402
    bodies,
    examples,
    export_joints,
    export_weights,
    train_joints,
    train_weights,
)
from muybridge.train.characters.figures import FigureSampler  # noqa: E402
from muybridge.train.characters.options import RiggerTraining, SkinningTraining  # noqa: E402
from muybridge.train.characters.rigs import artists_rig, decimated, with_fewer_joints  # noqa: E402


@pytest.fixture(scope="module")
def sampler():
    return FigureSampler(5)


@pytest.fixture(scope="module")
def drawn(sampler):
    """A few examples of weights."""
    return [examples.weight_example(decimated(artists_rig(sampler.sample(), sampler.rng), 400)) for _ in range(3)]


def test_characters_stand_and_every_vertex_has_weights(sampler):
    for cartoon in (0.0, 1.0):
        figure = sampler.sample(cartoon)
        np.testing.assert_allclose(figure.weights.sum(axis=1), 1, atol=1e-5)
        assert figure.triangles.max() < len(figure.vertices) and np.isfinite(figure.vertices).all()
        at = dict(zip(figure.names, figure.joints, strict=True))
        assert at["foot.L"][2] < at["lowerleg01.L"][2] < at["upperleg01.L"][2] < at["head"][2] < figure.height
        assert at["wrist.L"][0] > 0 > at["wrist.R"][0]
        joints = bodies.joints_of(figure)
        assert tuple(joints) == ROLES and joints["hips"][2] < joints["chest"][2] < joints["neck"][2]


def test_joints_that_are_left_out_give_their_weights_to_the_nearest_that_is_kept(sampler):
    figure = sampler.sample(0.0)
    kept = np.array([not name.startswith(("finger", "metacarpal")) for name in figure.names])
    fewer = with_fewer_joints(figure, kept)
    hand = [k for k, name in enumerate(figure.names) if name.endswith(".L") and (
        name.startswith("wrist") or not kept[k])]  # fmt: skip
    np.testing.assert_allclose(fewer.weights[:, fewer.names.index("wrist.L")], figure.weights[:, hand].sum(axis=1),
                               atol=1e-5)  # fmt: skip
    assert fewer.parents[0] == -1 and (fewer.parents[1:] < np.arange(1, len(fewer.parents))).all()


def test_rigs_of_artists_have_whole_weights(sampler):
    for _ in range(4):
        rig = artists_rig(sampler.sample(), sampler.rng)
        np.testing.assert_allclose(rig.weights.sum(axis=1), 1, atol=1e-4)
        assert rig.weights.shape == (len(rig.vertices), len(rig.joints)) == (len(rig.vertices), len(rig.parents))
        assert len(rig.vertices) < 5000 and rig.triangles.max() < len(rig.vertices)


def test_skin_by_rule_has_weights_by_heat_and_rigid_islands_keep_theirs(drawn):
    for example in drawn:
        rule = train_weights.by_rule(example)
        changed = np.abs(rule.target.astype(float) - example.target).sum(axis=1) > 0.02
        heat = (example.features[..., FEATURES.index("heat")] + FLOOR) * example.exists
        heat /= heat.sum(axis=1, keepdims=True)
        assert not changed.any() or np.abs(rule.target - heat)[changed].max() < 1e-3


def test_steps_lower_the_loss_of_the_weights(drawn):
    torch.manual_seed(0)
    net = WeightNet(len(FEATURES))
    optimiser, batch = torch.optim.AdamW(net.parameters(), 3e-3), train_weights.pack(drawn)
    assert len(batch[0]) == 3 and batch[1].shape[0] == int(batch[0].sum())
    apart = [train_weights.loss_of(net, train_weights.pack([e]))[1] for e in drawn]
    assert float(train_weights.loss_of(net, batch)[1]) == pytest.approx(float(sum(apart)) / 3, rel=1e-4)
    losses = []
    for _ in range(12):
        loss, figure = train_weights.loss_of(net, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(figure))
    assert losses[-1] < 0.9 * losses[0]
    scores = train_weights.evaluate(net, drawn)
    assert scores["net_l1"] < scores["heat_l1"]


def test_bodies_are_mirrored_with_their_joints(sampler):
    points, joints = bodies.draw_body(sampler)
    given, wanted = train_joints.given_and_wanted(points, joints, None)
    assert given[:, 2].min() == 0 and given[:, 2].max() == pytest.approx(1)
    np.testing.assert_allclose(np.linalg.norm(given[:, 3:], axis=1), 1, atol=1e-5)
    other = mirrored_roles()
    assert (other[other] == np.arange(len(ROLES))).all() and other[0] == 0
    for seed in range(6):
        changed, place = train_joints.given_and_wanted(points, joints, np.random.default_rng(seed))
        np.testing.assert_allclose(np.linalg.norm(changed[:, 3:], axis=1), 1, atol=1e-4)
        left = place[[k for k, role in enumerate(ROLES) if role == "left_hand"][0]]
        assert left[0] > 0 and np.abs(place - wanted).max() < 0.4


def test_steps_lower_the_distance_of_the_joints(sampler):
    torch.manual_seed(0)
    drawn = [bodies.draw_body(sampler) for _ in range(2)]
    batch = train_joints.packed(np.stack([p for p, _ in drawn]), np.stack([j for _, j in drawn]), None)
    net = RigNet(len(ROLES), width=32, layers=2)
    optimiser, losses = torch.optim.AdamW(net.parameters(), 3e-3), []
    for _ in range(15):
        loss, figure = train_joints.loss_of(net, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(figure))
    assert losses[-1] < 0.6 * losses[0]


@pytest.mark.slow
def test_exported_files_match_torch_and_say_what_they_are(tmp_path):
    torch.manual_seed(0)
    weights, rig = WeightNet(len(FEATURES)).eval(), RigNet(len(ROLES)).eval()
    torch.nn.init.normal_(weights.out[1].weight)
    said = {"muybridge_kind": "skinning", "version": "0", "features": list(FEATURES)}
    export_weights._export(weights, tmp_path / "skinning.onnx", said)
    assert export_weights.parity(weights, tmp_path / "skinning.onnx") < 1e-4
    export_joints._export(rig, tmp_path / "rigger.onnx", {"muybridge_kind": "rigger", "version": "0",
                                                          "roles": list(ROLES)})  # fmt: skip
    assert export_joints.parity(rig, tmp_path / "rigger.onnx") < 1e-4
    places, expected = RiggerNetwork(tmp_path / "rigger.onnx")(export_joints.example(2))
    assert places.shape == (2, len(ROLES), 3) and (expected > 0).all()
    with pytest.raises(ModelError, match="of kind 'rigger' where 'skinning' is needed"):
        SkinningNetwork(tmp_path / "rigger.onnx")
    export_weights._export(weights, tmp_path / "other.onnx", said | {"features": ["heat"]})
    with pytest.raises(ModelError, match="takes other features"):
        SkinningNetwork(tmp_path / "other.onnx")


def test_one_shard_is_refused(tmp_path):
    for module, options in ((train_weights, SkinningTraining), (train_joints, RiggerTraining)):
        with pytest.raises(SessionError, match="the first is held out"):
            module.train(options(out=tmp_path, shards=1))


@pytest.mark.slow
def test_trainings_make_their_data_resume_and_export(tmp_path, monkeypatch):
    monkeypatch.setattr(examples, "PER_SHARD", 2)
    monkeypatch.setattr(bodies, "PER_SHARD", 3)
    skinning = SkinningTraining(out=tmp_path / "weights", shards=2, steps=2)
    rigger = RiggerTraining(out=tmp_path / "joints", shards=2, steps=2)
    for module, options in ((train_weights, skinning), (train_joints, rigger)):
        module.train(options)
        checkpoint = module.train(replace(options, steps=1))
        log = [json.loads(line) for line in (options.out / "log.jsonl").read_text().splitlines()]
        assert [e["step"] for e in log if "loss" in e] == [2, 3] and checkpoint.exists()
    path = tmp_path / "skinning.onnx"
    export_weights.publish_skinning(tmp_path / "weights/checkpoint.pt", path, tmp_path / "weights/examples", "command")
    assert SkinningNetwork(path).version
    path = tmp_path / "rigger.onnx"
    export_joints.publish_rigger(tmp_path / "joints/checkpoint.pt", path, tmp_path / "joints/bodies", "command")
    assert RiggerNetwork(path).version
