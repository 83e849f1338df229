"""Third-party models with a card: small ONNX files with RTMPose's interface, whose outputs are known."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")

from muybridge.errors import ModelError  # noqa: E402
from muybridge.geometry.cameras.crops import crops_for_boxes  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.infer.commands.app import run_command  # noqa: E402
from muybridge.infer.demo_take.take import demo_folder, true_points  # noqa: E402
from muybridge.infer.detection.crop_pixels import extract_crops  # noqa: E402
from muybridge.infer.detection.detect import DetectOptions  # noqa: E402
from muybridge.infer.detection.pose_estimator import KeypointOptions  # noqa: E402
from muybridge.infer.networks.external import ExternalModel, open_keypoints  # noqa: E402
from muybridge.infer.networks.keypoints import OnnxOptions  # noqa: E402
from muybridge.infer.networks.models import open_models  # noqa: E402
from muybridge.infer.reconstruction.landmarks import MIN_CONFIDENCE, SolveOptions  # noqa: E402
from muybridge.models.keypoints.external import LAYOUTS, find_card, load_card, shipped_cards  # noqa: E402
from muybridge.models.keypoints.simcc import decode_simcc, decode_value_heatmaps  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.models.uncertainty import SpreadCalibration  # noqa: E402
from tests.paths import DATA  # noqa: E402

MEAN, STD = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
WIDTH, HEIGHT = 192, 256


def _bright_spot_model(path: Path, count: int, channel: int = 0, batch: object = "n", wider: int = 0) -> Path:
    """RTMPose's interface: every landmark's bins answer with the brightness of its rows and columns in one colour,
    as the sums over the other axis, stretched to two bins a pixel; landmark k is scaled by 1 + k / 1000."""
    make, numpy_helper = onnx.helper.make_node, onnx.numpy_helper
    pick = np.zeros((1, 3, 1, 1), np.float32)
    pick[0, channel] = 0.02
    gain = (1 + np.arange(count, dtype=np.float32) / 1000)[None, :, None]
    nodes = [make("Conv", ["input", "pick"], ["one"])]
    for axis, name in (("2", "simcc_x"), ("3", "simcc_y")):
        nodes += [
            make("ReduceSum", ["one", f"axis{axis}"], [f"sum{axis}"], keepdims=0),
            make("Resize", [f"sum{axis}", "", "", f"size{axis}"], [f"fine{axis}"], mode="linear",
                 coordinate_transformation_mode="asymmetric"),
            make("Mul", [f"fine{axis}", "gain"], [name]),
        ]  # fmt: skip
    weights = {"pick": pick, "gain": gain, "axis2": np.array([2]), "axis3": np.array([3])}
    graph_inputs = [onnx.helper.make_tensor_value_info("input", 1, [batch, 3, HEIGHT, WIDTH])]
    weights |= {"scale2": np.array([1, 1, 2], np.float32), "scale3": np.array([1, 1, 2], np.float32)}
    for node in nodes:
        if node.op_type == "Resize":
            axis = node.input[0][-1]
            del node.input[:]
            node.input.extend([f"sum{axis}", "", f"scale{axis}"])
    outputs = [
        onnx.helper.make_tensor_value_info("simcc_x", 1, [batch, count, 2 * WIDTH]),
        onnx.helper.make_tensor_value_info("simcc_y", 1, [batch, count, 2 * HEIGHT]),
    ]
    graph = onnx.helper.make_graph(nodes, "spot", graph_inputs, outputs,
                                   [numpy_helper.from_array(v, k) for k, v in weights.items()])  # fmt: skip
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def _frame_with_spot(at: tuple[float, float], channel: int = 0) -> np.ndarray:
    rows, columns = np.mgrid[:480, :640]
    frame = np.full((480, 640, 3), 40, np.uint8)
    frame[..., channel] = 40 + 200 * np.exp(-((columns - at[0]) ** 2 + (rows - at[1]) ** 2) / (2 * 6.0**2))
    return frame


def _card(tmp_path: Path, **changes: str) -> Path:
    text = shipped_cards()["rtmpose-coco17"].read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "card.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("layout", "count"), [("coco17", 17), ("halpe26", 26), ("coco133", 133)])
@pytest.mark.parametrize("box", [(250.0, 100.0, 350.0, 400.0), (200.0, 180.0, 420.0, 260.0)])
def test_rtmpose_layouts_find_a_spot_in_the_image(
    tmp_path: Path, layout: str, count: int, box: tuple[float, float, float, float]
) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", count)
    network = open_keypoints(path, f"rtmpose-{layout}", OnnxOptions(batch=2))
    assert isinstance(network, ExternalModel)
    spot = (311.3, 216.8)
    boxes = np.tile(network.fitted_boxes(np.array([box])), (3, 1))
    crops = crops_for_boxes(boxes, network.crop_size, None, network.box_padding)
    assert network.crop_size == HEIGHT
    # The whole person lies in the middle columns that the model sees.
    corners = crops.to_crop(np.tile(np.array(box).reshape(1, 2, 2), (3, 1, 1)))
    assert (corners[..., 0] > 32).all() and (corners[..., 0] < 32 + WIDTH - 1).all()
    (points, variance, score), visibility, further, _ = network.locate(extract_crops(_frame_with_spot(spot), crops))
    assert not further
    found = crops.to_image(points)
    known = [j for j, name in enumerate(BODY23.names) if name in LAYOUTS[layout]]
    missing = sorted(set(range(23)) - set(known))
    assert len(known) == (17 if layout == "coco17" else 23)
    np.testing.assert_allclose(found[:, known], np.broadcast_to(spot, (3, len(known), 2)), atol=0.6)
    assert (variance[:, known] > 0).all() and (score[:, known] > 0.3).all()
    assert np.isnan(found[:, missing]).all() and (score[:, missing] == 0).all()
    assert visibility.shape == (3, 23)


def test_each_layout_maps_by_name() -> None:
    rng = np.random.default_rng(0)
    for layout in ("halpe26", "coco133"):
        names = LAYOUTS[layout]
        at = rng.uniform(20, 170, (1, len(names), 2))
        x = -np.abs(np.arange(2 * WIDTH) / 2 - at[..., :1]).astype(np.float32)
        y = -np.abs(np.arange(2 * HEIGHT) / 2 - at[..., 1:]).astype(np.float32)
        found = decode_simcc(x, y, 2.0, SpreadCalibration(), 10.0).points_crop_px
        assert np.abs(found - at).max() < 0.15  # sub-pixel, from bins of half a pixel
        # The published orders: HALPE's feet go left, right; COCO-WholeBody's go left foot, right foot.
        toe = 21 if layout == "halpe26" else 20
        assert names[toe] == "right_big_toe" and names[17] == ("head" if layout == "halpe26" else "left_big_toe")
    assert LAYOUTS["halpe26"][24:26] == ("left_heel", "right_heel") and len(LAYOUTS["coco133"]) == 133


def test_simcc_returns_the_mode_with_a_variance_over_both_peaks() -> None:
    bins = np.arange(384)
    peak = lambda at, sd: np.exp(-((bins - at) ** 2) / (2 * sd**2))  # noqa: E731
    two = np.log(0.7 * peak(100.4, 3) + 0.3 * peak(300, 3) + 1e-9).astype(np.float32)[None, None]
    one = np.log(peak(100.4, 3) + 1e-9).astype(np.float32)[None, None]
    both = decode_simcc(two, one, 2.0, SpreadCalibration(1.0, 0.0))
    sure = decode_simcc(one, one, 2.0, SpreadCalibration(1.0, 0.0))
    np.testing.assert_allclose(both.points_crop_px[0, 0], 50.2, atol=0.05)
    assert sure.variance_crop_px2[0, 0] == pytest.approx(1.5**2, rel=0.02)
    assert both.variance_crop_px2[0, 0] == pytest.approx((1.5**2 * 2 + 0.3 * 99.8**2) / 2, rel=0.02)
    assert sure.score[0, 0] > 0.99 and both.score[0, 0] == pytest.approx(0.7, abs=0.01)
    broken = decode_simcc(np.full_like(one, np.nan), one, 2.0, SpreadCalibration())
    assert np.isnan(broken.points_crop_px).all() and broken.score[0, 0] == 0


@pytest.mark.parametrize(("logits", "sd"), [(True, 1.0), (False, 2.0), (False, 3.0)])
def test_heatmaps_of_other_conventions(logits: bool, sd: float) -> None:
    rows, columns = np.mgrid[:64, :48]
    values = 0.8 * np.exp(-((columns - 20.3) ** 2 + (rows - 31.6) ** 2) / (2 * sd**2))
    maps = (np.log(values + 1e-9) if logits else values).astype(np.float32)[None, None]
    found = decode_value_heatmaps(maps, 4.0, 0.0, SpreadCalibration(), logits)
    np.testing.assert_allclose(found.points_crop_px[0, 0], [81.2, 126.4], atol=0.15)
    if logits:
        assert found.score[0, 0] > 0.9  # nearly all of the probability lies near the point
    else:
        assert found.score[0, 0] == pytest.approx(values.max())


def test_normalisation_and_colour_order_follow_the_card(tmp_path: Path) -> None:
    """A model that gives back its first channel's value at a pixel tells what it was fed."""
    path = _bright_spot_model(tmp_path / "model.onnx", 17, channel=2)
    card = load_card(_card(tmp_path, **{'"rgb"': '"bgr"'}))
    network = ExternalModel(path, card, OnnxOptions())
    fed = {}
    session = network._session

    class Spy:
        def run(self, names, inputs):
            fed.update(inputs)
            return session.run(names, inputs)

    network._session = Spy()
    crops = np.random.default_rng(0).integers(0, 256, (2, HEIGHT, HEIGHT, 3), np.uint8)
    network.locate(crops)
    inner = crops[:, :, 32:224, ::-1].astype(np.float64)
    expected = ((inner - MEAN) / STD).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(fed["input"], expected, atol=1e-5)


