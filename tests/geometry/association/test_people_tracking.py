"""Tracking of people in 3D: crossings, absence and return, accidental intersections; and its ray primitives."""

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import take_slots
from muybridge.geometry.association.tracker import PeopleTracker, identify_people, track_people
from muybridge.geometry.association.tracks import BodyTrack, drop_stray_end
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.rays import nearest_points, pair_points, ray_directions
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.triangulation.multiview import triangulate


@pytest.fixture(scope="module")
def bench(script: Callable[[str], ModuleType]) -> ModuleType:
    """The benchmark's model of people, cameras and detections."""
    return script("benchmarks.takes.people")


@pytest.mark.parametrize("fps", [10.0, 30.0, 60.0])
def test_identities_survive_crossings(bench, fps: float) -> None:
    frames, rng = round(5 * fps), np.random.default_rng(7)
    cameras, people = bench.room(5, rng), bench.walkers(3, frames, rng, fps)
    middle = people[..., :2].mean(2)
    assert np.linalg.norm(middle[0] - middle[1], axis=-1).min() < 1.5  # they do meet
    keypoints = bench.keypoints_of(cameras, people, 7, 6)
    switches, error = bench.compare(people, bench.solved(cameras, keypoints, fps))
    assert switches == 0
    assert np.isfinite(error).any(-1).mean() > 0.9
    assert np.nanmean(error) < 30


def test_coasting_time_does_not_depend_on_the_frame_rate(bench) -> None:
    """Invisible for half a second, at 20 and 120 frames per second: the track continues or ends at both rates."""
    for fps in (20.0, 120.0):
        rng = np.random.default_rng(3)
        cameras, people = bench.room(4, rng), bench.walkers(1, round(2 * fps), rng, fps)
        keypoints = seen_exactly(cameras, list(people))
        px = keypoints.points_px.copy()
        px[:, round(fps) : round(1.5 * fps)] = np.nan
        for coast, bodies in ((1.0, 1), (0.25, 2)):
            options = TrackingOptions(coast=coast)
            tracker = PeopleTracker(cameras, keypoints.landmarks, options, fps)
            tracker.extend(px)
            assert len(tracker.finish()) == bodies, (fps, coast)


def test_a_person_who_leaves_and_returns_is_identified(bench) -> None:
    rng = np.random.default_rng(3)
    cameras, people = bench.room(4, rng), bench.walkers(2, 200, rng)
    keypoints = bench.keypoints_of(cameras, people, 3, 6)
    px = keypoints.points_px.copy()
    # The second person is invisible for two seconds.
    truth = cameras.project(people)
    for c in range(4):
        away = np.nanmedian(np.linalg.norm(px[c, 60:120] - truth[c, 1, 60:120, None], axis=-1), axis=-1)
        px[c, 60:120][away < 40] = np.nan
    switches, error = bench.compare(people, bench.solved(cameras, replace(keypoints, points_px=px)))
    assert switches == 0
    assert np.isnan(error[1, 70:110]).all() and np.isfinite(error[1, 140:]).any(-1).mean() > 0.8


def test_accidental_agreement_of_two_cameras_gives_no_person(bench) -> None:
    rng = np.random.default_rng(5)
    cameras, people = bench.room(5, rng), bench.walkers(1, 60, rng)
    keypoints = bench.keypoints_of(cameras, people, 5, 6)
    assert len(track_people(cameras, keypoints)) == 1
    # A person seen by a single camera has no 3D track.
    single = keypoints.points_px.copy()
    single[1:] = np.nan
    assert track_people(cameras, replace(keypoints, points_px=single)) == []


def test_slots_are_disjoint_and_point_at_detections(bench) -> None:
    rng = np.random.default_rng(11)
    cameras, people = bench.room(4, rng), bench.walkers(4, 60, rng)
    keypoints = bench.keypoints_of(cameras, people, 11, 6)
    found = track_people(cameras, keypoints, TrackingOptions())
    taken = np.zeros(keypoints.points_px.shape[:3], int)
    for slots in found:
        c, t = np.nonzero(slots >= 0)
        np.add.at(taken, (c, t, slots[c, t]), 1)
        px, variance, _ = take_slots(keypoints, slots)
        assert np.isfinite(px[c, t]).any(axis=(-1, -2)).all()
        assert np.isfinite(triangulate(cameras, px, variance).points_world).any()
    assert taken.max() == 1


