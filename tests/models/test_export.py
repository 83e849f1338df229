"""Exported networks: the float file matches torch, the 8-bit one nearly, and their variances are calibrated."""

import json
import pathlib

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

import onnxruntime  # noqa: E402

from muybridge.errors import ModelError  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions  # noqa: E402
from muybridge.models.keypoints.decode import decode_heatmaps  # noqa: E402
from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.models.keypoints.network import PLATE, KeypointNet, PlateApart  # noqa: E402
from muybridge.models.onnx_files.export import export_onnx  # noqa: E402
from muybridge.models.onnx_files.quantization import int8_path, quantize  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.models.uncertainty import SpreadCalibration  # noqa: E402
from muybridge.train.keypoints.variance_calibration import (  # noqa: E402
    HeldOut,
    _fit_hidden,
    _fit_hidden_slope,
    _groups,
    _largest_miss,
    calibrate,
    fit_mirrored,
    fit_spread,
    landmark_ratios,
    variances,
    within,
)

OUTPUTS = ("heatmaps", "visibility")
# Hidden channels and blocks a level: exporting takes time by the layer.
SMALL = (16, 16, 24, 24), (0, 1, 1, 1)


@pytest.fixture(scope="module")
def demo_crops(repository: pathlib.Path) -> np.ndarray:
    """(N, S, S, 3) crops of the person in the demo's videos, which no calibration of activations has seen."""
    import av

    from muybridge.geometry.cameras.crops import crops_for_boxes
    from muybridge.infer.detection.crop_pixels import extract_crops

    crops, side = [], KeypointNetwork(shipped_model("keypoints")).crop_size
    for video in sorted((repository / "infer" / "demo_take" / "videos").iterdir()):
        with av.open(str(video)) as container:
            for k, frame in enumerate(container.decode(video=0)):
                if k % 30 == 0:
                    image = frame.to_ndarray(format="rgb24")
                    height, width = image.shape[:2]
                    box = np.array([[0.3 * width, 0.15 * height, 0.7 * width, 0.95 * height]])
                    crops.append(extract_crops(image, crops_for_boxes(box, side))[0])
    return np.stack(crops)


def test_shipped_int8_agrees_with_fp32(demo_crops: np.ndarray) -> None:
    cards, points = [], []
    for precision in ("fp32", "int8"):
        network = KeypointNetwork(shipped_model("keypoints", precision), OnnxOptions(flip=False))
        points.append(network.locate(demo_crops).found.points_crop_px)
        cards.append(network.card)
    away = np.linalg.norm(points[0] - points[1], axis=-1)
    assert np.median(away) <= 0.5 and np.quantile(away, 0.8) < 1.0
    # The two belong together: the same weights, told by the same metadata.
    for key in ("version", "training", "names", "variance"):
        assert cards[0].metadata[key] == cards[1].metadata[key]
    assert cards[1].metadata["precision"] == "int8"
    small, large = (shipped_model("keypoints", p).stat().st_size for p in ("int8", "fp32"))
    assert small < 0.35 * large


def test_float_export_agrees_with_torch_in_pixels(tmp_path: pathlib.Path, demo_crops: np.ndarray) -> None:
    torch.manual_seed(0)
    net = KeypointNet(23).eval()
    with torch.no_grad():
        net.head.fine.weight.mul_(20)
        for layer in (net.head.eighth, net.head.sixteenth):
            torch.nn.init.normal_(layer.weight)
    path = tmp_path / "net.onnx"
    export_onnx(PlateApart(net), path, (2, 3, 64, 64), OUTPUTS, {"muybridge_kind": "keypoints"}, PLATE)
    image = demo_crops[:6].transpose(0, 3, 1, 2).astype(np.float32) / 255
    difference = np.random.default_rng(0).random((6, 1, *image.shape[2:]), np.float32)
    session = quiet_session(path)
    there = session.run(["heatmaps"], {"image": image, PLATE: difference})[0]
    with torch.inference_mode():
        here = net(torch.from_numpy(np.concatenate([image, difference], 1)))[0].numpy()
    points = [decode_heatmaps(h, 4, SpreadCalibration()).points_crop_px for h in (here, there)]
    assert np.median(np.linalg.norm(points[0] - points[1], axis=-1)) <= 0.05


