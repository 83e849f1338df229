"""A filter bank over time: a signal divided into octaves, each with its gain.

After A. Bruderlin, L. Williams, "Motion signal processing", 1995, section 2.1: the signal is low-passed again and again
with the kernel (1, 4, 6, 4, 1) / 16, which is expanded by zeros rather than the signal decimated, so that every band
has all frames; a band is the difference of two low-passed signals.
"""

import numpy as np

from muybridge.arrays import FloatArray

_KERNEL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
_HALF = 0.182  # cycles per sample at which the kernel passes half of the amplitude: cos(pi f)^4 = 1/2


def level_count(frames: int) -> int:
    """Bands that a signal of so many frames has: as many as the expanded kernel is no longer than the signal is."""
    return max(int(np.floor(np.log2((frames - 1) / 2))) + 1, 0) if frames > 2 else 0


def band_range(band: int, fps: float) -> tuple[float, float]:
    """Hz between which a band lies: where the low-pass before and behind it pass half of the amplitude.

    Args:
        band: 1 is the finest.
        fps: frames per second.
    """
    return _half(band, fps), _half(band - 1, fps)


def _half(level: int, fps: float) -> float:
    """Hz of which a low-passed signal has half of the amplitude; above the finest band it is half of the frame rate."""
    if level == 0:
        return fps / 2
    f = np.linspace(0, _HALF / 2 ** (level - 1), 2001)
    passed = np.prod([np.cos(np.pi * f * 2**k) ** 4 for k in range(level)], axis=0)
    return float(f[int(np.argmax(passed < 0.5)) if (passed < 0.5).any() else -1]) * fps


def low_pass(values: FloatArray, level: int, odd: bool = False) -> FloatArray:
    """(T, ...) values of which the `level` finest bands are taken away."""
    for k in range(level):
        values = _passed(values, 2**k, odd)
    return values


def filter_bank(values: FloatArray, odd: bool = False) -> tuple[FloatArray, FloatArray]:
    """The bands of a signal, which add up to it.

    Args:
        values: (T, ...).
        odd: beyond its ends the signal goes on as it came, mirrored in time and about its end value, so that the end
            values and a steady travel are in the rest, not in the bands; else it is mirrored in time alone.

    Returns:
        (K, T, ...) bands from fine to coarse, `level_count(T)` of them, and the rest (T, ...), which is the slowest.
    """
    bands = []
    for k in range(level_count(len(values))):
        passed = _passed(values, 2**k, odd)
        bands.append(values - passed)
        values = passed
    return np.array(bands).reshape(-1, *values.shape), values


def _passed(values: FloatArray, spacing: int, odd: bool) -> FloatArray:
    """Low-passed with the kernel whose taps are `spacing` frames apart."""
    reach, count = 2 * spacing, len(values)
    width = ((reach, reach), *[(0, 0)] * (values.ndim - 1))
    padded = np.pad(values, width, mode="reflect", reflect_type="odd" if odd else "even")
    return np.asarray(sum(w * padded[k * spacing : k * spacing + count] for k, w in enumerate(_KERNEL)))
