"""Videos: probed without decoding, read once in order, written whole or not at all."""

import struct
import tracemalloc
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from muybridge.errors import VideoError
from muybridge.infer.session.frame_copies import fit_inside
from muybridge.infer.session.probe import is_video, probe_video
from muybridge.infer.session.video import chunk_frames, read_chunks

FASTSTART = {"movflags": "+faststart"}


@pytest.fixture
def numbers(frame_number):
    """`numbers(path, ...)`: what the frames of a film of `make_video` show, in the order they are read."""

    def read(path: Path, **how) -> list[int]:
        return [frame_number(image) for chunk in read_chunks(probe_video(path), **how) for image in chunk]

    return read


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("a.mp4", "libx264"),
        ("a.mkv", "libx264"),
        ("a.avi", "libx264"),
        ("a.ts", "libx264"),
        ("a.mov", "mpeg4"),
        ("a.webm", "libvpx-vp9"),
        ("a.webm", "libvpx"),
    ],
)
def test_all_frames_come_in_order_from_any_container(tmp_path, make_video, name, codec, numbers):
    path = make_video(tmp_path / name, frames=40, codec=codec, fps=25)
    info = probe_video(path)
    assert (info.width, info.height, info.frames) == (64, 48, 40)
    assert info.fps == pytest.approx(25)
    assert not info.variable_rate
    assert numbers(path) == list(range(40))


def test_empty_frames_of_an_avi_were_dropped(tmp_path):
    kept = [0, 1, 2, 5, 6, 7, 11, 12, 13, 14]
    with av.open(str(tmp_path / "a.avi"), "w") as out:
        stream = out.add_stream("mjpeg", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for k in kept:
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 10 * k, np.uint8), format="rgb24")
            frame.pts, frame.time_base = k, Fraction(1, 30)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    info = probe_video(tmp_path / "a.avi")
    assert info.variable_rate and 30 * info.times == pytest.approx(kept)
    assert [round(i.mean() / 10) for chunk in read_chunks(info) for i in chunk] == kept


def test_chunks_are_bounded_and_may_be_kept(tmp_path, make_video, frame_number):
    info = probe_video(make_video(tmp_path / "a.mp4", frames=37))
    chunks = list(read_chunks(info))
    assert max(len(c) for c in chunks) <= chunk_frames(info)
    assert [frame_number(i) for c in chunks for i in c] == list(range(37))
    assert chunk_frames(replace(info, width=3840, height=2160)) * 3840 * 2160 * 3 <= 100 * 2**20


def test_memory_does_not_grow_with_the_video(tmp_path, make_video):
    peaks = []
    for frames in (48, 240):
        info = probe_video(make_video(tmp_path / f"{frames}.mp4", frames=frames, width=320, height=240))
        tracemalloc.start()
        for chunk in read_chunks(info):
            assert chunk.nbytes <= 16 * 320 * 240 * 3
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] < 240 * 320 * 240 * 3 / 2


def test_chosen_frames_may_be_skipped_and_repeated(tmp_path, make_video, numbers):
    path = make_video(tmp_path / "a.mp4", frames=20)
    chosen = np.array([0, 2, 2, 2, 7, 8, 19])
    assert numbers(path, indices=chosen) == chosen.tolist()


@pytest.mark.parametrize("name", ["a.mp4", "a.mov", "a.mkv"])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_truncated_video_is_refused_with_counts(tmp_path, make_video, name, share):
    muxer = {} if name.endswith("mkv") else FASTSTART
    path = make_video(tmp_path / name, frames=60, muxer=muxer)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(VideoError, match=rf"{name}.* truncated.*60.*re-encode"):
        probe_video(path)


def test_a_video_without_its_index_is_refused(tmp_path, make_video):
    path = make_video(tmp_path / "a.mp4", frames=60)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(VideoError, match=r"a\.mp4 cannot be decoded"):
        probe_video(path)


@pytest.mark.parametrize("content", [b"", b"not a film at all" * 50])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(VideoError, match=r"a\.mp4"):
        probe_video(tmp_path / "a.mp4")


