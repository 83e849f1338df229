"""Foot contacts and footskate of made-up and recorded motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import roles_of
from muybridge.motion.contacts.events import contact_events, contact_facts
from muybridge.motion.contacts.find import ContactOptions, Contacts, find_contacts, without_short_runs
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.footskate import contact_spans, measure_footskate, sliding_frames
from muybridge.motion.contacts.plates import plate_loads
from muybridge.motion.formats.points.c3d import read_c3d_take
from muybridge.motion.formats.registry import read_file
from tests.paths import DATA

FPS = 100.0


def steps(height: float = 0.1, drift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3) of a foot that stands for 0.5 s and swings for 0.4 s, five times, and when it stands."""
    places, stands = [], []
    x = 0.0
    for _ in range(5):
        t = np.arange(50) / FPS
        places.append(np.stack([x + drift * t, 0 * t, 0 * t], 1))
        stands.append(np.ones(50, bool))
        share = np.arange(1, 41) / 41
        smooth = share**2 * (3 - 2 * share)
        start = x + drift * 0.5
        x = start + 0.7
        places.append(np.stack([start + 0.7 * smooth, 0 * share, height * np.sin(np.pi * share)], 1))
        stands.append(np.zeros(40, bool))
    return np.concatenate(places) + [0, 0, 0.03], np.concatenate(stands)


def walker(drift: float = 0.0) -> tuple[Points3D, np.ndarray]:
    """Heels and toes of somebody whose feet step in turn, and (T, 2) when they stand."""
    left, stands = steps(drift=drift)
    right = np.concatenate([np.repeat(left[:1], 45, 0), left])[: len(left)] + [0.0, 0.3, 0.0]
    standing = np.stack([stands, np.concatenate([np.ones(45, bool), stands])[: len(stands)]], 1)
    names = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
    xyz = np.stack([left, left + [0.2, 0, 0], right, right + [0.2, 0, 0]], 1)
    none = np.empty((0, len(xyz), 4))
    covariance = np.full((len(xyz), 4, 3, 3), np.nan)
    return Points3D(LandmarkSet("feet", names, ()), xyz, covariance, none, none.astype(bool), FPS), standing


def test_feet_that_stand_and_swing():
    points, stands = walker()
    found = find_contacts(points)
    assert (found.feet == stands).mean() > 0.96 and len(contact_spans(found.feet[:, 0])) == 5
    assert found.floor.height == pytest.approx(0.03, abs=1e-3) and np.abs(found.clearance).max() < 1e-3
    above = replace(points, points_world=points.points_world + [0, 0, 0.2])
    assert not find_contacts(above, ContactOptions(floor=Floor(0.0))).contact.any()
    gliding = points.points_world.copy()
    gliding[..., 0] += np.arange(len(gliding))[:, None] * 0.02  # two metres per second
    assert not find_contacts(replace(points, points_world=gliding)).contact.any()
    empty = replace(points, points_world=points.points_world[:0], covariance_world=points.covariance_world[:0])
    assert find_contacts(empty).contact.shape == (0, 2, 2)


def test_a_foot_that_creeps_does_not_stand():
    points, stands = walker(drift=0.4)
    assert find_contacts(points).feet[stands].mean() < 0.3


def test_noise_widens_what_counts_as_standing():
    points, stands = walker()
    rng = np.random.default_rng(2)
    shaken = gaussian_filter1d(rng.normal(size=points.points_world.shape), 8, axis=0, mode="wrap")
    noisy = replace(points, points_world=points.points_world + 0.009 * shaken / shaken.std())
    assert (find_contacts(noisy).feet == stands).mean() > 0.9
    known = replace(noisy, covariance_world=np.tile(np.eye(3) * 0.009**2, (len(stands), 4, 1, 1)))
    found = find_contacts(known)
    assert found.noise_m == pytest.approx(0.009) and (found.feet == stands).mean() > 0.9


def test_missing_points_neither_stand_nor_spoil_the_rest():
    points, stands = walker()
    places = points.points_world.copy()
    places[100:130, :2] = np.nan
    found = find_contacts(replace(points, points_world=places))
    assert np.isfinite(found.probability).all()
    assert (found.feet[:, 1] == stands[:, 1]).mean() > 0.96


def test_a_floor_that_slopes():
    points, stands = walker()
    places = points.points_world + np.array([0.0, 0.0, 0.08]) * points.points_world[..., :1]
    found = find_contacts(replace(points, points_world=places), ContactOptions(slope=True))
    assert found.floor.normal[0] == pytest.approx(-0.08, abs=0.01)
    assert (found.feet == stands).mean() > 0.95


def test_short_contacts_and_gaps_are_dropped():
    runs = [(True, 20), (False, 2), (True, 20), (False, 30), (True, 3), (False, 30), (True, 2)]
    contact = np.concatenate([np.full(count, value) for value, count in runs])
    cleaned = without_short_runs(contact, 6)
    assert contact_spans(cleaned) == [(0, 42), (105, 107)], "what is cut by the ends of the take stays"


