"""The demo's take, which is part of the package, and its ground truth."""

from importlib import resources
from importlib.resources.abc import Traversable

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import SessionError

TAKE, TRUTH = "take", "truth.npz"


def demo_folder() -> Traversable:
    """The take inside the package: `videos/`, `calibration.toml` and `truth.npz`.

    Raises:
        SessionError: it is missing from the installation.
    """
    folder = resources.files("muybridge.infer").joinpath("demo_take")
    if not folder.joinpath(TRUTH).is_file():
        raise SessionError(f"{folder}: the demo's take is missing; reinstall muybridge")
    return folder


def true_points(folder: Traversable) -> tuple[FloatArray, list[str]]:
    """(T, K, 3) metres, and the (K,) landmarks' names, of a take like the demo's."""
    with folder.joinpath(TRUTH).open("rb") as file, np.load(file) as truth:
        return truth["points_world"], [str(n) for n in truth["names"]]
