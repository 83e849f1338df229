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
from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.models.keypoints.network import PLATE, KeypointNet, PlateApart, SeparateHeads  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx, parity  # noqa: E402
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, measure_normalisation  # noqa: E402
from muybridge.models.people.metadata import people_card  # noqa: E402
from muybridge.models.people.network import PeopleNet  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.train.engine.checkpoint import CHECKPOINT, save_checkpoint  # noqa: E402
from muybridge.train.images import dataset  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.compositor import WHOLE, Batch, Compositor  # noqa: E402
from muybridge.train.images.scenes import SceneBatch  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.evaluate import MIRROR, _figures, evaluate_onnx  # noqa: E402
from muybridge.train.keypoints.export import load_keypoint_checkpoint, publish_keypoints  # noqa: E402
from muybridge.train.keypoints.options import Evaluation, KeypointTraining  # noqa: E402
from muybridge.train.keypoints.variance_calibration import fit_spread, within  # noqa: E402
from muybridge.train.people import train as people  # noqa: E402
from muybridge.train.people.options import PeopleTraining  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE, load_renders  # noqa: E402


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
def test_export_says_the_same_as_torch(net, outputs, shapes, upsampled, tmp_path):
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


def test_spread_calibration_covers_errors():
    rng = np.random.default_rng(0)
    spread = rng.uniform(0.5, 40, 8000)
    error = rng.normal(size=(8000, 2)) * np.sqrt(0.7 * spread + 1.5)[:, None]
    fitted = fit_spread(error[:4000], spread[:4000])
    assert fitted.scale == pytest.approx(0.7, rel=0.15)
    one, two = within(error[4000:], fitted.variance(spread[4000:]))
    assert one == pytest.approx(0.683, abs=0.03)
    assert two == pytest.approx(0.954, abs=0.02)


def test_a_share_of_the_batches_is_of_smaller_crops(store, tmp_path):
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


