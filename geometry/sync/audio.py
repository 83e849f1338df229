"""A camera's clock from sound: loudness envelopes give the approximate delay, waveforms the exact one.

Generalised cross-correlation with phase transform (GCC-PHAT; Knapp and Carter, "The generalized correlation method for
estimation of time delay", 1976) of windows over the take, near the peak of the envelopes' correlation. Accurate to a
fraction of a millisecond; sound travels 2.9 ms per metre of distance between the cameras.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.robust import MAD_SIGMA
from muybridge.geometry.sync.clocks import UNKNOWN, Clock, Delays, clock_from_delays, parabola

_ENVELOPE_RATE = 500.0
_FINE_SEARCH = 0.02  # search range around the envelopes' delay in which waveforms are compared, seconds
# Where the envelopes fit nearly as well at other delays, such as with a metronome, the waveforms decide, because room
# noise does not repeat. Shares of the best delay's score, and number of delays tried.
_RIVAL, _CLEAR, _MOST = 0.8, 0.7, 24
_APART = 0.05  # smallest distance of two candidates, seconds


def audio_clock(
    reference: FloatArray, other: FloatArray, rate: float, max_offset: float | None = None, window: float = 20.0
) -> Clock:
    """Estimate a camera's clock from sound.

    Args:
        reference: (N,) samples of the reference's sound, from the time zero of its video.
        other: (M,) samples of the camera's sound.
        rate: samples per second of both.
        max_offset: largest offset, seconds; None for any offset with an overlap.
        window: length of the windows that are compared finely, seconds; drift needs several.

    Returns:
        The clock; `UNKNOWN` where one recording is silent or too short. Where the sound is periodic and has no other
        content common to both, the standard deviation covers the other delays that fit as well.
    """
    if min(len(reference), len(other)) < rate * 0.5 or not reference.std() > 0 or not other.std() > 0:
        return UNKNOWN
    coarse, doubt = _clearest(reference, other, rate, _coarse_delays(reference, other, rate, max_offset), window)
    lowest, highest, length = _overlap(reference, other, rate, coarse, window)
    if length < rate * 0.5:
        return UNKNOWN
    count = max(1, int(np.ceil((highest - lowest) / length)))
    starts = np.linspace(lowest, highest - length, count).round().astype(np.intp)
    # Drift changes the delay along the take: each window starts from the delay of the previous one.
    found, guess = [], coarse
    for start in starts:
        delay, sd, strength = _phat_delay(reference, other, rate, int(start), length, guess)
        found.append((((start + length / 2) / rate), delay, sd, strength))
        if strength > 0.1:
            guess = delay
    clock = clock_from_delays(Delays(*np.array(found, dtype=np.float64).T), with_drift=True)
    return replace(clock, offset_sd=float(np.hypot(clock.offset_sd, doubt)))


def _overlap(
    reference: FloatArray, other: FloatArray, rate: float, delay: float, window: float
) -> tuple[int, int, int]:
    """First and last sample of the reference that the other recording has too, and the number of samples per window."""
    lowest, highest = max(0, int(-delay * rate)), min(len(reference), int(len(other) - delay * rate))
    return lowest, highest, min(int(min(window * rate, len(reference), len(other))), highest - lowest)


def _clearest(
    reference: FloatArray, other: FloatArray, rate: float, delays: list[float], window: float
) -> tuple[float, float]:
    """The candidate delay at which the waveforms agree, seconds, and the distance of others that fit as well.

    The distance is 0 where no other delay fits as well.
    """
    strengths = []
    for delay in delays if len(delays) > 1 else ():
        lowest, highest, length = _overlap(reference, other, rate, delay, window)
        middle = (lowest + highest - length) // 2
        enough = length >= rate * 0.5
        strengths.append(_phat_delay(reference, other, rate, middle, length, delay)[2] if enough else 0.0)
    if not any(strengths):
        return delays[0], 0.0
    best = int(np.argmax(strengths))
    rivals = [d for d, s in zip(delays, strengths, strict=True) if s > _CLEAR * strengths[best]]
    return delays[best], max(abs(d - delays[best]) for d in rivals)


def _envelope(samples: FloatArray, rate: float) -> tuple[FloatArray, float]:
    """Onset strength, sampled at about `_ENVELOPE_RATE` Hz, and its exact rate."""
    step = max(1, int(rate / _ENVELOPE_RATE))
    kept = samples[: len(samples) // step * step].reshape(-1, step)
    loud = np.log1p(np.sqrt((np.asarray(kept, dtype=np.float64) ** 2).mean(axis=1)) / (np.std(samples) + 1e-12))
    rise = np.maximum(np.diff(loud, prepend=loud[:1]), 0.0)
    return np.asarray(rise - rise.mean()), rate / step


def _coarse_delays(reference: FloatArray, other: FloatArray, rate: float, max_offset: float | None) -> list[float]:
    """Delays at which the envelopes agree best or nearly so, seconds, best first."""
    from scipy.signal import correlate, correlation_lags, find_peaks  # slow to load, as every command loads this module

    a, step_rate = _envelope(reference, rate)
    b, _ = _envelope(other, rate)
    score = correlate(b, a, mode="full", method="fft")
    lags = correlation_lags(len(b), len(a), mode="full")
    overlap = np.minimum(len(b), lags + len(a)) - np.maximum(0, lags)
    score = score / np.sqrt(np.maximum(overlap, 0.1 * min(len(a), len(b))))
    if max_offset is not None:
        score = np.where(np.abs(lags) <= max_offset * step_rate, score, -np.inf)
    best = int(np.argmax(score))
    peaks, _ = find_peaks(score, height=_RIVAL * abs(score[best]), distance=max(1, int(_APART * step_rate)))
    others = sorted((int(p) for p in peaks if abs(p - best) >= _APART * step_rate), key=lambda p: -score[p])
    return [float(lags[p] / step_rate) for p in (best, *others[: _MOST - 1])]


def _phat_delay(
    reference: FloatArray, other: FloatArray, rate: float, start: int, length: int, guess: float
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
    # A peak one sample wide is known to a fraction of a sample, a wider one less precisely.
    sd = max(0.2 * floor / peak, 0.02) / rate
    return (shift + lag) / rate, sd, min(1.0, peak)
