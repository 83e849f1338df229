"""Average fp32 networks of one training run, for keypoints or people, and write the mean as `muybridge train` would.

Usage: python -m scripts.networks.average_networks OUT RENDERS POOL NETWORK.onnx NETWORK.onnx ...

OUT is the new file; RENDERS and POOL (`pool-*.npy`) provide the held-out images for the scores. For keypoints these are
crops of the first network's size, on which the variance is calibrated too and the activation ranges of the 8-bit
version, written beside OUT, are measured.
"""

import pathlib
import sys

import onnx

from muybridge.train.engine.checkpoint import save_checkpoint
from muybridge.train.keypoints import train as keypoints
from muybridge.train.keypoints.evaluate import load_model
from muybridge.train.keypoints.export import keypoint_net, publish_keypoints
from muybridge.train.people import train as people
from muybridge.train.people.export import people_net, publish_people
from scripts.networks.weight_averaging import average_keypoints, average_people


def main() -> None:
    if len(sys.argv) < 6:
        raise SystemExit(__doc__)
    out, renders, pool, *networks = map(pathlib.Path, sys.argv[1:])
    metadata = {entry.key: entry.value for entry in onnx.load(str(networks[-1])).metadata_props}
    trained, names = metadata.get("training_command", "a training"), ", ".join(n.name for n in networks)
    command = f"{trained}; python -m scripts.networks.average_networks of {names}"
    checkpoint = out.with_suffix(".pt")
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    if metadata.get("muybridge_kind") == "people":
        saved = average_people(networks)
        saved["scores"] = people.evaluate(people_net(saved), people.held_out_scenes(renders, pool))
        save_checkpoint(checkpoint, saved)
        print(publish_people(checkpoint, out, command)["scores"])
    else:
        saved = average_keypoints(networks)
        batches = keypoints.held_out_batches(renders, pool, load_model(networks[0])[1].input_size, 24)
        saved["scores"] = keypoints.evaluate(keypoint_net(saved), batches[:8])
        save_checkpoint(checkpoint, saved)
        print(publish_keypoints(checkpoint, out, batches, command)["scores"])


if __name__ == "__main__":
    main()
