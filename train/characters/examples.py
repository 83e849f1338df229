"""Examples for the network that weights skins: graphs of generated characters with their true weights, on disk."""

import pathlib
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, IndexArray
from muybridge.files import replacing
from muybridge.motion.character.surface import join_vertices
from muybridge.motion.character.weights.bones import bones_in
from muybridge.motion.character.weights.graph import WeightGraph, weight_graph
from muybridge.train.characters.figures import Figure, FigureSampler
from muybridge.train.characters.rigs import artists_rig

PER_SHARD = 32
_FIELDS = ("features", "base", "exists", "parent", "same", "target")


@dataclass(frozen=True, eq=False)
class WeightExample:
    """The graph of a character and its weights.

    Attributes:
        features: (P, K, F), see `weight_graph`.
        base: (P, K).
        exists: (P, K).
        parent: (P, K).
        same: (P, N, K).
        target: (P, K) weights of the pairs; what joints beyond the K have is left out of the sum of one.
    """

    features: Float32Array
    base: Float32Array
    exists: Float32Array
    parent: IndexArray
    same: IndexArray
    target: Float32Array


def weight_example(figure: Figure) -> WeightExample:
    """The graph of a character and its weights."""
    surface = join_vertices(figure.vertices, figure.triangles).outward()
    graph: WeightGraph = weight_graph(surface, bones_in(surface, figure.joints, figure.parents), figure.parents)
    weights = np.zeros((len(surface.points), len(figure.joints)), np.float32)
    weights[surface.point_of] = figure.weights
    target = np.take_along_axis(weights, graph.joint, 1) * graph.exists
    return WeightExample(graph.features, graph.base, graph.exists, graph.parent, graph.same, target)


def make_shard(folder: pathlib.Path, shard: int, seed: int) -> None:
    """Write a shard of examples, of its own bodies."""
    sampler = FigureSampler(int(np.random.SeedSequence([seed, shard]).generate_state(1)[0]))
    arrays: dict[str, np.ndarray] = {}
    for k in range(PER_SHARD):
        example = weight_example(artists_rig(sampler.sample(), sampler.rng))
        for name in _FIELDS:
            value = getattr(example, name)
            kind = np.float16 if value.dtype.kind == "f" else np.uint8 if name == "parent" else np.int32
            arrays[f"{name}_{k}"] = value.astype(kind)
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / f"{shard:05}.npz") as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def load_shards(folder: pathlib.Path, shards: range) -> list[WeightExample]:
    """The examples of those shards that exist."""
    out = []
    for shard in shards:
        path = folder / f"{shard:05}.npz"
        if not path.exists():
            break
        with np.load(path) as arrays:
            for k in range(PER_SHARD):
                values = {name: arrays[f"{name}_{k}"] for name in _FIELDS}
                out.append(WeightExample(**values))
    return out
