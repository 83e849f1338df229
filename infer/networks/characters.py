"""Networks for characters: weights of a skin, and joints in a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import onnxruntime

from muybridge.arrays import Float32Array, FloatArray
from muybridge.errors import ModelError
from muybridge.infer.networks.sessions import open_session
from muybridge.models.metadata_reader import Reader, metadata_of
from muybridge.motion.character.rigging.templates import TEMPLATES
from muybridge.motion.character.weights.graph import FEATURES, WeightGraph


class SkinningNetwork:
    """The network that corrects weights by heat.

    Attributes:
        path: of the file.
        version: of the weights.
    """

    def __init__(self, path: Path, threads: int = 1) -> None:
        """Open the file.

        Raises:
            ModelError: the file is missing, damaged or no such network of muybridge's.
        """
        self.path = path
        self._session, read = _open(path, threads, "skinning")
        self.version = read.text("version")
        if read.names("features") != FEATURES:
            raise ModelError(f"{path}: takes other features; train it again with this version of muybridge")

    def __call__(self, graph: WeightGraph) -> FloatArray:
        """(P, K) weights of the pairs of a graph, each row's sum one."""
        feed = {"features": graph.features, "base": graph.base, "exists": graph.exists,
                "parent": graph.parent.astype(np.int64), "same": graph.same.astype(np.int64)}  # fmt: skip
        return np.asarray(self._session.run(None, feed)[0], np.float64)


class RiggerNetwork:
    """The network that finds the joints of a standing body.

    Attributes:
        path: of the file.
        version: of the weights.
    """

    def __init__(self, path: Path, threads: int = 1) -> None:
        """Open the file.

        Raises:
            ModelError: the file is missing, damaged or no such network of muybridge's.
        """
        self.path = path
        self._session, read = _open(path, threads, "rigger")
        self.version = read.text("version")
        if read.names("roles") != TEMPLATES["human"].roles:
            raise ModelError(f"{path}: is of other joints; train it again with this version of muybridge")

    def __call__(self, points: Float32Array) -> tuple[FloatArray, FloatArray]:
        """Places (B, J, 3) and expected distances (B, J) from the true ones, shares of the height, of points
        (B, N, 6)."""
        places, spread = self._session.run(None, {"points": points})
        return np.asarray(places, np.float64), np.exp(np.asarray(spread, np.float64))


def _open(path: Path, threads: int, kind: Literal["skinning", "rigger"]) -> tuple[onnxruntime.InferenceSession, Reader]:
    """The session of a network of this kind, and the reader of its metadata."""
    session = open_session(path, threads)
    read = Reader(metadata_of(session, path), path)
    read.kind(kind)
    return session, read
