"""Soles of a character, measured on its meshes at rest."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.character import Character
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.retargeting.rig import SIDES, Rig

_MOST = 0.5  # of a vertex's weight: it belongs to the foot from here on
_SOLE_OF_LEG = 0.03  # sole below the lowest joint of a foot without mesh, as a share of the leg
_HEEL_OF_LEG = 0.05  # heel behind the ankle of such a foot
_FLAT_OF_LEG = 0.006  # vertices that are at most so much higher than the lowest belong to the sole


@dataclass(frozen=True, eq=False)
class Soles:
    """The undersides of the feet at rest, in the axes of the rig.

    Attributes:
        heel: (2, 3) metres from the left and the right ankle to the rear end of the sole.
        ball: (2, 3) metres from the ankle to the sole below the ball, or its fore end where a foot has no toes.
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
    heel, ball, measured = np.zeros((2, 3)), np.zeros((2, 3)), False
    leg = rig.leg_length()
    for k, side in enumerate(SIDES):
        foot, toe = rig.roles[f"{side}_foot"], rig.roles.get(f"{side}_toe", -1)
        below = [j for j in range(len(rig.parents)) if foot in rig.above(j)]
        points = _vertices(rig, character, below) if character is not None else np.zeros((0, 3))
        ankle, measured = rig.places[foot], measured or len(points) > 0
        if not len(points):
            ends = rig.places[below] + np.nan_to_num(rig.tips[below])
            points = np.concatenate([ends, rig.places[below]]) - [0, 0, _SOLE_OF_LEG * leg]
            points = np.concatenate([points, [ankle * [1, 1, 0] + [0, _HEEL_OF_LEG * leg, points[:, 2].min()]]])
        middle = (points[:, 1].min() + points[:, 1].max()) / 2
        for out, part in ((heel, points[points[:, 1] >= middle]), (ball, points[points[:, 1] <= middle])):
            low = part[part[:, 2] < part[:, 2].min() + _FLAT_OF_LEG * leg]
            end = low[:, 1].max() if out is heel else low[:, 1].min()
            if out is ball and toe >= 0:
                end = rig.places[toe, 1]
            out[k] = [0.0, end - ankle[1], part[:, 2].min() - ankle[2]]
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
