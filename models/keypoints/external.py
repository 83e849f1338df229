"""Model cards of third-party models: what an ONNX file without muybridge's metadata takes in and returns.

A card is a small TOML file, described in docs/guides/other-models.md; some come with the package (`models/cards/`).
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from reprlib import repr as shorten
from typing import Any, Literal

from muybridge.errors import ModelError, parsing
from muybridge.geometry.cameras.crops import BOX_PADDING
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.metadata_reader import LARGEST_AREA_PX, LARGEST_NUMBER, LARGEST_SIDE_PX
from muybridge.models.uncertainty import SpreadCalibration

_BODY17 = BODY23.names[:17]
_FEET = ("left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel")

LAYOUTS: dict[str, tuple[str, ...]] = {
    "body23": BODY23.names,
    "coco17": _BODY17,
    "halpe26": (
        *_BODY17, "head", "neck", "hip", "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe",
        "left_heel", "right_heel",
    ),
    "coco133": (
        *_BODY17, *_FEET, *(f"face_{i}" for i in range(68)), *(f"left_hand_{i}" for i in range(21)),
        *(f"right_hand_{i}" for i in range(21)),
    ),
}  # fmt: skip
"""Landmark layouts that cards may name, in the order of the models' outputs."""

# Default standard deviation where a card gives none: this share of the crop's longer side, added to the spread.
_DEFAULT_FLOOR = 0.01


@dataclass(frozen=True)
class ModelCard:
    """Inputs and outputs of a third-party top-down model.

    Attributes:
        name: for reports.
        input_name: of the image input; empty for the only one.
        width, height: of the input, px.
        colour: order of its channels.
        white: the value of white before `mean` and `std` are applied.
        mean, std: of each channel in the order of `colour`, subtracted and divided by.
        box_padding: size of the crop relative to the person's bounding box, widened to the input's aspect ratio.
        names: (K,) the model's landmarks.
        decode: kind of its outputs.
        outputs: names of the outputs: x and y, or the heatmaps.
        split_ratio, softmax_scale: of SimCC, see `simcc.decode_simcc`.
        stride, origin_px, logits: of heatmaps, see `simcc.decode_value_heatmaps`.
        spread: variance calibration.
        min_confidence: score, in 0..1, above which a camera's detection of a landmark counts.
    """

    name: str
    input_name: str
    width: int
    height: int
    colour: Literal["rgb", "bgr"]
    white: float
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    box_padding: float
    names: tuple[str, ...]
    decode: Literal["simcc", "heatmaps"]
    outputs: tuple[str, ...]
    split_ratio: float
    softmax_scale: float
    stride: float
    origin_px: float
    logits: bool
    spread: SpreadCalibration
    min_confidence: float


def shipped_cards() -> dict[str, Path]:
    """Cards that come with the package, by name."""
    folder = Path(str(resources.files("muybridge.models"))) / "cards"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find_card(model: Path, card: str | None) -> Path | None:
    """The card of a model: a file, the name of a shipped card, or the TOML file of the same name beside the model.

    Raises:
        ModelError: `card` is neither a file nor a shipped card.
    """
    if card is None:
        beside = model.with_suffix(".toml")
        return beside if beside.is_file() else None
    known = shipped_cards()
    if card in known:
        return known[card]
    if Path(card).is_file():
        return Path(card)
    raise ModelError(f"{card}: no such model card; name a TOML file, or one of {', '.join(known)}")


def load_card(path: Path) -> ModelCard:
    """Read a card.

    Raises:
        ModelError: it cannot be read, a key is missing or unknown, or a value is invalid.
    """
    with parsing(path, ModelError, "a readable model card (see docs/guides/other-models.md)"):
        return _card(path, tomllib.loads(path.read_text(encoding="utf-8")))


