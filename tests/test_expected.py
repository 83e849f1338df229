"""The stick figure where landmarks are expected, and a network that looks at it."""

import json
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import ModelError
from muybridge.geometry.landmarks import BODY23
from muybridge.infer.onnx import Expectation, KeypointNetwork, OnnxOptions
from muybridge.models.expected import MIRRORED, SIDES, draw_expected

onnx = pytest.importorskip("onnx", reason="onnx is in the train extra")
SIZE = 96


def _person(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.2, 0.8, (1, 23, 2)) * SIZE


def test_sides_have_channels_of_their_own() -> None:
    points = np.full((1, 23, 2), np.nan)
    for name, at in (("left_elbow", (20, 30)), ("left_wrist", (20, 60)), ("right_knee", (70, 20)), ("nose", (50, 80))):
        points[0, BODY23.index(name)] = at
    drawn = draw_expected(points, SIZE)[0]
    assert drawn.shape == (SIZE, SIZE, 3) and drawn.dtype == np.uint8
    # The bone is drawn between its ends; shades tell arms from legs.
    assert drawn[45, 20].tolist() == [255, 0, 0]
    assert drawn[20, 70, SIDES.index("right")] == 160 and drawn[80, 50, SIDES.index("middle")] == 255
    assert (draw_expected(points * np.nan, SIZE) == 0).all()


def test_a_mirrored_expectation_is_the_mirror_picture() -> None:
    points = _person()
    twin = points[:, list(BODY23.mirror)] * [-1, 1] + [SIZE - 1, 0]
    crops = np.concatenate([np.zeros((1, SIZE, SIZE, 4), np.uint8), draw_expected(points, SIZE)], -1)
    mirrored = crops[:, :, ::-1][..., MIRRORED][..., 4:].astype(int)
    assert (np.abs(mirrored - draw_expected(twin, SIZE)) > 64).mean() < 0.01  # but for how lines are rounded


def test_expectations_far_outside_are_cut_off() -> None:
    points = _person()
    points[0, BODY23.index("left_ankle")] = [1e12, -1e12]
    points[0, BODY23.index("right_ankle")] = [np.inf, 0]
    assert draw_expected(points, SIZE).any()


def test_faults_of_expectations_are_seeded_and_of_the_right_size() -> None:
    pytest.importorskip("torch", reason="torch is in the train extra")
    from muybridge.train.expectations import Expectations

    truth = np.random.default_rng(0).uniform(40, 150, (400, 23, 2)).astype(np.float32)
    before = truth.copy()
    first, second = (Expectations(np.random.default_rng(3))(truth, 192) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(truth, before)
    away = np.linalg.norm(first - truth, axis=-1)
    known = np.isfinite(away)
    # Two cameras' pixels off, mostly; a few quite elsewhere; some not at all.
    assert 3 < np.median(away[known]) < 8 and 0.75 < known.mean() < 0.95
    twin = np.linalg.norm(first - truth[:, list(BODY23.mirror)], axis=-1)
    paired = np.array(BODY23.mirror) != np.arange(23)
    exchanged = ((twin < 12) & (away > 30))[:, paired].sum() / known[:, paired].sum()
    assert 0.04 < exchanged < 0.2


def _heeding(path: Path, optional: bool = True) -> Path:
    """A network whose map of the left wrist is what is expected on the left and of the right wrist on the right; of
    the nose the red of the picture."""
    helper, floats = onnx.helper, onnx.TensorProto.FLOAT
    pick = np.zeros((3, 6, 4, 4), np.float32)
    pick[0, 0], pick[1, 3], pick[2, 4] = 1.0, 1.0, 1.0
    nodes = [
        helper.make_node("Sub", ["image", "image"], ["nothing"]),
        helper.make_node("Add", ["nothing", "expected"], ["spread"]),
        helper.make_node("Concat", ["image", "spread"], ["all"], axis=1),
        helper.make_node("Conv", ["all", "pick"], ["heatmaps"], strides=[4, 4]),
        helper.make_node("GlobalMaxPool", ["heatmaps"], ["pooled"]),
        helper.make_node("Flatten", ["pooled"], ["visibility"]),
    ]
    given = {"image": ["n", 3, "h", "w"], "expected": ["m", 3, "a", "b"]}
    weights = {"pick": pick} | ({"expected": np.zeros((1, 3, 1, 1), np.float32)} if optional else {})
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info(name, floats, shape) for name, shape in given.items()],
        [helper.make_tensor_value_info("heatmaps", floats, ["n", 3, "y", "x"]),
         helper.make_tensor_value_info("visibility", floats, ["n", 3])],
        [onnx.numpy_helper.from_array(value, name) for name, value in weights.items()],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {
        "muybridge_kind": "keypoints", "version": "0.0.1", "landmark_set": "wrists",
        "names": json.dumps(["nose", "left_wrist", "right_wrist"]), "input_size": str(SIZE), "stride": "4",
        "variance": json.dumps({"scale": 1.0, "floor_px2": 0.1}), "box_padding": "1.25", "expected_input": "expected",
    })  # fmt: skip
    onnx.save(model, path)
    return path


@pytest.mark.parametrize("flip", [False, True])
def test_a_network_is_shown_what_is_expected(tmp_path: Path, flip: bool) -> None:
    network = KeypointNetwork(_heeding(tmp_path / "net.onnx"), OnnxOptions(flip=flip))
    crops = np.zeros((2, SIZE, SIZE, 3), np.uint8)
    crops[:, 20:28, 40:48, 0] = 255
    points = np.full((2, 3, 2), np.nan)
    points[0, 1:] = [[60, 30], [30, 70]]
    located = network.locate(crops, Expectation(points, 0.08, 0.0))
    found, alone = located.found.points_crop_px, located.alone
    np.testing.assert_allclose(found[:, 0], [[43.5, 23.5]] * 2, atol=1)
    np.testing.assert_allclose(found[0, 1:], points[0, 1:], atol=2.5)
    assert alone is not None
    # With nothing expected of it the map of a wrist says nothing, in the same crop as in the other.
    assert np.isnan(found[1, 1:]).all() and np.isnan(alone.points_crop_px[:, 1:]).all()
    np.testing.assert_array_equal(alone.points_crop_px, network.locate(crops).found.points_crop_px)


def test_an_expectation_that_cannot_be_left_out_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="'expected' cannot be left out"):
        KeypointNetwork(_heeding(tmp_path / "net.onnx", optional=False))
