"""Motion graphs of generated takes: time and memory to build, how hard transitions accelerate, long walks, paths.

Usage: python -m scripts.benchmarks.motion.graphs [--frames 10000] [--seed 0] [--minutes 10] [--build-only]

Takes are those of `scripts.benchmarks.motion.walking_takes`, at 60 frames a second, and are made before the clock
starts. Kernels are compiled before it starts, too. Needs the `train` extra.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import body_joint
from muybridge.motion.graphs import (
    FloorPath,
    MotionGraph,
    build_graph,
    deviation,
    floor_path,
    follow_path,
    random_walk,
    walk_motion,
)
from scripts.benchmarks.motion.walking_takes import walking_takes

PATHS: dict[str, list[tuple[float, float]]] = {
    "straight, 12 m": [(0, 0), (0, -12)],
    "corner of 90 degrees, 12 m": [(0, 0), (0, -6), (6, -6)],
    "zigzag of 45 degrees, 17 m": [(0, 0), (0, -4), (3, -7), (3, -11), (0, -14)],
}


def circle(radius: float) -> list[tuple[float, float]]:
    """Corners of a full circle that begins along -Y."""
    turns = np.linspace(0, 2 * np.pi, 60)
    return [(float(radius * (np.cos(t) - 1)), float(-radius * np.sin(t))) for t in turns]


def accelerations(motion: Motion) -> FloatArray:
    """(T - 2,) m/s^2, the largest of any joint in each frame."""
    bend = np.diff(motion.joint_positions_world(), n=2, axis=0) * motion.fps**2
    return np.asarray(np.linalg.norm(bend, axis=-1).max(axis=1))


def peaks_of_transitions(graph: MotionGraph, motion: Motion, frames: list[int]) -> FloatArray:
    """m/s^2, the largest in each transition of a walk, whose windows begin at `frames`."""
    all_frames = accelerations(motion)
    return np.array([all_frames[max(f - 1, 0) : f + graph.window + 1].max() for f in frames if f < len(all_frames)])


def build_and_report(frames: int, seed: int) -> MotionGraph:
    """The graph of so many frames; prints what building it takes."""
    takes = list(walking_takes(frames, seed))
    names, clips = [name for name, _ in takes], [motion for _, motion in takes]
    labels = [name.split("_")[0] for name in names]
    build_graph(clips[:2], names[:2], labels[:2])  # compiles
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    start, cpu = time.perf_counter(), time.process_time()
    built = build_graph(clips, names, labels)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    graph = built.graph
    count = sum(map(len, clips))
    print(f"{count:,} frames: {wall:.1f} s ({cpu:.1f} s of CPU time), {most:.2f} GB at most ({before:.2f} before), "
          f"{len(graph.transitions)} transitions, {graph.component.mean():.0%} of the frames connected, "
          f"threshold {100 * built.choice.threshold:.1f} cm")  # fmt: skip
    clip_peaks = np.concatenate([accelerations(c) for c in clips])
    print(f"takes: joints accelerate by at most {clip_peaks.max():.0f} m/s2, 99th percentile of the frames "
          f"{np.quantile(clip_peaks, 0.99):.0f}")  # fmt: skip
    return graph


def long_walk(graph: MotionGraph, minutes: float, seed: int) -> None:
    """Print a walk's length, and how hard its transitions accelerate."""
    walk = random_walk(graph, 60 * minutes, seed)
    motion = walk_motion(graph, walk)
    peaks = peaks_of_transitions(graph, motion, walk.windows(graph).tolist())
    print(f"walk of {len(motion) / graph.fps / 60:.2f} minutes, {len(peaks)} transitions: peak acceleration median "
          f"{np.median(peaks):.0f}, largest {peaks.max():.0f} m/s2")  # fmt: skip


def paths(graph: MotionGraph) -> None:
    """Print how near walks stay to paths."""
    body = body_joint(graph.clip(0))
    for name, corners in {**PATHS, "circle of 3 m, 19 m": circle(3.0)}.items():
        wanted: FloorPath = floor_path(np.array(corners, dtype=np.float64))
        start = time.perf_counter()
        walk = follow_path(graph, wanted)
        taken = time.perf_counter() - start
        off = deviation(wanted, walk_motion(graph, walk).joint_positions_world()[:, body, :2])
        print(
            f"{name}: {off.mean:.2f} m off on average, {off.most:.2f} at most, {off.end:.2f} at the end; {taken:.1f} s"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--build-only", action="store_true", help="walk nowhere")
    options = parser.parse_args()
    graph = build_and_report(options.frames, options.seed)
    if options.build_only:
        return
    long_walk(graph, options.minutes, options.seed)
    paths(graph)


if __name__ == "__main__":
    main()
