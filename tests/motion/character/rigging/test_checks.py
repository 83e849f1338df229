"""What is no body is refused from its coarse volume, before any fine one is made."""

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.motion.character.rigging import RigOptions, rig_mesh
from muybridge.motion.character.rigging.checks import check_body
from tests.motion.character.rigging.figures import HEIGHT, animal, capsule, person, together

FLOOR = np.array([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
BODY = person(40.0)[:2]


def ball(radius):
    return capsule([0, 0, 0], [0, 0, 1e-3], radius, radius, 24, 48)


def loose_faces():
    rng = np.random.default_rng(0)
    return rng.normal(size=(3000, 3)), rng.integers(0, 3000, (3000, 3))


def beside(share):
    return together([BODY, (BODY[0] + [share * float(np.ptp(BODY[0][:, 0])), 0, 0], BODY[1])])


def armless():
    parts = [capsule([0, 0, 0.9], [0, 0, 1.45], 0.14, 0.12), capsule([0, 0, 1.45], [0, 0, 1.7], 0.07, 0.09)]
    for s in (1, -1):
        parts += [capsule([s * 0.09, 0, 0.9], [s * 0.1, 0, 0.08], 0.08, 0.05),
                  capsule([s * 0.1, 0.03, 0.06], [s * 0.1, -0.17, 0.05], 0.05, 0.04)]  # fmt: skip
    return together(parts)


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        (ball(0.9), "one lump"),
        (together([BODY, ball(20.0)]), "something around it"),
        (loose_faces(), "enclose nothing"),
        (together([BODY, FLOOR]), "such as a floor"),
        (beside(0.98), "two bodies that touch"),
        (animal(), "four legs"),
        (armless(), "no arms were found"),
    ],
    ids=["ball", "sky", "loose faces", "floor", "touching", "animal", "armless"],
)
def test_no_body_is_told_before_it_is_measured(mesh, said, monkeypatch):
    def late(*_, **__):
        raise AssertionError("the fine volume was made first")

    monkeypatch.setattr("muybridge.motion.character.rigging.rig._fine_volume", late)
    with pytest.raises(MuybridgeError, match=said):
        rig_mesh(*mesh)


def cape():
    """A sheet with two points behind the back, down to the floor."""
    k, x = np.meshgrid(np.arange(30), np.linspace(-1, 1, 21), indexing="ij")
    z = 0.82 * HEIGHT - k * (0.8 + 0.02 * np.abs(x)) * HEIGHT / 29.5
    width = 0.1 * HEIGHT + 0.012 * HEIGHT * k
    points = np.stack([x * width / 2, np.full(x.shape, 0.2) + 0.004 * k, z], axis=-1).reshape(-1, 3)
    corner = np.arange(29)[:, None] * 21 + np.arange(20)
    a, b, c, d = (v.ravel() for v in (corner, corner + 1, corner + 22, corner + 21))
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


@pytest.mark.parametrize("below", [-50.0, 0.0, 70.0])
@pytest.mark.parametrize("dressed", [False, True])
def test_people_of_any_pose_pass_with_a_cape_too(below, dressed):
    body = person(below)[:2]
    check_body(*(together([body, cape()]) if dressed else body), four_legs=False)


def test_an_animal_passes_where_one_is_expected():
    check_body(*animal(), four_legs=True)
    rig_mesh(*animal(), RigOptions(template="quadruped"))
