"""How probable it is that a point of a foot stands, by its height and velocity over time.

A hidden Markov model of two states for each point. What a point that stands shows is its noise and little else; what a
point that swings shows is spread widely. The widths are those of generated motion, whose contacts are known. The noise
is the points' own where they have it; else the one of a ladder under which the take is the most probable.
"""

from math import lgamma, log, pi

import numpy as np
from scipy.special import logsumexp

from muybridge.arrays import FloatArray

# Standing: height, metres, velocity a coordinate, metres per second, and way over `SHIFT_S`, without any noise. Speed
# and way are Student's t of NU.
_HEIGHT_M, _SPEED, _SHIFT_M = 0.012, 0.055, 0.008
_NU = 12.0
SHIFT_S = 0.1  # seconds over which a foot that creeps shows
# Swinging: heights from the floor up, and velocity a coordinate, by a mixture of slow and fast.
_SWING_HEIGHT_M = 0.12
_SWING_SPEEDS = ((0.25, 0.15), (0.35, 0.7), (0.4, 2.5))  # share, standard deviation
_GRAZING = 0.1  # share of swinging points that are as low as those that stand: feet that creep or are dragged
_BELOW_M = 0.004  # how far under the floor a swinging point may be, besides noise
# Mean durations, seconds.
_STANCE_S, _SWING_S = 0.8, 0.4
# Noise of positions, metres, and how fast it changes: velocity over position, 1/s, of the demo's landmarks.
LADDER_M = (0.0, 0.003, 0.006, 0.009)
NOISE_RATE = 9.0


def standing_probability(
    heights: FloatArray, velocity: FloatArray, shift: FloatArray, sigma: FloatArray, fps: float, size: float
) -> tuple[FloatArray, float]:
    """Probabilities (T, K) that each point stands, and the noise in metres that was assumed.

    Args:
        heights: (T, K) metres over where the point stands; NaN where unknown.
        velocity: (T, K, 3) metres per second, the last along the floor's normal.
        shift: (T, K) metres that it moves in the `SHIFT_S` before or after, whichever is less.
        sigma: (T, K) metres, standard deviation of a coordinate; NaN where unknown.
        fps: frames per second.
        size: of the body against an adult's.
    """
    given = bool(sigma.size) and np.isfinite(sigma).mean() > 0.5
    ladder = (float(np.nanmedian(sigma)),) if given else tuple(n * size for n in LADDER_M)
    best, likelihood, noise = np.zeros(heights.shape), -np.inf, 0.0
    for level in ladder:
        each = np.where(np.isfinite(sigma), sigma, level) if given else np.full(heights.shape, level)
        emission = _emissions(heights, velocity, shift, each, size)
        probability, total = _forward_backward(emission, fps)
        if total > likelihood:
            best, likelihood, noise = probability, total, level
    return best, noise


def _emissions(
    heights: FloatArray, velocity: FloatArray, shift: FloatArray, noise: FloatArray, size: float
) -> FloatArray:
    """(2, T, K) log-likelihoods of swinging and of standing; both zero where the point is not known."""
    high, speed = np.hypot(_HEIGHT_M * size, noise), np.hypot(_SPEED * size, noise * NOISE_RATE)
    known = np.isfinite(heights) & np.isfinite(velocity).all(-1)
    heights, shift = np.where(known, heights, 0.0), np.where(known, shift, 0.0)
    velocity = np.where(known[..., None], velocity, 0.0)
    stands = -0.5 * (heights / high) ** 2 - np.log(high) - 0.5 * log(2 * pi)
    stands += _student(np.linalg.norm(velocity, axis=-1), speed, 3)
    top, soft = _SWING_HEIGHT_M * size, np.hypot(_BELOW_M * size, noise)
    over = np.maximum(heights, 0)
    swings = np.logaddexp(log(1 - _GRAZING) - np.log(top) - over / top,
                          log(_GRAZING) - np.log(high) - 0.5 * log(2 * pi) - 0.5 * (over / high) ** 2)  # fmt: skip
    swings = swings - 0.5 * (np.minimum(heights, 0) / soft) ** 2
    stands += _student(shift, np.hypot(_SHIFT_M * size, noise), 3)
    squared = (velocity**2).sum(-1)
    parts = []
    for share, rate in _SWING_SPEEDS:
        s, way = np.hypot(rate * size, noise * NOISE_RATE), np.hypot(rate * size * SHIFT_S, noise)
        parts.append(np.log(share) - 3 * np.log(s * way) - 3 * np.log(2 * np.pi)
                     - 0.5 * squared / s**2 - 0.5 * (shift / way) ** 2)  # fmt: skip
    swings = swings + logsumexp(parts, axis=0)
    out = np.stack([swings, stands])
    return np.where(known, out, 0.0)


def _student(distance: FloatArray, scale: FloatArray, dimensions: int) -> FloatArray:
    """Log-density of Student's t of so many dimensions at a distance from its middle."""
    constant = lgamma((_NU + dimensions) / 2) - lgamma(_NU / 2) - dimensions / 2 * log(_NU * pi)
    return np.asarray(constant - dimensions * np.log(scale)
                      - (_NU + dimensions) / 2 * np.log1p((distance / scale) ** 2 / _NU))  # fmt: skip


def _forward_backward(emission: FloatArray, fps: float) -> tuple[FloatArray, float]:
    """(T, K) posterior of the second state, and the log-likelihood of everything."""
    _, frames, count = emission.shape
    if not frames:
        return np.zeros((0, count)), 0.0
    leave = np.array([1 - np.exp(-1 / (_SWING_S * fps)), 1 - np.exp(-1 / (_STANCE_S * fps))])
    step = np.array([[1 - leave[0], leave[0]], [leave[1], 1 - leave[1]]])
    peak = emission.max(0)
    like = np.exp(emission - peak)
    forward, scale = np.empty((frames, 2, count)), np.empty((frames, count))
    now = np.repeat(np.array([[_SWING_S], [_STANCE_S]]) / (_SWING_S + _STANCE_S), count, 1)
    for t in range(frames):
        now = (step.T @ now if t else now) * like[:, t]
        scale[t] = now.sum(0)
        now = now / scale[t]
        forward[t] = now
    back = np.ones((2, count))
    out = np.empty((frames, count))
    for t in range(frames - 1, -1, -1):
        both = forward[t] * back
        out[t] = both[1] / both.sum(0)
        back = step @ (like[:, t] * back) / scale[t]
    return out, float(np.log(scale).sum() + peak.sum())
