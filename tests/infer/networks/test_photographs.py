"""The score of the networks on photographs of labelled people."""

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from muybridge.api.networks import ImageLandmarks
from muybridge.geometry.landmarks.sets import BODY23


@pytest.fixture(scope="module")
def photographs(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("benchmarks.networks.photographs")


def _person(module: ModuleType):
    """Somebody with a trunk of 100 px, and landmarks of sd 10 px right on the labels."""
    rng = np.random.default_rng(0)
    joints = rng.uniform(0, 1000, (12, 2))
    joints[0], joints[1], joints[6], joints[7] = (0, 0), (40, 0), (0, 100), (40, 100)
    points = np.zeros((1, 23, 2))
    points[0, module.JOINT] = joints
    ones = np.ones((1, 23))
    found = ImageLandmarks(BODY23, points, 10 * ones, ones, ones, np.zeros((1, 4)))
    image = np.zeros((8, 8, 3), np.uint8)
    return module.Person(image, np.array([0.0, 0, 100, 200]), joints), found


def test_errors_count_in_trunks_and_sides_by_the_twin(photographs: ModuleType):
    person, found = _person(photographs)
    assert person.trunk == pytest.approx(100)
    assert photographs.score([person], [found])[:4] == (1, 1, 0, 0)
    elbows = photographs.JOINT[2:4]
    found.points_px[0, elbows] = found.points_px[0, elbows[::-1]]  # exchanged
    found.points_px[0, photographs.JOINT[4]] += (30, 0)  # off by 0.3 trunks and three sd
    found.points_px[0, photographs.JOINT[5]] = np.nan
    score = photographs.score([person], [found])
    assert score.at_two == pytest.approx(8 / 12) and score.at_five == pytest.approx(9 / 12)
    assert score.other_side == pytest.approx(2 / 12) and score.withheld == pytest.approx(1 / 12)
    assert score.one_sigma == pytest.approx(17 / 22)


def test_people_without_a_labelled_trunk_do_not_count(photographs: ModuleType):
    person, found = _person(photographs)
    joints = person.joints.copy()
    joints[6] = np.nan
    assert np.isfinite(person._replace(joints=joints).trunk)
    joints[7] = np.nan
    score = photographs.score([person, person._replace(joints=joints)], [found, found])
    assert score.at_two == 1


def test_each_person_has_one_box(photographs: ModuleType):
    boxes = np.array([[0.0, 0, 10, 20], [1, 0, 11, 20], [50, 50, 60, 60]])
    used, taken = photographs.match(boxes, np.array([[0.0, 0, 10, 20], [80, 80, 90, 90]]))
    assert used.tolist() == [True, False, False] and taken.tolist() == [True, False]


def test_a_box_scales_about_its_centre(photographs: ModuleType):
    person, _ = _person(photographs)
    assert photographs.scaled_box(person, 1.2).box.tolist() == [-10, -20, 110, 220]
