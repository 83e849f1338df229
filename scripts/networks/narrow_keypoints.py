"""Write a pruned version of a trained keypoint network, to continue training from (`muybridge train keypoints --model
OUT`).

Usage: python -m scripts.networks.narrow_keypoints NETWORK.onnx OUT.onnx RENDERS
           [--depths 0 2 2 2] [--hidden 32 64 96 160]

The remaining channels take over the contribution of the removed ones, on held-out crops of RENDERS (see `prune`).
Prints scores before and after, without any training.
"""

import argparse
import pathlib

import numpy as np
import onnx

from muybridge.errors import ModelError
from muybridge.models.onnx_files.import_weights import keypoint_net_from_onnx
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.images.compositor import Compositor
from muybridge.train.images.dataset import HELD_OUT
from muybridge.train.images.options import WHOLE
from muybridge.train.keypoints.evaluate import load_model
from muybridge.train.keypoints.export import CALIBRATION_IMAGES, write_keypoints
from muybridge.train.keypoints.train import evaluate
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.store import load_renders
from scripts.networks.prune import prune

SEED = 30_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("renders", type=pathlib.Path)
    parser.add_argument("--depths", type=int, nargs=4, help="residual blocks a resolution; as they are")
    parser.add_argument("--hidden", type=int, nargs=4, help="channels within them; as they are")
    options = parser.parse_args()
    if options.out.exists():
        raise ModelError(f"{options.out} is there already; name another file")
    net, (_, card) = keypoint_net_from_onnx(options.network), load_model(options.network)
    people, backgrounds = load_renders(options.renders, HELD_OUT), make_backgrounds(256, SIZE, SEED)
    compositor = Compositor(people, backgrounds, card.input_size, SEED, WHOLE)
    seen, held_out = ([compositor.batch(64) for _ in range(count)] for count in (2, 4))
    depths, hidden = options.depths or net.config["depths"], options.hidden or net.config["hidden"]
    less = prune(net, depths, hidden, [batch.pixels.float().div(255) for batch in seen])
    metadata = {entry.key: entry.value for entry in onnx.load(str(options.network)).metadata_props}
    images = np.concatenate([batch.pixels.numpy() for batch in seen])[:CALIBRATION_IMAGES]
    write_keypoints(less, options.out, metadata, images)
    for name, each in (("before", net), ("after", less)):
        weights = sum(p.numel() for p in each.parameters())
        scores = evaluate(each, held_out)
        print(f"{name}: {weights:,} weights;", ", ".join(f"{key} {value:.3f}" for key, value in scores.items()))


if __name__ == "__main__":
    main()
