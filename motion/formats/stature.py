"""Whether a skeleton has the size of a person or a figure, which shows a wrong unit."""

from collections.abc import Mapping

import numpy as np

from muybridge.geometry.skeleton.skeleton import Skeleton

# Metres from hip to ankle: of people from two years on, and of any figure of a film or a game.
_LEGS = (0.36, 1.25)
_ANY_LEGS = (0.1, 2.5)
_USUAL = 0.83
_INCH, _CMU = 0.0254, 0.0254 / 0.45
# By how much lengths are too long where a file states one unit and has another.
_SCALES = tuple(s for unit in (1e-1, 1e-2, 1e-3, _INCH, _CMU) for s in (unit, 1 / unit))


def leg_metres(skeleton: Skeleton, roles: Mapping[str, int]) -> float:
    """Metres from hip to ankle along the bones at rest, the mean of both legs; NaN where no leg is known."""
    rest, found = skeleton.rest_positions, []
    for side in ("left", "right"):
        chain = [roles.get(f"{side}_{part}", -1) for part in ("thigh", "shin", "foot")]
        if min(chain) >= 0:
            found.append(float(np.linalg.norm(np.diff(rest[chain], axis=0), axis=1).sum()))
    return float(np.mean(found)) if found else float("nan")


def likely_scale(legs: float) -> float | None:
    """The factor that makes a body one of a person's size, where it is too large or small for any figure.

    Args:
        legs: metres from hip to ankle.

    Returns:
        The ratio of two usual units; None where the size is plausible, or where none of them makes it so.
    """
    if not 0 < legs < np.inf or _ANY_LEGS[0] <= legs <= _ANY_LEGS[1]:
        return None
    scale = min(_SCALES, key=lambda s: abs(np.log(legs * s / _USUAL)))
    return scale if _LEGS[0] <= legs * scale <= _LEGS[1] else None
