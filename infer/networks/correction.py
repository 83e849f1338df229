"""The solver's network at work: joints of a fitted body, corrected."""

from __future__ import annotations

import json
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
from muybridge.infer.networks.keypoints import OnnxOptions, open_session
from muybridge.models.correction.features import apply_corrections, solver_input

# So much of an answer is taken: the most with which no held-out take became worse than its fit. People differ from
# those who were trained on, and half a right answer is most of the gain where a whole one is too much.
SHARE = 0.6


class SolverNetwork:
    """A solver network.

    Attributes:
        path: of the file; version: of the weights; spans: seconds, the windows in which it sees residuals.
    """

    def __init__(self, path: Path, threads: int = 1, batch: int = 256) -> None:
        """Opens the file; ModelError where it is missing, damaged or no solver network of ours."""
        self.path, self._batch = path, batch
        self._session = open_session(path, OnnxOptions(threads, batch))
        said = dict(self._session.get_modelmeta().custom_metadata_map)
        if said.get("muybridge_kind") != "solver":
            raise ModelError(f"{path}: is no solver network of muybridge; leave the option out to use the shipped one")
        try:
            self.version = str(said["version"])
            names, joints = json.loads(said["names"]), json.loads(said["joints"])
            self.spans = tuple(float(s) for s in json.loads(said["spans"]))
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"{path}: its metadata is damaged ({error}); get the file again") from error
        if tuple(names) != SURFACE.names or tuple(joints) != BODY.joint_names:
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
    """The fit with the network's corrections, its bones again of one length for the take."""
    turns, places = network.joints(fit, points_world)
    bones, root, local = body_through(fit.motion.skeleton, turns, places)
    motion = Motion(bones, fit.motion.fps, root, continuous_quat(quat_from_matrix(local)))
    return replace(fit, motion=motion, body=replace(fit.body, skeleton=bones))
