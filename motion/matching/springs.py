"""Critically damped springs: values that go to a goal as fast as they can without swinging beyond it, in closed form.

Such a spring's value is `goal + (a + b t) exp(-d t)`; a and b are what its value and rate at time zero ask for.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray


def spring_rate(halflife: float) -> float:
    """d, per second: of a spring at rest that has gone half of its way after about so many seconds."""
    return float(2 * np.log(2.0) / max(halflife, 1e-4))


@dataclass(frozen=True, eq=False)
class Spring:
    """A value (...) on its way.

    Attributes:
        value: where it is.
        rate: its derivative, per second.
    """

    value: FloatArray
    rate: FloatArray

    def after(self, goal: FloatArray, seconds: float, halflife: float) -> "Spring":
        """The spring so many seconds later, pulled to a goal (...)."""
        d, (a, b) = spring_rate(halflife), self._terms(goal, halflife)
        left = np.exp(-d * seconds)
        return Spring(goal + (a + b * seconds) * left, (b - d * (a + b * seconds)) * left)

    def values(self, goal: FloatArray, times: FloatArray, halflife: float) -> FloatArray:
        """(..., H) its values at times (H,) from now."""
        d, (a, b) = spring_rate(halflife), self._terms(goal, halflife)
        return np.asarray(np.asarray(goal)[..., None] + (a[..., None] + b[..., None] * times) * np.exp(-d * times))

    def sums(self, goal: FloatArray, times: FloatArray, halflife: float) -> FloatArray:
        """(..., H) the integral of its value from now to times (H,): ways, if the value is a velocity."""
        d, (a, b) = spring_rate(halflife), self._terms(goal, halflife)
        left = np.exp(-d * times)
        of_a, of_b = (1 - left) / d, (1 - left * (1 + d * times)) / d**2
        return np.asarray(np.asarray(goal)[..., None] * times + a[..., None] * of_a + b[..., None] * of_b)

    def _terms(self, goal: FloatArray, halflife: float) -> tuple[FloatArray, FloatArray]:
        away = np.asarray(self.value - goal)
        return away, np.asarray(self.rate + spring_rate(halflife) * away)
