"""Videos of another size than their calibration: every way of fitting, and the rule that chooses one."""

import cv2
import numpy as np
import pytest

from muybridge.arrays import ByteArray, FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import find_calibration, load_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.video_size import fit_to_video
from tests.paths import SHARED

POINTS_WORLD = np.random.default_rng(0).uniform([-1, -0.7, 3], [1, 0.7, 5], (40, 3))


def camera_of(width: int, height: int, name: str = "cam01") -> Camera:
    params = (0.9 * width, 0.91 * width, width / 2 + 3.0, height / 2 - 5.0, -0.05, 0.02, 0.001, -0.002)
    return Camera(name, "OPENCV", width, height, params, np.eye(3, 4))


def picture(width: int, height: int, bar_rows: int = 0, bar_columns: int = 0, level: int = 120) -> ByteArray:
    """Noise with black bars at both ends; video black is 16 and compression rings into it."""
    rng = np.random.default_rng(5)
    image = rng.integers(level // 2, level + 1, (height, width, 3)).astype(np.uint8)
    black = rng.integers(8, 24, image.shape).astype(np.uint8)
    rows, columns = np.arange(height)[:, None], np.arange(width)[None, :]
    bars = (rows < bar_rows) | (rows >= height - bar_rows) | (columns < bar_columns) | (columns >= width - bar_columns)
    return np.where(bars[..., None], black, image)


def affine(camera: Camera, fitted: Camera) -> FloatArray:
    """(2, 2) scale and offset per axis, from corner-based pixels of one image to the other's."""
    before, after = camera.project(POINTS_WORLD) + 0.5, fitted.project(POINTS_WORLD) + 0.5
    return np.array([np.polyfit(before[:, k], after[:, k], 1) for k in (0, 1)])


@pytest.mark.parametrize(
    ("calibrated", "video", "how", "scale", "offset"),
    [
        ((1920, 1080), (1280, 720), "scale", (2 / 3, 2 / 3), (0, 0)),
        ((1920, 1080), (960, 1080), "scale", (0.5, 1), (0, 0)),
        (
            (1088, 1920),
            (1080, 1920),
            "letterbox",
            (1080 / 1088, 1080 / 1088),
            (0, (1920 - 1920 * 1080 / 1088) / 2),
        ),
        ((640, 480), (1920, 1080), "letterbox", (2.25, 2.25), (240, 0)),
        ((640, 480), (1920, 1080), "fill", (3, 3), (0, -180)),
        ((1920, 1440), (1920, 1080), "fill", (1, 1), (0, -180)),
        ((1920, 1200), (1280, 1024), "crop", (1, 1), (-320, -88)),
        ((1921, 1200), (1280, 1024), "crop", (1, 1), (-321, -88)),
        ((1280, 1024), (1920, 1200), "crop", (1, 1), (320, 88)),
        ((1920, 1088), (1920, 1080), "crop-corner", (1, 1), (0, 0)),
    ],
)
def test_effect_of_each_fit_on_pixels(calibrated, video, how, scale, offset) -> None:  # type: ignore[no-untyped-def]
    camera = camera_of(*calibrated)
    fitted, assumption = fit_to_video(camera, *video, how=how)
    assert (fitted.width, fitted.height) == video and assumption is None
    np.testing.assert_allclose(affine(camera, fitted), np.column_stack([scale, offset]), atol=1e-7)


def test_the_same_size_changes_nothing() -> None:
    camera = camera_of(1920, 1080)
    for how in ("auto", "scale", "letterbox", "fill", "crop", "crop-corner", "rotate-cw"):
        assert fit_to_video(camera, 1920, 1080, how) == (camera, None)


@pytest.mark.parametrize(
    ("calibrated", "video", "bars", "chosen"),
    [
        # The shape stays: resized, also where the size was rounded to whole or even pixels.
        ((1920, 1080), (1280, 720), None, "scale"),
        ((1920, 1080), (854, 480), None, "scale"),
        ((1920, 1080), (426, 240), None, "scale"),
        ((1280, 720), (3840, 2160), None, "scale"),
        # The shape changes: the frame's black bars decide.
        ((1088, 1920), (1080, 1920), (7, 0), "letterbox"),
        ((640, 480), (1920, 1080), (0, 240), "letterbox"),
        ((1088, 1920), (1080, 1920), (0, 0), "crop-corner"),
        ((1920, 1088), (1920, 1080), (0, 0), "crop-corner"),
        ((1920, 1440), (1920, 1080), (0, 0), "fill"),
        ((4000, 3000), (1920, 1080), (0, 0), "fill"),
        ((640, 480), (1920, 1080), (0, 0), "fill"),
        ((1920, 1100), (1920, 1080), (0, 0), "fill"),
        # No frame to look at: near shapes were fitted in, others are another mode of the camera.
        ((1088, 1920), (1080, 1920), None, "letterbox"),
        ((1920, 1088), (1920, 1080), None, "letterbox"),
        ((640, 480), (1920, 1080), None, "fill"),
    ],
)
def test_the_automatic_choice(calibrated, video, bars, chosen) -> None:  # type: ignore[no-untyped-def]
    camera = camera_of(*calibrated)
    image = None if bars is None else picture(*video, bar_rows=bars[0], bar_columns=bars[1])
    fitted, assumption = fit_to_video(camera, *video, image=image)
    assert fitted == fit_to_video(camera, *video, how=chosen)[0]
    assert assumption is not None and "\n" not in assumption.sentence
    assert assumption.sentence.startswith(
        f"camera cam01: calibrated at {calibrated[0]}x{calibrated[1]}, video is {video[0]}x{video[1]};"
    )
    assert assumption.sentence.endswith(f"({chosen})") and assumption.fit == chosen
    assert len(assumption.alternatives) == 4 and chosen not in assumption.alternatives


def test_a_dark_frame_is_ignored() -> None:
    camera = camera_of(640, 480)
    dark = picture(1920, 1080, level=20)
    assert fit_to_video(camera, 1920, 1080, image=dark) == fit_to_video(camera, 1920, 1080)
    # Dark at the edges only on one side is no bar.
    one_side = picture(1920, 1080)
    one_side[:, :240] = 0
    assert fit_to_video(camera, 1920, 1080, image=one_side)[0] == fit_to_video(camera, 1920, 1080, "fill")[0]


def test_grey_frames_serve_too() -> None:
    camera, image = camera_of(1088, 1920), picture(1080, 1920, bar_rows=7)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    assert fit_to_video(camera, 1080, 1920, image=grey) == fit_to_video(camera, 1080, 1920, image=image)


@pytest.mark.parametrize("video", [(1080, 1920), (720, 1280), (1080, 1900)])
def test_a_rotated_video_is_an_error(video: tuple[int, int]) -> None:
    camera = camera_of(1920, 1080)
    with pytest.raises(CalibrationError, match='cam01: calibrated at 1920x1080, .*pass "rotate-cw" or "rotate-ccw"'):
        fit_to_video(camera, *video)


@pytest.mark.parametrize(("how", "quarter_turns"), [("rotate-cw", 1), ("rotate-ccw", -1)])
def test_turning_and_resizing(how: str, quarter_turns: int) -> None:
    camera = camera_of(1920, 1080)
    fitted, assumption = fit_to_video(camera, 720, 1280, how)  # type: ignore[arg-type]
    expected = camera.turned(quarter_turns).resized(720, 1280)
    np.testing.assert_allclose(fitted.project(POINTS_WORLD), expected.project(POINTS_WORLD), atol=1e-9)
    assert assumption is not None and "resized by 0.6667" in assumption.sentence
    # A camera of the rig that was not rotated is unchanged.
    upright = camera_of(1080, 1920)
    assert fit_to_video(upright, 1080, 1920, how) == (upright, None)  # type: ignore[arg-type]


def test_callers_mistakes() -> None:
    camera = camera_of(640, 480)
    with pytest.raises(ValueError, match="how must be one of auto, scale"):
        fit_to_video(camera, 640, 480, "stretch")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="the image is 100x100, the video 640x480"):
        fit_to_video(camera, 640, 480, image=np.zeros((100, 100, 3), np.uint8))
    with pytest.raises(ValueError, match="not positive"):
        fit_to_video(camera, 0, 480)


