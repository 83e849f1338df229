"""Training of the labelling network: clouds, network, export."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.errors import ModelError  # noqa: E402
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT, SURFACE  # noqa: E402
from muybridge.infer.networks.labelling import LabelNetwork  # noqa: E402
from muybridge.models.labelling.message_passing import gather_messages  # noqa: E402
from muybridge.models.labelling.network import WINDOW, LabelNet, sinkhorn  # noqa: E402
from muybridge.train.engine.checkpoint import load_checkpoint  # noqa: E402
from muybridge.train.labelling import train as labels  # noqa: E402
from muybridge.train.labelling.export import example, publish_labels  # noqa: E402
from muybridge.train.labelling.options import LabelTraining  # noqa: E402
from muybridge.train.synthesis.bodies.surface_markers import virtual_markers  # noqa: E402
from muybridge.train.synthesis.markers import trajectories as marker_clouds  # noqa: E402
from muybridge.train.synthesis.markers.augment import DUST, CloudOptions, CloudSampler  # noqa: E402
from muybridge.train.synthesis.markers.trajectories import MarkerBodies, load_marker_clips, make_marker_clips  # noqa: E402


@pytest.fixture(scope="module")
def bodies():
    return MarkerBodies(3)


@pytest.fixture(scope="module")
def store(tmp_path_factory, bodies):
    """A small store: six shards of two clips."""
    folder = tmp_path_factory.mktemp("clips")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(marker_clouds, "CLIPS", 2)
        patch.setattr(marker_clouds, "MarkerBodies", lambda seed: bodies)
        make_marker_clips(folder, range(6), 1)
    return folder


def test_markers_follow_the_skin(bodies):
    phenotypes = bodies.model.sample_phenotypes(1)
    skeleton = bodies.skeleton(phenotypes[0])
    rotvec, root = bodies.wander()
    some = slice(0, 60, 20)
    points, normals = bodies.markers(skeleton, rotvec[some], root[some])
    vertices, _, _, joints = bodies.model.forward(rotvec[some], np.repeat(phenotypes, 3, 0))
    skin = virtual_markers(vertices) - joints[:, :1] + root[some, None]
    off = points - skin
    # The stand-off, along the normal, and nothing else (four bones a vertex instead of all move it by 3 mm at most).
    assert np.abs(np.linalg.norm(off, axis=-1) - 0.012).max() < 0.0095
    assert np.abs(off - normals * (off * normals).sum(-1, keepdims=True)).max() < 0.004
    assert ((off * normals).sum(-1) > 0.002).all()


def test_shards_depend_only_on_number_and_seed(store, bodies, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(marker_clouds, "CLIPS", 2)
        patch.setattr(marker_clouds, "MarkerBodies", lambda seed: bodies)
        make_marker_clips(tmp_path, range(4, 5), 1)
    one, again = load_marker_clips(store, range(4, 5)), load_marker_clips(tmp_path, range(4, 5))
    assert np.array_equal(one.points, again.points) and one.points.shape[2] == len(SURFACE)
    assert len(load_marker_clips(store, range(4, 6)).points) == 4


def test_clouds_have_consistent_labels_and_sizes(store):
    sampler = CloudSampler(load_marker_clips(store, range(6)), WINDOW, 0, CloudOptions(((PLUG_IN_GAIT, 1.0),)))
    drawn = [sampler.batch(64) for _ in range(6)]
    ghosts = hidden = windowless = 0
    for points, seen, asked, label in drawn:
        assert np.isfinite(points).all() and (points[seen == 0] == 0).all()
        assert ((label >= 0) == (seen[:, 0] == 1)).all()  # what is there has a label, padding has none
        for row, wanted in zip(label, asked, strict=True):
            real = row[(row >= 0) & (row < DUST)]
            assert len(set(real)) == len(real) and wanted[real].mean() > 0.7
        ghosts += (label == DUST).any(1).sum()
        hidden += ((label >= 0) & (label < DUST)).sum(1).min() < asked.sum(1).max() - 3
        windowless += (seen[:, 1:].sum((1, 2)) == 0).sum()
        near = np.linalg.norm(points[:, 0, :, None] - points[:, 0, None], axis=-1)
        assert 0.3 < near[(label >= 0)[:, None] & (label >= 0)[:, :, None]].mean() < 1.5  # a person's size
    assert 0.3 < ghosts / 384 < 0.9 and hidden and 0.2 < windowless / 384 < 0.5


def test_fused_messages_match_the_plain_form():
    rows, count, width = 40, 6, 16
    tensors = [torch.randn(*s, requires_grad=True) for s in ((rows, width), (rows, width), (rows, count, width))]
    neighbour = torch.randint(0, rows, (rows * count,))
    weight = torch.randn(rows, 2 * width)
    fast = gather_messages(*tensors, neighbour)
    fast.backward(weight)
    grads = [t.grad.clone() for t in tensors]
    here, there, edge = (t.detach().requires_grad_() for t in tensors)
    message = torch.relu(here.unsqueeze(1) + there.index_select(0, neighbour).reshape(rows, count, width) + edge)
    plain = torch.cat([message.max(1).values, message.mean(1)], -1)
    plain.backward(weight)
    torch.testing.assert_close(fast, plain)
    for mine, other in zip(grads, (here, there, edge), strict=True):
        torch.testing.assert_close(mine, other.grad, atol=1e-5, rtol=1e-5)
    with torch.no_grad():
        torch.testing.assert_close(gather_messages(*tensors, neighbour), plain)


def probabilities(net, points, seen, asked):
    with torch.inference_mode():
        return net(*(torch.from_numpy(np.ascontiguousarray(a)) for a in (points, seen, asked))).exp().numpy()


def test_network_is_invariant_to_heading_position_and_order_but_not_mirroring():
    torch.manual_seed(0)
    net = LabelNet(len(SURFACE)).eval()
    assert sum(p.numel() for p in net.parameters()) < 1_000_000
    points, seen, asked = example(2, 30, 1)
    known = seen[:, 0] > 0
    plain = probabilities(net, points, seen, asked)[known]
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]], np.float32)
    turned = points @ turn.T + np.array([3, -2, 0.5], np.float32)
    assert np.abs(probabilities(net, turned, seen, asked)[known] - plain).max() < 2e-3
    order = np.random.default_rng(0).permutation(30)
    mixed = probabilities(net, points[:, :, order], seen[:, :, order], asked)[known[:, order]]
    assert np.abs(mixed - probabilities(net, points, seen, asked)[:, order][known[:, order]]).max() < 2e-3
    mirrored = points * np.array([-1, 1, 1], np.float32)
    assert np.abs(probabilities(net, mirrored, seen, asked)[known] - plain).max() > 0.01


def test_distant_points_have_no_influence():
    torch.manual_seed(0)
    net = LabelNet(len(SURFACE)).eval()
    points, seen, asked = example(1, 24, 2)
    seen[:] = 1
    other = points + np.array([6.0, 0, 0], np.float32)
    both = np.concatenate([points, other], 2)
    with torch.inference_mode():
        alone = net.logits(*(torch.from_numpy(a) for a in (points, seen, asked)))
        beside = net.logits(*(torch.from_numpy(a) for a in (both, np.concatenate([seen, seen], 2), asked)))
    torch.testing.assert_close(alone, beside[:, :24], atol=1e-4, rtol=1e-4)


def test_assignment_uses_every_point_once_and_only_requested_labels():
    torch.manual_seed(1)
    known, asked = torch.ones(2, 9), torch.ones(2, 7)
    known[0, 6:], asked[1, 4:] = 0, 0
    out = sinkhorn(torch.randn(2, 9, 8) * 2, known, asked, torch.zeros(()), 30).exp()
    torch.testing.assert_close(out.sum(2)[known > 0], torch.ones(int(known.sum())), atol=1e-3, rtol=0)
    assert (out * known.unsqueeze(2)).sum(1)[:, :7].max() < 1.01 and out[1, :, 4:7].max() < 1e-6


@pytest.mark.slow
def test_training_learns_resumes_and_exports(store, tmp_path, monkeypatch):
    monkeypatch.setattr(labels, "held_out_batches", lambda clips, count=8, options=None: _few(store))
    options = LabelTraining(out=tmp_path / "run", clips=store, minutes=0.12, batch=16, rate=3e-3)
    checkpoint = labels.train(options)
    first = load_checkpoint(checkpoint)["state"]
    labels.train(replace(options, minutes=0.02))
    again = load_checkpoint(checkpoint)["state"]
    assert again["step"] > first["step"] > 3 and again["images"] == 16 * again["step"]
    monkeypatch.setattr("muybridge.train.labelling.export.held_out_batches", lambda clips, count: _few(store))
    scores = publish_labels(checkpoint, tmp_path / "labels.onnx", store, "muybridge train labels")
    assert set(scores) == {"frame", "window"}
    card = LabelNetwork(tmp_path / "labels.onnx").card
    assert card.window == WINDOW and card.metadata["command"] == "muybridge train labels"
    heads = [SURFACE.index(f"{s}_front_head") for s in ("left", "right")]
    assert card.motion_m[heads[0], heads[1]] < 0.01 < card.distance_m[heads[0], heads[1]]
    assert np.array_equal(card.distance_m, card.distance_m.T)


def _few(store):
    sampler = CloudSampler(load_marker_clips(store, range(6)), WINDOW, 5, CloudOptions(window_lost=0.0))
    return [tuple(torch.from_numpy(a) for a in sampler.batch(8))]


def test_file_of_another_network_is_refused():
    from muybridge.models.shipped import shipped_model

    with pytest.raises(ModelError, match="kind 'people' where 'labels' is needed"):
        LabelNetwork(shipped_model("people"))
