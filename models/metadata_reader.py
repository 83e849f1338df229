"""Read and check a network's metadata field by field."""

from __future__ import annotations

from collections.abc import Mapping
from json import loads
from pathlib import Path
from reprlib import repr as shorten
from typing import Any, Protocol

from muybridge.errors import ModelError, parsing
from muybridge.models.shipped import ModelKind
from muybridge.models.uncertainty import SpreadCalibration


class OnnxSession(Protocol):
    """What is used of an onnxruntime session, which this package does not import."""

    def get_modelmeta(self) -> Any:
        """The file's description."""
        ...


# No network is larger: longest side of an input (px) and its area, so that a stated size cannot exhaust memory.
LARGEST_SIDE_PX, LARGEST_AREA_PX = 4096, 2048**2
LARGEST_NUMBER = 1e9  # beyond any quantity of a network's
_DIGITS = 18
_MOST_TIMES, _LONGEST_S = 1000, 60.0


def metadata_of(session: OnnxSession, path: Path) -> dict[str, str]:
    """A network's custom metadata.

    Args:
        session: of onnxruntime.
        path: of its file, for the message.

    Raises:
        ModelError: the metadata are not text in UTF-8.
    """
    with parsing(path, ModelError, "an ONNX file with metadata in UTF-8"):
        return {str(k): str(v) for k, v in session.get_modelmeta().custom_metadata_map.items()}


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

    def seconds(self, key: str) -> tuple[float, ...]:
        """A JSON list of numbers, of up to a minute either way."""
        values = self.json(key)
        if not isinstance(values, list) or len(values) > _MOST_TIMES:
            raise self.error(f"{key} is not a list of seconds")
        for value in values:
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LONGEST_S:
                raise self.error(f"{key} is not a list of seconds")
        return tuple(float(value) for value in values)

    def integer(self, key: str, multiple_of: int = 1, most: int = LARGEST_SIDE_PX) -> int:
        """A positive whole number of at most `most`, divisible by `multiple_of`."""
        text = self.text(key)
        number = int(text) if text.isdecimal() and len(text) <= _DIGITS else 0
        if not 0 < number <= most or number % multiple_of:
            wanted = "a positive whole number" + (f" divisible by {multiple_of}" if multiple_of > 1 else "")
            raise self.error(f"{key} is {shorten(text)}, not {wanted} of at most {most}")
        return number

    def positive(self, value: Any, key: str, zero: bool = False) -> float:
        """`value`, which must be a positive number, or `zero` if that is valid; `key` is its name in messages."""
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise self.error(f"{key} is {shorten(value)}, not a number") from None
        if not (0 < number < LARGEST_NUMBER or zero and number == 0):
            raise self.error(f"{key} is {number:g}, not a positive number below {LARGEST_NUMBER:g}")
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
        text = self.text(key)
        try:
            return loads(text)
        except Exception as error:  # nesting and numbers of thousands of digits raise others than JSON's own
            raise self.error(f"{key} is not JSON") from error
