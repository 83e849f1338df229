"""The search of motion matching: the tree of boxes against SciPy's KD-tree and against comparing with every frame.

Usage: python -m scripts.benchmarks.motion.matching WALKS.match [--frames 43000] [--queries 10000] [--seed 0]

Queries are what steering asks: the pose of one frame with the trajectory of another. They run one after another on one
core. More frames than the database has are made of its frames and of copies of them that differ by a twentieth of each
feature's spread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from muybridge.arrays import BoolArray, Float32Array
from muybridge.motion.matching import BoxTree, MatchDatabase, read_database

_COPY_SPREAD = 0.05  # of a feature's standard deviation
_SLOW = 300  # queries of the ways that take long; the tree of boxes answers all of them


def enlarged(database: MatchDatabase, frames: int, rng: np.random.Generator) -> tuple[Float32Array, BoolArray]:
    """(frames, F) scaled features and which may be found, of the database's frames and of copies that differ."""
    scaled, searchable = database.scaled, database.searchable
    parts, masks = [scaled], [searchable]
    while sum(map(len, parts)) < frames:
        # One difference for a whole copy: a take that is done again a little differently, as smooth as the first.
        parts.append((scaled + rng.normal(0.0, _COPY_SPREAD, scaled.shape[1]) * scaled.std(axis=0)).astype(np.float32))
        masks.append(searchable)
    return np.concatenate(parts)[:frames], np.concatenate(masks)[:frames]


def made_queries(scaled: Float32Array, trajectory: slice, count: int, rng: np.random.Generator) -> Float32Array:
    """(count, F) poses of frames with the trajectories of others."""
    queries = scaled[rng.integers(len(scaled), size=count)].copy()
    queries[:, trajectory] = scaled[rng.integers(len(scaled), size=count), trajectory]
    return queries


def timed(search: Callable[[Float32Array], float], queries: Float32Array) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances found, and milliseconds, of each query."""
    search(queries[0])
    found, taken = np.empty(len(queries)), np.empty(len(queries))
    for k, query in enumerate(queries):
        start = time.perf_counter()
        found[k] = search(query)
        taken[k] = 1e3 * (time.perf_counter() - start)
    return found, taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("database", type=Path)
    parser.add_argument("--frames", type=int, default=None)
    parser.add_argument("--queries", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    database = read_database(options.database)
    scaled, searchable = enlarged(database, options.frames or len(database), rng)
    queries = made_queries(scaled, database.options.trajectory, options.queries, rng)
    start = time.perf_counter()
    tree = BoxTree.build(scaled, searchable)
    built = time.perf_counter() - start
    kd = KDTree(scaled[searchable])
    print(
        f"{len(scaled)} frames, {len(tree)} of which can be found, {scaled.shape[1]} features; built in {built:.2f} s"
    )
    found, taken = timed(lambda q: tree.search(q)[1], queries)
    exact, all_taken = timed(lambda q: tree.search_all(q)[1], queries)
    points = scaled[searchable]
    plain, plain_taken = timed(lambda q: float(((points - q) ** 2).sum(axis=1).min()), queries[:_SLOW])
    of_kd, kd_taken = timed(lambda q: float(kd.query(q)[0]) ** 2, queries[:_SLOW])
    same = int((found == exact).sum())
    print(f"same squared distance as comparing with every frame: {same} of {len(queries)} queries")
    for name, other in (("NumPy", plain), ("KD-tree", of_kd)):
        gap = np.abs(found[: len(other)] - other).max()
        print(f"  largest difference from {name}, of {len(other)} queries: {gap:.1e}")
    ways = {"tree of boxes": taken, "every frame, compiled": all_taken, "every frame, NumPy": plain_taken,
            "SciPy KD-tree": kd_taken}  # fmt: skip
    for name, ms in ways.items():
        print(
            f"{name:22s} {ms.mean():.3f} ms a query, median {np.median(ms):.3f}, 99th percentile "
            f"{np.percentile(ms, 99):.3f}"
        )


if __name__ == "__main__":
    main()
