"""Damaged videos: no picture that differs from the recording is delivered without a word, no sound one is blamed."""

import random
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from muybridge.errors import MuybridgeError, VideoError
from muybridge.infer.session.damage import DamageWatch, damage_notice, frame_ranges, spread
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.video import read_chunks
from tests.paths import DATA

WIDTH, HEIGHT, FRAMES = 192, 144, 30
# Mean absolute difference, of 255, from which a picture counts as damaged.
VISIBLE = 1.0
H264 = ("libx264", "a.mp4", {"g": "10", "crf": "20", "preset": "veryfast"})
H264_LONG = ("libx264", "a.mkv", {"crf": "26", "preset": "veryfast"})
BASELINE = ("libx264", "a.mp4", {"profile": "baseline", "crf": "23"})
MPEG2 = ("mpeg2video", "a.mpg", {})


def _pictures(seed: int) -> list[np.ndarray]:
    """A textured room with a textured box that moves through it."""
    rng = np.random.default_rng(seed)
    room = cv2.GaussianBlur(rng.integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8), (0, 0), 3)
    room = cv2.normalize(room, None, 20, 235, cv2.NORM_MINMAX)
    box = cv2.resize(rng.integers(0, 255, (12, 8, 3)).astype(np.uint8), (32, 64), interpolation=cv2.INTER_CUBIC)
    images = []
    for t in range(FRAMES):
        image = room.copy()
        x, y = 10 + 4 * t, 40 + round(10 * np.sin(t / 4))
        image[y : y + 64, x : x + 32] = box
        images.append(image)
    return images


def _encode(folder: Path, how: tuple[str, str, dict[str, str]], seed: int = 0) -> Path:
    codec, name, options = how
    path = folder / name
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt, stream.options = WIDTH, HEIGHT, "yuv420p", options
        stream.bit_rate = 1_500_000
        for image in _pictures(seed):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def _damaged_copy(path: Path, seed: int) -> Path:
    """The video with a few bits of its packets flipped; containers and their indices stay whole."""
    rng = random.Random(seed)
    with av.open(str(path)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.size > 16 and p.pos is not None]
    data = bytearray(path.read_bytes())
    for _ in range(rng.choice([1, 1, 2, 4, 8])):
        begin, size = rng.choice(places)
        data[min(rng.randrange(begin + 10, begin + size), len(data) - 1)] ^= 1 << rng.randrange(8)
    damaged = path.with_name(f"damaged{seed}{path.suffix}")
    damaged.write_bytes(data)
    return damaged


def _read(path: Path, threads: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """All pictures, and which frames are said to be damaged."""
    info = probe_video(path)
    watch = DamageWatch(info)
    pictures = np.concatenate(list(read_chunks(info, threads=threads, watch=watch)))
    return pictures, watch.damaged()


@pytest.mark.parametrize("how", [H264, H264_LONG, BASELINE, MPEG2], ids=lambda how: f"{how[0]}-{how[1]}")
def test_no_damaged_picture_without_a_word(tmp_path, how):
    clean = _encode(tmp_path, how)
    truth, blamed = _read(clean)
    assert not blamed.any()
    found = 0
    for seed in range(8):
        try:
            pictures, blamed = _read(_damaged_copy(clean, seed))
        except VideoError as error:
            assert "damaged" in str(error)
            continue
        shared = min(len(pictures), len(truth))
        away = np.abs(pictures[:shared].astype(np.int16) - truth[:shared]).mean((1, 2, 3))
        if len(pictures) == len(truth):
            assert not ((away > VISIBLE) & ~blamed[:shared]).any()
        found += bool(blamed.any())
    assert found >= 2


def test_frame_threads_find_the_same_frames(tmp_path):
    damaged = _damaged_copy(_encode(tmp_path, H264), 5)
    alone, together = _read(damaged), _read(damaged, threads=3)
    assert alone[1].any()
    assert np.array_equal(alone[1], together[1])
    assert np.array_equal(alone[0][~alone[1]], together[0][~alone[1]])


def test_sound_recordings_are_not_blamed():
    videos = sorted(path for name in ("balancing/videos", "charuco", "hands") for path in (DATA / name).glob("*.mp4"))
    if not videos:
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    for path in videos:
        info = probe_video(path)
        watch = DamageWatch(info)
        for _ in read_chunks(info, np.arange(min(8, info.frames)), threads=2, watch=watch):
            pass
        assert not watch.damaged().any(), path


def test_the_recording_with_flipped_bits():
    path = DATA / "cases" / "video_silent_damage" / "cam01.mp4"
    if not path.is_file():
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    _, damaged = _read(path)
    assert damaged.all()
    assert "cam01.mp4: frames 0 to 23 (24 of 24) are damaged" in str(damage_notice(path.name, damaged))


def test_damage_spreads_to_the_next_frame_that_stands_alone():
    #      shown: I0 B1 P2 B3 I4 P5, decoded: I0 P2 B1 I4 B3 P5
    coded_at = np.array([0, 2, 1, 4, 3, 5])
    alone = np.array([True, False, False, False, True, False])

    def damaged(*corrupt: int) -> list[int]:
        return np.flatnonzero(spread(np.isin(np.arange(6), corrupt), coded_at, alone)).tolist()

    assert damaged() == []
    assert damaged(2) == [1, 2, 3]  # 3 is shown between the damaged one and the next that stands alone
    assert damaged(0) == [0, 1, 2, 3]
    assert damaged(3) == [3, 5]
    assert damaged(4) == [3, 4, 5]


@pytest.mark.parametrize(
    ("frames", "said"),
    [([3], "frame 3"), ([3, 4, 5], "frames 3 to 5"), ([1, 4, 5, 8], "frames 1, 4 to 5 and 8")],
)
def test_ranges_in_words(frames, said):
    assert frame_ranges(np.isin(np.arange(10), frames)) == said


def test_many_ranges_are_counted():
    assert frame_ranges(np.arange(40) % 2 == 0).endswith("8 and 15 more places")


def test_an_unknown_codec_is_named():
    folder = DATA / "cases" / "video_unknown_codec"
    if not folder.is_dir():
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    for name, codec in (("cam02.mp4", "avc1"), ("102_exception_a.mkv", "V_MP")):
        with pytest.raises(MuybridgeError, match=f"{name}: FFmpeg does not know .* codec {codec}"):
            probe_video(folder / name)


@pytest.mark.parametrize(("name", "fourcc"), [("a.mp4", b"avc1"), ("a.mkv", b"V_MPEG4/ISO/AVC")])
def test_a_changed_codec_is_named(tmp_path, make_video, name, fourcc):
    path = make_video(tmp_path / name)
    data = path.read_bytes()
    at = data.rindex(fourcc)
    changed = b"zZ9q" if name == "a.mp4" else b"V_MPEG4/ISO/ZZZ"
    path.write_bytes(data[:at] + changed + data[at + len(fourcc) :])
    with pytest.raises(VideoError, match=f"{name}: FFmpeg does not know .* {changed.decode()}"):
        probe_video(path)
