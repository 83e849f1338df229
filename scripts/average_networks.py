#!/usr/bin/env python3
"""Averages fp32 keypoint networks of one training run and writes the mean as `muybridge train keypoints` would.

usage: python scripts/average_networks.py OUT RENDERS POOL NETWORK.onnx NETWORK.onnx ...

OUT is the new file, its 8-bit version goes beside it; RENDERS and POOL (`pool-*.npy`) give the held-out crops that
the score, the variance and the 8-bit ranges are taken from, as large as the first network's.
"""

import pathlib
import sys

import torch

from muybridge.train.averaging import average_keypoints
from muybridge.train.evaluation import load_model
from muybridge.train.keypoints import evaluate, held_out_batches
from muybridge.train.publish import keypoint_net, publish_keypoints


def main() -> None:
    if len(sys.argv) < 6:
        raise SystemExit(__doc__)
    out, renders, pool, *networks = map(pathlib.Path, sys.argv[1:])
    saved = average_keypoints(networks)
    batches = held_out_batches(renders, pool, load_model(networks[0])[1].input_size, 24)
    saved["scores"] = evaluate(keypoint_net(saved), batches[:8])
    checkpoint = out.with_suffix(".pt")
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    torch.save(saved, checkpoint)
    command = f"python scripts/average_networks.py of {', '.join(n.name for n in networks)}"
    print(publish_keypoints(checkpoint, out, batches, command)["scores"])


if __name__ == "__main__":
    main()
