"""Trajectories, votes, distances, cleaning and recovery of markers: known answers, no network."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from muybridge.geometry.markers.cleaning import CleanOptions, Sample, clean_markers, fill_pattern
from muybridge.geometry.markers.recovery import recover_points
from muybridge.geometry.markers.rigidity import RigidityOptions, distance_scores, measured_rigidity, prior_rigidity
from muybridge.geometry.markers.subjects import split_people
from muybridge.geometry.markers.tracking import Tracks, find_tracks
from muybridge.geometry.markers.voting import VoteOptions, assign_frames, assign_labels, cut_tracks, exchangeable, vote
from muybridge.geometry.smoothing.gap_models import gaps_of, rigid_gap

FPS = 100.0


def moving(count=200, markers=6, seed=0):
    """(T, M, 3) points that wander smoothly, at least 10 cm apart."""
    rng = np.random.default_rng(seed)
    time = np.arange(count)[:, None, None] / FPS
    at = np.stack(np.meshgrid(*[np.arange(3) * 0.4] * 3), -1).reshape(-1, 3)[:markers]
    return at + 0.12 * np.sin(2 * np.pi * rng.uniform(0.3, 1.2, (markers, 3)) * time + rng.uniform(0, 6, (markers, 3)))


def body(count=160, seed=1):
    """(T, 6, 3) points of a rigid body that turns and travels."""
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 0.15, (6, 3))
    angle = np.linspace(0, 3, count)
    turn = np.stack([np.stack([np.cos(angle), -np.sin(angle), 0 * angle], -1),
                     np.stack([np.sin(angle), np.cos(angle), 0 * angle], -1),
                     np.tile([0.0, 0, 1], (count, 1))], 1)  # fmt: skip
    path = np.stack([np.linspace(0, 2, count), 0.2 * np.sin(angle * 4), 1 + 0.1 * np.cos(angle * 5)], -1)
    return np.einsum("tij,mj->tmi", turn, shape) + path[:, None]


def purity(tracks, truth):
    """Share of points whose trajectory is mostly that point's."""
    right = total = 0
    for number in range(tracks.count):
        t, s = np.nonzero(tracks.track == number)
        who = np.linalg.norm(truth[t] - tracks.points[t, s][:, None], axis=-1).argmin(1)
        right += np.bincount(who).max()
        total += len(t)
    return right / total


def test_points_shuffled_in_every_frame_are_tracked():
    truth = moving()
    rng = np.random.default_rng(3)
    cloud = np.stack([frame[rng.permutation(6)] for frame in truth])
    tracks = find_tracks(cloud, FPS)
    assert tracks.tracked and tracks.count == 6 and purity(tracks, truth) == 1


def test_a_marker_out_of_sight_for_some_frames_stays_the_same_trajectory_and_a_long_gap_ends_it():
    truth = moving()
    rng = np.random.default_rng(4)
    cloud = truth.copy()
    cloud[80:86, 2] = np.nan
    cloud[100:150, 3] = np.nan
    cloud = np.stack([frame[rng.permutation(6)] for frame in cloud])
    tracks = find_tracks(cloud, FPS)
    assert tracks.count == 7 and purity(tracks, truth) == 1


def test_columns_that_are_trajectories_are_kept_and_cut_where_they_jump():
    cloud = moving()
    cloud[120:, [0, 1]] = cloud[120:, [1, 0]]
    tracks = find_tracks(cloud, FPS)
    assert not tracks.tracked and tracks.count == 8
    assert (np.diff(tracks.track[:, 0]) != 0).nonzero()[0].tolist() == [119]
    assert (tracks.column[:, 4] == 4).all()


def test_frames_alone_are_assigned_once_a_label():
    scores = np.log(np.array([[[0.6, 0.3, 0.1], [0.85, 0.05, 0.1], [np.nan] * 3]]))
    assert assign_frames(scores).tolist() == [[1, 0, -1]]


