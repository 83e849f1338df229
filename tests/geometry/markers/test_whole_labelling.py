"""The whole labelling against known answers, without a network."""

import numpy as np

from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.markers.fit import geometry_of
from muybridge.geometry.markers.groups import groups_of, head_posture
from muybridge.geometry.markers.voting import VoteOptions, cut_tracks, join_pieces, share_votes
from muybridge.geometry.markers.whole import Judge, find_columns, known_bodies

NAMES = ("left_knee_lateral", "left_malleolus_lateral", "left_heel", "left_toe", "right_knee_lateral",
         "right_malleolus_lateral", "right_heel", "right_toe")  # fmt: skip


def legs(extra=0, frames=40):
    """Markers (T, 8 + extra, 3) of two shanks that swing, and markers beyond the set beside the knees."""
    leg = np.array([[0.05, 0.15, 0.5], [0.04, 0.15, 0.08], [-0.04, 0.1, 0.05], [0.17, 0.11, 0.04]])
    shape = np.concatenate([leg, leg * [1, -1, 1], np.array([[0.05, 0.05, 0.5], [0.05, -0.05, 0.5]])[:extra]])
    angle = 0.2 * np.sin(np.linspace(0, 6, frames))[:, None]
    turned = shape[None].repeat(frames, 0)
    turned[..., 0] += angle * turned[..., 2]
    return turned


def judged(points, label, scores):
    distance = np.linalg.norm(legs()[0][:, None] - legs()[0], axis=-1)
    motion = np.where(distance > 0.35, 0.03, 0.002)
    track = np.tile(np.arange(points.shape[1]), (len(points), 1))
    bodies = known_bodies(distance, motion, 0.05 * distance, NAMES)
    return Judge(find_columns(points, track, label, scores), bodies)


def test_names_move_back_from_markers_beyond_the_set():
    points = legs(extra=2)
    label = np.tile([-1, 1, 2, 3, -1, 5, 6, 7, 0, 4], (len(points), 1))  # the medial knees have the lateral names
    scores = np.full((*label.shape, 9), -4.0)
    t, s = np.nonzero(label >= 0)
    scores[t, s, label[t, s]] = -0.3
    scores[:, 0, 0] = scores[:, 4, 4] = -0.8
    judge = judged(points, label, scores)
    better = judge.improve(judge.start)
    assert judge.quality(better) > judge.quality(judge.start)
    assert np.array_equal(judge.columns.place[0, better], points[0, :8])


def test_quality_is_what_its_alternatives_say():
    points = legs(extra=2)
    label = np.tile([0, 1, 2, 3, 4, 5, 6, 7, -1, -1], (len(points), 1))
    rng = np.random.default_rng(0)
    judge = judged(points, label, rng.uniform(-5, 0, (*label.shape, 9)))
    gains = judge.alternatives(judge.start)
    for a, k in ((0, 8), (2, 9), (1, -1)):
        moved = judge.start.copy()
        moved[a] = k
        gain = gains[a, k if k >= 0 else gains.shape[1] - 1]
        if np.isfinite(gain):
            assert np.isclose(judge.quality(moved) - judge.quality(judge.start), gain)
    swapped = judge.start.copy()
    swapped[[2, 1]] = swapped[[1, 2]]
    assert np.isclose(judge.quality(swapped) - judge.quality(judge.start), gains[1, 2])
    order = geometry_of(judge.start, judge.seen, judge.known, judge.bodies.twin, judge.scale, judge.weights)
    assert np.isclose(order, judge.geometry(judge.start)) and judge.fit(judge.start).min() > 0


def test_a_search_never_makes_the_whole_worse():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        points = legs(extra=2)[:, rng.permutation(10)] + rng.normal(0, 0.03, (1, 10, 3))
        label = np.tile(np.where(rng.random(10) < 0.8, rng.permutation(10), -1), (len(points), 1))
        label[label >= 8] = -1
        judge = judged(points, label, rng.uniform(-5, 0, (*label.shape, 9)))
        assert judge.quality(judge.improve(judge.start)) >= judge.quality(judge.start) - 1e-9


def test_a_head_turned_far_is_more_usual_than_one_that_leans_far():
    names = ("left_front_head", "right_front_head", "left_back_head", "right_back_head", "left_acromion",
             "right_acromion")  # fmt: skip
    head = np.array([[0.08, 0.06, 1.74], [0.08, -0.06, 1.74], [-0.08, 0.05, 1.66], [-0.08, -0.05, 1.66]])
    angle = np.radians(-50)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    place = np.concatenate([head @ turn.T, [[0, 0.18, 1.45], [0, -0.18, 1.45]]])[None]
    right = head_posture(place, np.arange(6), names)
    assert right > head_posture(place, np.array([2, 0, 3, 1, 4, 5]), names) + 3
    assert right > head_posture(place, np.array([3, 2, 1, 0, 4, 5]), names)
    assert head_posture(place, np.array([0, 1, -1, 3, 4, 5]), names) == 0


def test_groups_are_the_head_the_hands_and_the_feet():
    groups = [{PLUG_IN_GAIT.labels[i] for i in g} for g in groups_of(PLUG_IN_GAIT.names)]
    assert {"LFHD", "RFHD", "LBHD", "RBHD"} in groups and {"RWRA", "RWRB", "RFIN"} in groups
    assert {"LANK", "LHEE", "LTOE"} in groups and len(groups) == 5


def test_a_short_piece_of_a_column_follows_its_neighbours():
    scores = np.full((60, 1, 3), np.log(0.05))
    scores[:, 0, 0] = np.log(0.9)
    scores[30:34, 0, 0], scores[30:34, 0, 1] = np.log(0.3), np.log(0.6)
    there = np.ones(60, bool)
    there[25:30] = there[34:40] = False
    scores[~there] = np.nan
    track = np.where(there, np.cumsum(np.diff(there, prepend=False) & there) - 1, -1)[:, None]
    points = np.where(there[:, None, None], np.zeros((60, 1, 3)), np.nan)
    whole = join_pieces(track, np.where(track >= 0, 0, -1), False)
    pieces = cut_tracks(scores, track, points, 100.0, VoteOptions(), whole)
    assert len(np.unique(pieces[there])) == 1
    assert np.array_equal(join_pieces(track, track, True), track)
    votes = np.array([[-1.0, -9.0, -9.0], [-2.0, -1.5, -3.0], [-5.0, -0.5, -3.0]])
    shared = share_votes(votes, np.array([0, 0, 1]), 0.5)
    assert shared[1].argmax() == 0 and shared[2].argmax() == 1
