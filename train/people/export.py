"""From a checkpoint to the person detector's ONNX file."""

import pathlib
from typing import Any

from muybridge.models.keypoints.network import CHANNELS
from muybridge.models.onnx_files.export import export_onnx
from muybridge.models.people.network import MEAN, STD, STRIDE, PeopleNet
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import IMAGES, training_metadata

LONG_SIDE = 320  # pixels of the images that the detector is trained for


def people_net(saved: dict[str, Any]) -> PeopleNet:
    """The averaged network of a checkpoint."""
    net = PeopleNet(**saved["config"])
    net.load_state_dict(saved["average"])
    return net.eval()


def publish_people(checkpoint: pathlib.Path, path: pathlib.Path, command: str) -> dict[str, Any]:
    """Write the person detector of `checkpoint`, trained by `command`, to `path`; return the file's metadata."""
    saved = load_checkpoint(checkpoint)
    metadata = training_metadata(saved, "people", command) | {
        "input_long_side": str(LONG_SIDE), "stride": str(STRIDE),
        "normalisation": f"{IMAGES}; mean {MEAN} and standard deviation {STD} are applied inside the graph",
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    export_onnx(people_net(saved), path, (2, CHANNELS, 192, 320), ("heatmap", "box"), metadata)
    return metadata
