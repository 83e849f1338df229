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
_WAYS, _TILTS = 16, np.radians([10.0, 25.0, 45.0, 70.0])  # directions in which a foot's lowest points are looked for
_FLAT_OF_LEG = 0.006  # vertices that are at most so much higher than the lowest belong to the sole


@dataclass(frozen=True, eq=False)
class FootSkin:
    """Vertices of a foot that can be its lowest.

    Attributes:
        points: (N, 3) metres at rest, from the mover, in the axes of the rig.
        weights: (N, K) of the rig's joints.
    """

    points: FloatArray
    weights: FloatArray

    def lowest(self, rig: Rig, turns: FloatArray, places: FloatArray) -> FloatArray:
        """(T,) metres, the height of the lowest point; turns (T, K, 3, 3), places (T, K, 3) of the rig's joints."""
        heights = np.zeros((len(turns), len(self.points)))
        for j in np.nonzero(self.weights.any(axis=0))[0]:
            arms = self.points - rig.places[j]
            heights += self.weights[:, j] * (turns[:, j, 2] @ arms.T + places[:, j, 2, None])
        return np.asarray(heights.min(axis=1))


@dataclass(frozen=True, eq=False)
class Soles:
    """The undersides of the feet at rest, in the axes of the rig.

    Attributes:
        heel: (2, 3) metres from the left and the right ankle to the rear end of the sole.
        ball: (2, 3) metres from the ankle to the sole below the ball, or its fore end where a foot has no toes.
        measured: whether there are meshes that show them.
        skins: of the left and the right foot, the points that can touch the floor.
    """

    heel: FloatArray
    ball: FloatArray
    measured: bool
    skins: tuple["FootSkin", ...] = ()


def measure_soles(rig: Rig, character: Character | None) -> Soles:
    """The soles of a rig at rest.

    Args:
        rig: of the character.
        character: None for a skeleton without meshes, whose soles are a little below the lowest joint of each foot.
    """
    heel, ball, measured = np.zeros((2, 3)), np.zeros((2, 3)), False
    leg, skins = rig.leg_length(), []
    posed = pose_meshes(character, character.rest_motion()) if character is not None else []
    for k, side in enumerate(SIDES):
        foot, toe = rig.roles[f"{side}_foot"], rig.roles.get(f"{side}_toe", -1)
        below = [j for j in range(len(rig.parents)) if foot in rig.above(j)]
        skin = _skin(rig, character, [v[0] for v in posed], below) if character is not None else None
        points = skin.points if skin is not None else np.zeros((0, 3))
        if skin is not None and len(points):
            skins.append(_outermost(skin, below))
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
    return Soles(heel, ball, measured, tuple(skins) if len(skins) == 2 else ())


def _skin(rig: Rig, character: Character, vertices: list[FloatArray], below: list[int]) -> FootSkin:
    """The vertices of a foot at rest; what of their weight other joints have than the rig's is the foot's."""
    count = len(rig.joints)
    index = np.full(len(character.skeleton), count)
    index[list(rig.joints)] = np.arange(count)
    points, weights = [np.zeros((0, 3))], [np.zeros((0, count))]
    for mesh, posed in zip(character.meshes, vertices, strict=True):
        own = np.zeros((len(posed), count + 1))
        for k in range(mesh.joints.shape[1]):
            np.add.at(own, (np.arange(len(posed)), index[mesh.joints[:, k]]), mesh.weights[:, k])
        chosen = own[:, below].sum(axis=1) > _MOST
        points.append((posed[chosen] - rig.mover_at_rest) @ rig.turn.T)
        own[:, below[0]] += own[:, count]
        weights.append(own[chosen, :count])
    return FootSkin(np.concatenate(points), np.concatenate(weights))


def _outermost(skin: FootSkin, below: list[int]) -> FootSkin:
    """The vertices that are the lowest of their joint in some orientation, of feet that are not upside down."""
    ring = np.linspace(0, 2 * np.pi, _WAYS, endpoint=False)
    ways = [np.array([0.0, 0.0, -1.0])]
    ways += [np.array([np.cos(a) * np.sin(b), np.sin(a) * np.sin(b), -np.cos(b)]) for b in _TILTS for a in ring]
    chosen: set[int] = set()
    leader = skin.weights[:, below].argmax(axis=1)
    for j in range(len(below)):
        mine = np.nonzero(leader == j)[0]
        if len(mine):
            chosen.update(mine[(skin.points[mine] @ np.array(ways).T).argmax(axis=0)].tolist())
    order = sorted(chosen)
    return FootSkin(skin.points[order], skin.weights[order])
