"""Networks, model files and the pose estimator, on tiny networks that see coloured blobs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from muybridge.arrays import ByteArray, FloatArray
from muybridge.errors import ModelError
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.crops import crops_for_boxes
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.background import SmallFrames
from muybridge.infer.detection.crop_pixels import extract_crops
from muybridge.infer.detection.crop_reader import body_boxes
from muybridge.infer.detection.person_detector import PeopleDetector, PeopleOptions
from muybridge.infer.detection.pose_estimator import KeypointOptions, PoseEstimator
from muybridge.infer.detection.tracker import TrackOptions
from muybridge.infer.detection.tracks import by_name, merge_tracks
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions, PeopleNetwork
from muybridge.models.keypoints.decode import decode_heatmaps
from muybridge.models.keypoints.metadata import keypoint_card
from muybridge.models.people.decode import DetectedPeople
from muybridge.models.uncertainty import SpreadCalibration

onnx = pytest.importorskip("onnx", reason="onnx is in the train extra")

# A "person" is a grey ellipse with a red, a green and a blue blob on it.
NAMES = ("nose", "left_wrist", "right_wrist")
OFFSETS_PX = np.array([[0.0, -34.0], [18.0, 6.0], [-18.0, 6.0]])
PERSON_PX = (60.0, 100.0)
WIDTH, HEIGHT, CROP = 640, 480, 96


def _save(path: Path, nodes: list[Any], weights: dict[str, NDArray[Any]], outputs: dict[str, list[Any]],
          channels: int, metadata: dict[str, str]) -> Path:  # fmt: skip
    helper, floats = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info("image", floats, ["n", channels, "h", "w"])],
        [helper.make_tensor_value_info(name, floats, shape) for name, shape in outputs.items()],
        [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in weights.items()],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return path


def _keypoint_metadata(**changes: str) -> dict[str, str]:
    metadata = {
        "muybridge_kind": "keypoints", "version": "0.0.1", "landmark_set": "blobs3",
        "names": json.dumps(NAMES), "input_size": str(CROP), "stride": "4", "normalisation": "none",
        "variance": json.dumps({"scale": 1.5, "floor_px2": 0.25}), "box_padding": "1.25",
        "training_command": "none", "seed": "0", "licence": "Apache-2.0",
    }  # fmt: skip
    return {key: value for key, value in {**metadata, **changes}.items() if value}


def _tiny_keypoints(path: Path, **changes: str) -> Path:
    """Each landmark's map is the average over a cell of one colour minus the other two."""
    kernel = np.full((3, 3, 4, 4), -0.5) + 1.5 * np.eye(3)[:, :, None, None]
    weights = {"w": (kernel * 20 / 16).astype(np.float32)}
    make = onnx.helper.make_node
    nodes = [
        make("Conv", ["image", "w"], ["heatmaps"], strides=[4, 4]),
        make("GlobalMaxPool", ["heatmaps"], ["pooled"]),
        make("Flatten", ["pooled"], ["visibility"]),
    ]
    outputs = {"heatmaps": ["n", 3, "y", "x"], "visibility": ["n", 3]}
    return _save(path, nodes, weights, outputs, 3, _keypoint_metadata(**changes))


def _tiny_people(path: Path, **changes: str) -> Path:
    """A person's middle is where a person-sized window is bright; every box has the blob people's size."""
    rows, columns = np.mgrid[:48, :32]
    window = np.exp(-(((columns - 15.5) / 10) ** 2) - ((rows - 23.5) / 16) ** 2)
    heat = np.repeat((window / window.sum())[None, None] * 20, 4, axis=1)
    heat[:, 3] = 0.0
    half = np.array(PERSON_PX) / 4  # half a person at half the resolution
    weights = {
        "w": heat.astype(np.float32), "b": np.array([-6.0], dtype=np.float32),
        "w0": np.zeros((4, 4, 8, 8), dtype=np.float32), "b0": np.tile(half, 2).astype(np.float32),
    }  # fmt: skip
    make = onnx.helper.make_node
    nodes = [
        make("Conv", ["image", "w", "b"], ["heatmap"], strides=[8, 8], pads=[20, 12, 20, 12]),
        make("Conv", ["image", "w0", "b0"], ["box"], strides=[8, 8]),
    ]
    metadata = {"muybridge_kind": "people", "version": "0.0.1", "input_long_side": "320", "stride": "8"}
    outputs = {"heatmap": ["n", 1, "y", "x"], "box": ["n", 4, "y", "x"]}
    return _save(path, nodes, weights, outputs, 4, {**metadata, **changes})


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("models")
    return _tiny_keypoints(folder / "keypoints.onnx"), _tiny_people(folder / "people.onnx")


