"""The inside of surfaces on a grid."""

import numpy as np
import pytest

from muybridge.motion.character.rigging.paths import build_graph, find_branches, section
from muybridge.motion.character.rigging.repair import repair
from muybridge.motion.character.rigging.volume import fill_volume
from tests.motion.character.rigging.figures import capsule, person, together


def volume_of(parts, cells=60):
    whole = repair(*together(parts))
    return fill_volume(whole.vertices, whole.triangles, cells)


def cubic_metres(volume):
    return float(volume.inside.sum()) * volume.cell**3


BALL = capsule([0, 0, 0], [0, 0, 1e-3], 0.5, 0.5, 24, 48)
SIZE = 4 / 3 * np.pi * 0.5**3


def test_the_volume_of_a_ball():
    assert cubic_metres(volume_of([BALL])) == pytest.approx(SIZE, rel=0.03)


def test_parts_within_one_another_and_turned_parts_count_once():
    inner = capsule([0, 0, 0], [0, 0, 1e-3], 0.3, 0.3)
    turned = inner[0], inner[1][:, ::-1]
    for part in (inner, turned):
        assert cubic_metres(volume_of([BALL, part])) == pytest.approx(SIZE, rel=0.03)


def test_a_hole_does_not_drain_a_volume():
    vertices, triangles = BALL
    centre = vertices[triangles].mean(axis=1)
    open_ = vertices, triangles[np.linalg.norm(centre - [0, 0.5, 0], axis=1) > 0.2]
    assert len(open_[1]) < len(triangles)
    assert cubic_metres(volume_of([open_])) == pytest.approx(SIZE, rel=0.06)


def test_a_sheet_stays_as_a_layer_of_cells():
    sheet = np.array([[0.4, -0.2, 0.0], [1.2, -0.2, 0], [1.2, 0.2, 0], [0.4, 0.2, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    volume = volume_of([BALL, sheet])
    assert volume.inside[tuple(volume.cell_of(np.array([1.1, 0.0, 0.0])))]


def test_specks_are_left_out_and_bodies_are_counted():
    speck = capsule([0.9, 0.9, 0.9], [0.9, 0.9, 0.91], 0.01, 0.01)
    other = capsule([1.6, 0, 0], [1.6, 0, 0.01], 0.45, 0.45)
    assert volume_of([BALL, speck]).bodies == 1
    assert volume_of([BALL, other]).bodies == 2


def test_repair_welds_turns_and_drops():
    vertices, triangles = BALL
    apart = vertices[triangles.reshape(-1)]
    faces = np.concatenate([np.arange(len(apart)).reshape(-1, 3)[:, ::-1], [[0, 0, 1]]])
    whole = repair(apart, faces)
    assert len(whole.vertices) == len(vertices)
    assert whole.inside_out and whole.dropped == 1
    a, b, c = (whole.vertices[whole.triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    assert np.allclose(whole.vertices[whole.source], apart)


def test_ways_lead_to_the_ends_of_limbs_and_keep_to_their_middle():
    vertices, triangles, joints = person(20.0)
    whole = repair(vertices, triangles)
    graph = build_graph(fill_volume(whole.vertices, whole.triangles, 110))
    branches = find_branches(graph, graph.node_near(np.array([0, 0, 1.1])), 0.15)
    ends = np.array([b.points[0] for b in branches])
    assert len(branches) == 5
    for side, sign in (("left", 1), ("right", -1)):
        assert ((ends[:, 0] * sign > 0.7) & (ends[:, 2] > 1.0)).sum() == 1
        assert ((ends[:, 0] * sign > 0.05) & (ends[:, 2] < 0.1)).sum() == 1
        for part in ("forearm", "shin"):
            near = min(np.linalg.norm(b.points - joints[f"{side}_{part}"], axis=1).min() for b in branches)
            assert near < 0.025


def test_the_section_of_a_limb():
    volume = volume_of([capsule([0, 0, 0], [0, 0, 1], 0.1, 0.1, 12, 32)], 100)
    area, centre = section(volume, np.array([0.02, 0.0, 0.5]), np.array([0.0, 0.0, 1.0]), 0.3)
    assert area == pytest.approx(np.pi * 0.01, rel=0.35)
    assert np.linalg.norm(centre[:2]) < 0.01