def test_fixed_batches_are_filled_up(tmp_path: Path) -> None:
    crops = np.random.default_rng(0).integers(0, 256, (5, HEIGHT, HEIGHT, 3), np.uint8)
    card = str(shipped_cards()["rtmpose-coco17"])
    free = open_keypoints(_bright_spot_model(tmp_path / "a.onnx", 17), card, OnnxOptions()).locate(crops)
    fixed = open_keypoints(_bright_spot_model(tmp_path / "b.onnx", 17, batch=4), card, OnnxOptions()).locate(crops)
    np.testing.assert_allclose(fixed.found.points_crop_px, free.found.points_crop_px, atol=1e-6)


def test_weights_may_lie_beside_the_model(tmp_path: Path) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", 17)
    crops = np.zeros((1, HEIGHT, HEIGHT, 3), np.uint8)
    crops[:, 100:110, 120:130] = 255
    one = open_keypoints(path, "rtmpose-coco17", OnnxOptions()).locate(crops)[0]
    beside = {"save_as_external_data": True, "location": "model.onnx.data", "size_threshold": 50}
    onnx.save(onnx.load(str(path)), str(path), **beside)
    assert (tmp_path / "model.onnx.data").exists()
    two = open_keypoints(path, "rtmpose-coco17", OnnxOptions()).locate(crops)[0]
    np.testing.assert_array_equal(one.points_crop_px, two.points_crop_px)


