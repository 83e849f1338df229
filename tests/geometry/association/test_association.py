"""Association in a synthetic room with a moving person, bystanders, broken tracks and flipped labels."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import SessionError
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import find_people, select_person, take_person
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from tests.paths import DATA
from tests.rigs import ring_of_cameras

# A standing body of 1.75 m: x to its left, y backwards, z up. The right side mirrors the left.
_HALF = {
    "eye": (0.03, -0.10, 1.65), "ear": (0.07, 0.0, 1.63), "shoulder": (0.18, 0.0, 1.45),
    "elbow": (0.30, 0.02, 1.18), "wrist": (0.33, -0.12, 0.95), "hip": (0.10, 0.0, 0.95),
    "knee": (0.11, -0.03, 0.52), "ankle": (0.11, 0.03, 0.09), "big_toe": (0.13, -0.16, 0.03),
    "small_toe": (0.17, -0.12, 0.03), "heel": (0.11, 0.09, 0.03),
}  # fmt: skip
BODY = np.array(
    [
        (0.0, -0.12, 1.60) if name == "nose" else _HALF[name.split("_", 1)[1]] * np.array(
            [1.0 if name.startswith("left") else -1.0, 1.0, 1.0]
        )
        for name in BODY23.names
    ]
)  # fmt: skip


def ring(count: int, radius: float = 4.5) -> CameraGroup:
    return ring_of_cameras(
        [f"cam{c + 1:02d}" for c in range(count)],
        radius=radius,
        height=[1.6 + 0.3 * (c % 3) for c in range(count)],
        target=(0, 0, 0.9),
        angles=[2 * np.pi * c / count + 0.3 + 0.25 * (c % 2) for c in range(count)],
        size=(1920, 1080),
        focal=1400,
    )


def walker(frames: int, center: tuple[float, float], travel: float, phase: float = 0.0) -> FloatArray:
    """(T, J, 3) a body that walks in a circle, turns and swings its limbs."""
    time = np.linspace(0, 2 * np.pi, frames)
    turn = phase + (time if travel else np.zeros(frames))
    cos, sin = np.cos(turn), np.sin(turn)
    points = np.repeat(BODY[None], frames, axis=0)
    swing = 0.15 * travel * np.sin(6 * time)
    side = np.sign(points[..., 0]) * (points[..., 2] < 1.2)
    points[..., 1] += side * swing[:, None]
    x = points[..., 0] * cos[:, None] - points[..., 1] * sin[:, None]
    y = points[..., 0] * sin[:, None] + points[..., 1] * cos[:, None]
    path = np.stack([center[0] + travel * np.cos(time), center[1] + travel * np.sin(time)], axis=-1)
    return np.stack([x + path[:, :1], y + path[:, 1:], points[..., 2]], axis=-1)


def keypoints_of(
    cameras: CameraGroup,
    bodies: list[tuple[FloatArray, list[int]]],
    people: int,
    noise_px: float = 8.0,
    seed: int = 0,
) -> tuple[Keypoints2D, IntArray]:
    """Tracks of bodies in some cameras, in random slots; and (bodies, C) the slot of each, -1 where unseen."""
    rng = np.random.default_rng(seed)
    frames = bodies[0][0].shape[0]
    px = np.full((len(cameras), frames, people, len(BODY23), 2), np.nan)
    where = np.full((len(bodies), len(cameras)), -1)
    free = [list(rng.permutation(people)) for _ in cameras]
    for b, (points, seen_by) in enumerate(bodies):
        seen = cameras.project(points) + rng.normal(0, noise_px, (len(cameras), frames, len(BODY23), 2))
        for c in seen_by:
            where[b, c] = free[c].pop()
            px[c, :, where[b, c]] = seen[c]
    known = np.isfinite(px[..., 0])
    variance = np.where(known, noise_px**2, np.nan)
    return Keypoints2D(BODY23, px, variance, np.where(known, 0.9, 0.0)), where


def test_moving_man_between_a_bystander_and_a_hanging_skeleton() -> None:
    cameras = ring(4)
    man = walker(60, (0.2, 0.0), 0.4)
    bystander = walker(60, (-1.5, 1.2), 0.0)
    skeleton = walker(60, (1.4, 1.5), 0.0, 1.0)
    seen_by = [[0, 1, 2, 3], [0, 2], [0, 1, 2, 3]]
    keypoints, where = keypoints_of(cameras, list(zip([man, bystander, skeleton], seen_by, strict=True)), 4)
    selection = select_person(cameras, keypoints)
    np.testing.assert_array_equal(selection.slots, np.repeat(where[0][:, None], 60, axis=1))
    assert [len(p.cameras) for p in selection.people] == [4, 4, 2]
    assert "followed by 4 of 4 cameras in 100 % of 60 frames, moves most; 2 other people" in selection.reason
    for person in selection.people[1:]:
        constant = [row[0] for row in person.slots]
        assert constant in (where[1].tolist(), where[2].tolist())
    px, variance, score = take_person(keypoints, selection)
    assert np.nanmax(np.abs(px - cameras.project(man))) < 60
    assert np.isfinite(px).all() and np.isfinite(variance).all() and (score > 0).all()


@pytest.mark.parametrize("count", [2, 3, 6])
def test_two_people_in_several_numbers_of_cameras(count: int) -> None:
    cameras = ring(5) if count == 2 else ring(count)
    cameras = CameraGroup(cameras.cameras[:count])
    bodies = [
        (walker(40, (0.5, 0.0), 0.3), list(range(count))),
        (walker(40, (-0.8, -0.4), 0.0), list(range(count))),
    ]
    keypoints, where = keypoints_of(cameras, bodies, 2, noise_px=5.0, seed=count)
    selection = select_person(cameras, keypoints)
    np.testing.assert_array_equal(selection.slots, np.repeat(where[0][:, None], 40, axis=1))
    assert len(selection.people) == 2


def test_broken_and_crossed_tracks_are_corrected() -> None:
    cameras = ring(4)
    bodies = [(walker(90, (0.3, 0.0), 0.3), [0, 1, 2, 3]), (walker(90, (-1.0, 0.6), 0.0), [0, 1, 2, 3])]
    keypoints, where = keypoints_of(cameras, bodies, 4)
    px = keypoints.points_px.copy()
    # Camera 0 loses its man and finds him again in another slot; in camera 1 the tracker exchanges the two.
    free = next(p for p in range(4) if p not in where[:, 0])
    px[0, 50:, free] = px[0, 50:, where[0, 0]]
    px[0, 40:, where[0, 0]] = np.nan
    px[0, 40:50, free] = np.nan
    px[1, 30:, where[:, 1]] = px[1, 30:, where[::-1, 1]]
    px[2, 70:] = np.nan
    known = np.isfinite(px[..., 0])
    broken = replace(
        keypoints, points_px=px, variance_px2=np.where(known, 64.0, np.nan), score=np.where(known, 0.9, 0.0)
    )
    selection = select_person(cameras, broken)
    expected = np.repeat(where[0][:, None], 90, axis=1)
    expected[0, 40:50], expected[0, 50:] = -1, free
    expected[1, 30:] = where[1, 1]
    expected[2, 70:] = -1
    np.testing.assert_array_equal(selection.slots, expected)


def test_flipped_sides_and_gross_errors_do_not_split_a_person() -> None:
    cameras = ring(4)
    bodies = [(walker(50, (0.2, 0.1), 0.4), [0, 1, 2, 3]), (walker(50, (-1.3, 1.0), 0.0), [1, 3])]
    keypoints, where = keypoints_of(cameras, bodies, 3, noise_px=20.0)
    px = keypoints.points_px.copy()
    px[2] = px[2][:, :, list(BODY23.mirror)]
    rng = np.random.default_rng(9)
    wild = rng.random(px.shape[:-1]) < 0.15
    px[wild] += rng.normal(0, 150, (int(wild.sum()), 2))
    selection = select_person(cameras, replace(keypoints, points_px=px))
    np.testing.assert_array_equal(selection.slots, np.repeat(where[0][:, None], 50, axis=1))


def test_single_slot_dead_camera_and_empty_frames() -> None:
    cameras = ring(4)
    keypoints, _ = keypoints_of(cameras, [(walker(40, (0.0, 0.0), 0.4), [0, 1, 3])], 1)
    px = keypoints.points_px.copy()
    px[:, 10:13] = np.nan
    px[0, 20:25] = np.nan
    selection = select_person(cameras, replace(keypoints, points_px=px))
    expected = np.isfinite(px[..., 0]).any(axis=(2, 3))
    np.testing.assert_array_equal(selection.slots >= 0, expected)
    assert "3 of 4 cameras in 92 %" in selection.reason and "nobody else" in selection.reason
    taken, variance, score = take_person(keypoints, selection)
    assert np.isnan(taken[2]).all() and np.isnan(variance[2]).all() and (score[2] == 0).all()


def test_one_frame_is_enough() -> None:
    cameras = ring(4)
    keypoints, where = keypoints_of(cameras, [(walker(1, (0, 0), 0.4), [0, 1, 2, 3])], 2)
    np.testing.assert_array_equal(select_person(cameras, keypoints).slots, where[0][:, None])


def test_a_person_seen_by_one_camera_is_not_preferred() -> None:
    cameras = ring(4)
    bodies = [(walker(40, (0.0, 0.0), 0.0), [0, 1, 2, 3]), (walker(40, (1.0, -1.0), 0.8), [2])]
    keypoints, where = keypoints_of(cameras, bodies, 2)
    selection = select_person(cameras, keypoints)
    np.testing.assert_array_equal(selection.slots, np.repeat(where[0][:, None], 40, axis=1))
    assert "1 track is seen by one camera only" in selection.reason
    assert selection.people[1].rank == 0.0 and selection.people[1].cameras == ("cam03",)


def test_errors_without_people_and_with_people_in_one_camera() -> None:
    cameras = ring(3)
    keypoints, _ = keypoints_of(cameras, [(walker(20, (0, 0), 0.4), [1])], 2)
    with pytest.raises(SessionError, match="only by camera cam02.*cam01, cam03"):
        select_person(cameras, keypoints)
    nothing = replace(keypoints, points_px=np.full_like(keypoints.points_px, np.nan))
    with pytest.raises(SessionError, match="no person was found in any of the 3 cameras"):
        select_person(cameras, nothing)
    with pytest.raises(ValueError, match="3 cameras, the calibration 2"):
        find_people(cameras.select(["cam01", "cam02"]), keypoints)


def test_cameras_that_never_agree_fall_back_to_the_most_prominent_person() -> None:
    cameras = ring(3)
    rng = np.random.default_rng(0)
    keypoints, where = keypoints_of(cameras, [(walker(30, (0, 0), 0.4), [0, 1, 2])], 1)
    px = keypoints.points_px + rng.normal(0, 400, (3, 1, 1, 1, 2)) + 500 * np.arange(3)[:, None, None, None, None]
    selection = select_person(cameras, replace(keypoints, points_px=px), TrackingOptions(start=0.02))
    assert "calibration or the synchronisation" in selection.reason
    np.testing.assert_array_equal(selection.slots, np.zeros((3, 30)))


def test_balancing_take_with_a_static_double_and_false_detections() -> None:
    folder = DATA / "balancing"
    if not folder.exists():
        pytest.skip("balancing is not here")
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    data = np.load(folder / "reference" / "openpose_body25b.npz")
    landmarks = LandmarkSet("body25b", tuple(str(n) for n in data["names"]), ())
    seen = data["keypoints2d_px"].astype(float)
    rng = np.random.default_rng(4)
    px = np.full((4, 100, 3, 25, 2), np.nan)
    px[:, :, 0] = np.where(seen[..., 2:] > 0.05, seen[..., :2], np.nan)
    still = np.nanmean(data["points3d_world"].astype(float), axis=0) + [0.7, -0.9, 0.0]
    px[:, :, 1] = cameras.project(still)[:, None] + rng.normal(0, 6, (4, 100, 25, 2))
    # Something that is taken for a person now and then, anywhere.
    often = rng.random((4, 100)) < 0.3
    px[:, :, 2][often] = rng.uniform(200, 1000, (int(often.sum()), 1, 2)) + rng.uniform(
        -150, 150, (int(often.sum()), 25, 2)
    )
    order = np.stack([rng.permutation(3) for _ in range(4)])
    px = np.take_along_axis(px, order[:, None, :, None, None], axis=2)
    known = np.isfinite(px).all(axis=-1)
    keypoints = Keypoints2D(landmarks, px, np.where(known, 25.0, np.nan), np.where(known, 0.5, 0.0))
    selection = select_person(cameras, keypoints)
    np.testing.assert_array_equal(selection.slots, np.repeat(np.argmin(order, axis=1)[:, None], 100, axis=1))
    assert "4 of 4 cameras in 100 % of 100 frames" in selection.reason
    assert selection.people[1].seen_share > 0.95
