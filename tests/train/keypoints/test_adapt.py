"""Adaptation of the shipped network to a take's unlabelled footage."""

import json
import shutil
import subprocess
import sys

import numpy as np
import onnxruntime
import pytest
import torch

from muybridge.errors import FormatError, MissingExtraError, ModelError, SessionError
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.sync.clocks import Clock, own_frames
from muybridge.infer.commands import adapt as command
from muybridge.infer.commands.app import run_command
from muybridge.infer.demo_take.take import demo_folder, true_points
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.networks.models import open_models
from muybridge.infer.pipelines import videos as pipeline
from muybridge.infer.pipelines.adapt import RESULTS
from muybridge.infer.pipelines.pseudo_labels import PseudoLabelOptions, _held_out, collect
from muybridge.infer.pipelines.videos import RunOptions, follow
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.session import open_session
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx, people_net_from_onnx
from muybridge.models.pseudo_labels import PseudoLabels, load_pseudo_labels, save_pseudo_labels
from muybridge.models.shipped import shipped_model
from muybridge.train.images.compositor import MIRROR
from muybridge.train.keypoints.adapt import View, measure_agreement, train_on_footage
from muybridge.train.keypoints.adapt_export import adapt
from muybridge.train.keypoints.evaluate import load_model
from muybridge.train.keypoints.options import Adaptation

JOINTS = len(BODY23) + len(SURFACE)


@pytest.fixture(scope="module")
def followed(short_demo, tmp_path_factory):
    """What the pipeline finds in the demo's take, markers too."""
    detect = DetectOptions(markers="all")
    store = StageStore(tmp_path_factory.mktemp("adapt") / "work")
    store.folder.mkdir()
    with Progress(quiet=True) as progress:
        return follow(open_session(short_demo), open_models(detect), store, RunOptions(detect=detect), progress)


@pytest.fixture(scope="module")
def network_card():
    return load_model(shipped_model("keypoints"))[1]


@pytest.fixture(scope="module")
def footage(followed, network_card):
    """80 crops of it or so."""
    with Progress(quiet=True) as progress:
        return collect(followed, network_card, progress, PseudoLabelOptions(most_crops=80))