@pytest.mark.parametrize(
    ("kind", "shape"), [(10, (3, 256, 192)), (2, (3, 256, 192)), (1, (256, 192, 3)), (1, (3, 384, 288))]
)
def test_input_that_differs_from_the_card_is_refused(tmp_path: Path, kind: int, shape: tuple[int, ...]) -> None:
    model = onnx.load(str(_bright_spot_model(tmp_path / "model.onnx", 17)))
    model.graph.input[0].CopyFrom(onnx.helper.make_tensor_value_info("input", kind, ["n", *shape]))
    cast = onnx.helper.make_node("Cast", ["input"], ["as_float"], to=1)
    crop = onnx.helper.make_node("Expand", ["any", "any_shape"], ["image"])
    model.graph.initializer.extend([
        onnx.numpy_helper.from_array(np.zeros((1, 1, 1, 1), np.float32), "any"),
        onnx.numpy_helper.from_array(np.array([1, 3, HEIGHT, WIDTH]), "any_shape"),
    ])  # fmt: skip
    next(node for node in model.graph.node if node.op_type == "Conv").input[0] = "image"
    for node in (cast, crop):
        model.graph.node.insert(0, node)
    onnx.save(model, str(tmp_path / "other.onnx"))
    with pytest.raises(ModelError, match=r"its card says float \(N, 3, 256, 192\); correct width and height"):
        open_keypoints(tmp_path / "other.onnx", "rtmpose-coco17", OnnxOptions())


