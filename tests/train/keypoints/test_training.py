"""The training loops, their losses, checkpoints and exports."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import ModelError, SessionError  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.models.keypoints.decode import decode_heatmaps  # noqa: E402
from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.models.keypoints.network import PLATE, KeypointNet, PlateApart, SeparateHeads  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx, parity  # noqa: E402
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, measure_normalisation  # noqa: E402
from muybridge.models.people.network import PeopleNet  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.models.uncertainty import SpreadCalibration  # noqa: E402
from muybridge.train.correction.options import SolverTraining  # noqa: E402
from muybridge.train.engine import loop  # noqa: E402
from muybridge.train.engine.checkpoint import CHECKPOINT, save_checkpoint  # noqa: E402
from muybridge.train.images import dataset  # noqa: E402
from muybridge.train.images.scenes import SceneBatch  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.export import load_keypoint_checkpoint, publish_keypoints  # noqa: E402
from muybridge.train.keypoints.loss import OUTSIDE, heatmap_loss  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.labelling.options import LabelTraining  # noqa: E402
from muybridge.train.people import train as people  # noqa: E402
from muybridge.train.people.options import PeopleTraining  # noqa: E402
from muybridge.train.synthesis.rendering.store import load_renders  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_held_out")


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


def test_heatmap_loss_is_least_where_the_decoder_reads():
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


def test_invalid_share_of_steps_is_refused(store, tmp_path):
    with pytest.raises(SessionError, match="--average 2"):
        keypoints.train(KeypointTraining(renders=store, out=tmp_path / "run", average=2.0, workers=0))
    for other in (PeopleTraining, LabelTraining, SolverTraining):
        with pytest.raises(SessionError, match="--average -1"):
            other(average=-1.0)


def test_networks_are_small():
    assert sum(p.numel() for p in KeypointNet().parameters()) < 3e6
    assert sum(p.numel() for p in PeopleNet().parameters()) < 3e6


@pytest.mark.parametrize(
    ("net", "outputs", "shapes", "upsampled"),
    [
        (KeypointNet(23), ("heatmaps", "visibility"), [(3, 4, 64, 64), (1, 4, 160, 160)], 5),
        (PeopleNet(), ("heatmap", "box"), [(2, 4, 96, 160), (1, 4, 320, 192)], 2),
    ],
)
def test_export_matches_torch(net, outputs, shapes, upsampled, tmp_path):
    torch.manual_seed(0)
    path = tmp_path / "net.onnx"
    example = (2, shapes[0][1], 64, 96)
    export_onnx(net, path, example, outputs, {"muybridge_kind": "test", "names": ["a", "b"]})
    for shape in shapes:
        assert parity(net, path, shape) < 1e-3
    import onnxruntime

    metadata = onnxruntime.InferenceSession(str(path)).get_modelmeta().custom_metadata_map
    assert json.loads(metadata["names"]) == ["a", "b"]
    # Upsampling is one operator in files, however it is written for training.
    operators = [node.op_type for node in onnx.load(str(path)).graph.node]
    assert operators.count("Resize") == upsampled and "Unsqueeze" not in operators
    assert b"site-packages" not in path.read_bytes()  # no paths of the machine that exported it


def test_a_share_of_batches_has_smaller_crops(store, tmp_path):
    options = KeypointTraining(renders=store, out=tmp_path / "run", backgrounds=8, workers=0)
    crops = keypoints._Crops(dataset.background_pool(options), 128, 0.5, 4, tmp_path / "difficulty.npy", 0.0)
    following = crops(load_renders(store, dataset.TRAINED_ON), seed=2)
    batches = [following() for _ in range(24)]
    sides = [batch[0].shape[-1] for batch in batches]
    assert sides[0] == 128  # the largest first: the second process makes room for it
    assert 6 <= sum(side < 128 for side in sides) <= 18
    assert {64, 96, 128} == set(sides)
    for image, landmarks, visible, _ in batches:  # the same people, as large in the crop
        assert image.shape == (4, 4, *(image.shape[-1:] * 2))
        at = landmarks[visible]
        assert (at >= 0).all() and (at < image.shape[-1]).all() and at.max() > 0.6 * image.shape[-1]


def test_keypoint_training_learns_resumes_and_exports(store, tmp_path):
    options = KeypointTraining(
        renders=store, out=tmp_path / "run", steps=24, size=64, batch=16, backgrounds=8, threads=1, workers=0
    )
    checkpoint = keypoints.train(options)
    first = load_keypoint_checkpoint(checkpoint)
    again = load_keypoint_checkpoint(keypoints.train(options))
    assert again["state"]["images"] > first["state"]["images"] > 0
    assert again["state"]["step"] > first["state"]["step"]
    lines = [json.loads(line) for line in (options.out / "log.jsonl").read_text().splitlines()]
    losses = [line["loss"] for line in lines if "loss" in line]
    assert losses[-1] < losses[0]
    assert lines[0]["options"]["seed"] == "0" and "torch" in lines[0]
    assert 2 < lines[-1]["held_out_loss"] < np.log(16 * 16)
    assert cv2.imread(str(options.out / "curves.png")).std() > 5
    assert len(again["optimiser"]) == 2
    alone = load_keypoint_checkpoint(keypoints.train(replace(options, steps=5, muon=False)))
    assert len(alone["optimiser"]) == 1 and alone["state"]["images"] > again["state"]["images"]
    pool = dataset.background_pool(options)
    path = tmp_path / "out" / "keypoints.onnx"
    publish_keypoints(checkpoint, path, keypoints.held_out_batches(store, pool, 64), "a test")
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path))
    card = keypoint_card(session.get_modelmeta().custom_metadata_map, path)
    assert card.landmarks is BODY23 and card.input_size == 64
    assert card.metadata["training_command"] == "a test"


def as_trained(net):
    """With normalisations that are away from their beginning; in evaluation mode."""
    for module in net.eval().modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.running_mean)
            torch.nn.init.uniform_(module.running_var, 0.2, 3)
            torch.nn.init.uniform_(module.weight, 0.2, 2)
    return net


def test_measured_normalisation_keeps_the_outputs():
    torch.manual_seed(4)
    net, images = KeypointNet(5), [torch.rand(4, 4, 64, 64) for _ in range(2)]
    as_trained(net)
    with torch.no_grad():
        before = net(images[0])[0]
        measure_normalisation(net, images)
        after = net(images[0])[0]
        torch.testing.assert_close(after, before, rtol=1e-3, atol=1e-3)
        # In training the statistics are those of the batch: alike, since these were measured.
        trained = net.train()(torch.cat(images))[0][:4]
    assert (trained - before).abs().mean() < 0.02 * before.std()
    outputs = net.stem[0][0](torch.cat(images))
    torch.testing.assert_close(outputs.std((0, 2, 3)), torch.ones(16), rtol=2e-2, atol=0)


@pytest.mark.slow
def test_older_files_with_heatmaps_of_the_finest_features_are_read(tmp_path):
    torch.manual_seed(0)
    net, path = as_trained(KeypointNet(95)), tmp_path / "net.onnx"
    names = ("heatmaps", "visibility", "marker_heatmaps", "marker_visibility")
    export_onnx(PlateApart(SeparateHeads(net, 23)), path, (2, 3, 64, 64), names, {}, PLATE)
    # As that version named them, and without what it did not know, which says nothing before it was trained.
    model = onnx.load(str(path))
    kept = [i for i in model.graph.initializer if "eighth" not in i.name and "sixteenth" not in i.name]
    assert len(model.graph.initializer) - len(kept) == 2
    for initializer in kept:
        initializer.name = initializer.name.replace(".fine.", ".")
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)
    onnx.save(model, str(path))
    again, image = keypoint_net_from_onnx(path), torch.rand(2, 4, 64, 64)
    with torch.no_grad():
        torch.testing.assert_close(again(image)[0], net(image)[0], rtol=1e-3, atol=1e-3)
        # What coarser features say is exported, and read again.
        for layer in (again.head.eighth, again.head.sixteenth):
            torch.nn.init.normal_(layer.weight)
        export_onnx(PlateApart(SeparateHeads(again, 23)), path, (2, 3, 64, 64), names, {}, PLATE)
        third = keypoint_net_from_onnx(path)
        assert (third(image)[0] - net(image)[0])[:, :23].abs().mean() > 0.1
        torch.testing.assert_close(third(image)[0], again(image)[0], rtol=1e-3, atol=1e-3)


def test_checkpoint_of_another_design_is_refused(store, tmp_path):
    options = KeypointTraining(
        renders=store, out=tmp_path / "run", minutes=0.02, size=64, batch=4, backgrounds=8, workers=0
    )
    saved = load_keypoint_checkpoint(keypoints.train(options))
    other = saved | {"net": KeypointNet(95, depths=(0, 2, 2, 3)).state_dict()}
    save_checkpoint(options.out / CHECKPOINT, other)
    with pytest.raises(SessionError, match=r"run.checkpoint\.pt: of another network design"):
        keypoints.train(options)
    del saved["config"]["hidden"]  # as of networks that normalised their images
    save_checkpoint(options.out / CHECKPOINT, saved)
    with pytest.raises(ModelError, match=r"run.checkpoint\.pt: of an earlier version's network"):
        keypoints.train(options)


@pytest.mark.parametrize("kind", ["keypoints", pytest.param("people", marks=pytest.mark.slow)])
def test_training_continues_from_shipped_weights(kind, store, tmp_path):
    module, options = {"keypoints": (keypoints, KeypointTraining), "people": (people, PeopleTraining)}[kind]
    path = shipped_model(kind)
    some = options(renders=store, out=tmp_path / "run", minutes=0.02, batch=4, backgrounds=8, workers=0, model=path)
    saved = load_keypoint_checkpoint(module.train(some))
    assert saved["state"]["images"] > 100_000 and saved["state"]["step"] < 1000
    # Where a run is there already it goes on, whatever file is named.
    again = load_keypoint_checkpoint(module.train(replace(some, model=tmp_path / "none.onnx")))
    assert again["state"]["step"] >= saved["state"]["step"]
    with pytest.raises(ModelError, match="none.onnx"):
        module.train(replace(some, model=tmp_path / "none.onnx", out=tmp_path / "other"))


def test_people_training_learns(store, tmp_path):
    options = PeopleTraining(
        renders=store, out=tmp_path / "run", minutes=0.05, batch=8, backgrounds=8, threads=1, workers=0
    )
    saved = load_keypoint_checkpoint(people.train(options))
    assert saved["state"]["images"] > 0
    assert set(saved["scores"]) == {"recall", "precision", "iou", "held_out_loss"}


class _Finds(torch.nn.Module):
    """A detector that is sure of the targets that it is given, by so much."""

    def __init__(self, targets, confidence):
        super().__init__()
        self.confidence = torch.nn.Parameter(torch.tensor(confidence))
        self.heat, self.box = torch.from_numpy(targets.heat)[:, None], torch.from_numpy(targets.box)

    def forward(self, image):
        return self.confidence * (2 * (self.heat >= 0.999).float() - 1), self.box


def test_detector_scores_measure_recall_and_confidence():
    def scene(*box):
        boxes = [np.array([box], np.float32)]
        return SceneBatch(torch.zeros(1, 4, 192, 320, dtype=torch.uint8), boxes, [np.zeros((0, 4), np.float32)])

    here, there = scene(40, 30, 99, 150), scene(200, 30, 259, 150)
    sure, unsure, wrong = (
        people.evaluate(_Finds(people.make_targets(said), confidence), [here])
        for said, confidence in ((here, 9.0), (here, 3.0), (there, 9.0))
    )
    assert sure["recall"] == sure["precision"] == unsure["recall"] == 1 and sure["iou"] == pytest.approx(1, abs=1e-4)
    assert wrong["recall"] == wrong["precision"] == 0
    assert sure["held_out_loss"] < 0.01 < unsure["held_out_loss"] < 1 < wrong["held_out_loss"]


def test_training_without_renders_suggests_a_remedy(tmp_path):
    with pytest.raises(SessionError, match="muybridge synth"):
        keypoints.train(KeypointTraining(renders=tmp_path, shards=0, out=tmp_path / "run"))


def test_missing_held_out_renders_are_named(store, tmp_path):
    for file in store.glob("renders-00004.*"):
        (tmp_path / file.name).symlink_to(file)
    with pytest.raises(SessionError, match=r"none of renders-00000\.npz to renders-00003\.npz, to validate with"):
        keypoints.train(KeypointTraining(renders=tmp_path, out=tmp_path / "run"))


def test_files_other_than_checkpoints_are_refused(tmp_path):
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ModelError, match="checkpoint"):
        load_keypoint_checkpoint(path)