def random_pseudo_labels(count=12, seed=0):
    """Crops with a bright spot at the first landmark."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(100, 156, (count, JOINTS, 2)).astype(np.float32)
    crops = np.zeros((count, 256, 256, 4), np.uint8)
    for crop, (x, y) in zip(crops, at[:, 0].round().astype(int), strict=True):
        crop[y - 2 : y + 3, x - 2 : x + 3] = 255
    return PseudoLabels(
        crops, at, np.ones((count, JOINTS), bool), np.arange(count) % 4 == 0, 1.25 * 4 / 3, {"session": "s"}
    )


def test_shipped_network_is_restored_from_its_file():
    path = shipped_model("keypoints")
    net = keypoint_net_from_onnx(path)
    image = np.random.default_rng(0).random((2, 4, 96, 128), np.float32)
    session, card = load_model(path)
    outputs = ["heatmaps", "marker_heatmaps", "visibility", "marker_visibility"]
    there = session.run(outputs, card.inputs(image))
    with torch.no_grad():
        heatmaps, visibility = (out.numpy() for out in net(torch.from_numpy(image)))
    assert np.abs(heatmaps - np.concatenate(there[:2], 1)).max() < 1e-3
    assert np.abs(visibility - np.concatenate(there[2:], 1)).max() < 1e-3


def test_shipped_detector_is_restored_from_its_file():
    path = shipped_model("people")
    image = np.random.default_rng(1).random((1, 4, 96, 160), np.float32)
    there = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(None, {"image": image})
    with torch.no_grad():
        here = [out.numpy() for out in people_net_from_onnx(path)(torch.from_numpy(image))]
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-3)
    with pytest.raises(ModelError, match="keypoints.onnx"):
        people_net_from_onnx(shipped_model("keypoints"))


def test_other_files_are_refused_by_name(tmp_path):
    nothing = tmp_path / "nothing.onnx"
    nothing.write_bytes(b"no network")
    for path in (shipped_model("keypoints", "int8"), shipped_model("people"), nothing, tmp_path / "absent.onnx"):
        with pytest.raises(ModelError, match=path.name):
            keypoint_net_from_onnx(path)


def test_pseudo_labels_round_trip(tmp_path):
    before, path = random_pseudo_labels(), tmp_path / "footage.npz"
    save_pseudo_labels(path, before)
    after = load_pseudo_labels(path)
    for a, b in zip(before[:4], after[:4], strict=True):
        np.testing.assert_array_equal(a, b)
    assert after.padding == before.padding and after.facts == before.facts
    for name, content in (("cut", path.read_bytes()[:500]), ("other", b"something else")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FormatError, match=name):
            load_pseudo_labels(tmp_path / name)
    with pytest.raises(FormatError, match="save_pseudo_labels"):
        load_pseudo_labels(tmp_path / "absent")
    save_pseudo_labels(path, before._replace(agreed=before.agreed[:5]))
    with pytest.raises(FormatError, match="do not fit together"):
        load_pseudo_labels(path)


def test_crops_move_with_their_landmarks():
    view = View(random_pseudo_labels(), 192, 1.25)
    count, rng = 12, np.random.default_rng(1)
    for flip in (np.zeros(count, bool), np.ones(count, bool)):
        angle, scale, shift_px = rng.normal(0, 0.3, count), rng.uniform(0.8, 1.2, count), rng.normal(0, 8, (count, 2))
        images, at = view.transform(np.arange(count), angle, scale, shift_px, flip)
        for image, (x, y) in zip(images, at[:, 0], strict=True):
            rows, columns = np.nonzero(image[0] > 100)
            assert abs(columns.mean() - x) < 1 and abs(rows.mean() - y) < 1
    plain, at = view.plain(np.arange(count))
    assert plain.shape == (count, 4, 192, 192)
    # A stored crop spans a third more of the world on a third more pixels.
    np.testing.assert_allclose(at, view.labels.landmarks_px - 32, atol=1e-3)


@pytest.mark.parametrize("count", [1, 4, 20, 49, 100, 1234])
def test_some_frames_of_every_take_are_held_out(count):
    held = _held_out(count)
    assert len(held) == count and 1 <= held.sum() <= max(1, 0.2 * count)


def test_labels_are_where_the_person_is(followed, footage):
    world, names = true_points(demo_folder())
    world = world[: followed.session.frames]
    side = round(load_model(shipped_model("keypoints"))[1].input_size * footage.padding / 1.25)
    assert footage.crops.shape[1:] == (side, side, 4) and 60 <= len(footage.crops) <= 100
    assert footage.landmarks_px.shape == (len(footage.crops), JOINTS, 2)
    assert np.isfinite(footage.landmarks_px).all(-1).mean() > 0.8
    assert 0 < footage.held_out.mean() < 0.3
    # The crops of one camera lie next to each other: the first camera's, of frames evenly spread.
    chosen = [BODY23.index(n) for n in names]
    count = len(footage.crops) // 4
    frames = np.unique(np.linspace(0, len(world) - 1, count).astype(int))
    camera = followed.session.cameras[0]
    there = camera.project(world[frames])
    found = footage.landmarks_px[:count, chosen]
    # Both up to the crop's own scale and shift: rows of distances from the body's middle agree.
    spread = [np.linalg.norm(p - np.nanmean(p, 1, keepdims=True), axis=-1) for p in (there, found)]
    ratio = np.nanmedian(spread[1] / spread[0], axis=1, keepdims=True)
    assert np.nanmedian(np.abs(spread[1] - ratio * spread[0])) < 3


@pytest.fixture
def worse_network(change_weights, tmp_path):
    """The shipped network with noise on its heads' weights: something to gain, however slow the machine."""

    def noisy(values):
        return values + np.random.default_rng(0).normal(0, 0.6 * values.std(), values.shape).astype(np.float32)

    to = tmp_path / "worse.onnx"
    return change_weights(shipped_model("keypoints"), to, lambda i: i.name == "net.body_head.fine.weight", noisy)


def test_network_adapts_to_footage(footage, worse_network, tmp_path):
    view = View(footage, 224, 1.25)
    net = keypoint_net_from_onnx(worse_network)
    before = {k: v.clone() for k, v in net.state_dict().items()}
    shares = []
    options = Adaptation(tmp_path / "footage.npz", tmp_path, minutes=0.2, rate=1e-3)  # much, in seconds
    student, images = train_on_footage(net, view, options, shares.append)
    assert images >= 64 and shares == sorted(shares) and shares[-1] <= 1
    assert all(torch.equal(v, before[k]) for k, v in net.state_dict().items())  # the teacher stays
    assert measure_agreement(student, view).mean_px < 0.95 * measure_agreement(net, view).mean_px