def test_label_assignment_is_optimal_where_all_overlap():
    rng = np.random.default_rng(5)
    for _ in range(10):
        votes = rng.normal(size=(24, 21))
        votes[:, -1] = -0.4
        label = assign_labels(votes, np.tile([0, 9], (24, 1)))
        named = label[label >= 0]
        assert len(set(named)) == len(named)
        gain = votes[:, :-1] - votes[:, -1:]
        rows, cols = linear_sum_assignment(np.concatenate([gain, np.zeros((24, 24))], 1), maximize=True)
        best = sum(gain[r, c] for r, c in zip(rows, cols, strict=True) if c < 20)
        won = sum(gain[p, label[p]] for p in range(24) if label[p] >= 0)
        assert won == pytest.approx(best, rel=0.01)


def test_trajectories_without_overlap_may_share_a_label():
    votes = np.array([[5.0, 0, 0], [4.0, 3.0, 0], [4.0, 0, 0]])
    assert assign_labels(votes, np.array([[0, 10], [5, 20], [11, 30]])).tolist() == [0, 1, 0]


def test_a_trajectory_is_split_at_permanent_label_changes_only():
    scores = np.full((200, 1, 4), -3.0)
    scores[:120, 0, 0], scores[120:, 0, 1] = -0.1, -0.1
    scores[40:43, 0, 2] = 0.0
    jumping = np.zeros((200, 1, 3))
    jumping[:120] += 0.1
    pieces = cut_tracks(scores, np.zeros((200, 1), int), jumping, FPS)
    assert np.nonzero(np.diff(pieces[:, 0]))[0].tolist() == [119]
    votes, span = vote(scores, pieces, FPS, VoteOptions())
    assert votes.argmax(1).tolist() == [0, 1] and span.tolist() == [[0, 119], [120, 199]]


def test_a_trajectory_is_exchanged_where_it_jumps_or_meets_another_and_not_elsewhere():
    time = np.linspace(-1, 1, 101)[:, None]
    points = np.stack([time * [1, 0, 0], time * [-1, 0, 0] + [0, 0.01, 0], time * [1, 0, 0] + [0, 0, 0.5]], 1)
    points[70:, 2] += [0, 0.2, 0]
    track = np.tile(np.arange(3), (101, 1))
    may = exchangeable(points, track)
    assert may[50, :2].all() and not may[:45, :2].any() and not may[56:, :2].any()
    assert np.nonzero(may[:, 2])[0].tolist() == [70, 71]  # where it jumps, and where its speed was that of the jump
    # Doubts in between do not cut it, however long they last.
    scores = np.full((101, 3, 4), -3.0)
    scores[:, [0, 1, 2], [0, 1, 2]] = -0.1
    scores[10:20, 0], scores[60:64, 0] = [-3, -3, -0.1, -3], [-3, -3, -0.1, -3]
    pieces = cut_tracks(scores, track, points, FPS, VoteOptions(switch=0.2))
    assert len(set(pieces[:45, 0])) == 1


def test_shuffled_frames_are_detected_at_any_frame_rate():
    cloud = moving()[::10]
    rng = np.random.default_rng(3)
    assert not find_tracks(cloud, FPS / 10).tracked
    assert find_tracks(np.stack([frame[rng.permutation(6)] for frame in cloud]), FPS / 10).tracked


def test_distances_separate_neighbouring_markers():
    points = body()
    away = np.linalg.norm(points[0][:, None] - points[0], axis=-1)
    prior = prior_rigidity(away * 1.2, np.full((6, 6), 0.005), np.full((6, 6), 0.05), 4)
    measured = measured_rigidity(points, prior, RigidityOptions())
    rows = np.arange(6)[:, None]
    assert np.abs(measured.mean_m - away[rows, prior.partners]).max() < 1e-9  # the person's, not the prior's
    owner = np.tile(np.arange(6), (len(points), 1))
    fit = distance_scores(points, points, owner, measured)
    own = fit[:, np.arange(6), np.arange(6)]
    assert own.min() > 0.7 and (fit.argmax(2) == np.arange(6)).mean() > 0.95


