"""Motion graphs as files: one `.graph`, which is an `.npz` of plain arrays.

Motions are kept in single precision: a micrometre at ten metres from the origin.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.described_npz import DescribedFile
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.graphs.graph import MotionGraph
from muybridge.motion.graphs.transitions import Transitions

# The mark says that muybridge wrote the file, in its first bytes.
_FILE = DescribedFile("muybridge_graph", "a motion graph", "build_graph", most_bytes=2**33)


def save_graph(path: Path, graph: MotionGraph) -> None:
    """Write a graph.

    Raises:
        OutputError: the file cannot be written.
    """
    skeleton, motion, ways = graph.motion.skeleton, graph.motion, graph.transitions
    about = {
        "fps": motion.fps, "window": graph.window, "threshold": graph.threshold,
        "names": graph.names, "labels": graph.labels, "joints": skeleton.names, "parents": skeleton.parents,
        "sliding": skeleton.sliding, "twist_axis": skeleton.twist_axis,
    }  # fmt: skip
    arrays: dict[str, NDArray[Any]] = {
        "starts": graph.starts,
        "offsets": skeleton.offsets,
        "tips": skeleton.tips,
        "lower": skeleton.lower,
        "upper": skeleton.upper,
        "root_positions_world": motion.root_positions_world.astype(np.float32),
        "quat_wxyz": motion.quat_wxyz.astype(np.float32),
        "leave": ways.leave.astype(np.int32),
        "enter": ways.enter.astype(np.int32),
        "yaw": ways.yaw,
        "shift": ways.shift,
        "distance": ways.distance.astype(np.float32),
        "component": graph.component,
    }
    if skeleton.axes is not None:
        arrays["axes"] = skeleton.axes
    if motion.translations is not None:
        arrays["translations"] = motion.translations.astype(np.float32)
    _FILE.write(path, about, arrays)


def load_graph(path: Path) -> MotionGraph:
    """Read a graph.

    Raises:
        FormatError: it is none, of another version, or damaged.
    """
    return _FILE.read(path, _graph)


def _graph(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> MotionGraph:
    def real(name: str) -> NDArray[np.float64]:
        values = arrays[name].astype(np.float64)
        if not np.isfinite(values).all() and name not in ("tips", "lower", "upper"):
            raise ValueError(f"{name} holds numbers that are not finite")
        return values

    skeleton = Skeleton(
        names=tuple(str(n) for n in about["joints"]), parents=tuple(int(p) for p in about["parents"]),
        offsets=real("offsets"), tips=real("tips"), lower=real("lower"), upper=real("upper"),
        twist_axis=tuple(int(a) for a in about["twist_axis"]), sliding=tuple(int(s) for s in about["sliding"]),
        axes=real("axes") if "axes" in arrays else None,
    )  # fmt: skip
    motion = Motion(
        skeleton, float(about["fps"]), real("root_positions_world"), real("quat_wxyz"),
        real("translations") if "translations" in arrays else None,
    )  # fmt: skip
    length = np.linalg.norm(motion.quat_wxyz, axis=-1, keepdims=True)
    if len(length) and np.abs(length - 1).max() > 1e-3:
        raise ValueError("quat_wxyz holds no rotations")
    motion = replace(motion, quat_wxyz=continuous_quat(motion.quat_wxyz / length))
    ways = Transitions(arrays["leave"].astype(np.int64), arrays["enter"].astype(np.int64), real("yaw"), real("shift"),
                       real("distance"))  # fmt: skip
    graph = MotionGraph(
        motion, arrays["starts"].astype(np.int64), tuple(str(n) for n in about["names"]),
        tuple(str(n) for n in about["labels"]), int(about["window"]), float(about["threshold"]), ways,
        arrays["component"].astype(np.bool_),
    )  # fmt: skip
    _check(graph)
    return graph


def _check(graph: MotionGraph) -> None:
    """ValueError where the parts of a graph do not belong to each other."""
    frames, starts, ways, window = len(graph), graph.starts, graph.transitions, graph.window
    if not 0 < graph.fps < np.inf or window < 2 or not 0 < graph.threshold < np.inf:
        raise ValueError("frame rate, window or threshold is out of range")
    clips = len(graph.names)
    if starts.shape != (clips + 1,) or len(graph.labels) != clips or not clips:
        raise ValueError("names, labels and starts of the clips differ in number")
    if starts[0] != 0 or starts[-1] != frames or (np.diff(starts) <= window).any():
        raise ValueError("the clips do not cover the frames")
    count = len(ways)
    if graph.component.shape != (frames,) or not graph.component.any():
        raise ValueError("component is not of the frames")
    if any(a.shape != s for a, s in ((ways.enter, (count,)), (ways.yaw, (count,)), (ways.shift, (count, 2)),
                                     (ways.distance, (count,)))):  # fmt: skip
        raise ValueError("the arrays of the transitions differ in length")
    if count and (min(ways.leave.min(), ways.enter.min()) < 0 or max(ways.leave.max(), ways.enter.max()) >= frames):
        raise ValueError("a transition joins frames that are not there")
    if (np.diff(ways.leave) < 0).any():
        raise ValueError("the transitions are not in order")
    clip = graph.clip_of
    behind = ways.enter + window
    last = np.maximum(ways.leave + window - 1, 0)
    if (behind >= frames).any() or (last >= frames).any():
        raise ValueError("a window reaches beyond the frames")
    if (clip[behind] != clip[ways.enter]).any() or (clip[last] != clip[ways.leave]).any():
        raise ValueError("a window reaches beyond its clip")
    if not (graph.component[ways.leave] & graph.component[behind]).all():
        raise ValueError("a transition leads out of the component")
