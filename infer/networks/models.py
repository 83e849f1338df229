"""Find and check the networks of a run before the first frame."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from muybridge.errors import ModelError
from muybridge.geometry.landmarks.marker_sets import SURFACE, MarkerChoice
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.networks.external import open_keypoints
from muybridge.infer.networks.keypoints import OnnxOptions, PeopleNetwork
from muybridge.infer.runtime.digests import file_digest
from muybridge.models.keypoints.external import find_card
from muybridge.models.shipped import Precision, shipped_model


@dataclass(frozen=True)
class Models:
    """The networks of a run, opened once to check them.

    Attributes:
        keypoints, people: the files.
        landmarks: the landmark set that the keypoint network finds.
        metadata: the files' own metadata, and their digests; for `run.json`.
        model_card: of the keypoint network, as it was named.
    """

    keypoints: Path
    people: Path
    landmarks: LandmarkSet
    metadata: dict[str, dict[str, str]]
    model_card: str | None = None

    @property
    def min_confidence(self) -> float | None:
        """The minimum confidence on the keypoint network's card; None for muybridge's own networks."""
        stated = self.metadata["keypoints"].get("min_confidence")
        return None if stated is None else float(stated)

    @property
    def sets(self) -> tuple[LandmarkSet, ...]:
        """All landmark sets that a run can find, the body's first."""
        return self.landmarks, SURFACE


class ModelChoice(Protocol):
    """Which networks to use; see `DetectOptions` for the fields."""

    @property
    def precision(self) -> Precision: ...
    @property
    def keypoint_model(self) -> Path | None: ...
    @property
    def model_card(self) -> str | None: ...
    @property
    def people_model(self) -> Path | None: ...
    @property
    def markers(self) -> MarkerChoice: ...
    @property
    def onnx(self) -> OnnxOptions: ...


def open_models(choice: ModelChoice) -> Models:
    """Find and check the networks.

    Raises:
        ModelError: a file is missing or is not a network that can be used.
    """
    if choice.model_card is not None and choice.keypoint_model is None:
        raise ModelError(f"a model card ({choice.model_card}) without a model", remedy="model_of_card")
    keypoints = choice.keypoint_model or shipped_model("keypoints", choice.precision)
    network = open_keypoints(keypoints, choice.model_card, choice.onnx, choice.markers != "none")
    card = find_card(keypoints, choice.model_card)
    if card is not None and choice.onnx.size is not None:  # not on opening: a first pass has a size of its own
        raise ModelError(f"{keypoints}: the size of crops is for muybridge's own networks; {card.name} states this "
                         "model's")  # fmt: skip
    people = choice.people_model or shipped_model("people")
    people_card = PeopleNetwork(people, choice.onnx).card
    metadata = {
        "keypoints": {
            **network.metadata,
            "file": keypoints.name,
            "sha256": file_digest(keypoints),
            **({} if card is None else {"card": card.name, "card_sha256": file_digest(card)}),
        },
        "people": {**people_card.metadata, "file": people.name, "sha256": file_digest(people)},
    }
    return Models(keypoints, people, network.landmarks, metadata, choice.model_card)