# --- the balancing take: two videos are 8 px narrower than their calibration ---

TAKE = SHARED / "data" / "balancing"


@pytest.mark.skipif(not TAKE.is_dir(), reason="../shared/data is not here")
@pytest.mark.parametrize("name", ["cam01", "cam02"])
def test_the_automatic_choice_agrees_with_the_pixels_of_a_real_take(name: str) -> None:
    """Static features of the calibration's picture are found in the video where the fitted camera says."""
    camera = load_calibration(find_calibration(TAKE))[name]
    ok, frame = cv2.VideoCapture(str(TAKE / "videos" / f"{name}.mp4")).read()
    assert ok
    height, width = frame.shape[:2]
    calibrated = cv2.imread(str(TAKE / "calibration" / "extrinsics" / f"{name}_ext.png"))
    sift = cv2.SIFT_create(nfeatures=2000)
    keys_a, words_a = sift.detectAndCompute(cv2.cvtColor(calibrated, cv2.COLOR_BGR2GRAY), None)
    keys_b, words_b = sift.detectAndCompute(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), None)
    pairs = cv2.BFMatcher().knnMatch(words_a, words_b, k=2)
    good = [m for m, n in pairs if m.distance < 0.7 * n.distance]
    before = np.array([keys_a[m.queryIdx].pt for m in good])
    after = np.array([keys_b[m.trainIdx].pt for m in good])
    off = {}
    for how in ("auto", "scale", "fill", "crop", "crop-corner"):
        fitted, _ = fit_to_video(camera, width, height, how, frame)  # type: ignore[arg-type]
        predicted = fitted.project(fitted.center_world + camera.rays(before))
        off[how] = float(np.median(np.linalg.norm(predicted - after, axis=1)))
    assert len(good) > 100
    assert off["auto"] < 1.0
    assert min(value for how, value in off.items() if how != "auto") > 2 * off["auto"]