@pytest.mark.parametrize(("count", "frames", "fps"), [(4, 150, 60.0), (5, 140, 30.0)])
def test_tracking_frame_by_frame_gives_the_tracks_of_the_whole_take(bench, count: int, frames: int, fps: float) -> None:
    rng = np.random.default_rng(count)
    cameras, people = bench.room(count, rng), bench.walkers(3, frames, rng, fps)
    keypoints = bench.keypoints_of(cameras, people, count, 6)
    tracker = PeopleTracker(cameras, keypoints.landmarks, None, fps)
    followed = [tracker.step(keypoints.points_px[:, t]) for t in range(frames)]
    assert all(len(people) >= 3 for people in followed[frames // 2 :])
    stepwise = identify_people(tracker.finish(), keypoints.landmarks, None, fps)
    whole = track_people(cameras, keypoints, None, fps)
    assert len(whole) == len(stepwise) == 3
    for a, b in zip(whole, stepwise, strict=True):
        np.testing.assert_array_equal(a, b)


def seen_exactly(cameras, slots: list[np.ndarray]) -> Keypoints2D:
    """Detections of people (T, J, 3), one per slot, without error; NaN where missing."""
    px = np.stack([cameras.project(s) for s in slots], axis=2)
    known = np.isfinite(px).all(-1)
    return Keypoints2D(BODY23, px, np.where(known, 4.0, np.nan), known * 0.9)


def test_tracks_reach_back_over_wrong_first_detections(bench) -> None:
    """Two cameras see a person arrive; one of them is wrong for a third of a second."""
    rng = np.random.default_rng(4)
    cameras, people = bench.room(4, rng), bench.walkers(1, 120, rng, 60.0)
    keypoints = seen_exactly(cameras, [people[0]])
    px = keypoints.points_px.copy()
    px[2:, :40] = np.nan
    px[1, :20] += 0.25 * np.ptp(px[1, :20], axis=-2, keepdims=True)
    found = track_people(cameras, replace(keypoints, points_px=px), TrackingOptions(), 60.0)
    assert len(found) == 1
    assert (found[0][0] >= 0).all() and (found[0][1, :20] < 0).all() and (found[0][1, 22:] >= 0).all()


def test_close_passes_do_not_merge_people(bench) -> None:
    """After four seconds one person passes close to another, and hides them in some cameras."""
    seed, until = 7 + 5000 + 400, 170
    rng = np.random.default_rng(seed)
    cameras, people = bench.room(4, rng), bench.walkers(5, 300, rng)
    whole = bench.keypoints_of(cameras, people, seed, 6)
    cut = {name: getattr(whole, name)[:, :until] for name in ("points_px", "variance_px2", "score")}
    switches, error = bench.compare(people[:, :until], bench.solved(cameras, replace(whole, **cut)))
    assert switches == 0
    assert np.isfinite(error).any(-1).mean(1).min() > 0.95


def test_accidental_end_of_a_lost_body_is_dropped() -> None:
    points = np.zeros((23, 3))
    slots = np.zeros((3, 100), int)
    body = BodyTrack(points, slots, True, 0, met=45, track={t: points for t in [*range(40), 60, 61, 90, 91, 92]})
    drop_stray_end(body, 5, 6.0)
    assert sorted(body.track) == list(range(40)) and body.met == 40
    assert (body.slots[:, :40] == 0).all() and (body.slots[:, 40:] == -1).all()
    long = BodyTrack(points, slots * 0, True, 0, met=46, track={t: points for t in [*range(40), *range(60, 66)]})
    drop_stray_end(long, 5, 6.0)
    assert len(long.track) == 46


def test_a_near_view_with_growing_errors_does_not_split_a_person(bench) -> None:
    rng = np.random.default_rng(2)
    cameras, people = bench.room(5, rng), bench.walkers(1, 80, rng)
    cameras = CameraGroup(cameras.cameras[:3])
    keypoints = seen_exactly(cameras, [people[0]])
    px = keypoints.points_px.copy()
    near = int(np.linalg.norm(cameras.centers_world - people[0].mean((0, 1)), axis=1).argmin())
    # The border of its image cuts the person off: the detection shrinks into a corner.
    for k, t in enumerate(range(40, 60)):
        corner = px[near, t, 0].min(axis=0)
        px[near, t, 0] = corner + (px[near, t, 0] - corner) * max(0.1, 1 - 0.08 * k)
    px[near, 60:] = np.nan
    found = track_people(cameras, replace(keypoints, points_px=px))
    assert len(found) == 1
    others = [c for c in range(3) if c != near]
    assert (found[0][others] == 0).all()
    assert (found[0][near, :40] == 0).all() and (found[0][near, 50:] == -1).all()


def test_a_person_beside_a_camera_gets_none_of_its_detections(bench) -> None:
    """Far outside of the image, the polynomial of a lens magnifies a person beyond all bounds."""
    rng = np.random.default_rng(3)
    cameras, people = bench.room(4, rng), bench.walkers(1, 90, rng)
    tripod = cameras.cameras[3]
    tripod = replace(tripod, model="OPENCV", params=(*tripod.params, -0.08, 0.08, 0.0, 0.0))
    cameras = CameraGroup((*cameras.cameras[:3], tripod))
    beside = tripod.center_world + 0.7 * tripod.rotation[2] + 1.2 * tripod.rotation[0]
    other = people[0] - people[0].mean(1, keepdims=True) + beside
    keypoints = seen_exactly(cameras, [people[0], other])
    keypoints.points_px[2:, :, 1] = np.nan  # only those across the room see them
    keypoints.points_px[:] += rng.normal(0, 6, keypoints.points_px.shape)
    found = track_people(cameras, keypoints)
    assert [(slots[2:] >= 0).any() for slots in found] in ([True, False], [False, True])
    assert any((slots == 0).all() for slots in found)


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_short_false_detections_are_no_person(bench, fps: float) -> None:
    """A shadow that four cameras detect as a person for 0.4 s; a person who is visible for 0.4 s twice."""
    rng = np.random.default_rng(6)
    cameras, people = bench.room(4, rng), bench.walkers(1, round(3 * fps), rng, fps)
    beside = people[0] + [0.9, 0.0, 0.0]
    first, again = slice(round(0.5 * fps), round(0.9 * fps)), slice(round(1.2 * fps), round(1.6 * fps))
    for there, count in (((first,), 1), ((first, again), 2)):
        other = np.full_like(beside, np.nan)
        for frames in there:
            other[frames] = beside[frames]
        assert len(track_people(cameras, seen_exactly(cameras, [people[0], other]), fps=fps)) == count


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_a_person_seen_by_two_cameras_has_to_be_visible_for_longer(bench, fps: float) -> None:
    rng = np.random.default_rng(6)
    cameras, people = bench.room(4, rng), bench.walkers(1, round(5 * fps), rng, fps)
    for seconds, seen_by, count in ((0.8, 2, 1), (0.8, 3, 2), (1.3, 2, 2)):
        other = people[0] + [0.9, 0.0, 0.0]
        other[round((1 + seconds) * fps) :] = other[: round(fps)] = np.nan
        found = seen_exactly(cameras, [people[0], other])
        found.points_px[seen_by:, :, 1] = np.nan
        assert len(track_people(cameras, found, fps=fps)) == count, (seconds, seen_by)


def test_shadows_are_dropped_and_lying_people_are_kept(bench) -> None:
    rng = np.random.default_rng(6)
    cameras, people = bench.room(4, rng), bench.walkers(1, 90, rng)
    person = people[0]
    shadow = person.copy()
    shadow[..., 0] += 0.9 * person[..., 2]
    shadow[..., 2] = rng.normal(0, 0.01, person.shape[:2])
    assert len(track_people(cameras, seen_exactly(cameras, [person, shadow]))) == 1
    # The feet that throw it are taken for its own.
    feet = [k for k, name in enumerate(BODY23.names) if name.endswith(("ankle", "heel", "toe"))]
    with_feet = shadow.copy()
    with_feet[:, feet[:6], 2] += 0.12
    assert len(track_people(cameras, seen_exactly(cameras, [person, with_feet]))) == 1
    # Without a standing person as a reference for the floor, nobody is dropped.
    assert len(track_people(cameras, seen_exactly(cameras, [shadow]))) == 1
    # Who lies on their back, 1 m away: half a trunk above the floor.
    still = person[:1] - person[:1].mean(axis=(1,), keepdims=True)
    lying = np.stack([still[..., 0] - 1.2, still[..., 2], 0.12 - still[..., 1]], -1).repeat(len(person), 0)
    assert len(track_people(cameras, seen_exactly(cameras, [person, lying + person[:1, :1] * [1, 1, 0]]))) == 2


def test_duplicate_detections_give_one_person(bench) -> None:
    rng = np.random.default_rng(4)
    cameras, people = bench.room(4, rng), bench.walkers(1, 60, rng)
    person = people[0]
    # A second box on the same person, in which limbs are mistaken; the first one is lost three frames later.
    limbs = [n for n, name in enumerate(BODY23.names) if name.split("_")[-1] not in ("shoulder", "hip")]
    other = person + [0.1, 0.0, 0.0]
    other[:, limbs] += rng.normal(0, 0.25, (len(limbs), 3))
    first, second = person.copy(), np.full_like(person, np.nan)
    second[40:], first[43:] = other[40:], np.nan
    found = track_people(cameras, seen_exactly(cameras, [first, second]))
    assert len(found) == 1 and (found[0] >= 0).all()
    # While both are present, the second is dropped.
    both = person.copy()
    second[50:] = np.nan
    assert len(track_people(cameras, seen_exactly(cameras, [both, second]))) == 1
    # A person at an arm's length is kept.
    assert len(track_people(cameras, seen_exactly(cameras, [person, person + [0.6, 0.0, 0.0]]))) == 2


def test_wrong_views_that_attract_others_give_no_second_person(bench) -> None:
    rng = np.random.default_rng(6)
    cameras, people = bench.room(4, rng), bench.walkers(1, 60, rng)
    true, false = people[0], people[0] + [0.35, 0.0, 0.1]
    px = np.stack([cameras.project(true)], axis=2)
    # Two cameras are wrong from frame 20 on; from 40 on the others agree with them.
    px[:2, :20], px[:2, 20:, 0] = np.nan, cameras.project(false)[:2, 20:]
    px[2:, 40:, 0] = cameras.project(false)[2:, 40:]
    keypoints = seen_exactly(cameras, [true])
    found = track_people(cameras, replace(keypoints, points_px=px))
    assert len(found) == 1 and (found[0][2:] == 0).all() and (found[0][:2, 20:] == 0).mean() > 0.9
    # Where cameras see both at a time they are two.
    both = np.concatenate([px, np.stack([cameras.project(people[0] + [0.9, 0.4, 0.0])], axis=2)], axis=2)
    two = Keypoints2D(BODY23, both, np.full(both.shape[:-1], 4.0), np.full(both.shape[:-1], 0.9))
    assert len(track_people(cameras, two)) == 2


def test_rays_meet_where_the_point_is(bench) -> None:
    rng = np.random.default_rng(0)
    cameras, body = bench.room(4, rng), bench.BODY
    rays = ray_directions(cameras, cameras.project(body))
    centers = cameras.centers_world
    points, away = nearest_points(centers, rays[:, None], np.ones((4, 1)))
    np.testing.assert_allclose(points[0], body, atol=1e-6)
    assert np.nanmax(away) < 1e-6
    # One camera's gross errors do not move the points by much.
    rays[2] = ray_directions(cameras, cameras.project(body) + 80.0)[2]
    points, _ = nearest_points(centers, rays[:, None], np.ones((4, 1)))
    assert np.median(np.linalg.norm(points[0] - body, axis=-1)) < 0.02
    two, gap = pair_points(centers[0], rays[:1][0][None], centers[1], rays[1][None])
    np.testing.assert_allclose(two[0, 0], body, atol=1e-6)
    assert gap.max() < 1e-6
    assert len(BODY23) == len(body)
