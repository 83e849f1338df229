"""Metadata of a person detector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from muybridge.models.metadata_reader import Reader


@dataclass(frozen=True)
class PeopleModelCard:
    """Metadata of a person detector.

    Attributes:
        version: of the weights.
        input_long_side: length to which the longer side of a frame is resized, px.
        stride: input px per heatmap cell.
        metadata: all metadata, as text.
    """

    version: str
    input_long_side: int
    stride: int
    metadata: Mapping[str, str]


def people_card(metadata: Mapping[str, str], path: Path) -> PeopleModelCard:
    """Parse the metadata of a person detector; arguments and errors as in `keypoint_card`."""
    read = Reader(metadata, path)
    read.kind("people")
    return PeopleModelCard(
        version=read.text("version"),
        input_long_side=read.integer("input_long_side"),
        stride=read.integer("stride"),
        metadata=dict(metadata),
    )