@pytest.mark.parametrize("logits", [True, False])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_non_finite_maps_are_missing_landmarks(logits: bool, wrong: float) -> None:
    maps = np.zeros((1, 2, 64, 48), np.float32)
    maps[0, :, 20, 30] = 5 if logits else 1
    maps[0, 1, 3, 3] = wrong
    found = decode_value_heatmaps(maps, 4, 1.5, SpreadCalibration(), logits)
    assert found.points_crop_px[0, 0] == pytest.approx([121.5, 81.5], abs=0.5) and found.score[0, 0] > 0
    assert np.isnan(found.points_crop_px[0, 1]).all() and np.isnan(found.variance_crop_px2[0, 1])
    assert found.score[0, 1] == 0


def test_shipped_cards_are_complete() -> None:
    cards = shipped_cards()
    assert {"rtmpose-coco17", "rtmpose-halpe26", "rtmpose-coco133", "heatmap-coco17"} <= set(cards)
    for name, path in cards.items():
        card = load_card(path)
        assert card.names == LAYOUTS[name.split("-")[1]] and (card.width, card.height) == (192, 256)


def test_a_card_beside_the_model_is_found(tmp_path: Path) -> None:
    model = tmp_path / "pose.onnx"
    assert find_card(model, None) is None
    (tmp_path / "pose.toml").write_text(shipped_cards()["rtmpose-halpe26"].read_text())
    assert find_card(model, None) == tmp_path / "pose.toml"
    with pytest.raises(ModelError, match="rtmpose-coco17"):
        find_card(model, "no-such-card")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({'"coco17"': '"coco18"'}, "neither a list"),
        ({'"coco17"': '["navel"]'}, "none of the landmarks"),
        ({'"coco17"': '["nose", "nose"]'}, "twice"),
        ({'decode = "simcc"': 'decode = "regression"'}, "not one of simcc, heatmaps"),
        ({"width = 192": "width = 191"}, "odd number"),
        ({"width = 192": "width = 0"}, "positive whole number"),
        ({"split_ratio = 2.0": "split = 2.0"}, "split_ratio is missing"),
        ({"white = 255.0": "whyte = 255.0"}, "unknown whyte"),
        ({"std = [58.395, 57.12, 57.375]": "std = [1, 0, 1]"}, "std must be positive"),
        ({"std = [58.395, 57.12, 57.375]": "std = 3"}, "not three numbers"),
        ({"[simcc]": "[score]\nmin_confidence = 50\n[simcc]"}, "min_confidence is 50.0, not from 0 to 1"),
        ({"[input]": "[input"}, "not a readable model card"),
        ({"width = 192": "width = 32768", "height = 256": "height = 32768"}, "at most 4096"),
        ({"width = 192": "width = 4096", "height = 256": "height = 4096"}, "more than 4194304 pixels"),
        ({"split_ratio = 2.0": "split_ratio = " + "9" * 400}, "split_ratio is 99999"),
        ({"split_ratio = 2.0": "split_ratio = inf"}, "split_ratio is inf"),
        ({"mean = [123.675,": "mean = [nan,"}, "not three numbers"),
        ({"[input]": "x = " + "[" * 5000}, "nested too deeply"),
    ],
)
def test_cards_with_faults(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    path = _card(tmp_path, **changes)
    with pytest.raises(ModelError, match=message) as caught:
        load_card(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 600


@pytest.mark.parametrize("name", ["deep_card.toml", "num_card.toml"])
def test_cards_that_went_wrong(name: str) -> None:
    path = DATA / "cases" / "card_deep" / name
    if not path.exists():
        pytest.skip(f"{path} is absent")
    with pytest.raises(ModelError) as caught:
        load_card(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_size_of_crops_and_huge_batches_are_refused(tmp_path: Path) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", 17)
    with pytest.raises(ModelError, match="size of crops"):
        open_models(DetectOptions(keypoints=KeypointOptions(onnx=OnnxOptions(size=0.75)), keypoint_model=path,
                                  model_card="rtmpose-coco17"))  # fmt: skip
    path = _bright_spot_model(tmp_path / "many.onnx", 17, batch=10**6)
    with pytest.raises(ModelError, match="takes 1000000 images"):
        open_keypoints(path, "rtmpose-coco17", OnnxOptions())


@pytest.mark.parametrize(
    ("card", "changes", "message"),
    [
        ("rtmpose-halpe26", {}, "17 landmarks, its card 26"),
        ("heatmap-coco17", {}, "no output 'output' but simcc_x, simcc_y"),
        (None, {'"input"': '"image"'}, "its inputs are input"),
        (None, {"split_ratio = 2.0": "split_ratio = 3.0"}, "384 bins for 192 px"),
    ],
)
def test_models_that_differ_from_the_card_are_refused(
    tmp_path: Path, card: str | None, changes: dict[str, str], message: str
) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", 17)
    card = card or str(_card(tmp_path, **changes))
    with pytest.raises(ModelError, match=message):
        open_keypoints(path, card, OnnxOptions()).locate(np.zeros((1, HEIGHT, HEIGHT, 3), np.uint8))


def test_card_sets_the_minimum_confidence(tmp_path: Path) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", 17)

    def used(asked: float | None, detect: DetectOptions) -> float:
        return SolveOptions(min_confidence=asked).with_card(open_models(detect).min_confidence).confident_from

    silent = DetectOptions(keypoint_model=path, model_card="rtmpose-coco17")
    card = _card(tmp_path, **{"[simcc]": "[score]\nmin_confidence = 0.3\n[simcc]"})
    telling = DetectOptions(keypoint_model=path, model_card=str(card))
    assert [used(None, how) for how in (DetectOptions(), silent, telling)] == [MIN_CONFIDENCE, 0.0, 0.3]
    assert [used(0.4, how) for how in (DetectOptions(), silent, telling)] == [0.4, 0.4, 0.4]


def test_documented_card_is_valid() -> None:
    for path in shipped_cards().values():
        assert tomllib.loads(path.read_text())["model"]["name"]


def _shipped_as_simcc(path: Path) -> Path:
    """The shipped network dressed as RTMPose: BGR 0..255 normalised input of 192 x 256, SimCC outputs of HALPE-26.

    The graph undoes the normalisation, cuts the middle 192 rows out, runs the network and takes the marginals of the
    softmax over its cells, stretched to two bins a pixel.
    """
    make, array = onnx.helper.make_node, onnx.numpy_helper.from_array
    model = onnx.load(str(shipped_model("keypoints")))
    graph = model.graph
    std, mean = (np.array(v, np.float32).reshape(1, 3, 1, 1) / 255 for v in (STD, MEAN))
    order = [BODY23.names.index(n) if n in BODY23.names else 0 for n in LAYOUTS["halpe26"]]
    constants = {
        "t_std": std, "t_mean": mean, "t_from": np.array([32]), "t_to": np.array([224]), "t_axis": np.array([2]),
        "t_order": np.array(order), "t_flat": np.array([0, 0, -1]), "t_map": np.array([0, 0, 48, 48]),
        "t_x": np.array([2]), "t_y": np.array([3]), "t_scale": np.array([1, 1, 8], np.float32),
        "t_tiny": np.array(1e-9, np.float32), "t_tenth": np.array(0.1, np.float32),
    }  # fmt: skip
    before = [
        make("Mul", ["input", "t_std"], ["t_a"]), make("Add", ["t_a", "t_mean"], ["t_b"]),
        make("Slice", ["t_b", "t_from", "t_to", "t_axis"], ["image"]),
    ]  # fmt: skip
    after = [
        make("Gather", ["heatmaps", "t_order"], ["t_h"], axis=1), make("Reshape", ["t_h", "t_flat"], ["t_f"]),
        make("Softmax", ["t_f"], ["t_p"], axis=-1), make("Reshape", ["t_p", "t_map"], ["t_m"]),
    ]  # fmt: skip
    for name, axis in (("simcc_x", "t_x"), ("simcc_y", "t_y")):
        n = name[-1]
        # A cell of 4 px is 8 bins; its centre lies at bin 8 u + 3, which this resizing gives but for half a bin.
        after += [
            make("ReduceSum", ["t_m", axis], [f"s{n}"], keepdims=0),
            make("Resize", [f"s{n}", "", "t_scale"], [f"r{n}"], mode="linear",
                 coordinate_transformation_mode="half_pixel"),
            make("Add", [f"r{n}", "t_tiny"], [f"e{n}"]), make("Log", [f"e{n}"], [f"l{n}"]),
            make("Mul", [f"l{n}", "t_tenth"], [f"{name}_short"]),
        ]  # fmt: skip
    constants |= {"t_low": np.array(-2.0, np.float32), "t_pads": np.array([0, 0, 64, 0, 0, 64])}
    after += [
        make("Identity", ["simcc_x_short"], ["simcc_x"]),
        make("Pad", ["simcc_y_short", "t_pads", "t_low"], ["simcc_y"]),
    ]
    nodes = [*before, *graph.node, *after]
    del graph.node[:], graph.input[:], graph.output[:], graph.value_info[:]
    graph.node.extend(nodes)
    graph.initializer.extend(array(v, k) for k, v in constants.items())
    graph.input.append(onnx.helper.make_tensor_value_info("input", 1, ["n", 3, HEIGHT, WIDTH]))
    graph.output.extend(
        onnx.helper.make_tensor_value_info(n, 1, ["n", 26, 2 * s]) for n, s in (("simcc_x", WIDTH), ("simcc_y", HEIGHT))
    )
    del model.metadata_props[:]
    onnx.save(model, str(path))
    return path


def test_run_with_another_model(brief_demo: Path, tmp_path: Path) -> None:
    """The demo's take with a model in RTMPose's clothes: as near to the truth as our own network nearly is."""
    model = _shipped_as_simcc(tmp_path / "pose.onnx")
    out = tmp_path / "out"
    card = _card(tmp_path, **{"coco17": "halpe26", "box_padding = 1.25": "box_padding = 1.6667"})
    code = run_command(["run", str(brief_demo), "--out", str(out), "--keypoint-model", str(model),
                        "--model-card", str(card), "--quiet"])  # fmt: skip
    assert code == 0
    used = json.loads((out / "run.json").read_text())
    assert "pose.onnx" in json.dumps(used) and "card.toml" in json.dumps(used)
    points = _points_of(out)
    expected, names = true_points(demo_folder())
    error = np.linalg.norm(points[:, [BODY23.index(n) for n in names]] - expected[: len(points)], axis=-1)
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmedian(error) < 0.04


def _points_of(out: Path) -> np.ndarray:
    import ezc3d

    data = ezc3d.c3d(str(out / "points.c3d"))
    labels = list(data["parameters"]["POINT"]["LABELS"]["value"])
    order = [labels.index(n) for n in BODY23.names]
    return data["data"]["points"][:3, order].transpose(2, 1, 0) / 1000


def test_a_card_needs_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "videos").mkdir()
    code = run_command(["run", str(tmp_path), "--model-card", "rtmpose-coco17"])
    assert code == 2
