"""Foot contacts and footskate of made-up and recorded motion."""

import numpy as np
import pytest

from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.detect import (
    ContactOptions,
    detect_contacts,
    foot_joints,
    leg_length,
    point_contacts,
    without_short_runs,
)
from muybridge.motion.contacts.footskate import contact_spans, measure_footskate, sliding_frames
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


def test_a_foot_that_stands_and_swings():
    places, stands = steps()
    found = point_contacts(places, FPS, ContactOptions())
    assert (found == stands).mean() > 0.96 and len(contact_spans(found)) == 5
    assert not point_contacts(places + [0, 0, 0.2], FPS, ContactOptions(ground=0.0)).any()
    assert (point_contacts(places * 0.2, FPS, ContactOptions(), size=0.2) == found).mean() > 0.99
    gliding = places.copy()
    gliding[:, 0] = np.arange(len(places)) * 0.02  # two metres per second on the floor
    gliding[:, 2] = 0.03
    assert not point_contacts(gliding, FPS, ContactOptions()).any()
    assert point_contacts(places[:1], FPS, ContactOptions()).tolist() == [True]
    assert point_contacts(places[:0], FPS, ContactOptions()).shape == (0,)


def test_short_contacts_and_gaps_are_dropped():
    runs = [(True, 20), (False, 2), (True, 20), (False, 30), (True, 3), (False, 30), (True, 2)]
    contact = np.concatenate([np.full(count, value) for value, count in runs])
    cleaned = without_short_runs(contact, 6)
    assert contact_spans(cleaned) == [(0, 42), (105, 107)], "what is cut by the ends of the take stays"


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


def test_a_body_that_stands_and_one_that_hangs():
    skeleton = BODY.skeleton(prior_shape(1.7))
    quat = np.tile([1.0, 0, 0, 0], (60, len(skeleton), 1))
    root = np.tile([0.0, 0.0, 0.9], (60, 1))
    assert detect_contacts(Motion(skeleton, 60.0, root, quat)).all()
    moving = root + np.arange(60)[:, None] * [0.05, 0, 0]
    assert not detect_contacts(Motion(skeleton, 60.0, moving, quat)).any()
    assert not detect_contacts(Motion(skeleton, 60.0, root + [0, 0, 0.5], quat), ContactOptions(ground=0.0)).any()
    assert leg_length(skeleton) == pytest.approx(1.7 * (0.245 + 0.246), rel=1e-6)
    assert [tuple(skeleton.names[j] for j in foot) for foot in foot_joints(skeleton)] == [
        ("left_foot", "left_toe"), ("right_foot", "right_toe")]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "stance", "flight"), [("02_01.amc", (0.4, 0.7), 0.05), ("02_03.amc", (0.15, 0.4), 0.65)]
)
def test_recorded_walking_and_running(name, stance, flight):
    path = DATA / "motion" / name
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    motion = read_file(path).motion
    contacts = detect_contacts(motion)
    assert all(stance[0] < share < stance[1] for share in contacts.mean(axis=0))
    assert (~contacts.any(axis=1)).mean() < flight
    if name == "02_03.amc":
        assert not contacts.all(axis=1).any(), "who runs never has both feet on the ground"
        assert (~contacts.any(axis=1)).mean() > 0.2
    for k, joints in enumerate(foot_joints(motion.skeleton)):
        toe = motion.joint_positions_world()[:, joints[-1]]
        inside = measure_footskate(toe, contacts[:, k], motion.fps)
        outside = measure_footskate(toe, ~contacts[:, k], motion.fps)
        assert inside.mean_speed < 0.2 and outside.mean_speed > 5 * inside.mean_speed
