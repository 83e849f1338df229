"""The networks and frame-by-frame tracking on frames of the demo, against its truth."""

from pathlib import Path

import numpy as np
import pytest

import muybridge
from muybridge.infer.demo_take.take import demo_folder, true_points
from muybridge.infer.session.session import open_session
from muybridge.infer.session.video import read_chunks

FRAMES = 16


@pytest.fixture(scope="module")
def cameras() -> muybridge.CameraGroup:
    return muybridge.load_calibration(Path(str(demo_folder())) / "calibration.toml")


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    """(16, 480, 640, 3) of each of the four cameras."""
    session = open_session(Path(str(demo_folder())))
    return [np.concatenate(list(read_chunks(video, np.arange(FRAMES)))) for video in session.videos]


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """(16, 23, 3) metres, in the order of BODY23; NaN where there is no truth."""
    points, names = true_points(demo_folder())
    ordered = np.full((FRAMES, len(muybridge.BODY23), 3), np.nan)
    ordered[:, [muybridge.BODY23.index(name) for name in names]] = points[:FRAMES]
    return ordered


@pytest.fixture(scope="module")
def background(images: list[np.ndarray]) -> list[np.ndarray]:
    """What the demo's static cameras see at most times, for want of an empty picture."""
    return [np.median(frames, axis=0).astype(np.uint8) for frames in images]


def test_detector_puts_a_box_round_the_person(
    images: list[np.ndarray], cameras: muybridge.CameraGroup, truth: np.ndarray
) -> None:
    detector = muybridge.PersonDetector()
    for frames, camera in zip(images, cameras, strict=True):
        found = detector.detect(frames[5])
        assert len(found) == 1 and found.confidence[0] > 0.35
        left, top, right, bottom = found.boxes_px[0]
        px = camera.project(truth[5])
        inside = (px >= [left - 10, top - 10]) & (px <= [right + 10, bottom + 10])
        assert inside[np.isfinite(px)].mean() > 0.97
        assert right - left < 1.6 * np.ptp(px[:, 0]) and bottom - top < 1.6 * np.ptp(px[:, 1])


def test_a_camera_on_its_side_is_turned_upright(images: list[np.ndarray], cameras: muybridge.CameraGroup) -> None:
    camera, image = cameras[0], images[0][5]
    turned = np.ascontiguousarray(np.rot90(image))  # counterclockwise: what was right is up
    focal_x, focal_y, middle_x, middle_y = camera.params
    quarter = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    side = muybridge.Camera(
        "side", "PINHOLE", camera.height, camera.width, (focal_y, focal_x, middle_y, camera.width - 1 - middle_x),
        quarter @ camera.cam_from_world,
    )  # fmt: skip
    upright = muybridge.PersonDetector().detect(image, camera=camera).boxes_px[0]
    left, top, right, bottom = muybridge.PersonDetector().detect(turned, camera=side).boxes_px[0]
    back = [camera.width - 1 - bottom, left, camera.width - 1 - top, right]
    np.testing.assert_allclose(back, upright, atol=12)


def test_landmarks_are_where_the_truth_is(
    images: list[np.ndarray], cameras: muybridge.CameraGroup, truth: np.ndarray, background: list[np.ndarray]
) -> None:
    detector, network = muybridge.PersonDetector(), muybridge.KeypointNetwork()
    whitened, errors = [], []
    for frames, camera, empty in zip(images, cameras, background, strict=True):
        boxes = detector.detect(frames[5], camera=camera, background=empty).boxes_px
        found = network.locate(frames[5], boxes, camera=camera, background=empty)
        assert found.points_px.shape == (1, 23, 2) and found.landmarks == muybridge.BODY23
        away = np.linalg.norm(found.points_px[0] - camera.project(truth[5]), axis=-1)
        errors.append(away)
        whitened.append(away / found.sd_px[0])
        assert found.confidence.max() <= 1 and (found.confidence[np.isnan(found.sd_px)] == 0).all()
        assert ((found.visibility >= 0) & (found.visibility <= 1)).all()
    assert np.nanmedian(errors) < 4 and np.isfinite(errors).mean() > 0.9
    # The median length of a two-dimensional Gaussian error is 1.18 of its standard deviations.
    assert 0.5 < np.nanmedian(whitened) < 2.5


def test_a_shifted_box_is_corrected(
    images: list[np.ndarray], cameras: muybridge.CameraGroup, truth: np.ndarray
) -> None:
    detector, network = muybridge.PersonDetector(), muybridge.KeypointNetwork()
    for frames, camera in zip(images, cameras, strict=True):
        (box,) = detector.detect(frames[5]).boxes_px
        width, height = box[2] - box[0], box[3] - box[1]
        shift = np.array([0.4 * width, 0.1 * height] * 2)
        found = network.locate(frames[5], [box + shift])
        assert np.nanmedian(np.linalg.norm(found.points_px[0] - camera.project(truth[5]), axis=-1)) < 6
        assert np.abs(found.boxes_px[0] - box).max() < 0.1 * height


