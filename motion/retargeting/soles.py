"""Soles of a character, measured on its meshes at rest."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.character import Character
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.retargeting.rig import SIDES, Rig

_MOST = 0.5  # of a vertex's weight: it belongs to the foot from here on
_SOLE_OF_LEG = 0.03  # sole below the lowest joint of a foot without mesh, as a share of the leg


@dataclass(frozen=True, eq=False)
class Soles:
    """The undersides of the feet.

    Attributes:
        heel: (2,) metres from the left and the right ankle down to the lowest point behind the middle of the foot.
        ball: (2,) metres from the ankle down to the lowest point before it.
        measured: whether there are meshes that show them.
    """

    heel: FloatArray
    ball: FloatArray
    measured: bool


def measure_soles(rig: Rig, character: Character | None) -> Soles:
    """The soles of a rig at rest.

    Args:
        rig: of the character.
        character: None for a skeleton without meshes, whose soles are a little below the lowest joint of each foot.
    """
    heel, ball, measured = np.zeros(2), np.zeros(2), False
    for k, side in enumerate(SIDES):
        foot = rig.roles[f"{side}_foot"]
        below = [j for j in range(len(rig.parents)) if foot in rig.above(j)]
        points = _vertices(rig, character, below) if character is not None else np.zeros((0, 3))
        ankle = rig.places[foot]
        if len(points):
            measured = True
            middle = (points[:, 1].min() + points[:, 1].max()) / 2
            behind, before = points[points[:, 1] >= middle], points[points[:, 1] <= middle]
            heel[k], ball[k] = ankle[2] - behind[:, 2].min(), ankle[2] - before[:, 2].min()
        else:
            ends = rig.places[below] + np.nan_to_num(rig.tips[below])
            lowest = min(ends[:, 2].min(), rig.places[below][:, 2].min()) - _SOLE_OF_LEG * rig.leg_length()
            heel[k] = ball[k] = ankle[2] - lowest
    return Soles(heel, ball, measured)


def _vertices(rig: Rig, character: Character, below: list[int]) -> FloatArray:
    """(N, 3) metres in the rig's axes, from the mover: the vertices of a foot at rest."""
    wanted = np.zeros(len(character.skeleton), np.bool_)
    wanted[[rig.joints[j] for j in below]] = True
    out = [np.zeros((0, 3))]
    for mesh, posed in zip(character.meshes, pose_meshes(character, character.rest_motion()), strict=True):
        share = (mesh.weights * wanted[mesh.joints]).sum(axis=1)
        out.append(posed[0][share > _MOST])
    return np.asarray((np.concatenate(out) - rig.mover_at_rest) @ rig.turn.T)