def test_crops_are_scored_smaller_too():
    seen = {}

    class Found(torch.nn.Module):
        """Finds every landmark in the middle, where it is, and in smaller crops a cell right of it."""

        def __init__(self):
            super().__init__()
            self.weight = torch.nn.Parameter(torch.zeros(1))

        def forward(self, image):
            side = image.shape[-1]
            seen[side] = seen.get(side, 0) + 1
            maps = torch.full((len(image), 23, side // 4, side // 4), -9.0)
            middle, right = side // 8, int(side < 64)
            maps[:, :, middle - 1 : middle + 1, middle - 1 + right : middle + 1 + right] = 9.0
            return maps, None

    at = torch.full((2, 23, 2), 31.5)
    batch = Batch(
        torch.zeros(2, 3, 64, 64, dtype=torch.uint8), torch.zeros(2, 1, 64, 64, dtype=torch.uint8), at,
        torch.ones(2, 23, dtype=torch.bool), torch.zeros(2, 0, 2), torch.ones(2, 0, dtype=torch.bool),
    )  # fmt: skip
    scores = keypoints.evaluate(Found(), [batch])
    assert seen == {64: 1, 32: 1}
    assert scores["median_px"] == pytest.approx(0, abs=1e-3)
    assert scores["pck05"] == 1 and scores["pck05_smaller"] == 0


def test_keypoint_training_learns_resumes_and_exports(store, tmp_path):
    options = KeypointTraining(
        renders=store, out=tmp_path / "run", minutes=0.25, size=64, batch=16, backgrounds=8, threads=1, workers=0
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
    alone = load_keypoint_checkpoint(keypoints.train(replace(options, minutes=0.02, muon=False)))
    assert len(alone["optimiser"]) == 1 and alone["state"]["images"] > again["state"]["images"]
    pool = dataset.background_pool(options)
    path = tmp_path / "out" / "keypoints.onnx"
    publish_keypoints(checkpoint, path, keypoints.held_out_batches(store, pool, 64, 2), "a test")
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path))
    card = keypoint_card(session.get_modelmeta().custom_metadata_map, path)
    assert card.landmarks is BODY23 and card.input_size == 64
    assert card.metadata["training_command"] == "a test"


class _Says(torch.nn.Module):
    """A network that is sure of the places it is given, by so much."""

    def __init__(self, landmarks_px, confidence):
        super().__init__()
        self.confidence = torch.nn.Parameter(torch.tensor(confidence))
        self.cell = (landmarks_px - 1.5) / 4

    def forward(self, image):
        at = torch.arange(16.0)
        x, y = ((at - self.cell[..., axis, None]) ** 2 / (2 * 0.8**2) for axis in (0, 1))
        return -self.confidence * (y[..., :, None] + x[..., None, :]), None


def test_scores_tell_what_is_right_what_is_exchanged_and_how_sure_of_either():
    at = torch.from_numpy(np.random.default_rng(3).uniform(8, 56, (2, 23, 2))).float()
    seen, empty = torch.ones(2, 23, dtype=torch.bool), torch.empty(2, 0)
    image, difference = (torch.zeros(2, channels, 64, 64, dtype=torch.uint8) for channels in (3, 1))
    batch = Batch(image, difference, at, seen, empty, empty)
    right, sure, exchanged, unsurely = (
        keypoints.evaluate(_Says(places, confidence), [batch])
        for places, confidence in ((at, 1.0), (at, 9.0), (at[:, MIRROR], 1.0), (at[:, MIRROR], 0.3))
    )
    assert right["pck05"] == sure["pck05"] == 1 and right["flips"] == 0
    assert exchanged["flips"] == unsurely["flips"] == 1
    # Of a Gaussian over the cells the entropy is the least loss; who is too sure, or wrong, has more.
    assert right["held_out_loss"] == pytest.approx(np.log(2 * np.pi * np.e * 0.8**2), abs=0.02)
    assert right["held_out_loss"] < sure["held_out_loss"]
    assert right["held_out_loss"] < unsurely["held_out_loss"] < exchanged["held_out_loss"]


def as_trained(net):
    """With normalisations that are away from their beginning; in evaluation mode."""
    for module in net.eval().modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.running_mean)
            torch.nn.init.uniform_(module.running_var, 0.2, 3)
            torch.nn.init.uniform_(module.weight, 0.2, 2)
    return net


def test_measured_normalisation_changes_nothing_but_the_filters():
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
def test_files_whose_heatmaps_came_of_the_finest_features_alone_are_read(tmp_path):
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


def test_a_run_of_another_design_is_refused_by_name(store, tmp_path):
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
def test_training_goes_on_from_shipped_weights(kind, store, tmp_path):
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
        renders=store, out=tmp_path / "run", minutes=0.2, batch=8, backgrounds=8, threads=1, workers=0
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


def test_scores_of_detectors_tell_who_is_found_and_how_surely():
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


def test_evaluation_counts_what_it_says():
    count, pairs = 4, [BODY23.index("left_knee"), BODY23.index("right_knee")]
    distance, visible = np.zeros((count, 23)), np.ones((count, 23), bool)
    twin = np.where(MIRROR == np.arange(23), 0.0, 60.0) * np.ones((count, 1))
    found = _figures(distance, twin, np.full((count, 23, 2), 0.5), visible, visible, 192)
    assert found["PCK@0.05 of the box"] == 1 and found["left-right swaps"] == 0 and found["within 1 sigma (0.683)"] == 1
    # One person's knees have changed places; they count unless they are hidden.
    distance[0, pairs], twin[0, pairs] = 60.0, 0.0
    found = _figures(distance, twin, np.full((count, 23, 2), 1.5), visible, visible, 192)
    limbs = int((MIRROR != np.arange(23))[5:].sum()) * count
    assert found["left-right swaps"] == pytest.approx(2 / limbs)
    assert found["left-right swaps, face too"] == pytest.approx(2 / (23 * count))
    assert found["PCK@0.1 of the box"] == pytest.approx(1 - 2 / (23 * count))
    # Of four crops one has both swaps: the error of the mean of 2, 0, 0, 0 in units of 23 landmarks.
    assert found["swaps, standard error"] == pytest.approx(np.std([2, 0, 0, 0], ddof=1) / 2 / 23)
    assert found["within 1 sigma (0.683)"] == 0 and found["within 2 sigma (0.954)"] == 1
    visible[0, pairs] = False
    assert _figures(distance, twin, np.zeros((count, 23, 2)), visible, visible, 192)["left-right swaps"] == 0


