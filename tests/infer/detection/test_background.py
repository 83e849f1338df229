"""The background plate: who moves, who sways in one place, cameras that expose anew, and crops of the difference."""

from __future__ import annotations

import numpy as np
import pytest

from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.crops import crops_for_boxes
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.background import BackgroundModel, silhouettes, sort_images
from muybridge.infer.detection.crop_pixels import extract_crops
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox, orientation_for
from muybridge.infer.networks.keypoints import KeypointNetwork
from muybridge.models.shipped import shipped_model

WIDTH, HEIGHT, CROP = 640, 480, 96
# Portrait: turned by 90 degrees, 4 m from the wall y = 0.
_TURN = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
ROLLED = Camera(
    "rolled", "OPENCV", WIDTH, HEIGHT, (600.0, 600.0, 320.0, 240.0, -0.1, 0.02, 0, 0),
    np.column_stack([_TURN, -_TURN @ np.array([0.0, -4.0, 1.0])]),
)  # fmt: skip


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16, 25])
def test_images_are_sorted_pixel_by_pixel(count: int) -> None:
    images = np.random.default_rng(count).integers(0, 256, (count, 6, 5, 3), dtype=np.uint8)
    np.testing.assert_array_equal(sort_images(images.copy()), np.sort(images, axis=0))


def test_background_plate_omits_moving_people() -> None:
    rng = np.random.default_rng(0)
    scene = rng.integers(0, 200, (64, 96, 3), dtype=np.uint8)
    letterbox = Letterbox(FrameOrientation(96, 64), 96)
    backdrop = BackgroundModel(letterbox)
    assert backdrop(scene[None]).difference(0).max() == 0 and backdrop.plate is None
    for t in range(300):
        frame = scene.copy()
        frame[10:30, (t * 2) % 88 : (t * 2) % 88 + 8] = 255
        small = backdrop(frame[None])
        assert len(backdrop._plate._kept) <= 25
    assert backdrop.plate is not None
    np.testing.assert_array_equal(backdrop.plate, scene)
    expected = np.abs(frame.astype(float) - scene).mean(axis=-1) / 255
    np.testing.assert_allclose(small.difference(0), expected, atol=1e-6)
    # Of a chunk, only frames that are asked for are scaled down.
    few = backdrop(np.stack([frame] * 40))
    few.difference(7)
    assert len(few._pixels) <= 4
    # A plate that is known is there from the first frame, and stays; a moving camera has none.
    again = BackgroundModel(letterbox, known=backdrop.plate)
    for _ in range(5):
        np.testing.assert_allclose(again(frame[None]).difference(0), expected, atol=1e-6)
    moving = BackgroundModel(letterbox, enabled=False)
    still = moving(np.stack([scene, frame] * 5))
    assert all(still.difference(t).max() == 0 for t in range(10)) and moving.plate is None


def test_exposure_changes_are_no_difference_to_the_background() -> None:
    rng = np.random.default_rng(0)
    scene = rng.integers(30, 180, (96, 128, 3)).astype(np.uint8)
    backdrop = BackgroundModel(Letterbox(FrameOrientation(128, 96), 128), known=scene)
    frame = scene.copy()
    frame[20:70, 40:60] = 240 - frame[20:70, 40:60]
    brighter = (frame * np.array([1.25, 1.2, 1.15])).clip(0, 255).astype(np.uint8)
    person = np.zeros(scene.shape[:2], bool)
    person[20:70, 40:60] = True
    as_was, exposed = (backdrop(f[None]).difference(0) for f in (frame, brighter))
    assert as_was[~person].max() == 0 and exposed[~person].max() < 0.02
    assert exposed[person].mean() > 0.7 * as_was[person].mean() > 0.1
    # Another picture altogether is not made alike.
    other = rng.integers(30, 180, scene.shape).astype(np.uint8)
    assert backdrop(other[None]).difference(0).mean() == pytest.approx(np.abs(other - scene.astype(float)).mean() / 255)