def test_several_boxes_and_none(images: list[np.ndarray]) -> None:
    network = muybridge.KeypointNetwork(precision="fp32")
    (box,) = muybridge.PersonDetector().detect(images[2][5]).boxes_px
    several = network.locate(images[2][5], [box, box + 4])
    assert len(several) == 2
    assert np.nanmedian(np.linalg.norm(several.points_px[0] - several.points_px[1], axis=-1)) < 3
    assert network.locate(images[2][5], np.empty((0, 4))).points_px.shape == (0, 23, 2)


def test_images_are_checked(images: list[np.ndarray], cameras: muybridge.CameraGroup) -> None:
    detector, network, image = muybridge.PersonDetector(), muybridge.KeypointNetwork(), images[0][0]
    with pytest.raises(ValueError, match=r"\(H, W, 3\) RGB uint8, not \(480, 640, 3\) float64"):
        detector.detect(image / 255)
    with pytest.raises(ValueError, match="320x240 px for camera cam1 of 640x480"):
        detector.detect(image[::2, ::2], camera=cameras[0])
    with pytest.raises(ValueError, match="background of 320x240"):
        network.locate(image, [[0, 0, 9, 9]], background=image[::2, ::2])
    with pytest.raises(ValueError, match="left < right"):
        network.locate(image, [[9, 0, 0, 9]])
    with pytest.raises(muybridge.ModelError, match="no.onnx") as error:
        muybridge.PersonDetector("no.onnx")
    assert "--" not in str(error.value)


def test_images_stay_as_they_were(images: list[np.ndarray]) -> None:
    dark = (images[0][5] // 8).astype(np.uint8)
    before = dark.copy()
    found = muybridge.PersonDetector().detect(dark)
    muybridge.KeypointNetwork().locate(dark, found.boxes_px)
    np.testing.assert_array_equal(dark, before)
    assert len(found) == 1, "dark images are stretched for the networks"


def test_live_capture_follows_the_person(
    images: list[np.ndarray], cameras: muybridge.CameraGroup, truth: np.ndarray
) -> None:
    with muybridge.LiveCapture(cameras, fps=25) as live:
        assert live.landmarks == muybridge.BODY23
        moments = [live.process([frames[t] for frames in images]) for t in range(FRAMES)]
    assert [[person.id for person in people] for people in moments] == [[0]] * FRAMES
    assert all(people[0].cameras == cameras.names for people in moments)
    points = np.stack([people[0].points_world for people in moments])
    error = np.linalg.norm(points - truth, axis=-1)
    assert np.isfinite(points).all(-1).mean() > 0.97
    assert np.nanmean(error) < 0.03
    sd = np.sqrt(np.stack([np.trace(people[0].covariance_world, axis1=-2, axis2=-1) for people in moments]))
    assert 0.3 < np.nanmedian(error / sd) < 3


def test_live_capture_goes_on_without_a_camera_and_with_nobody(
    images: list[np.ndarray], cameras: muybridge.CameraGroup, truth: np.ndarray
) -> None:
    three = cameras.select(["cam1", "cam2", "cam3"])
    with muybridge.LiveCapture(three, fps=25, window=0.2) as live:
        for t in range(3):
            everybody = live.process({name: images[c][t] for c, name in enumerate(three.names)})
        without = live.process({"cam1": images[0][3], "cam2": images[1][3], "cam3": None})
        alone = live.process({"cam1": images[0][4]})
        nobody = [live.process([np.zeros((480, 640, 3), np.uint8)] * 3) for _ in range(30)][-1]
    assert [person.cameras for person in everybody] == [("cam1", "cam2", "cam3")]
    assert [(person.id, person.cameras) for person in without] == [(0, ("cam1", "cam2"))]
    assert np.nanmean(np.linalg.norm(without[0].points_world - truth[3], axis=-1)) < 0.05
    assert alone == () and nobody == ()


def test_live_capture_checks_its_input(images: list[np.ndarray], cameras: muybridge.CameraGroup) -> None:
    with pytest.raises(ValueError, match="two cameras or more"):
        muybridge.LiveCapture(cameras.select(["cam1"]), fps=25)
    with pytest.raises(ValueError, match="above zero"):
        muybridge.LiveCapture(cameras, fps=0)
    with muybridge.LiveCapture(cameras, fps=25) as live:
        with pytest.raises(ValueError, match="2 images for 4 cameras"):
            live.process([images[0][0], images[1][0]])
        with pytest.raises(ValueError, match="no camera cam9"):
            live.process({"cam9": images[0][0]})
        with pytest.raises(ValueError, match="image of cam2 of 320x240"):
            live.process([images[0][0], images[1][0][::2, ::2], images[2][0], images[3][0]])
