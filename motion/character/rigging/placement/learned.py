"""Where a network sees the joints of a standing body, and what to make of two opinions."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.motion.character.rigging.points import POINTS, surface_points, upright_points
from muybridge.motion.character.rigging.templates import TEMPLATES

# Places (B, J, 3) and expected distances (B, J) from the true ones, shares of the height, of points (B, N, 6).
RigNetwork = Callable[[Float32Array], tuple[FloatArray, FloatArray]]
ROLES = TEMPLATES["human"].roles
_DRAWS = 3  # sets of points, each also mirrored
_SHARE = 0.6  # of the network where both agree
_APART = 2.0  # times the expected distance up to which they do
_OTHER = {"left": "right", "right": "left"}


class Opinion(NamedTuple):
    """Where joints are thought to be.

    Attributes:
        places: role -> (3,) metres in the body's own frame.
        expected: role -> metres, the expected distance from the true place.
        height: of the body, metres.
    """

    places: dict[str, FloatArray]
    expected: dict[str, float]
    height: float


def mirrored_roles() -> IntArray:
    """(J,) the joint on the other side."""
    return np.array([ROLES.index("_".join(_OTHER.get(w, w) for w in role.split("_"))) for role in ROLES])


def learned_places(vertices: FloatArray, triangles: IntArray, network: RigNetwork) -> Opinion:
    """Where a network sees the joints, the mean over several sets of points and their mirror images.

    Args:
        vertices: (V, 3) metres in the body's own frame: it stands, faces -Y, and is symmetric about x = 0.
        triangles: (F, 3).
        network: finds joints.
    """
    rng = np.random.default_rng(0)
    given, origins, heights = [], [], []
    flip = np.array([-1, 1, 1, -1, 1, 1], np.float32)
    for _ in range(_DRAWS):
        points = surface_points(vertices, triangles, POINTS, rng)
        for each in (points, points * flip):
            upright, origin, height = upright_points(each)
            given.append(upright)
            origins.append(origin)
            heights.append(height)
    places, expected = network(np.stack(given))
    scale = np.array(heights)[:, None]
    places = places * scale[..., None] + np.stack(origins)[:, None]
    other = mirrored_roles()
    places[1::2] = places[1::2, other] * [-1, 1, 1]
    expected[1::2] = expected[1::2, other]
    mean, far = places.mean(axis=0), (expected * scale).mean(axis=0)
    return Opinion(dict(zip(ROLES, mean, strict=True)), dict(zip(ROLES, far.tolist(), strict=True)),
                   float(np.mean(heights)))  # fmt: skip


def agreed(measured: Mapping[str, FloatArray], seen: Opinion) -> dict[str, FloatArray]:
    """Role -> (3,) metres, between what is measured and what a network sees.

    Two opinions that are near to each other are averaged, since their errors have little in common. Where they are
    farther apart than the network expects to be off, the network is right more often: it has seen other proportions
    than those of people.

    Args:
        measured: role -> (3,) metres.
        seen: by the network.
    """
    out = dict(measured)
    for role, place in seen.places.items():
        if role in measured:
            apart = float(np.linalg.norm(np.asarray(measured[role]) - place))
            share = _SHARE if apart <= _APART * seen.expected[role] else 1.0
            out[role] = (1 - share) * np.asarray(measured[role]) + share * place
    return out
