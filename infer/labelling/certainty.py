"""How sure a name is: a probability that is right as often as it says.

It is a logistic regression on what speaks for a name: the network, how much worse the best other whole labelling is,
how well distances fit, and how many points beyond the set are near. It was fitted to generated trials with markers
beyond the set, missing ones and turned heads (`scripts/benchmarks/markers/label_reliability.py`).
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.infer.labelling.settle import Settled

# Distance within which unnamed points may be meant instead of a marker, metres.
_NEAR_M = 0.15
# Of the parts of the evidence, in their order.
WEIGHTS = np.array([0.15, 0.187, -0.013, 0.799, 0.029, -0.008, -0.23, 1.281, -0.291, -0.162, 0.043, 0.489, -1.152])
# Where the distances of a piece of a trajectory fit less than this, its own frames speak against its name, which is
# taken from other pieces: it is no surer than `_ALONE`.
_UNFIT, _ALONE = 0.0, 0.5
# No name is surer than the trials can show.
MOST = 0.999


def evidence_of(network: FloatArray, settled: Settled, fit: FloatArray) -> FloatArray:
    """What speaks for every name in every frame, (T, M, E).

    Args:
        network: (T, M) probability by the network, averaged over time.
        settled: the labelling as a whole.
        fit: (T, M) how well distances fit in every frame, -1 to 1.
    """
    judge, chosen = settled.judge, settled.chosen
    others = judge.alternatives(chosen)
    own = np.where(chosen >= 0, chosen, others.shape[1] - 1)
    others[np.arange(len(chosen)), own] = -np.inf
    size = len(chosen)
    exchange = -others[:, :size].max(1, initial=-30.0)
    stranger = -others[:, size:-1].max(1, initial=-30.0)
    absent = np.where(chosen >= 0, -others[:, -1], 0.0)
    mean, known = judge.columns.mean_m[:, size:], judge.columns.known[:, size:]
    unnamed = ~np.isin(np.arange(size, len(judge.columns.mean_m)), chosen)
    crowd = ((mean < _NEAR_M) & (known > 0) & unnamed)[np.maximum(chosen, 0)].sum(1)
    whole = judge.quality(chosen) / max(int((chosen >= 0).sum()), 1)
    steady = [np.clip(exchange, -5, 20), np.log1p(np.clip(exchange, 0, 30)), np.clip(stranger, -5, 20),
              np.log1p(np.clip(stranger, 0, 30)), np.clip(absent, -5, 20), np.minimum(settled.margin, 10.0),
              np.log1p(np.clip(settled.margin, 0, 10)), np.clip(judge.fit(chosen), -1, 2), np.minimum(crowd, 4),
              np.full(size, whole)]  # fmt: skip
    odds = np.log(np.clip(network, 1e-3, 1 - 1e-4) / (1 - np.clip(network, 1e-3, 1 - 1e-4)))
    each = np.broadcast_to(np.stack(steady, -1), (*network.shape, len(steady)))
    return np.concatenate([each, odds[..., None], fit[..., None], np.ones((*network.shape, 1))], -1)


def certainty(evidence: FloatArray) -> FloatArray:
    """Probability that names are right, from `evidence_of`; at most `MOST`."""
    return np.asarray(MOST / (1 + np.exp(-np.clip(evidence @ WEIGHTS, -30, 30))))


def by_piece(certainty: FloatArray, fit: FloatArray, column: IndexArray) -> FloatArray:
    """Certainty (T, M) of pieces between gaps by their own evidence.

    Args:
        certainty: (T, M) of the names as a whole.
        fit: (T, M) how well distances fit in every frame, -1 to 1.
        column: (T, M) column of the file that each marker has, -1 for none.
    """
    out = certainty.copy()
    for m in range(column.shape[1]):
        edges = np.concatenate([[0], np.nonzero(np.diff(column[:, m]))[0] + 1, [len(column)]])
        for first, last in zip(edges, edges[1:], strict=False):
            if last > first and column[first, m] >= 0 and fit[first:last, m].mean() < _UNFIT:
                out[first:last, m] = np.minimum(out[first:last, m], _ALONE)
    return out