def test_a_swaying_person_is_removed_from_the_background() -> None:
    """In most frames' way and not in all: the median shows the person, what is free of their silhouette the scene."""
    rng = np.random.default_rng(0)
    scene = rng.integers(0, 200, (128, 96, 3), dtype=np.uint8)
    standing = np.full((len(BODY23), 2), np.nan)
    for name, (x, y) in {
        "nose": (0, -45), "left_shoulder": (8, -32), "right_shoulder": (-8, -32), "left_hip": (6, 0),
        "right_hip": (-6, 0), "left_knee": (6, 22), "right_knee": (-6, 22), "left_ankle": (6, 45),
        "right_ankle": (-6, 45),
    }.items():  # fmt: skip
        standing[BODY23.index(name)] = x, y
    letterbox = Letterbox(FrameOrientation(96, 128), 128)
    backdrop = BackgroundModel(letterbox)
    tracks = standing + np.stack([48 + 16 * np.sin(np.arange(40) / 6), np.full(40, 64.0)], -1)[:, None, None]
    covered = silhouettes(tracks[:, 0][:, None], BODY23, (96, 128))
    for mask in covered:
        frame = scene.copy()
        frame[mask] = 255
        backdrop(frame[None])
    plain, clean = backdrop.plate, backdrop.without(tracks, BODY23)
    assert plain is not None and clean is not None
    shown, left = ((plate == 255).all(-1).sum() for plate in (plain, clean))
    assert shown > 300 and left < 0.15 * shown
    np.testing.assert_array_equal(clean[~covered.any(0)], scene[~covered.any(0)])
    # Nobody found, nothing cut out.
    np.testing.assert_array_equal(backdrop.without(np.full_like(tracks, np.nan), BODY23), plain)


@pytest.mark.parametrize("camera", [None, ROLLED], ids=["uncalibrated", "calibrated"])
def test_crops_of_the_difference_lie_on_those_of_the_frame(camera: Camera | None) -> None:
    """The difference is taken at the detector's resolution, of frames turned upright, and cropped as the frame is."""
    upright = orientation_for(camera, WIDTH, HEIGHT)
    scene, box = np.full((HEIGHT, WIDTH, 3), 20, dtype=np.uint8), np.array([[250.0, 130.0, 350.0, 270.0]])
    frame = scene.copy()
    frame[190:206, 280:296] = 255
    backdrop = BackgroundModel(letterbox := Letterbox(upright, 320), known=letterbox.apply(scene))
    crops = crops_for_boxes(box, CROP, camera)
    difference = backdrop.difference_in(crops, backdrop(frame[None]), 0)[0].astype(float)
    expected = extract_crops(frame, crops)[0, ..., 0] - 20.0
    y, x = np.mgrid[:CROP, :CROP]
    at, truth = ([float((image * v).sum() / image.sum()) for v in (x, y)] for image in (difference, expected))
    np.testing.assert_allclose(at, truth, atol=0.3)
    assert abs(difference.sum() / expected.sum() - 1) < 0.1
    # A frame larger than the picture: what lies outside does not differ.
    assert backdrop.difference_in(crops_for_boxes(box + [-900, 0, -900, 0], CROP), backdrop(frame[None]), 0).max() == 0


def test_the_shipped_network_works_with_and_without_the_background() -> None:
    network = KeypointNetwork(shipped_model("keypoints"))
    assert network.channels == 4
    side = network.crop_size
    crops = np.random.default_rng(0).integers(0, 256, (2, side, side, 4), dtype=np.uint8)
    without = network(crops[..., :3])[0]
    assert np.abs(network(crops)[0] - without).max() > 0.1
    crops[..., 3] = 0
    np.testing.assert_allclose(network(crops)[0], without, atol=1e-4)
    with pytest.raises(ValueError, match=str(side)):
        network(crops[:, :96])
