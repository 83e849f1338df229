"""Axes of hinges and the centres behind their markers: on limbs with known axes and on people of plain anatomy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.aliases import map_surface
from muybridge.geometry.skeleton.hinge_axes import Hinge, chord, outward_of
from muybridge.geometry.skeleton.joint_centres import USUAL, Measurements, centres_from_markers
from muybridge.infer.reconstruction.measurements import measurements_of
from muybridge.motion.formats.registry import read_file
from muybridge.train.synthesis.markers.anatomical import AnatomicalPerson, AnatomicalTake, anatomical_take
from tests.paths import DATA

KNEE = Hinge(0.06, 0.0, 1.0, 0.0, 0.06, np.radians(8.0), np.radians(12.0))
ELBOW = Hinge(0.042, 0.0, -1.0, 0.21, 0.10, np.inf, np.inf, slip=np.radians(20.0))
LEG, ARM = ("thigh", "shin", "foot"), ("upper_arm", "forearm", "hand")
PEOPLE = {
    "adult": AnatomicalPerson(),
    "child": AnatomicalPerson(1.35, 1.05, 0.15, 0.2, examiner=0.003),
    "tall": AnatomicalPerson(1.95, 0.95, 0.26, 0.45),
    "loose skin": AnatomicalPerson(1.65, 1.05, skin=1.5),
    "wide range": AnatomicalPerson(elbow=(0.1, 2.2)),
}


def flexion_deg(above: np.ndarray, joint: np.ndarray, below: np.ndarray) -> np.ndarray:
    first, second = joint - above, below - joint
    cosine = np.sum(first * second, -1) / np.linalg.norm(first, axis=-1) / np.linalg.norm(second, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def limb(flexes: float, flexion: np.ndarray, half_width: float, wand_deg: float) -> tuple[np.ndarray, ...]:
    """A hinge whose centre is at (0.1, 0, 0), its marker outward of it (+x), in a bone that turns about its length;
    the bone above, the marker, the bone below, a marker on the upper bone, the true direction."""
    turns = Rotation.from_euler("z", np.linspace(-60, 60, len(flexion))[:, None], degrees=True).as_matrix()
    centre = np.array([0.1, 0.0, 0.0])
    bend = flexes * flexion  # x cross -z is +y, to which the lower bone of a hinge that flexes by 1 goes
    lower = np.stack([0 * bend, np.sin(bend), -np.cos(bend)], -1) * 0.3
    aside = np.radians(wand_deg)
    wand = centre + np.array([0.08 * np.cos(aside), 0.08 * np.sin(aside), 0.15])
    parts = [centre + [0, 0, 0.4], centre + [half_width, 0, 0], centre + lower, wand]
    at = [np.einsum("tij,tj->ti", turns, np.broadcast_to(p, (len(flexion), 3))) for p in parts]
    return *at, turns[:, :, 0], turns @ centre


def test_chord_is_a_right_angle_at_the_centre() -> None:
    above, marker = np.array([[0.0, 0.0, 0.4]]), np.array([[0.05, 0.01, 0.0]])
    centre = chord(above, marker, np.array([[1.0, 0.3, 0.2]]), 0.06)[0]
    assert np.isclose(np.linalg.norm(marker[0] - centre), 0.06)
    assert abs((marker[0] - centre) @ (above[0] - centre)) < 1e-9
    assert (marker[0] - centre)[0] > 0


@pytest.mark.parametrize("wand_deg", [0.0, 20.0, -90.0, 170.0])
def test_a_knees_axis_is_found_wherever_the_marker_on_the_thigh_is(wand_deg: float) -> None:
    flexion = 0.05 + 0.5 * (1 - np.cos(np.linspace(0, 6 * np.pi, 90)))
    above, marker, below, wand, axis, centre = limb(1.0, flexion, 0.06, wand_deg)
    side = axis @ Rotation.from_euler("z", 10, degrees=True).as_matrix().T
    found = outward_of(KNEE, above, marker, below, (wand,), side)
    assert np.linalg.norm(chord(above, marker, found, 0.06) - centre, axis=-1).max() < 0.006


def test_without_a_marker_on_the_thigh_the_pelvis_side_and_the_plane_tell() -> None:
    flexion = 0.05 + 0.5 * (1 - np.cos(np.linspace(0, 6 * np.pi, 90)))
    above, marker, below, _, axis, _ = limb(1.0, flexion, 0.06, 0.0)
    side = axis @ Rotation.from_euler("z", 10, degrees=True).as_matrix().T
    found = outward_of(KNEE, above, marker, below, (), side)
    assert np.degrees(np.arccos(np.sum(found * axis, -1))).max() < 10


@pytest.mark.parametrize("flexes", [1.0, -1.0])
def test_an_elbow_bends_to_the_side_to_which_the_wrist_goes(flexes: float) -> None:
    """Flexed by 20 to 36 degrees only, and the marker on the arm anywhere."""
    flexion = np.radians(28 + 8 * np.sin(np.linspace(0, 6 * np.pi, 90)))
    for wand_deg in (0.0, 130.0, -100.0):
        above, marker, below, wand, axis, centre = limb(flexes, flexion, 0.042, wand_deg)
        found = outward_of(replace(ELBOW, flexes=flexes), above, marker, below, (wand,))
        joint = chord(above, marker, found, 0.042)
        assert np.sum(found * axis, -1).min() > np.cos(np.radians(40))
        assert np.abs(flexion_deg(above, joint, below) - np.degrees(flexion)).max() < 8
        # The lower bone goes to the flexors' side of the axis that was found.
        assert (flexes * np.einsum("ti,ti->t", below - joint, np.cross(found, joint - above))).min() > 0


def test_a_straight_arm_without_a_marker_on_it_tells_nothing() -> None:
    above, marker, below, _, axis, _ = limb(-1.0, np.array([0.0, 0.0, 1.2]), 0.0, 0.0)
    found = outward_of(ELBOW, above, marker, below)
    assert np.isnan(found[:2]).all()
    assert np.allclose(found[2], axis[2], atol=1e-6)


def errors(take: AnatomicalTake, centres: dict[str, np.ndarray], side: str) -> tuple[dict[str, float], float, float]:
    """Median distances in millimetres, and median differences of the knee's and the elbow's flexion in degrees."""
    off = {j: 1e3 * float(np.median(np.linalg.norm(centres[f"{side}_{j}"] - take.centres[f"{side}_{j}"], axis=-1)))
           for j in LEG + ARM}  # fmt: skip
    knee, elbow = (
        float(np.median(np.abs(flexion_deg(*(centres[f"{side}_{j}"] for j in part))
                               - flexion_deg(*(take.centres[f"{side}_{j}"] for j in part)))))
        for part in (LEG, ARM)
    )  # fmt: skip
    return off, knee, elbow


@pytest.mark.parametrize("who", PEOPLE)
def test_centres_of_people_of_plain_anatomy(who: str) -> None:
    take = anatomical_take(PEOPLE[who], np.random.default_rng(4), 90)
    found = centres_from_markers(take.points, take.index, USUAL)
    centres = dict(zip(found.names, np.moveaxis(found.points_world, 1, 0), strict=True))
    for side in ("left", "right"):
        off, knee, elbow = errors(take, centres, side)
        assert off["thigh"] < 20 and off["shin"] < 20 and off["foot"] < 15
        assert off["upper_arm"] < 20 and off["forearm"] < 15
        assert knee < 5 and elbow < 5


def test_measured_widths_count() -> None:
    take = anatomical_take(PEOPLE["adult"], np.random.default_rng(0), 30)
    knee = SURFACE.names.index("left_knee_lateral")
    column = list(take.index).index(SURFACE.names[knee])
    for width in (0.09, 0.13):
        measured = Measurements(knee_width={"left": width}, marker_diameter=0.02)
        found = centres_from_markers(take.points, take.index, USUAL, measured)
        centre = found.points_world[:, found.names.index("left_shin")]
        assert np.allclose(np.linalg.norm(centre - take.points[:, column], axis=-1), width / 2 + 0.01)


def test_a_laboratorys_walk_agrees_with_its_own_centres() -> None:
    """The thigh's marker of this set is on the patella, and the front spines' are 5 cm wider than the bones."""
    path = DATA / "markers" / "walk_force_plates.c3d"
    if not path.exists():
        pytest.skip("no shared data")
    take = read_file(path).positions
    at = {n: take.points_world[:, i] for i, n in enumerate(take.landmarks.names)}
    if "LFEP" not in at:
        pytest.skip("the gait model's outputs are not read")
    measured = measurements_of(path)
    assert measured.asis_width == pytest.approx(0.227, abs=1e-3)
    assert measured.knee_width == {"left": pytest.approx(0.109), "right": pytest.approx(0.109)}
    found = centres_from_markers(take.points_world, map_surface(take.landmarks.names), USUAL, measured)
    centres = dict(zip(found.names, np.moveaxis(found.points_world, 1, 0), strict=True))
    for side in ("left", "right"):
        own = {j: at[f"{side[0].upper()}{n}"] for j, n in zip(LEG, ("FEP", "KJC", "AJC"), strict=True)}
        off = [1e3 * np.median(np.linalg.norm(centres[f"{side}_{j}"] - own[j], axis=-1)) for j in LEG]
        assert off[0] < 20 and off[1] < 20 and off[2] < 12
        flexion = flexion_deg(*(centres[f"{side}_{j}"] for j in LEG)) - flexion_deg(*own.values())
        assert np.median(np.abs(flexion)) < 5