def test_events_and_facts():
    points, stands = walker()
    found = Contacts.of_feet(stands, FPS)
    events = contact_events(found, first_frame=101)
    assert [e.label for e in events if e.context == "Left"] == ["Foot Off", "Foot Strike"] * 4 + ["Foot Off"]
    assert events[0].time == pytest.approx(1.5) and [e.time for e in events] == sorted(e.time for e in events)
    assert contact_facts(found)["seconds"]["left_ball"][1] == [0.9, 1.4]
    with pytest.raises(ValueError, match=r"\(T, 2\) or \(T, 2, 2\)"):
        Contacts.of_feet(stands[:, :1], FPS)


def test_points_without_heels_are_refused():
    points, _ = walker()
    with pytest.raises(ValueError, match="no point is known to be the left heel; the points are a, b, c, d"):
        find_contacts(replace(points, landmarks=LandmarkSet("x", ("a", "b", "c", "d"), ())))


def test_footskate_of_a_foot_that_drifts():
    places, stands = steps()
    still = measure_footskate(places, stands, FPS)
    assert still.frames == 250 and still.mean_speed < 1e-12 and still.extent < 1e-12 and still.sliding == 0
    places, stands = steps(drift=0.1)
    drifting = measure_footskate(places, stands, FPS)
    assert drifting.mean_speed == pytest.approx(0.1, rel=1e-9)
    assert drifting.extent == pytest.approx(0.049, rel=0.01)
    assert drifting.sliding == pytest.approx(1 - 10 / 50, abs=0.03), "within 5 mm of the middle are 10 frames of 50"
    assert sliding_frames(places, stands, 1.0).sum() == 0
    nothing = measure_footskate(places, np.zeros(len(places), bool), FPS)
    assert (nothing.frames, nothing.mean_speed, nothing.extent, nothing.sliding) == (0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"places must be \(450, 3\)"):
        measure_footskate(places[:5], stands, FPS)


def test_a_body_that_stands_and_one_that_moves():
    skeleton = BODY.skeleton(prior_shape(1.7))
    quat = np.tile([1.0, 0, 0, 0], (60, len(skeleton), 1))
    root = np.tile([0.0, 0.0, 0.9], (60, 1))
    assert find_contacts(Motion(skeleton, 60.0, root, quat)).contact.all()
    moving = root + np.arange(60)[:, None] * [0.05, 0, 0]
    assert not find_contacts(Motion(skeleton, 60.0, moving, quat)).contact.any()
    high = Motion(skeleton, 60.0, root + [0, 0, 0.5], quat)
    assert not find_contacts(high, ContactOptions(floor=Floor(0.0))).contact.any()
    with pytest.raises(ValueError, match="no joint is known to be left_thigh"):
        find_contacts(high, roles={"hips": 0})


@pytest.mark.parametrize(
    ("name", "stance", "flight"), [("02_01.amc", (0.4, 0.7), 0.05), ("02_03.amc", (0.15, 0.4), 0.65)]
)
def test_recorded_walking_and_running(name, stance, flight):
    path = DATA / "motion" / name
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    motion = read_file(path).motion
    found = find_contacts(motion)
    contacts = found.feet
    assert all(stance[0] < share < stance[1] for share in contacts.mean(axis=0))
    assert (~contacts.any(axis=1)).mean() < flight
    if name == "02_03.amc":
        assert not contacts.all(axis=1).any(), "who runs never has both feet on the ground"
        assert (~contacts.any(axis=1)).mean() > 0.2
    for k, side in enumerate(("left", "right")):
        toe = motion.joint_positions_world()[:, roles_of(motion.skeleton.names)[f"{side}_toe"]]
        inside = measure_footskate(toe, contacts[:, k], motion.fps)
        outside = measure_footskate(toe, ~contacts[:, k], motion.fps)
        assert inside.mean_speed < 0.2 and outside.mean_speed > 5 * inside.mean_speed


def test_force_plates_decide(real_data):
    take = read_c3d_take(real_data / "markers/walk_force_plates.c3d")
    loads = plate_loads(take)
    assert [contact_spans(load.loaded) for load in loads] == [[(123, 221)], [(71, 138)], [], [(15, 85)]]
    alone, weighed = (find_contacts(take.points, plates=plates).feet for plates in (None, take))
    onsets = {0: (71,), 1: (15, 123)}
    for foot, frames in onsets.items():
        for found, most in ((alone, 3), (weighed, 1)):
            starts = [a for a, _ in contact_spans(found[:, foot])]
            assert all(min(abs(a - frame) for a in starts) <= most for frame in frames)
    assert not weighed[86:120, 1].any() and weighed[72:122, 0].all() and weighed[16:70, 1].all()
