"""A camera's clock by sound: envelopes say about where, waveforms exactly.

Generalised cross-correlation with phase transform (GCC-PHAT; Knapp and Carter, "The generalized correlation
method for estimation of time delay", 1976) of windows over the take, found near the peak of the envelopes'
correlation. Good to a fraction of a millisecond; sound takes 2.9 ms for each metre that one camera is farther.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.clocks import MAD_SIGMA, UNKNOWN, Clock, Delays, clock_from_delays, parabola

Floats = NDArray[np.float64]

_ENVELOPE_RATE = 500.0
_FINE_SEARCH = 0.02  # seconds about the envelopes' delay in which waveforms are compared


def audio_clock(
    reference: Floats, other: Floats, rate: float, max_offset: float | None = None, window: float = 20.0
) -> Clock:
    """A camera's clock by sound.

    Args:
        reference: (N,) samples of the reference's sound, from its video's time zero.
        other: (M,) the camera's.
        rate: samples a second of both.
        max_offset: seconds; None for anything that overlaps.
        window: seconds of the pieces that are compared finely; drift needs several.

    Returns:
        `UNKNOWN` where one is silent or too short.
    """
    if min(len(reference), len(other)) < rate * 0.5 or not reference.std() > 0 or not other.std() > 0:
        return UNKNOWN
    coarse, _ = _coarse_delay(reference, other, rate, max_offset)
    length = int(min(window * rate, len(reference), len(other)))
    lowest = max(0, int(-coarse * rate))
    highest = min(len(reference), int(len(other) - coarse * rate))
    if highest - lowest < rate * 0.5:
        return UNKNOWN
    length = min(length, highest - lowest)
    count = max(1, int(np.ceil((highest - lowest) / length)))
    starts = np.linspace(lowest, highest - length, count).round().astype(np.intp)
    # Drift moves the delay along the take: each window starts from where the one before ended.
    found, guess = [], coarse
    for start in starts:
        delay, sd, strength = _phat_delay(reference, other, rate, int(start), length, guess)
        found.append((((start + length / 2) / rate), delay, sd, strength))
        if strength > 0.1:
            guess = delay
    return clock_from_delays(Delays(*np.array(found, dtype=np.float64).T), with_drift=True)


def _envelope(samples: Floats, rate: float) -> tuple[Floats, float]:
    """Loudness that stands out, about `_ENVELOPE_RATE` times a second, and its rate."""
    step = max(1, int(rate / _ENVELOPE_RATE))
    kept = samples[: len(samples) // step * step].reshape(-1, step)
    loud = np.log1p(np.sqrt((np.asarray(kept, dtype=np.float64) ** 2).mean(axis=1)) / (np.std(samples) + 1e-12))
    rise = np.maximum(np.diff(loud, prepend=loud[:1]), 0.0)
    return np.asarray(rise - rise.mean()), rate / step


def _coarse_delay(reference: Floats, other: Floats, rate: float, max_offset: float | None) -> tuple[float, float]:
    """Delay by the envelopes, seconds, and how clear it is."""
    from scipy.signal import correlate, correlation_lags  # slow to load, and every command loads this module

    a, step_rate = _envelope(reference, rate)
    b, _ = _envelope(other, rate)
    score = correlate(b, a, mode="full", method="fft")
    lags = correlation_lags(len(b), len(a), mode="full")
    overlap = np.minimum(len(b), lags + len(a)) - np.maximum(0, lags)
    score = score / np.sqrt(np.maximum(overlap, 0.1 * min(len(a), len(b))))
    if max_offset is not None:
        score = np.where(np.abs(lags) <= max_offset * step_rate, score, -np.inf)
    best = int(np.argmax(score))
    return float(lags[best] / step_rate), float(score[best])


def _phat_delay(
    reference: Floats, other: Floats, rate: float, start: int, length: int, guess: float
) -> tuple[float, float, float]:
    """(delay, standard deviation, strength) of one window by GCC-PHAT, near a guess; seconds."""
    shift = int(round(guess * rate))
    a = np.zeros(length)
    b = np.zeros(length)
    a[:] = reference[start : start + length]
    low, high = max(0, start + shift), min(len(other), start + shift + length)
    if high - low < length // 2:
        return np.nan, np.nan, 0.0
    b[low - start - shift : high - start - shift] = other[low:high]
    taper = np.hanning(length)
    size = 1 << int(np.ceil(np.log2(2 * length)))
    spectrum = np.fft.rfft(b * taper, size) * np.conj(np.fft.rfft(a * taper, size))
    magnitude = np.abs(spectrum)
    spectrum /= np.maximum(magnitude, 1e-3 * magnitude.mean() + 1e-30)
    curve = np.fft.irfft(spectrum, size)
    reach = min(max(2, int(_FINE_SEARCH * rate)), length // 2)
    near = np.concatenate([curve[-reach:], curve[: reach + 1]])
    best = int(np.argmax(near))
    peak, floor = float(near[best]), float(MAD_SIGMA * np.median(np.abs(near)))
    if peak < 6 * floor:
        return np.nan, np.nan, 0.0
    lag = best - reach + parabola(near, best)
    # A peak one sample wide is known to a fraction of it; a blurred one to less.
    sd = max(0.2 * floor / peak, 0.02) / rate
    return (shift + lag) / rate, sd, min(1.0, peak)