def test_a_rigid_body_fills_its_own_gaps_exactly():
    points = body()
    hidden = points.copy()
    hidden[60:110, 2] = np.nan
    others = [0, 1, 3, 4]
    for fill in (rigid_gap, fill_pattern):
        found = fill(hidden[:, 2], points[:, others], 60, 110)
        assert np.abs(found - points[60:110, 2]).max() < 1e-3, fill.__name__


def test_gaps_are_filled_by_the_best_method_and_marked():
    points = body()
    hidden = points.copy()
    hidden[30:34, 0] = np.nan  # short
    hidden[60:110, 2] = np.nan  # long: the body knows
    hidden[:20, 4] = np.nan  # at the start: the body again
    done = clean_markers(hidden, FPS)
    assert np.abs(done.points - points).max() < 2e-3
    measured = np.isfinite(hidden[..., 0])
    assert (done.sample[measured] == Sample.MEASURED).all() and (done.sample[~measured] >= Sample.CURVE).all()
    assert np.array_equal(done.points[measured], points[measured])
    assert np.isfinite(done.error_m[~measured]).all() and np.isnan(done.error_m[measured]).all()


def test_unpredictable_gaps_stay_open():
    points = moving(120, 2)
    points[40:80, 0] = np.nan
    done = clean_markers(points, FPS)
    assert np.isnan(done.points[40:80, 0]).all() and (done.sample[40:80, 0] == Sample.MISSING).all()
    kept = clean_markers(points, FPS, CleanOptions(fill=False))
    assert (kept.sample != Sample.CURVE).all()


def test_only_spikes_are_removed_and_refilled():
    points = body()
    spoilt = points.copy()
    rng = np.random.default_rng(8)
    spikes = np.zeros(points.shape[:2], bool)
    for t, m in ((20, 1), (50, 3), (51, 3), (90, 5), (130, 0)):
        spikes[t, m] = True
        spoilt[t, m] += rng.choice([-1, 1], 3) * 0.08
    done = clean_markers(spoilt, FPS)
    assert np.array_equal(done.spikes, spikes)
    assert np.abs(done.points - points).max() < 3e-3


def test_gaps_of_a_marker():
    assert gaps_of(np.array([False, True, False, False, True, False])) == [(0, 1), (2, 4), (5, 6)]
    assert gaps_of(np.ones(4, bool)) == []


def test_an_unlabelled_point_gets_the_label_of_a_missing_marker_and_a_ghost_does_not():
    points = moving(60, 3)
    cloud = np.concatenate([points, np.full((60, 2, 3), np.nan)], 1)
    label = np.tile([0, 1, 2, -1, -1], (60, 1))
    cloud[20:25, 3] = points[20:25, 1]  # the marker goes on in another column
    cloud[20:25, 1] = np.nan
    label[20:25, 1] = -1
    cloud[22, 4] = points[22, 1] + 0.3
    found = recover_points(cloud, label, np.zeros((60, 5, 3)))
    assert (found[20:25, 3] == 1).all() and found[22, 4] == -1
    assert np.array_equal(np.delete(found, range(20, 25), 0), np.delete(label, range(20, 25), 0))


def test_two_people_are_separated_and_one_is_not_split():
    one = moving(80, 12, 1)
    other = moving(80, 12, 2)[:, :10] + [1.5, 0.4, 0]
    cloud = np.concatenate([one, other], 1)[:, np.random.default_rng(0).permutation(22)]
    people = split_people(find_tracks(cloud, FPS), 12)
    assert len(people) == 2
    assert [int((p.track >= 0).sum()) for p in people] == [80 * 12, 80 * 10]
    nearest = np.linalg.norm(people[0].points[0][people[0].track[0] >= 0][:, None] - one[0], axis=-1).min(1)
    assert nearest.max() < 1e-9
    assert len(split_people(find_tracks(one, FPS), 12)) == 1


def test_empty_tracks():
    tracks = find_tracks(np.full((5, 3, 3), np.nan), FPS)
    assert isinstance(tracks, Tracks) and tracks.count == 0