def _card(path: Path, table: dict[str, Any]) -> ModelCard:
    read = _Table(path, table)
    model, image = read.section("model"), read.section("input")
    decode = model.choice("decode", ("simcc", "heatmaps"))
    outputs = read.section(decode)
    names = model.landmarks()
    width, height = image.whole("width"), image.whole("height")
    if width * height > LARGEST_AREA_PX:
        raise image.error(f"width and height are {width} x {height}, more than {LARGEST_AREA_PX} pixels")
    if (width - height) % 2:
        raise image.error("width and height differ by an odd number, which no crop can have")
    variance, score = read.section("variance", needed=False), read.section("score", needed=False)
    simcc = decode == "simcc"
    card = ModelCard(
        name=model.text("name", path.stem), input_name=image.text("name", ""), width=width, height=height,
        colour=image.choice("colour", ("rgb", "bgr"), "rgb"), white=image.positive("white", 255.0),
        mean=image.triple("mean", (0.0, 0.0, 0.0)), std=image.triple("std", (1.0, 1.0, 1.0)),
        box_padding=image.positive("box_padding", BOX_PADDING), names=names, decode=decode,
        outputs=(outputs.text("x"), outputs.text("y")) if simcc else (outputs.text("output"),),
        split_ratio=outputs.positive("split_ratio") if simcc else 1.0,
        softmax_scale=outputs.positive("softmax_scale", 1.0) if simcc else 1.0,
        stride=1.0 if simcc else outputs.positive("stride"),
        origin_px=0.0 if simcc else outputs.number("origin_px", 0.0),
        logits=not simcc and outputs.choice("values", ("probability", "logits")) == "logits",
        spread=SpreadCalibration(
            variance.positive("scale", 1.0),
            variance.positive("floor_px2", (_DEFAULT_FLOOR * max(width, height)) ** 2),
        ),
        min_confidence=score.number("min_confidence", 0.0),
    )  # fmt: skip
    if min(card.std) <= 0:
        raise image.error("std must be positive")
    if not 0 <= card.min_confidence <= 1:
        raise score.error(f"min_confidence is {card.min_confidence}, not from 0 to 1")
    for section in (model, image, outputs, variance, score, read):
        section.refuse_unknown_keys()
    return card


def _is_number(value: object) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) <= LARGEST_NUMBER  # type: ignore[operator]  # false of NaN


class _Table:
    """Typed access to a table of a card; every error names the file and the key."""

    def __init__(self, path: Path, table: dict[str, Any], name: str = "") -> None:
        self._path, self._table, self._name, self._used = path, table, name, set[str]()

    def error(self, what: str) -> ModelError:
        where = f"[{self._name}] " if self._name else ""
        return ModelError(f"{self._path}: {where}{what}; see docs/guides/other-models.md")

    def _get(self, key: str, default: Any) -> Any:
        self._used.add(key)
        value = self._table.get(key, default)
        if value is None:
            raise self.error(f"{key} is missing")
        return value

    def section(self, key: str, needed: bool = True) -> _Table:
        value = self._get(key, None if needed else {})
        if not isinstance(value, dict):
            raise self.error(f"{key} is not a table")
        return _Table(self._path, value, key)

    def text(self, key: str, default: str | None = None) -> str:
        value = self._get(key, default)
        if not isinstance(value, str):
            raise self.error(f"{key} is {shorten(value)}, not text")
        return value

    def choice(self, key: str, known: tuple[str, ...], default: str | None = None) -> Any:
        value = self.text(key, default)
        if value not in known:
            raise self.error(f"{key} is {shorten(value)}, not one of {', '.join(known)}")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        value = self._get(key, default)
        if not _is_number(value):
            raise self.error(f"{key} is {shorten(value)}, not a number from -{LARGEST_NUMBER:g} to {LARGEST_NUMBER:g}")
        return float(value)

    def positive(self, key: str, default: float | None = None) -> float:
        value = self.number(key, default)
        if value < 1 / LARGEST_NUMBER:
            raise self.error(f"{key} is {value:g}, not positive")
        return value

    def whole(self, key: str) -> int:
        value = self._get(key, None)
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= LARGEST_SIDE_PX:
            raise self.error(f"{key} is {shorten(value)}, not a positive whole number of at most {LARGEST_SIDE_PX}")
        return value

    def triple(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        value = self._get(key, list(default))
        if not isinstance(value, list) or len(value) != 3 or not all(_is_number(v) for v in value):
            raise self.error(f"{key} is {shorten(value)}, not three numbers")
        return float(value[0]), float(value[1]), float(value[2])

    def landmarks(self) -> tuple[str, ...]:
        """The landmarks of a named layout, or a list of names."""
        value = self._get("landmarks", None)
        if isinstance(value, str) and value in LAYOUTS:
            return LAYOUTS[value]
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.error(f"landmarks is {shorten(value)}, neither a list of names nor one of {', '.join(LAYOUTS)}")
        if len(set(value)) != len(value):
            raise self.error("a landmark is listed twice")
        if not set(value) & set(BODY23.names):
            raise self.error(f"none of the landmarks is known to muybridge: {', '.join(BODY23.names)}")
        return tuple(value)

    def refuse_unknown_keys(self) -> None:
        """Raise ModelError if the table has a key that was never read."""
        unknown = sorted(set(self._table) - self._used)
        if unknown:
            raise self.error(f"unknown {', '.join(shorten(key)[1:-1] for key in unknown[:10])}")
