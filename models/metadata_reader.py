"""Read and check a network's metadata field by field."""

from __future__ import annotations

import math
from collections.abc import Mapping
from json import JSONDecodeError, loads
from pathlib import Path
from typing import Any

from muybridge.errors import ModelError
from muybridge.models.shipped import ModelKind
from muybridge.models.uncertainty import SpreadCalibration


class Reader:
    """Typed access to a file's metadata; every error is a ModelError that names the file.

    Args:
        metadata: of the file.
        path: of the file, for messages.
    """

    def __init__(self, metadata: Mapping[str, str], path: Path) -> None:
        self._metadata = metadata
        self._path = path

    def error(self, what: str) -> ModelError:
        """The exception for a damaged field."""
        return ModelError(f"{self._path}: not a usable muybridge model: {what}", remedy="use_muybridge_model")

    def kind(self, expected: ModelKind) -> None:
        """Check the kind of network."""
        found = self._metadata.get("muybridge_kind")
        if found is None:
            raise ModelError(
                f"{self._path}: an ONNX file, but not a muybridge model (no muybridge_kind in its metadata)",
                remedy="third_party_model",
            )
        if found != expected:
            raise ModelError(
                f"{self._path}: a muybridge model of kind {found!r} where {expected!r} is needed",
                remedy="use_muybridge_model",
            )

    def text(self, key: str) -> str:
        """A field that must not be empty."""
        value = self._metadata.get(key, "")
        if not value:
            raise self.error(f"its metadata has no {key}")
        return value

    def integer(self, key: str, multiple_of: int = 1) -> int:
        """A positive whole number, divisible by `multiple_of`."""
        text = self.text(key)
        if not text.isdecimal() or int(text) == 0 or int(text) % multiple_of:
            wanted = "a positive whole number" + (f" divisible by {multiple_of}" if multiple_of > 1 else "")
            raise self.error(f"{key} is {text!r}, not {wanted}")
        return int(text)

    def positive(self, value: Any, key: str) -> float:
        """`value`, which must be a positive number; `key` is its name in messages."""
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self.error(f"{key} is {value!r}, not a number") from None
        if not (math.isfinite(number) and number > 0):
            raise self.error(f"{key} is {number}, not a positive number")
        return number

    def knots(self, value: Any, key: str) -> tuple[tuple[float, float], ...]:
        """Pairs of positive numbers, both ascending; older files have none."""
        if not isinstance(value, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
            raise self.error(f"{key} is not a list of pairs")
        pairs = tuple((self.positive(a, key), self.positive(b, key)) for a, b in value)
        for (a, b), (next_a, next_b) in zip(pairs, pairs[1:], strict=False):
            if next_a <= a or next_b < b:
                raise self.error(f"{key} do not ascend")
        return pairs

    def json_object(self, key: str) -> dict[str, Any]:
        """A field that is a JSON object."""
        value = self.json(key)
        if not isinstance(value, dict):
            raise self.error(f"{key} is not a JSON object")
        return value

    def ratios(self, value: Any, key: str, count: int) -> tuple[float, ...]:
        """One positive number per landmark; older files have none."""
        if not isinstance(value, list) or len(value) not in (0, count):
            raise self.error(f"{key} is not a list of {count} numbers, one a landmark")
        return tuple(self.positive(ratio, key) for ratio in value)

    def spread(self, key: str, landmarks: int) -> SpreadCalibration:
        """A variance calibration of so many `landmarks`."""
        spread = self.json_object(key)
        return SpreadCalibration(
            scale=self.positive(spread.get("scale"), f"{key}.scale"),
            floor_px2=self.positive(spread.get("floor_px2"), f"{key}.floor_px2"),
            knots=self.knots(spread.get("knots", []), f"{key}.knots"),
            hidden=self.positive(spread.get("hidden", 1.0), f"{key}.hidden"),  # older files lack these
            mirrored=self.positive(spread.get("mirrored", 1.0), f"{key}.mirrored"),
            part=self.positive(spread.get("part", 1.0), f"{key}.part"),
            landmarks=self.ratios(spread.get("landmarks", []), f"{key}.landmarks", landmarks),
        )

    def names(self, key: str) -> tuple[str, ...]:
        """A list of different landmark names."""
        value = self.json(key)
        if not isinstance(value, list) or not value or not all(isinstance(n, str) for n in value):
            raise self.error(f"{key} is not a JSON list of landmark names")
        if len(set(value)) != len(value):
            raise self.error("a landmark name is listed twice")
        return tuple(value)

    def json(self, key: str) -> Any:
        """The value of a field that is JSON."""
        try:
            return loads(self.text(key))
        except JSONDecodeError:
            raise self.error(f"{key} is not JSON") from None