def test_network_without_gain_is_not_written(footage, tmp_path):
    save_pseudo_labels(tmp_path / "footage.npz", footage)
    with pytest.raises(SessionError, match="no better than before"):
        adapt(Adaptation(tmp_path / "footage.npz", tmp_path / "out", minutes=0.03, rate=1e-12, threads=1), "")
    assert not (tmp_path / "out").exists()
    some = footage._replace(landmarks_px=footage.landmarks_px[:, :30], agreed=footage.agreed[:, :30])
    save_pseudo_labels(tmp_path / "footage.npz", some)
    with pytest.raises(ModelError, match="landmarks"):
        adapt(Adaptation(tmp_path / "footage.npz", tmp_path / "out"), "")


def test_labels_far_from_the_network_are_refused(followed, network_card, footage, tmp_path):
    with pytest.raises(SessionError, match="too little"), Progress(quiet=True) as progress:
        collect(followed, network_card, progress, PseudoLabelOptions(fewest_crops=100_000))
    # Labels beside the person.
    save_pseudo_labels(tmp_path / "footage.npz", footage._replace(landmarks_px=footage.landmarks_px + 30))
    with pytest.raises(SessionError, match="too far to be used as labels"):
        adapt(Adaptation(tmp_path / "footage.npz", tmp_path / "out"), "")


@pytest.mark.slow  # the tests above adapt in this process
def test_the_command_from_a_session_to_a_network(short_demo, worse_network, tmp_path):
    out = tmp_path / "adapted"
    run = [sys.executable, "-m", "muybridge", "adapt", str(short_demo), "--out", str(out), "--minutes", "0.3"]
    run += ["--keypoint-model", str(worse_network)]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == {*RESULTS, "work"}
    assert "before" in done.stdout and f"--keypoint-model {out / 'keypoints-int8.onnx'}" in done.stdout
    # Files that `run` takes.
    models = open_models(DetectOptions(keypoint_model=out / "keypoints.onnx", markers="all"))
    assert models.landmarks == BODY23
    metadata = models.metadata["keypoints"]
    assert "scores" not in metadata and json.loads(metadata["adapted"])["session"] == "take"
    open_models(DetectOptions(keypoint_model=out / "keypoints-int8.onnx"))
    facts = json.loads((out / "adapt.json").read_text())
    assert facts["after"]["mean_px"] < facts["before"]["mean_px"]
    # A file of somebody else's stays.
    (out / "keypoints.onnx").write_text("mine")
    again = subprocess.run(run, capture_output=True, text=True, check=False)
    assert again.returncode == 2 and "--overwrite" in again.stderr and (out / "keypoints.onnx").read_text() == "mine"


def test_8_bit_network_is_refused_before_detection(short_demo, tmp_path, capsys):
    model = str(shipped_model("keypoints", "int8"))
    assert run_command(["adapt", str(short_demo), "--out", str(tmp_path / "out"), "--keypoint-model", model]) == 2
    assert "an 8-bit network, which cannot be trained" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_run_reports_an_unused_adapted_network(short_demo, tmp_path, monkeypatch, capsys):
    def follow(*_: object) -> None:
        raise SessionError("far enough")

    take = tmp_path / "take"
    shutil.copytree(short_demo, take)
    (take / pipeline.ADAPTED).parent.mkdir()
    (take / pipeline.ADAPTED).touch()
    monkeypatch.setattr(pipeline, "follow", follow)
    notice = f"{take / pipeline.ADAPTED} was adapted to this session and is not used; --keypoint-model names it"
    for given in ([], ["--keypoint-model", str(shipped_model("keypoints"))]):
        assert run_command(["run", str(take), *given]) == 2
        said = capsys.readouterr().err
        assert "far enough" in said and (notice in said) == (not given)


def test_missing_extra_is_reported_first(monkeypatch, tmp_path):
    monkeypatch.setattr(command.importlib.util, "find_spec", lambda name: None if name == "torch" else object())
    with pytest.raises(MissingExtraError, match="train"):
        command.adapt(tmp_path / "no session")


def test_mirrored_landmarks_change_sides():
    names = [*BODY23.names, *SURFACE.names]
    for i, name in enumerate(names):
        twin = name.replace("left", "\0").replace("right", "left").replace("\0", "right")
        assert names[MIRROR[i]] == twin


def test_own_frames_follow_the_clock():
    frames = np.arange(0, 50, 10)
    clocks = [Clock(0.0, 0.0, 0, 0, 1), Clock(0.1, 0.0, 0, 0, 1)]
    assert own_frames(None, 1, frames, 50, 100).tolist() == frames.tolist()
    assert own_frames(clocks, 1, frames, 50, 100).tolist() == [5, 15, 25, 35, 45]
    assert own_frames(clocks, 1, frames, 50, 40).tolist() == [5, 15, 25, 35, 39]