def _frame(centers: list[FloatArray], noise: np.random.Generator | None = None) -> ByteArray:
    image = np.full((HEIGHT, WIDTH, 3), 20.0, dtype=np.float32)
    if noise is not None:
        image += noise.normal(0, 4, image.shape).astype(np.float32)
    for center in centers:
        left, top = np.maximum(center.astype(int) - 70, 0)
        part = image[top : top + 140, left : left + 140]
        y, x = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]].astype(np.float32)
        part[((x - center[0]) / 30) ** 2 + ((y - center[1]) / 50) ** 2 < 1] += 90
        for channel, (dx, dy) in enumerate(OFFSETS_PX):
            blob = np.exp(-((x - center[0] - dx) ** 2 + (y - center[1] - dy) ** 2) / (2 * 4.0**2))[..., None]
            part *= 1 - blob
            part += blob * 255 * np.eye(3, dtype=np.float32)[channel]
    return np.clip(image, 0, 255).astype(np.uint8)


def _two_people(frames: int) -> FloatArray:
    """(T, 2, 2) middles of two people who walk past each other at different heights."""
    t = np.arange(frames)[:, None]
    first = np.concatenate([120 + 3.0 * t, 140 + 0.5 * t], axis=1)
    second = np.concatenate([500 - 3.0 * t, 330 + 20 * np.sin(t / 8)], axis=1)
    return np.stack([first, second], axis=1)


def _rolled_camera() -> Camera:
    """Portrait: turned by 90 degrees, 4 m from the wall y = 0."""
    rotation = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    pose = np.column_stack([rotation, -rotation @ np.array([0.0, -4.0, 1.0])])
    return Camera("rolled", "OPENCV", WIDTH, HEIGHT, (600.0, 600.0, 320.0, 240.0, -0.1, 0.02, 0, 0), pose)


@pytest.mark.parametrize("camera", [None, _rolled_camera()], ids=["uncalibrated", "calibrated"])
@pytest.mark.parametrize("chunk", [7, 40])
def test_two_people_are_tracked(models: tuple[Path, Path], camera: Camera | None, chunk: int) -> None:
    truth = _two_people(40)
    rng = np.random.default_rng(0)
    estimator = PoseEstimator(*models, camera=camera)
    for start in range(0, 40, chunk):
        estimator.process(np.stack([_frame(list(c), rng) for c in truth[start : start + chunk]]))
    tracks = estimator.finish()
    assert tracks.body.points_px.shape == (40, 2, 3, 2) and tracks.boxes_px.shape == (40, 2, 4)
    assert np.isfinite(tracks.body.points_px).all() and (tracks.ids == tracks.ids[0]).all()
    order = np.argsort(tracks.body.points_px[0, :, 0, 1])
    error = np.linalg.norm(tracks.body.points_px[:, order] - (truth[:, :, None] + OFFSETS_PX), axis=-1)
    assert error.max() < 2.5 and np.median(error) < 0.7
    # A sigma of the right size: the blobs' own, as this network's maps follow them.
    assert 1.0 < np.sqrt(np.median(tracks.body.variance_px2)) < 8.0
    assert tracks.body.score.min() > 0.5 and tracks.body.visibility.min() > 0.9


def test_a_person_who_is_gone_is_missing(models: tuple[Path, Path]) -> None:
    estimator = PoseEstimator(*models)
    for t in range(30):
        there = [np.array([200.0 + t, 200.0])] if t < 12 else []
        estimator.process(_frame(there)[None])
    tracks = estimator.finish()
    assert tracks.body.points_px.shape == (30, 1, 3, 2)
    assert np.isfinite(tracks.body.points_px[:12]).all()
    assert np.isnan(tracks.body.points_px[12:]).all() and np.isnan(tracks.body.variance_px2[12:]).all()
    assert (tracks.body.score[12:] == 0).all() and (tracks.ids[12:] == -1).all()


def _patch_detector(monkeypatch: pytest.MonkeyPatch, change: Callable[[int, DetectedPeople], DetectedPeople]) -> None:
    """Every detection passes through `change`, which is told the number of its frame."""
    original, count = PeopleDetector.__call__, [0]

    def patched(self: PeopleDetector, frames: SmallFrames) -> list[DetectedPeople | None]:
        found = original(self, frames)
        changed = [change(count[0] + i, f) if f is not None else None for i, f in enumerate(found)]
        count[0] += len(found)
        return changed

    monkeypatch.setattr(PeopleDetector, "__call__", patched)


