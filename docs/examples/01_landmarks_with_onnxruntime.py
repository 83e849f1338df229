"""The 23 landmarks of one person in a few lines, with nothing but onnxruntime and numpy.

    python 01_landmarks_with_onnxruntime.py keypoints.onnx crop.npy

`crop.npy` holds a square RGB image of one person as uint8, with the side that the network's metadata states.
"""

# --8<-- [start:snippet]
import json
import sys

import numpy
import onnxruntime

network = onnxruntime.InferenceSession(sys.argv[1])
meta = network.get_modelmeta().custom_metadata_map
image = numpy.load(sys.argv[2]).transpose(2, 0, 1)[None].astype("float32") / 255
heatmaps = network.run(["heatmaps"], {"image": image})[0][0]  # (landmarks, rows, columns), logits
names, stride = json.loads(meta["names"]), int(meta["stride"])
v, u = numpy.unravel_index(heatmaps.reshape(len(names), -1).argmax(axis=1), heatmaps.shape[1:])
pixels = numpy.stack([u, v], axis=1) * stride + (stride - 1) / 2  # of the crop; (0, 0) is its first pixel's centre
# --8<-- [end:snippet]

for name, (x, y) in zip(names, pixels, strict=True):
    print(f"{name} {x:.2f} {y:.2f}")