def test_zeros_in_the_middle_are_found_while_decoding(tmp_path, make_video, numbers):
    path = make_video(tmp_path / "a.mp4", frames=60, muxer=FASTSTART, options={"g": "1"})
    data = bytearray(path.read_bytes())
    half = len(data) // 2
    data[half : half + len(data) // 4] = bytes(len(data) // 4)
    path.write_bytes(data)
    with pytest.raises(VideoError, match=r"a\.mp4 (cannot be decoded after frame|is damaged).*60"):
        numbers(path)


def test_an_index_that_lists_more_frames_than_there_are_is_refused(tmp_path, make_video):
    # The container lists 60 samples; the last ten are moved to beyond the end of the file.
    path = make_video(tmp_path / "a.mp4", frames=60, muxer=FASTSTART, options={"g": "1", "bf": "0"})
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[: size - 1])
    with pytest.raises(VideoError, match="truncated or damaged at frame 60 of the 60"):
        probe_video(path)


def test_an_edit_list_that_leaves_frames_out_is_no_damage(tmp_path, make_video, numbers):
    path = make_video(tmp_path / "a.mp4", frames=60, options={"g": "10", "bf": "2"})
    data = bytearray(path.read_bytes())
    at = data.index(b"elst") + 4 + 8  # after version, flags and the number of entries
    whole = struct.unpack_from(">I", data, at)[0]
    struct.pack_into(">I", data, at, whole // 2)
    path.write_bytes(data)
    info = probe_video(path)
    assert 25 <= info.frames < 60
    assert numbers(path) == list(range(info.frames))


def test_a_rotation_flag_turns_the_frames(tmp_path, make_video, frame_number):
    path = make_video(tmp_path / "a.mp4", frames=5)
    data = bytearray(path.read_bytes())
    upright = struct.pack(">9I", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    quarter = struct.pack(">9i", 0, 0x10000, 0, -0x10000, 0, 0, 0, 0, 0x40000000)
    at = data.index(upright, data.index(b"tkhd"))
    data[at : at + 36] = quarter
    path.write_bytes(data)
    info = probe_video(path)
    assert (info.width, info.height) == (48, 64)
    turned = next(read_chunks(info))[3]
    # This matrix asks for a quarter turn clockwise: the coded top is then the right-hand side.
    assert frame_number(np.rot90(turned, 1)) == 3
    coded = info.unrotated()
    assert (coded.width, coded.height, coded.rotation_deg) == (64, 48, 0)
    assert frame_number(next(read_chunks(coded))[3]) == 3


def test_a_varying_frame_rate_is_noticed(tmp_path, make_video):
    steps = np.array([33, 33, 100, 33, 33, 33, 67, 33] * 4)
    pts = np.concatenate([[0], np.cumsum(steps)])[:30]
    path = make_video(tmp_path / "a.mp4", frames=30, pts=[int(p) for p in pts])
    info = probe_video(path)
    assert info.variable_rate
    assert info.times == pytest.approx(pts / 1000, abs=2e-3)


def test_an_undecodable_beginning_counts_as_time(tmp_path):
    """A recorder that joins a stream between two whole pictures."""
    path = tmp_path / "joined.ts"
    noise = np.random.default_rng(0).integers(0, 255, (24, 48, 64, 3)).astype(np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.options = {"g": "12", "keyint_min": "12", "bf": "0", "sc_threshold": "0"}
        for image in noise:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    whole = probe_video(path)
    assert whole.frames == 24 and whole.times[0] == 0
    path.write_bytes(path.read_bytes()[188 * 40 :])
    info = probe_video(path)
    shown = np.concatenate(list(read_chunks(info)))
    assert info.frames == len(shown) == 12
    assert info.times[0] > 0.1 and np.diff(info.times) == pytest.approx(0.04) and info.fps == 25
    assert np.abs(shown[0].astype(int) - noise[12]).mean() < 50


def test_images_and_texts_are_no_videos(tmp_path, make_video):
    (tmp_path / "notes.txt").write_text("first take\n" * 40)
    (tmp_path / "empty").write_bytes(b"")
    cv2.imwrite(str(tmp_path / "still.png"), np.zeros((8, 8, 3), np.uint8))
    assert not is_video(tmp_path / "notes.txt")
    assert not is_video(tmp_path / "empty")
    assert not is_video(tmp_path / "still.png")
    assert is_video(make_video(tmp_path / "odd.name.mp4"))


def test_a_size_fits_inside_a_longer_side_and_is_even():
    assert fit_inside(1080, 1921, 96) == (54, 96)
    assert fit_inside(63, 31, 960) == (64, 32)