@pytest.fixture(scope="module")
def small_net() -> KeypointNet:
    torch.manual_seed(1)
    return KeypointNet(5, *SMALL).eval()


@pytest.fixture(scope="module")
def small_file(small_net: KeypointNet, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """What `small_net` is exported to."""
    path = tmp_path_factory.mktemp("small") / "net.onnx"
    metadata = {"muybridge_kind": "keypoints", "names": ["a"]}
    before = [(name, value.clone()) for name, value in small_net.state_dict().items()]
    export_onnx(PlateApart(small_net), path, (2, 3, 64, 64), OUTPUTS, metadata, PLATE)
    after = small_net.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before) and not small_net.training
    return path


def test_export_does_not_change_the_network_or_preprocess_pixels(
    small_net: KeypointNet, small_file: pathlib.Path
) -> None:
    net, image = small_net, torch.rand(2, 4, 64, 64)
    with torch.inference_mode():
        before = net(image)
        apart = PlateApart(net)(image[:, :3], image[:, 3:])
        bare, none = PlateApart(net)(image[:, :3], torch.zeros(1, 1, 1, 1)), image.clone()
        none[:, 3] = 0
        for here, there in zip((*before, *net(none)), (*apart, *bare), strict=True):
            torch.testing.assert_close(here, there, rtol=1e-4, atol=1e-4)
        assert torch.equal(net(image)[0], before[0])
    operators = [node.op_type for node in __import__("onnx").load(str(small_file)).graph.node]
    assert set(operators[: operators.index("Conv")]) == {"Shape", "Concat", "Expand"}


