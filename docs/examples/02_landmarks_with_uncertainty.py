"""Sub-pixel landmarks of one person and how well each is known, with nothing but onnxruntime and numpy.

    python 02_landmarks_with_uncertainty.py keypoints.onnx crop.npy

`crop.npy` holds a square RGB image of one person as uint8, with the side that the network's metadata states.
"""

# --8<-- [start:function]
import json
import sys

import numpy as np
import onnxruntime


def find_landmarks(network: onnxruntime.InferenceSession, crop: np.ndarray) -> dict[str, tuple]:
    """For each landmark x, y and the standard deviation of each, in pixels of the crop."""
    meta = network.get_modelmeta().custom_metadata_map
    stride, variance = int(meta["stride"]), json.loads(meta["variance"])
    image = crop.transpose(2, 0, 1)[None].astype(np.float32) / 255
    logits, visibility = network.run(["heatmaps", "visibility"], {"image": image})
    p = np.exp(logits[0])  # (landmarks, rows, columns)
    p /= p.sum(axis=(1, 2), keepdims=True)  # where each landmark is: a probability over cells
    v, u = np.unravel_index(p.reshape(len(p), -1).argmax(axis=1)[:, None, None], p.shape[1:])
    rows, columns = np.indices(p.shape[1:])
    near = p * ((columns - u) ** 2 + (rows - v) ** 2 <= 6)  # the best cell's neighbourhood, not a global mean
    u, v = ((near * x).sum(axis=(1, 2)) / near.sum(axis=(1, 2)) for x in (columns, rows))
    spread = (p * ((columns - u[:, None, None]) ** 2 + (rows - v[:, None, None]) ** 2)).sum(axis=(1, 2)) / 2
    spread = spread * stride**2
    sigma = np.sqrt(variance["scale"] * spread + variance["floor_px2"])
    if knots := variance.get("knots"):  # a finer map from spread to variance, linear in logarithms
        at, value = np.log(knots).T
        sigma = np.exp(np.interp(np.log(spread), at, value) / 2) * np.sqrt(np.maximum(spread / knots[-1][0], 1))
    hidden = 1 / (1 + np.exp(visibility[0]))  # the probability that something is in front of it
    sigma = sigma * variance.get("hidden", 1.0) ** (hidden / 2)
    sigma = sigma * np.sqrt(variance.get("landmarks") or 1.0)  # toes are better known than their spread suggests
    x, y = u * stride + (stride - 1) / 2, v * stride + (stride - 1) / 2
    return {name: (x[i], y[i], sigma[i]) for i, name in enumerate(json.loads(meta["names"]))}


# --8<-- [end:function]

if __name__ == "__main__":
    onnxruntime.set_default_logger_severity(3)  # one input may be left out, which it would remark on
    session = onnxruntime.InferenceSession(sys.argv[1])
    for name, (x, y, sigma) in find_landmarks(session, np.load(sys.argv[2])).items():
        print(f"{name} {x:.2f} {y:.2f} {sigma:.2f}")