def test_landmarks_keep_a_track_that_the_detector_loses(
    models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Looked for in every frame, seen in none of 60, moving: the landmarks carry the box along."""
    nobody = DetectedPeople(np.empty((0, 4)), np.empty(0))
    _patch_detector(monkeypatch, lambda t, found: nobody if 30 <= t < 90 else found)
    estimator = PoseEstimator(*models, options=KeypointOptions(track=TrackOptions(coast=8 / 30)))
    positions = np.stack([[100.0 + 3 * t, 200.0] for t in range(120)])
    for start in range(0, 120, 4):
        estimator.process(np.stack([_frame([c]) for c in positions[start : start + 4]]))
    tracks = estimator.finish()
    error = np.linalg.norm(tracks.body.points_px[:, 0] - (positions[:, None] + OFFSETS_PX), axis=-1)
    assert tracks.body.points_px.shape[1] == 1 and error.max() < 3.0


def test_a_second_track_on_one_person_is_dropped(models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A detector that also reports half of the person: both boxes lead to the same landmarks."""

    def also_half(frame: int, found: DetectedPeople) -> DetectedPeople:
        half = found.boxes_px[:1] + [0.0, 0.0, 0.0, -55.0]
        return DetectedPeople(np.concatenate([found.boxes_px[:1], half]), np.array([0.9, 0.8]))

    _patch_detector(monkeypatch, also_half)
    estimator = PoseEstimator(*models, options=KeypointOptions(min_confidence=0.2))
    center = np.array([300.0, 200.0])
    estimator.process(np.stack([_frame([center])] * 20))
    tracks = estimator.finish()
    assert tracks.body.points_px.shape[1] == 1
    assert np.abs(tracks.body.points_px[:, 0] - center - OFFSETS_PX).max() < 2.5


def test_a_track_without_a_person_is_dropped(models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A detector that sees somebody in an empty corner, in every frame and without a doubt."""

    def also_there(frame: int, found: DetectedPeople) -> DetectedPeople:
        corner = np.array([[20.0, 330.0, 80.0, 430.0]])
        return DetectedPeople(np.concatenate([found.boxes_px[:1], corner]), np.array([0.9, 0.9]))

    _patch_detector(monkeypatch, also_there)
    people = []
    for least in (0.0, KeypointOptions().min_confidence):
        estimator = PoseEstimator(*models, options=KeypointOptions(min_confidence=least))
        estimator.process(np.stack([_frame([np.array([300.0, 200.0])])] * 20))
        people.append(estimator.finish().body.points_px.shape[1])
    assert people == [2, 1]
    # Where nobody is surer, even the unsure count.
    estimator = PoseEstimator(*models, options=KeypointOptions(min_confidence=1.0))
    estimator.process(np.stack([_frame([np.array([300.0, 200.0])])] * 20))
    assert estimator.finish().body.points_px.shape[1] == 1


def test_unknown_landmarks_are_missing(models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A landmark that nobody can see; a second track on the same person is found out all the same."""

    def twice(frame: int, found: DetectedPeople) -> DetectedPeople:
        box = np.array([[255.0, 130.0, 345.0, 270.0]])
        return DetectedPeople(np.concatenate([box, box + [0.0, 0.0, 0.0, -40.0]]), np.array([0.9, 0.8]))

    _patch_detector(monkeypatch, twice)
    center = np.array([300.0, 200.0])
    frame = _frame([center])
    x, y = (center + OFFSETS_PX[2]).astype(int)
    frame[y - 20 : y + 21, x - 20 : x + 21] = 20
    estimator = PoseEstimator(*models, options=KeypointOptions(min_confidence=0.2))
    estimator.process(np.stack([frame] * 20))
    tracks = estimator.finish()
    assert tracks.body.points_px.shape[1] == 1
    assert np.isnan(tracks.body.points_px[:, 0, 2]).all() and (tracks.body.score[:, 0, 2] == 0).all()
    assert np.isnan(tracks.body.variance_px2[:, 0, 2]).all()
    assert np.abs(tracks.body.points_px[:, 0, :2] - center - OFFSETS_PX[:2]).max() < 2.5


def test_nobody_at_all(models: tuple[Path, Path]) -> None:
    estimator = PoseEstimator(*models)
    assert estimator.finish().body.points_px.shape == (0, 1, 3, 2)
    estimator.process(np.stack([_frame([])] * 3))
    tracks = estimator.finish()
    assert tracks.body.points_px.shape == (3, 1, 3, 2) and np.isnan(tracks.body.points_px).all()


@pytest.mark.parametrize(("every", "most_fps"), [(1, None), (4, None), (None, None), (None, 20.0)])
def test_looking_at_fewer_frames_tracks_as_well(models: Any, every: int | None, most_fps: float | None) -> None:
    options = KeypointOptions(people=PeopleOptions(every=every, background=False), most_fps=most_fps)
    estimator = PoseEstimator(*models, options=options, fps=60.0)
    positions = np.stack([[150.0 + 3 * t, 200.0] for t in range(40)])
    for start in range(0, 40, 8):
        estimator.process(np.stack([_frame([c]) for c in positions[start : start + 8]]))
    tracks = estimator.finish()
    error = np.linalg.norm(tracks.body.points_px[:, 0] - (positions[:, None] + OFFSETS_PX), axis=-1)
    assert error.max() < 2.5


@pytest.mark.parametrize(("step", "thin", "read"), [(1.0, True, [6]), (1.0, False, [16]), (9.0, True, [6, 10])])
def test_a_first_pass_reads_every_frame_only_of_people_who_move_fast(
    models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, step: float, thin: bool, read: list[int]
) -> None:
    counts: list[int] = []
    locate = KeypointNetwork.locate
    monkeypatch.setattr(
        KeypointNetwork, "locate", lambda self, crops, **how: counts.append(len(crops)) or locate(self, crops, **how)
    )
    options = KeypointOptions(people=PeopleOptions(background=False), most_fps=20.0, refine_crop=False)
    estimator = PoseEstimator(*models, options=options, fps=60.0)
    positions = np.stack([[150.0 + step * t, 200.0] for t in range(16)])
    estimator.process(np.stack([_frame([c]) for c in positions]), thin=thin)
    assert counts == read
    found = estimator.finish().body.points_px[:, 0]
    assert np.linalg.norm(found - (positions[:, None] + OFFSETS_PX), axis=-1).max() < 2.5


def test_a_poor_box_is_cropped_again(models: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A detector whose boxes are twice too large and trembling: the second crop follows the landmarks."""
    truth = np.array([300.0, 200.0]) + OFFSETS_PX
    rng, grow = np.random.default_rng(0), np.array([-80.0, -60, 40, 60])
    errors, sides, trembling = [], [], []
    for refine in (False, True):
        with monkeypatch.context() as patch:
            _patch_detector(patch, lambda t, f: f._replace(boxes_px=f.boxes_px + grow + rng.normal(0, 4, 4)))
            estimator = PoseEstimator(*models, options=KeypointOptions(refine_crop=refine, min_confidence=0.1))
            estimator.process(np.stack([_frame([np.array([300.0, 200.0])])] * 12))
        tracks = estimator.finish()
        errors.append(np.linalg.norm(tracks.body.points_px[:, 0] - truth, axis=-1).mean())
        sides.append((tracks.boxes_px[:, 0, 3] - tracks.boxes_px[:, 0, 1]).mean())
        trembling.append(np.abs(np.diff(tracks.boxes_px[:, 0], axis=0)).mean())
    assert sides[1] < 0.7 * sides[0] and trembling[1] < trembling[0]
    assert errors[1] <= errors[0] + 0.2


def test_frames_of_another_size_are_refused(models: tuple[Path, Path]) -> None:
    estimator = PoseEstimator(*models, camera=_rolled_camera())
    with pytest.raises(ValueError, match="fit the calibration to the video first"):
        estimator.process(np.zeros((1, 100, 100, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match="uint8"):
        estimator.process(np.zeros((1, HEIGHT, WIDTH, 3), dtype=np.float32))  # type: ignore[arg-type]


def test_cameras_merge_with_padded_slots(models: tuple[Path, Path]) -> None:
    results = []
    for people in ([np.array([200.0, 200.0])], [np.array([200.0, 150.0]), np.array([450.0, 300.0])]):
        estimator = PoseEstimator(*models)
        estimator.process(np.stack([_frame(people)] * 6))
        results.append(estimator.finish())
    (merged,) = merge_tracks(results).values()
    assert merged.points_px.shape == (2, 6, 2, 3, 2)
    np.testing.assert_array_equal(merged.points_px[0, :, 0], results[0].body.points_px[:, 0])
    assert np.isnan(merged.points_px[0, :, 1]).all() and (merged.score[0, :, 1] == 0).all()
    with pytest.raises(ValueError, match="landmarks"):
        other = replace(results[1], landmarks=by_name([replace(results[1].body, set=BODY23)]))
        merge_tracks([results[0], other])


def test_body_boxes_reach_beyond_the_landmarks() -> None:
    points = np.full((2, 23, 2), np.nan)
    points[0, BODY23.index("nose")] = [100, 50]
    points[0, BODY23.index("left_heel")] = [110, 250]
    box = body_boxes(points, BODY23)
    np.testing.assert_allclose(box[0], [78, 28, 122, 258])
    assert np.isnan(box[1]).all()


def test_flip_averages_the_mirrored_crop(models: tuple[Path, Path]) -> None:
    crops = np.random.default_rng(0).integers(0, 256, (5, CROP, CROP, 3), dtype=np.uint8)
    plain = KeypointNetwork(models[0], OnnxOptions(batch=2))
    heatmaps, visibility = plain(crops)
    mirrored, mirrored_visibility = plain(np.ascontiguousarray(crops[:, :, ::-1]))
    both, both_visibility = KeypointNetwork(models[0], OnnxOptions(flip=True))(crops)
    flip = [0, 2, 1]
    np.testing.assert_allclose(both, (heatmaps + mirrored[:, flip, :, ::-1]) / 2, atol=1e-5)
    np.testing.assert_allclose(both_visibility, (visibility + mirrored_visibility[:, flip]) / 2, atol=1e-5)


@pytest.mark.parametrize("network", [KeypointNetwork, PeopleNetwork])
def test_files_that_are_no_networks(
    network: Callable[[Path], object], tmp_path: Path, models: tuple[Path, Path]
) -> None:
    whole = models[0 if network is KeypointNetwork else 1].read_bytes()
    files = {"empty": b"", "text": b"hello, world\n" * 50, "truncated": whole[: len(whole) // 2]}
    for name, content in files.items():
        path = tmp_path / f"{name}.onnx"
        path.write_bytes(content)
        with pytest.raises(ModelError, match="not an ONNX model, or a damaged one") as caught:
            network(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    for path in (tmp_path / "absent.onnx", tmp_path):
        with pytest.raises(ModelError, match="no such model file"):
            network(path)
    other = models[1 if network is KeypointNetwork else 0]
    with pytest.raises(ModelError, match="is needed"):
        network(other)


def test_the_card_has_the_files_metadata(models: tuple[Path, Path]) -> None:
    card = KeypointNetwork(models[0]).card
    assert card.landmarks.names == NAMES and card.input_size == CROP and card.version == "0.0.1"
    assert card.spread == SpreadCalibration(1.5, 0.25) and card.box_padding == 1.25
    body = keypoint_card(_keypoint_metadata(landmark_set="body23", names=json.dumps(BODY23.names)), Path("x"))
    assert body.landmarks == BODY23
    assert PeopleNetwork(models[1]).card.input_long_side == 320


def test_the_code_in_the_guide_agrees(models: tuple[Path, Path], repository: Path) -> None:
    code = (repository / "docs" / "examples" / "02_landmarks_with_uncertainty.py").read_text(encoding="utf-8")
    session = pytest.importorskip("onnxruntime").InferenceSession(str(models[0]), providers=["CPUExecutionProvider"])
    crops = crops_for_boxes(np.array([[270.0, 150.0, 330.0, 250.0]]), CROP)
    pixels = extract_crops(_frame([np.array([300.0, 200.0])]), crops)
    scope: dict[str, Any] = {"__name__": "example"}
    exec(code, scope)
    found = scope["find_landmarks"](session, pixels[0])
    network = KeypointNetwork(models[0])
    heatmaps, _ = network(pixels)
    ours = decode_heatmaps(heatmaps, 4, network.card.spread)
    assert tuple(found) == NAMES
    values = np.array(list(found.values()))
    np.testing.assert_allclose(values[:, :2], ours.points_crop_px[0], atol=0.7)
    np.testing.assert_allclose(values[:, 2], np.sqrt(ours.variance_crop_px2[0]), rtol=0.05)
    truth = np.array([300.0, 200.0]) + OFFSETS_PX
    np.testing.assert_allclose(crops.to_image(values[None, :, :2])[0], truth, atol=2.0)
