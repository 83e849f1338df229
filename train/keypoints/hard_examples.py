"""Which renders the network finds hard, so that they are drawn more often.

Of a trained network's misses nearly half lie in a twelfth of the crops: people head down, folded up, running in
profile. What it does well teaches it little more (importance sampling by loss, Katharopoulos and Fleuret 2018; here
the loss is not weighted back: that hard poses count for more is meant).
"""

import pathlib

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.files import replacing

# Of a render's mean loss, what its newest crop says: crops of one render differ by background, things in front and
# light, so that one alone says little.
_NEWEST = 0.3
# Losses are counted above this quantile: nobody is easier than easy.
_EASY = 0.2


class Difficulty:
    """Mean loss of a store's renders, kept in a file that the processes read which make crops.

    Args:
        path: of the file (`.npy`, float32, NaN where unknown); what is there already is gone on with.
        every: it is written after so many batches.
    """

    def __init__(self, path: pathlib.Path, every: int = 100) -> None:
        self.path, self.every, self.noted = path, every, 0
        self.loss = read_difficulty(path)

    def note(self, index: IntArray, loss: Float32Array) -> None:
        """The losses (B,) of crops of the renders `index` (B,); NaN says nothing."""
        size = int(index.max()) + 1
        if size > len(self.loss):
            self.loss = np.append(self.loss, np.full(size - len(self.loss), np.nan, np.float32))
        index, loss = index[np.isfinite(loss)], loss[np.isfinite(loss)]
        before = self.loss[index]
        self.loss[index] = np.where(np.isnan(before), loss, before + _NEWEST * (loss - before))
        self.noted += 1
        if self.noted % self.every == 0:
            with replacing(self.path) as temporary:
                np.save(temporary, self.loss)


def read_difficulty(path: pathlib.Path) -> Float32Array:
    """(N,) losses of the first renders of a store, NaN where unknown; none where there is no file."""
    return np.load(path) if path.exists() else np.zeros(0, np.float32)


def drawing_probability(loss: Float32Array, count: int, hard: float) -> FloatArray:
    """With which probability each of `count` renders is drawn: a share `hard` by how far its loss lies above the easy
    ones', the rest evenly.

    Args:
        loss: (N,) of the first renders, NaN where unknown: such are drawn as the mean of the known.
        count: of all renders.
        hard: 0 to 1.
    """
    even = np.full(count, 1 / count)
    known = np.full(count, np.nan)
    known[: len(loss)] = loss[:count]
    if not np.isfinite(known).any():
        return even
    excess = np.maximum(known - np.nanquantile(known, _EASY), 0)
    excess[np.isnan(excess)] = np.nanmean(excess)
    total = excess.sum()
    return (1 - hard) * even + hard * excess / total if total > 0 else even