def test_evaluation_with_and_without_what_makes_it_hard(store, tmp_path, monkeypatch):
    # Whether sticks are to be turned depends on the weights; here whatever is unsure is.
    monkeypatch.setattr("muybridge.models.keypoints.test_time._SURER", -100.0)
    monkeypatch.setattr(
        "muybridge.train.keypoints.evaluate.make_backgrounds", lambda count, *how: make_backgrounds(16, *how)
    )
    small = onnx.load(str(shipped_model("keypoints")))
    for fact in small.metadata_props:
        fact.value = "96" if fact.key == "input_size" else fact.value  # a seventh of the time
    onnx.save(small, str(tmp_path / "small.onnx"))
    options = Evaluation(tmp_path / "small.onnx", renders=store, crops=64)
    found = evaluate_onnx(options)
    assert all(np.isfinite(v) for v in found.values()) and found == evaluate_onnx(options)  # seeded
    plain = evaluate_onnx(replace(options, faults=False, occlusion=False))
    assert plain != found
    assert evaluate_onnx(replace(options, flip=False)) != found
    assert evaluate_onnx(replace(options, plate=False)) != found
    assert evaluate_onnx(replace(options, backdrop=True, tinted=True, monochrome=True)) != found
    assert evaluate_onnx(replace(options, all_shards=True)) != found  # of other people too
    assert evaluate_onnx(replace(options, turn=False)) != found
    with pytest.raises(SessionError, match="muybridge synth"):
        evaluate_onnx(replace(options, renders=tmp_path / "none"))


def test_crops_without_faults_are_sharp(store):
    renders, backgrounds = load_renders(store), np.full((4, 3, SIZE, SIZE), 90, np.uint8)
    nothing = replace(
        WHOLE, scale_sd=0, shift_sd=0, rotation_sd_deg=0, tumble=0, second_person=0, occluder=0, mosaic=0, truncate=0,
        clutter=0,
    )  # fmt: skip
    edges = []
    for faults in (False, True):
        image = Compositor(renders, backgrounds, 192, 0, replace(nothing, faults=faults)).batch(64).image.float()
        edges.append(float((image[..., 1:] - image[..., :-1]).abs().amax((1, 2, 3)).median()))
    assert edges[0] > 1.15 * edges[1]


def test_training_without_renders_says_what_to_do(tmp_path):
    with pytest.raises(SessionError, match="muybridge synth"):
        keypoints.train(KeypointTraining(renders=tmp_path, shards=0, out=tmp_path / "run"))


def test_training_without_held_out_renders_names_those_that_are_wanting(store, tmp_path):
    for file in store.glob("renders-00004.*"):
        (tmp_path / file.name).symlink_to(file)
    with pytest.raises(SessionError, match=r"none of renders-00000\.npz to renders-00003\.npz, to score with"):
        keypoints.train(KeypointTraining(renders=tmp_path, out=tmp_path / "run"))


def test_a_file_that_is_no_checkpoint_is_refused(tmp_path):
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ModelError, match="checkpoint"):
        load_keypoint_checkpoint(path)


@pytest.mark.parametrize(("kind", "card"), [("keypoints", keypoint_card), ("people", people_card)])
def test_shipped_weights_say_how_they_were_made(kind, card):
    import onnxruntime

    path = shipped_model(kind)
    metadata = onnxruntime.InferenceSession(str(path)).get_modelmeta().custom_metadata_map
    assert card(metadata, path).metadata["training_command"].startswith("muybridge train")
    assert json.loads(metadata["training"])["images"] > 100_000
    assert "scores" in metadata and "seed" in metadata and "synthetic" in metadata["licence"]
