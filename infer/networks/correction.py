"""The solver network: corrections of a fitted body's joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import ModelError
from muybridge.geometry.fitting.marker_fit import MarkerFit
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.rigid_bones import body_through
from muybridge.infer.networks.sessions import open_session
from muybridge.models.correction.features import apply_corrections, solver_input
from muybridge.models.metadata_reader import Reader, metadata_of

# Share of a correction that is applied: the largest with which no held-out take became worse than its fit. People
# differ from the training data, and most of the gain comes with half of a correction.
SHARE = 0.6


class SolverNetwork:
    """A solver network.

    Attributes:
        path: of the file.
        version: of the weights.
        spans: seconds, the windows over which it takes residuals.
    """

    def __init__(self, path: Path, threads: int = 1, batch: int = 256) -> None:
        """Open the file.

        Raises:
            ModelError: the file is missing, damaged or no solver network of muybridge's.
        """
        self.path, self._batch = path, batch
        self._session = open_session(path, threads)
        metadata = metadata_of(self._session, path)
        if metadata.get("muybridge_kind") != "solver":
            raise ModelError(
                f"{path}: is no solver network of muybridge's; leave the option out to use the shipped one"
            )
        read = Reader(metadata, path)
        self.version, self.spans = read.text("version"), read.seconds("spans")
        if read.names("names") != SURFACE.names or read.names("joints") != BODY.joint_names:
            raise ModelError(f"{path}: is of other markers or joints; train it again with this version of muybridge")

    def joints(self, fit: MarkerFit, points_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corrected rotations (T, J, 3, 3) and places (T, J, 3) in the world of BODY's joints.

        Args:
            fit: of the markers.
            points_world: (T, L, 3) metres, those that were fitted.
        """
        given = solver_input(fit, points_world, self.spans)
        answers = []
        for start in range(0, len(given.markers), self._batch):
            part = slice(start, start + self._batch)
            feed = {"markers": given.markers[part], "known": given.known[part], "joints": given.joints[part]}
            answers.append(self._session.run(None, feed)[0])
        return apply_corrections(given, SHARE * np.concatenate(answers))


def correct_joints(fit: MarkerFit, points_world: FloatArray, network: SolverNetwork) -> MarkerFit:
    """The fit with the network's corrections; bones keep one length over the take.

    Args:
        fit: of the markers.
        points_world: (T, L, 3) metres, those that were fitted.
        network: computes the corrections.
    """
    turns, places = network.joints(fit, points_world)
    bones, root, local = body_through(fit.motion.skeleton, turns, places)
    motion = Motion(bones, fit.motion.fps, root, continuous_quat(quat_from_matrix(local)))
    return replace(fit, motion=motion, body=replace(fit.body, skeleton=bones))
