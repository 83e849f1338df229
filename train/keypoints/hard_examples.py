"""Hard example mining: renders with a high loss are drawn more often.

Nearly half of a trained network's misses lie in a twelfth of the crops: people upside down, folded up, or running in
profile; it learns little more from what it does well (importance sampling by loss, Katharopoulos and Fleuret 2018).
Unlike there, the loss is not reweighted: hard poses are meant to count more.
"""

import pathlib

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray, IntArray
from muybridge.files import replacing

# Weight of the newest crop in a render's mean loss: crops of one render differ by background, occluders and light, so
# that one alone is noisy.
_NEWEST = 0.3
# Losses count above this quantile; below it all renders are equally easy.
_EASY = 0.2


class Difficulty:
    """Mean loss of a store's renders, kept in a file for the processes that make crops.

    Args:
        path: of the file (`.npy`, float32, NaN where unknown); an existing one is continued.
        every: number of batches between writes.
    """

    def __init__(self, path: pathlib.Path, every: int = 100) -> None:
        self.path, self.every, self.recorded = path, every, 0
        self.loss = read_difficulty(path)

    def record(self, index: IntArray, loss: Float32Array) -> None:
        """Record the losses (B,) of crops of the renders `index` (B,); NaN is ignored."""
        size = int(index.max()) + 1
        if size > len(self.loss):
            self.loss = np.append(self.loss, np.full(size - len(self.loss), np.nan, np.float32))
        index, loss = index[np.isfinite(loss)], loss[np.isfinite(loss)]
        before = self.loss[index]
        self.loss[index] = np.where(np.isnan(before), loss, before + _NEWEST * (loss - before))
        self.recorded += 1
        if self.recorded % self.every == 0:
            with replacing(self.path) as temporary:
                np.save(temporary, self.loss)


def read_difficulty(path: pathlib.Path) -> Float32Array:
    """(N,) losses of the first renders of a store, NaN where unknown; empty if there is no file."""
    return np.load(path) if path.exists() else np.zeros(0, np.float32)


def drawing_probability(loss: Float32Array, count: int, hard: float) -> FloatArray:
    """Probability of drawing each of `count` renders.

    Args:
        loss: (N,) of the first renders, NaN where unknown: these are drawn like the mean of the known ones.
        count: number of renders.
        hard: share, 0 to 1, that is drawn in proportion to how far the loss exceeds that of easy renders; the rest is
            uniform.
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


def mix_scenes(probability: FloatArray, people: IndexArray, scenes: IndexArray, share: float) -> FloatArray:
    """The probability of drawing each of N renders, with a fixed share of scenes.

    Args:
        probability: (N,) before.
        people: renders with a subject; the others are never drawn.
        scenes: those of them that are of scenes.
        share: of scenes, if there are both kinds.
    """
    alone, mixed = np.setdiff1d(people, scenes), np.zeros_like(probability)
    shares = (1 - share, share) if len(alone) and len(scenes) else (1.0, 1.0)
    for part, total in zip((alone, scenes), shares, strict=True):
        mixed[part] = total * probability[part] / max(probability[part].sum(), 1e-12)
    return np.asarray(mixed / mixed.sum())
