"""Files without unused outputs give the same results for the others."""

import numpy as np
import onnxruntime
import pytest

from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.onnx_files.prune_outputs import without_outputs
from muybridge.models.shipped import shipped_model

onnx = pytest.importorskip("onnx")

MARKERS = ("marker_heatmaps", "marker_visibility")


@pytest.mark.parametrize("precision", ["fp32", "int8"])
def test_body_outputs_are_unchanged_without_markers(precision):
    file = shipped_model("keypoints", precision).read_bytes()
    whole, trimmed = (onnx.load_from_string(data) for data in (file, without_outputs(file, MARKERS)))
    onnx.checker.check_model(trimmed)
    assert [output.name for output in trimmed.graph.output] == ["heatmaps", "visibility"]
    gone = [node for node in whole.graph.node if node not in trimmed.graph.node]
    assert {name for node in gone for name in node.output} == set(MARKERS)
    # Nothing else was touched.
    trimmed.graph.output.extend(output for output in whole.graph.output if output.name in MARKERS)
    for node in gone:
        trimmed.graph.node.insert(list(whole.graph.node).index(node), node)
    assert trimmed == whole
    crops = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 4), np.uint8)
    options = OnnxOptions(flip=False)
    bare, marked = (KeypointNetwork(shipped_model("keypoints", precision), options, m)(crops) for m in (False, True))
    assert len(bare) == 2 and len(marked) == 4
    for here, there in zip(bare, marked, strict=False):
        np.testing.assert_array_equal(here, there)


def small_model() -> bytes:
    """x to a = -x, b = -a, c = |x|; its version is negative, which takes ten bytes."""
    helper = onnx.helper
    nodes = [helper.make_node("Neg", ["x"], ["a"]), helper.make_node("Neg", ["a"], ["b"]),
             helper.make_node("Abs", ["x"], ["c"])]  # fmt: skip
    values = {name: helper.make_tensor_value_info(name, 1, ["n"]) for name in "xabc"}
    graph = helper.make_graph(nodes, "small", [values["x"]], [values[n] for n in "abc"])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8,
                             model_version=-7).SerializeToString()  # fmt: skip


def test_nodes_needed_by_other_outputs_stay():
    model = onnx.load_from_string(without_outputs(small_model(), ["a", "c", "of no such name"]))
    assert model.model_version == -7
    assert [node.output[0] for node in model.graph.node] == ["a", "b"]
    assert [output.name for output in model.graph.output] == ["a", "b"]
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    np.testing.assert_array_equal(session.run(["b"], {"x": np.array([2], np.float32)})[0], [2])


def test_other_files_are_refused():
    file = small_model()
    for cut in (b"no network at all", file[:-3], file + b"\xff", file + b"\x07"):
        with pytest.raises(ValueError, match="field|number"):
            without_outputs(cut, ["c"])
