"""The overlay video: what is drawn where, in which colour, and that a browser can play it."""

import re
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from muybridge.errors import OutputError, VideoError
from muybridge.geometry.landmarks.sets import BODY23, side_of
from muybridge.infer.report.templates import SIDES_ON_DARK, SIDES_ON_LIGHT, page_style, read_asset
from muybridge.infer.results.overlay import OverlayOptions, write_overlay
from muybridge.infer.results.overlay_drawing import (
    LEFT,
    MIDDLE,
    REJECTED,
    RIGHT,
    OverlayData,
    colour_of,
    draw_overlay,
)

J = len(BODY23)


def _grey(count: int, height: int = 240, width: int = 320) -> Iterator[np.ndarray]:
    for _ in range(count):
        yield np.full((height, width, 3), 90, np.uint8)


def _spread_points(count: int) -> np.ndarray:
    """(T, J, 2) landmarks on a grid of a 640 x 480 original, far enough apart not to cover each other."""
    grid = np.stack([(np.arange(J) % 6) * 90.0 + 80.0, (np.arange(J) // 6) * 90.0 + 90.0], axis=-1)
    return np.repeat(grid[None], count, axis=0)


def _data(
    keypoints: np.ndarray | None, projected: np.ndarray, name: str = "a", fps: float = 30.0, **more: object
) -> OverlayData:
    """What is drawn; arrays of single frames are repeated for four."""
    if projected.ndim == 2:
        projected = np.repeat(projected[None], 4, axis=0)
        keypoints = None if keypoints is None else np.repeat(keypoints[None], 4, axis=0)
        more = {key: np.repeat(np.asarray(value)[None], 4, axis=0) for key, value in more.items()}
    return OverlayData(
        camera_name=name, fps=fps, landmarks=BODY23, projected_px=projected, keypoints_px=keypoints,
        **more,  # type: ignore[arg-type]
    )  # fmt: skip


def _distance(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.abs(image.astype(int) - colour).sum(axis=-1)


def test_sides_by_name() -> None:
    assert [side_of(n) for n in ("left_knee", "right_toe", "nose", "handLeft")] == [
        "left", "right", "middle", "left",
    ]  # fmt: skip
    assert colour_of("left_hip", "left_knee") == LEFT
    assert colour_of("left_hip", "right_hip") == MIDDLE
    assert colour_of("nose", "left_eye") == MIDDLE


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.7])
def test_points_land_on_scaled_pixel(scale: float) -> None:
    # A point in the middle of the original (pixel-centre convention) is in the middle at every scale.
    original = np.array([320.0, 240.0])
    frame = np.zeros((round(480 * scale), round(640 * scale), 3), np.uint8)
    projected = np.full((J, 2), np.nan)
    projected[BODY23.index("left_wrist")] = original / 2 - 0.25
    image = draw_overlay(frame, 0, scale, _data(None, projected), legend=False)
    rows, columns = np.nonzero(_distance(image, LEFT) < 60)
    wanted = (original / 2 - 0.25 + 0.5) * scale - 0.5
    np.testing.assert_allclose([columns.mean(), rows.mean()], wanted, atol=0.6)


def test_scale_may_differ_by_axis() -> None:
    projected = np.full((J, 2), np.nan)
    projected[BODY23.index("right_wrist")] = [400.0, 300.0]
    image = draw_overlay(np.zeros((240, 640, 3), np.uint8), 0, (1.0, 0.5), _data(None, projected), legend=False)
    rows, columns = np.nonzero(_distance(image, RIGHT) < 60)
    np.testing.assert_allclose([columns.mean(), rows.mean()], [400.0, 149.75], atol=0.6)


def test_rejected_points_differ_from_inliers() -> None:
    points = _spread_points(1)[0]
    nothing = np.full((J, 2), np.nan)
    frame = np.full((480, 640, 3), 90, np.uint8)
    inlier = np.ones(J, bool)
    inlier[7] = False
    image = draw_overlay(frame, 0, 1.0, _data(points, nothing, inlier=inlier), legend=False)
    rows, columns = np.nonzero(_distance(image, REJECTED) < 90)
    assert len(rows) > 5
    np.testing.assert_allclose([columns.mean(), rows.mean()], points[7], atol=1.0)


def test_missing_is_not_drawn_and_input_is_untouched() -> None:
    frame = np.full((480, 640, 3), 90, np.uint8)
    nothing = np.full((J, 2), np.nan)
    image = draw_overlay(frame, 3, 1.0, _data(nothing, nothing, ""), legend=False)
    assert (frame == 90).all()
    # The caption is at the top; below it nothing has changed.
    assert (image[120:] == 90).all()
    assert (image[:120] != 90).any()


def test_far_outside_points_do_not_break_drawing() -> None:
    projected = _spread_points(1)[0]
    projected[:4] = [[1e12, 5.0], [-1e7, 3.0], [np.inf, 0.0], [np.nan, np.nan]]
    image = draw_overlay(np.zeros((240, 320, 3), np.uint8), 0, 0.5, _data(projected, projected))
    assert image.any()


def test_video_plays_back_with_figure_in_place(tmp_path: Path) -> None:
    count, path = 12, tmp_path / "overlay_cam01.mp4"
    points = _spread_points(count)
    result = write_overlay(
        path, _grey(count, 241, 321), 0.5,
        _data(points, points, "cam01", 29.97, residual_px=np.full((count, J), 2.0)), thumbnail_frames=(0, 5, 40),
    )  # fmt: skip
    assert result.frames == count and path.is_file()
    assert not list(tmp_path.glob(".*"))
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
        assert (stream.width, stream.height) == (322, 242)
        assert float(stream.average_rate) == pytest.approx(29.97, abs=0.01)
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(images) == count
    x, y = np.round((points[0, BODY23.index("left_ankle")] + 0.5) * 0.5 - 0.5).astype(int)
    warm = images[5][y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0)
    assert warm[0] > warm[2] + 60, "the left ankle is not drawn warm where it was projected"
    # +faststart: the index precedes the samples, so that a browser can begin at once.
    head = path.read_bytes()
    assert head.index(b"moov") < head.index(b"mdat")
    assert set(result.thumbnails) == {0, 5}
    decoded = cv2.imdecode(np.frombuffer(result.thumbnails[5], np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape[:2] == (242, 322)


def test_equal_runs_write_equal_bytes(tmp_path: Path) -> None:
    points = _spread_points(20)
    rng = np.random.default_rng(4)
    frames = rng.integers(0, 255, (20, 120, 160, 3)).astype(np.uint8)
    written = []
    for name in ("a.mp4", "b.mp4", "c.mp4", "d.mp4"):
        write_overlay(tmp_path / name, frames, 0.25, _data(points, points))
        written.append((tmp_path / name).read_bytes())
    assert len(set(written)) == 1
    # x264 writes its settings into the file: with threads of its own choice they depend on the machine.
    assert re.findall(rb" threads=(\d+)", written[0]) == [b"1"]


def test_left_and_right_have_one_colour_each_everywhere() -> None:
    assert "#{:02x}{:02x}{:02x}".format(*LEFT) == SIDES_ON_DARK["left"]
    assert "#{:02x}{:02x}{:02x}".format(*RIGHT) == SIDES_ON_DARK["right"]
    style = page_style()
    for side in ("left", "right"):
        assert re.findall(rf"--{side}: (#\w+);", style) == [SIDES_ON_LIGHT[side], SIDES_ON_DARK[side]]
        assert re.findall(rf"--{side}-on-dark: (#\w+);", style) == [SIDES_ON_DARK[side]]
    script = read_asset("label.js")  # draws on a dark canvas
    assert 'side === "L" ? LEFT : side === "R" ? RIGHT' in script and "-on-dark" in script
    red, _, blue = (int(SIDES_ON_LIGHT["left"][k : k + 2], 16) for k in (1, 3, 5))
    assert red > blue, "the left is warm, as the pages say"


def test_thumbnails_are_shrunk(tmp_path: Path) -> None:
    points = _spread_points(1)
    result = write_overlay(
        tmp_path / "a.mp4", _grey(1), 0.5, _data(None, points),
        thumbnail_frames=(0,), options=OverlayOptions(thumbnail_side_px=100),
    )  # fmt: skip
    shape = cv2.imdecode(np.frombuffer(result.thumbnails[0], np.uint8), cv2.IMREAD_COLOR).shape
    assert shape == (75, 100, 3)


def test_shorter_input_decides_length(tmp_path: Path) -> None:
    points = _spread_points(5)
    assert write_overlay(tmp_path / "a.mp4", _grey(3), 1.0, _data(None, points)).frames == 3
    assert write_overlay(tmp_path / "b.mp4", _grey(9), 1.0, _data(None, points)).frames == 5


def test_failed_write_leaves_nothing(tmp_path: Path) -> None:
    points = _spread_points(5)

    def breaks() -> Iterator[np.ndarray]:
        yield from _grey(2)
        raise RuntimeError("decoder died")

    target = tmp_path / "overlay_a.mp4"
    target.write_bytes(b"the previous run's")
    with pytest.raises(RuntimeError, match="decoder died"):
        write_overlay(target, breaks(), 1.0, _data(None, points))
    assert target.read_bytes() == b"the previous run's"
    assert [p.name for p in tmp_path.iterdir()] == ["overlay_a.mp4"]


def test_no_frames_and_no_folder_are_known_errors(tmp_path: Path) -> None:
    points = _spread_points(1)
    with pytest.raises(VideoError, match="cam07"):
        write_overlay(tmp_path / "a.mp4", iter(()), 1.0, _data(None, points, "cam07"))
    (tmp_path / "absent").write_text("a file, not a folder")
    with pytest.raises(OutputError, match=r"absent.*choose a folder"):
        write_overlay(tmp_path / "absent" / "a.mp4", _grey(1), 1.0, _data(None, points))
    with pytest.raises(ValueError, match="keypoints_px"):
        write_overlay(tmp_path / "a.mp4", _grey(1), 1.0, _data(points[:, :5], points))
