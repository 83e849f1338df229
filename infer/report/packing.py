"""Arrays packed for the scripts in a page."""

import base64
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray

_MISSING = -32768


def rounded(value: float, digits: int = 2) -> float | None:
    """A number for JSON: None where it is not finite."""
    return round(float(value), digits) if np.isfinite(value) else None


def packed_positions(positions: FloatArray) -> dict[str, Any]:
    """(T, J, 3) metres as 16-bit integers: an offset, a step and base64 in little-endian order.

    One point a hundred metres away would cost the others their precision (0.3 mm in a room of 20 m), so positions
    beyond 12 interquartile ranges from the median count as missing here.
    """
    finite = np.isfinite(positions).all(axis=-1)
    seen = positions[finite]
    if not len(seen):
        seen = np.zeros((1, 3))
    low, middle, high = np.quantile(seen, [0.25, 0.5, 0.75], axis=0)
    reach = 12.0 * np.maximum(high - low, 0.5)
    near = finite & (np.abs(np.nan_to_num(positions) - middle) <= reach).all(axis=-1)
    seen = positions[near] if near.any() else seen
    center = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    step = max(float((seen.max(axis=0) - seen.min(axis=0)).max()) / 65000.0, 1e-5)
    codes = np.full(positions.shape, _MISSING, "<i2")
    codes[near] = np.round((positions[near] - center) / step)
    return {
        "offset": [rounded(v, 5) for v in center],
        "step": step,
        "data": base64.b64encode(codes.tobytes()).decode("ascii"),
    }


def packed_shares(values: FloatArray) -> str:
    """Percentages as bytes in base64."""
    return base64.b64encode(np.clip(np.round(values), 0, 100).astype(np.uint8).tobytes()).decode("ascii")
