"""Crops per second of the keypoint networks, and their ratio to the matrix product's peak measured in the same minute.

Usage: python -m scripts.benchmarks.networks.networks [--sizes 192 224 256] [--sessions 1x1 1x2 2x1] [--rounds 15]
           [--markers]

Prints a Markdown table. The networks detect the body's landmarks, as in `muybridge run`, or the virtual markers too.
2x1 are two sessions of one thread each, as `muybridge run` uses them on two processors. Networks, sizes and the matrix
product alternate, and the best round of each counts, so that other load affects all of them similarly.
"""

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

BATCH = 4
PRECISIONS: tuple[Literal["fp32", "int8"], ...] = ("fp32", "int8")
PRODUCT = 1024  # side of the matrices


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[192, 224, 256])
    parser.add_argument("--sessions", nargs="+", default=["1x1", "1x2", "2x1"], help="sessions x threads of each")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--markers", action="store_true")
    options = parser.parse_args()
    print("| sessions x threads | px | GMAC a crop | fp32 crops/s | int8 crops/s | int8 / fp32 | fp32 / matmul peak |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for layout in options.sessions:
        sessions, threads = map(int, layout.split("x"))
        with ThreadPoolExecutor(sessions) as pool:
            jobs = {name: _side_by_side(job, sessions, pool) for name, job in _jobs(options, threads).items()}
            rates = {name: rate * sessions for name, rate in _best_rates(jobs, options.rounds).items()}
        peak = rates["matmul"] * PRODUCT**3
        for size in options.sizes:
            work = _multiplications(size, options.markers)
            fp32, int8 = (rates[f"{precision} {size}"] * BATCH for precision in PRECISIONS)
            print(f"| {sessions} x {threads} | {size} | {work / 1e9:.2f} | {fp32:.0f} | {int8:.0f} | {int8 / fp32:.1f} "
                  f"| {fp32 * work / peak:.2f} (of {2 * peak / 1e9:.0f} GFLOP/s) |")  # fmt: skip


def _side_by_side(job: Callable[[], object], count: int, pool: ThreadPoolExecutor) -> Callable[[], object]:
    """The job `count` times at once: a session of one thread works in whichever threads call it."""
    return lambda: [done.result() for done in [pool.submit(job) for _ in range(count)]]


def _jobs(options: argparse.Namespace, threads: int) -> dict[str, Callable[[], object]]:
    """The measured jobs, by name."""
    import numpy as np
    import onnxruntime

    jobs: dict[str, Callable[[], object]] = {}
    for precision in PRECISIONS:
        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = threads
        settings.log_severity_level = 3
        network = _network(precision, options.markers)
        session = onnxruntime.InferenceSession(network, settings, providers=["CPUExecutionProvider"])
        for size in options.sizes:
            image = np.random.default_rng(0).random((BATCH, 3, size, size), np.float32)
            jobs[f"{precision} {size}"] = lambda s=session, i=image: s.run(None, {"image": i})
    jobs["matmul"] = matrix_product(threads)
    return jobs


def matrix_product(threads: int) -> Callable[[], object]:
    """A large float32 matrix product in onnxruntime, with as many threads."""
    import numpy as np
    import onnx
    import onnxruntime

    helper, shape = onnx.helper, [PRODUCT, PRODUCT]
    values = [helper.make_tensor_value_info(name, 1, shape) for name in "abc"]
    graph = helper.make_graph([helper.make_node("MatMul", ["a", "b"], ["c"])], "product", values[:2], values[2:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(model.SerializeToString(), settings, providers=["CPUExecutionProvider"])
    matrix = np.random.default_rng(0).random(shape, np.float32)
    return lambda: session.run(None, {"a": matrix, "b": matrix})


def _network(precision: Literal["fp32", "int8"], markers: bool) -> bytes:
    """The shipped file, with or without the virtual markers."""
    from muybridge.models.keypoints.metadata import MARKER_OUTPUTS
    from muybridge.models.onnx_files.prune_outputs import without_outputs
    from muybridge.models.shipped import shipped_model

    file = shipped_model("keypoints", precision).read_bytes()
    return file if markers else without_outputs(file, MARKER_OUTPUTS)


def _multiplications(size: int, markers: bool) -> float:
    """Multiply-accumulates of the network's convolutions for one crop."""
    import onnx
    from onnx import shape_inference

    model = onnx.load_from_string(_network("fp32", markers))
    dims = model.graph.input[0].type.tensor_type.shape.dim
    for dim, value in zip(dims, (1, 3, size, size), strict=True):
        dim.Clear()
        dim.dim_value = value
    del model.graph.value_info[:]
    for output in model.graph.output:
        output.type.tensor_type.ClearField("shape")
    graph = shape_inference.infer_shapes(model, data_prop=True).graph
    shapes = {v.name: [d.dim_value for d in v.type.tensor_type.shape.dim] for v in [*graph.value_info, *graph.output]}
    weights = {w.name: w.dims for w in graph.initializer}
    total = 0.0
    for node in graph.node:
        if node.op_type == "Conv":
            _, outputs, rows, columns = shapes[node.output[0]]
            _, inputs, *kernel = weights[node.input[1]]
            total += outputs * rows * columns * inputs * kernel[0] * kernel[1]
    return total


def _best_rates(jobs: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Calls per second of each job's best round."""
    best = dict.fromkeys(jobs, float("inf"))
    for turn in range(rounds + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if turn:  # the first round warms up
                best[name] = min(best[name], time.perf_counter() - start)
    return {name: 1 / seconds for name, seconds in best.items()}


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