def test_quantised_network_keeps_its_interface_and_batch(small_file: pathlib.Path) -> None:
    path = small_file
    images = np.random.default_rng(0).integers(0, 256, (12, 4, 64, 64), np.uint8)
    target = int8_path(path)
    assert target.name == "net-int8.onnx"
    quantize(path, target, images)
    session = quiet_session(target)
    assert json.loads(session.get_modelmeta().custom_metadata_map["names"]) == ["a"]
    onnx = __import__("onnx")
    graph = onnx.load(str(target)).graph
    types = {w.name: w.data_type for w in graph.initializer}
    # The three that heatmaps are summed of stay as they are.
    filters = [types.get(node.input[1], onnx.TensorProto.INT8) for node in graph.node if node.op_type == "Conv"]
    assert onnx.TensorProto.INT8 in types.values()
    assert filters.count(onnx.TensorProto.FLOAT) == 3 < len(filters)
    for batch, size in ((1, 64), (3, 96)):
        image, nothing = np.zeros((batch, 3, size, size), np.float32), np.zeros((batch, 1, size, size), np.float32)
        heatmaps, visibility = session.run(None, {"image": image})
        assert heatmaps.shape == (batch, 5, size // 4, size // 4) and visibility.shape == (batch, 5)
        np.testing.assert_array_equal(session.run(None, {"image": image, PLATE: nothing})[0], heatmaps)
        assert (session.run(None, {"image": image, PLATE: nothing + 1})[0] != heatmaps).any()


def quiet_session(path: pathlib.Path) -> onnxruntime.InferenceSession:
    """Without the warning that an input may be left out."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def test_quantisation_reports_unusable_files(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "text.onnx"
    path.write_bytes(b"no network")
    with pytest.raises(ModelError, match=str(path)):
        quantize(path, tmp_path / "out.onnx", np.zeros((1, 3, 64, 64), np.uint8))
    assert not (tmp_path / "out.onnx").exists()
    with pytest.raises(ValueError, match="images"):
        quantize(shipped_model("keypoints"), tmp_path / "out.onnx", np.zeros((0, 3, 64, 64), np.uint8))


def test_variance_holds_at_one_and_two_sigma_where_errors_have_two_modes() -> None:
    """A tenth to a third of the errors of unsure landmarks lie on another hypothesis; the spread tells of it."""
    rng = np.random.default_rng(0)
    count = 40_000
    far = rng.uniform(0, 0.3, count) ** 2
    local = rng.uniform(0.5, 4, count)
    spread = local + far * 900 / 2 * rng.uniform(0.5, 2, count)
    error = rng.normal(size=(count, 2)) * np.sqrt(local)[:, None]
    gone = rng.random(count) < far
    error[gone] += rng.normal(size=(gone.sum(), 2)) * 20
    half = count // 2
    fitted = fit_spread(error[:half], spread[:half])
    one, two = within(error[half:], fitted.variance(spread[half:]))
    assert one == pytest.approx(0.683, abs=0.05) and two == pytest.approx(0.954, abs=0.05)
    at = np.geomspace(0.1, 1e4, 200)
    variance = fitted.variance(at)
    assert (np.diff(variance) >= 0).all() and variance[-1] / variance[-2] == pytest.approx(at[-1] / at[-2])


def test_hidden_landmarks_have_larger_and_mirrored_ones_smaller_variance() -> None:
    """Errors that grow with the chance of being hidden, the spread being the same; both shares hold for either."""
    rng = np.random.default_rng(1)
    count = 20_000
    spread = rng.uniform(2.0, 50.0, count)
    seen = rng.beta(2.0, 1.0, count)
    visible = rng.random(count) < seen
    variance = (0.5 * spread + 1.0) * 2.5 ** (1 - seen)
    error = rng.normal(size=(count, 2)) * np.sqrt(variance)[:, None]
    fitted = fit_spread(error, spread, visible, seen)
    assert fitted.hidden == pytest.approx(2.5, rel=0.1)
    plain = fit_spread(error, spread, visible)
    assert plain.hidden == 1.0
    mirrored = HeldOut(0.8 * error, spread, seen, np.ones(count, dtype=bool), visible)
    fitted = fit_mirrored(fitted, mirrored)
    assert fitted.mirrored == pytest.approx(0.64, rel=0.05)
    hard = seen < 0.4
    for found, both in ((HeldOut(error, *mirrored[1:]), False), (mirrored, True)):
        one, two = within(found.error_px[hard], variances(fitted, found, both)[hard])
        assert one == pytest.approx(0.683, abs=0.02) and two == pytest.approx(0.954, abs=0.02)
    assert within(error[hard], plain.variance(spread)[hard])[0] < 0.65


def test_ratio_of_hidden_landmarks_fits_the_shares() -> None:
    rng = np.random.default_rng(5)
    count = 40_000
    spread, visible = np.exp(rng.uniform(0, 3, count)), rng.random(count) < 0.6
    seen = np.where(visible, 0.95, 0.05)
    # Some of the hidden ones are far off, which the slope of the logarithms hardly knows.
    wide = np.where(~visible & (rng.random(count) < 0.25), 16.0, 1.0)
    error = rng.normal(size=(count, 2)) * np.sqrt(spread * wide)[:, None]
    parts = np.array_split(np.argsort(spread), 16)
    slope = _fit_hidden_slope(error, seen, parts)
    fitted = fit_spread(error, spread, visible, seen)
    assert fitted.hidden > 1.2 * slope
    groups = _groups(visible)
    off = _largest_miss(error, fitted.variance(spread) * fitted.ratio(seen, False), groups)
    assert off < _fit_hidden(error, spread, seen, slope, parts, groups)[0] - 0.001


def test_each_landmark_has_its_share_within_its_sigma() -> None:
    """Errors of the second pair are twice those of the first, those of the landmark between half, spreads alike."""
    rng = np.random.default_rng(2)
    mirror, factor = (1, 0, 2, 4, 3), np.array([1.0, 1.0, 0.25, 4.0, 4.0])
    spread = rng.uniform(2.0, 50.0, (8_000, 5))
    error = rng.normal(size=(8_000, 5, 2)) * np.sqrt(0.5 * spread * factor)[..., None]
    visible = rng.random(spread.shape) < 0.7
    # Of unknown truth, as much of a trap as it gets.
    inside = np.arange(8_000)[:, None] % 10 > 0
    error[~inside[:, 0]] = np.nan
    inside = np.broadcast_to(inside, spread.shape)
    found = HeldOut(error, spread, np.ones(spread.shape), inside, visible & inside)
    ratios = landmark_ratios(found, mirror)
    np.testing.assert_allclose(ratios, factor / np.exp(np.log(factor).mean()), rtol=0.1)
    assert ratios[0] == ratios[1] and ratios[3] == ratios[4] and np.prod(ratios) == pytest.approx(1.0)
    metadata, shares = calibrate(found, found, slice(None), mirror)
    assert shares["one"] == pytest.approx(0.683, abs=0.02) and shares["two"] == pytest.approx(0.954, abs=0.02)
    spread_of = SpreadCalibration(knots=tuple(metadata["knots"]), landmarks=tuple(metadata["landmarks"]))
    for variance, off in ((spread_of.variance(spread), 0.02), (spread_of.variance(spread) / ratios, 0.3)):
        each = [within(error[inside[:, j], j], variance[inside[:, j], j])[0] for j in range(5)]
        assert (np.abs(np.array(each) - 0.683).max() < 0.02) == (off == 0.02)


def test_rare_landmarks_have_no_ratio() -> None:
    rng = np.random.default_rng(3)
    spread = np.full((400, 3), 4.0)
    error = rng.normal(size=(400, 3, 2)) * np.array([2.0, 2.0, 20.0])[:, None]
    inside = np.ones(spread.shape, dtype=bool)
    inside[:, 2] = np.arange(400) < 20
    ratios = landmark_ratios(HeldOut(error, spread, np.ones(spread.shape), inside, inside), (0, 1, 2))
    np.testing.assert_allclose(ratios, 1.0, atol=0.2)


def test_shipped_network_scales_variances_of_hidden_and_mirrored_landmarks() -> None:
    session = onnxruntime.InferenceSession(shipped_model("keypoints"), providers=["CPUExecutionProvider"])
    card = keypoint_card(session.get_modelmeta().custom_metadata_map, shipped_model("keypoints"))
    assert card.spread.hidden > 1.2 and 0.6 < card.spread.mirrored < 1.0 and 0.5 < card.spread.part < 1.0
    maps = np.zeros((1, 23, 56, 56), dtype=np.float32)
    maps[:, :, 20, 30] = 12.0
    found = card.decode(maps)
    seen = np.full((1, 23), 20.0, dtype=np.float32)
    np.testing.assert_allclose(
        card.scale_variance(found, seen, False).variance_crop_px2, found.variance_crop_px2, rtol=1e-6
    )
    np.testing.assert_allclose(
        card.scale_variance(found, -seen, True).variance_crop_px2,
        found.variance_crop_px2 * card.spread.hidden * card.spread.mirrored, rtol=1e-6,
    )  # fmt: skip
    shares = json.loads(card.metadata["sigma_coverage"])
    assert len(shares) == 18
    for name, share in shares.items():
        # Of parts of people it is not as good: more of their errors are far off.
        off = 0.07 if name.endswith("part") else 0.05
        assert share == pytest.approx(0.683 if name.startswith("one") else 0.954, abs=off), name


def test_knots_and_older_files_are_read() -> None:
    base = {
        "muybridge_kind": "keypoints", "version": "1", "landmark_set": "body23", "names": json.dumps(BODY23.names),
        "input_size": "192", "stride": "4", "box_padding": "1.25",
    }  # fmt: skip
    old = {"scale": 2.0, "floor_px2": 0.5}
    where = pathlib.Path("x.onnx")
    card = keypoint_card(base | {"variance": json.dumps(old)}, where)
    np.testing.assert_allclose(card.spread.variance(np.array([1.0, 4.0])), [2.5, 8.5])
    new = old | {"knots": [[1.0, 2.0], [100.0, 200.0]]}
    card = keypoint_card(base | {"variance": json.dumps(new)}, where)
    np.testing.assert_allclose(card.spread.variance(np.array([0.1, 10.0, 1000.0, np.nan])), [2, 20, 2000, np.nan])
    for knots in ([[2, 1], [1, 2]], [[1, 2], [2, 1]], [[1]], "x", [[0, 1]]):
        with pytest.raises(ModelError, match="knots"):
            keypoint_card(base | {"variance": json.dumps(old | {"knots": knots})}, where)
    assert (card.spread.hidden, card.spread.mirrored) == (1.0, 1.0)
    card = keypoint_card(base | {"variance": json.dumps(new | {"hidden": 2.0, "mirrored": 0.9})}, where)
    np.testing.assert_allclose(card.spread.ratio(np.array([1.0, 0.5, 0.0]), True), [0.9, 0.9 * 2**0.5, 1.8])
    with pytest.raises(ModelError, match="hidden"):
        keypoint_card(base | {"variance": json.dumps(new | {"hidden": 0.0})}, where)


def test_crops_of_parts_of_people_have_their_own_variance_ratio() -> None:
    base = {
        "muybridge_kind": "keypoints", "version": "1", "landmark_set": "body23", "names": json.dumps(BODY23.names),
        "input_size": "192", "stride": "4", "box_padding": "1.25",
    }  # fmt: skip
    plain, parts = (
        keypoint_card(base | {"variance": json.dumps({"scale": 2.0, "floor_px2": 0.5} | own)}, pathlib.Path("x.onnx"))
        for own in ({}, {"part": 0.5})
    )
    maps = np.zeros((3, 23, 24, 24), dtype=np.float32)  # of which nothing is known: nowhere more than anywhere
    for crop, there in enumerate((23, 12, 4)):  # all of a person, a part of one, too little to say so
        maps[crop, :there, 12, 12] = 12.0
    seen = np.zeros((3, 23), dtype=np.float32)
    found = plain.decode(maps)
    ratio = (
        parts.scale_variance(found, seen, False).variance_crop_px2
        / plain.scale_variance(found, seen, False).variance_crop_px2
    )
    np.testing.assert_allclose(ratio, np.broadcast_to([[1.0], [0.5], [1.0]], ratio.shape))
    # Where something was expected every landmark is somewhere: what counts is what was found without.
    expected = found._replace(score=np.ones_like(found.score))
    np.testing.assert_array_equal(
        parts.scale_variance(expected, seen, False, found.score).variance_crop_px2,
        parts.scale_variance(found, seen, False).variance_crop_px2,
    )
    assert (parts.scale_variance(expected, seen, False).variance_crop_px2 == found.variance_crop_px2).all()
    with pytest.raises(ModelError, match="part"):
        keypoint_card(base | {"variance": json.dumps({"scale": 2.0, "floor_px2": 0.5, "part": -1})}, pathlib.Path("x"))


def test_variance_ratios_of_single_landmarks() -> None:
    base = {
        "muybridge_kind": "keypoints", "version": "1", "landmark_set": "body23", "names": json.dumps(BODY23.names),
        "input_size": "192", "stride": "4", "box_padding": "1.25",
    }  # fmt: skip
    alike = {"scale": 2.0, "floor_px2": 0.5, "hidden": 1.5, "mirrored": 0.8}
    where = pathlib.Path("x.onnx")
    ratios = [0.5 + 0.1 * j for j in range(23)]
    maps = np.random.default_rng(0).normal(0, 3, (2, 23, 12, 12)).astype(np.float32)
    seen = np.random.default_rng(1).normal(0, 2, (2, 23)).astype(np.float32)
    cards = [keypoint_card(base | {"variance": json.dumps(v)}, where) for v in (alike, alike | {"landmarks": ratios})]
    plain, own = (card.scale_variance(card.decode(maps), seen, True) for card in cards)
    np.testing.assert_allclose(own.variance_crop_px2, plain.variance_crop_px2 * ratios)
    np.testing.assert_array_equal(own.points_crop_px, plain.points_crop_px)
    knots = {"knots": [[1.0, 2.0], [100.0, 200.0]], "landmarks": ratios}
    card = keypoint_card(base | {"variance": json.dumps(alike | knots)}, where)
    np.testing.assert_allclose(card.spread.variance(np.full((1, 23), 10.0))[0], 20.0 * np.array(ratios))
    for wrong in (ratios[1:], 1.0, [-1.0, *ratios[1:]], [None, *ratios[1:]]):
        with pytest.raises(ModelError, match="landmarks"):
            keypoint_card(base | {"variance": json.dumps(alike | {"landmarks": wrong})}, where)
