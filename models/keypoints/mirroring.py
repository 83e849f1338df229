"""What a network says of a crop and of its mirror image, as one."""

import numpy as np

from muybridge.arrays import Float32Array, IndexArray


def mean_of_mirrored(once: Float32Array, mirrored: Float32Array, twins: IndexArray) -> Float32Array:
    """The mean of what is said of crops and of their mirror images, as of the crops.

    Args:
        once: (N, J, h, w) heatmaps or (N, J) visibility, logits.
        mirrored: the same of the mirror images.
        twins: (J,) each landmark's counterpart on the other side.
    """
    back = mirrored[:, twins]
    return np.asarray((once + (back[..., ::-1] if back.ndim == 4 else back)) / 2, dtype=np.float32)
