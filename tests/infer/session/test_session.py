"""Session folders: what is paired with what, what is mended and said, what is refused."""

import shutil
import struct
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from muybridge.errors import CalibrationError, MuybridgeError, SessionError, VideoError
from muybridge.geometry.calibration import export_calibration, load_calibration
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.session.discover import find_videos, select_cameras
from muybridge.infer.session.pairing import match_cameras, natural_key
from muybridge.infer.session.session import SessionOptions, open_session, with_frames
from tests.rigs import ring_of_cameras

HERE, FILE = Path("session"), Path("session/calibration.toml")


def paired(stems, names):
    order, said = match_cameras(stems, names, HERE, FILE)
    return [stems[k] for k in order], said


def test_a_session_is_videos_and_a_calibration(make_session):
    session = open_session(make_session(frames=9, fps=25))
    assert session.cameras.names == ("cam1", "cam2", "cam3")
    assert [v.path.stem for v in session.videos] == ["cam1", "cam2", "cam3"]
    assert (session.frames, session.fps, session.name) == (9, 25.0, "session")
    assert session.frame_indices.tolist() == [list(range(9))] * 3
    assert session.notices == ()


@pytest.mark.parametrize(
    ("stems", "names"),
    [
        (["cam1", "CAM2"], ["Cam1", "cam2"]),
        (["cam_01", "Cam-02"], ["cam1", "cam2"]),
        (["take3_cam1", "take3_cam10", "take3_cam2"], ["cam1", "cam10", "cam2"]),
        (["1_cam1", "1_cam2"], ["1", "2"]),
        (["left side", "right side"], ["left", "right"]),
        (["video1", "video2"], ["Miqus_1_20871", "Miqus_2_20871"]),
        (["b", "a"], ["b", "a"]),
    ],
)
def test_cameras_and_videos_pair_by_name(stems, names):
    videos, said = paired(stems, names)
    assert videos == stems
    assert all("by name" in text for text in said)
    assert bool(said) == any(s.lower() != n.lower() for s, n in zip(stems, names, strict=True))


def test_names_pair_in_the_calibrations_order():
    assert paired(["cam1", "cam2", "cam3"], ["cam3", "cam1", "cam2"])[0] == ["cam3", "cam1", "cam2"]


def test_without_common_names_the_order_decides_and_is_reported():
    videos, said = paired(["GX010019", "GX010020", "GX010101"], ["c10", "c9", "b"])
    assert videos == ["GX010101", "GX010020", "GX010019"]
    assert len(said) == 1 and "c10 = GX010101, c9 = GX010020, b = GX010019" in said[0]


@pytest.mark.parametrize("first", [0, 1])
def test_cameras_and_videos_counted_from_different_numbers_are_never_paired_with_neighbours(first):
    names, stems = ([f"cam{k}" for k in range(start, start + 4)] for start in (first, 1 - first))
    with pytest.raises(SessionError) as caught:
        match_cameras(stems, names, HERE, FILE)
    said = str(caught.value)
    assert "--cameras" not in said
    assert f"rename {stems[0]} to {names[0]}, {stems[1]} to {names[1]}, {stems[2]} to {names[2]}" in said
    group = ring_of_cameras(names, size=(64, 48), model="PINHOLE", params=[(60.0, 60.0, 31.5, 23.5)] * 4)
    with pytest.raises(SessionError, match=f"numbered differently; .*{stems[3]} to {names[3]}"):
        select_cameras(group, [Path(f"{s}.mp4") for s in stems], tuple(names[1:3]), FILE)


def test_a_proposal_never_pairs_neighbours():
    with pytest.raises(SessionError, match="counted from different numbers") as caught:
        match_cameras(["cam1", "cam2", "cam3", "cam4", "cam5"], ["cam0", "cam1", "cam2", "cam3"], HERE, FILE)
    assert "--cameras" not in str(caught.value)
    with pytest.raises(SessionError, match="--cameras cam1 cam2"):
        match_cameras(["cam1", "cam2"], ["cam1", "cam2", "cam3"], HERE, FILE)


@pytest.mark.parametrize(
    ("stems", "names", "said"),
    [
        (["cam1", "cam2"], ["cam1", "cam2", "cam3"], "no video for camera cam3"),
        (["cam1", "cam2", "cam3"], ["cam1", "cam2"], "no camera for video cam3"),
        (["cam1", "cam2", "cam4"], ["cam1", "cam2", "cam3"], "camera cam3 and .* video cam4"),
        (["cam0", "cam1", "cam2"], ["cam1", "cam2", "cam3"], "camera cam3 and .* video cam0"),
        (["x", "y", "z"], ["cam1", "cam2"], "camera cam1, cam2 and .* video x, y, z"),
    ],
)
def test_unpaired_cameras_and_videos_are_named(stems, names, said):
    with pytest.raises(SessionError, match=f"{said}.*name each video after its camera"):
        match_cameras(stems, names, HERE, FILE)


def test_a_choice_of_cameras_leaves_the_others_out(make_session):
    folder = make_session(("a", "b", "c"), videos=("a.mp4", "c.mp4", "d.mp4"))
    with pytest.raises(SessionError, match="--cameras a c"):
        open_session(folder)
    session = open_session(folder, SessionOptions(cameras=("c", "a")))
    assert [v.path.stem for v in session.videos] == ["c", "a"] == list(session.cameras.names)
    with pytest.raises(SessionError, match="no camera x; .* a, b, c"):
        open_session(folder, SessionOptions(cameras=("a", "x")))


def test_numbers_sort_as_numbers():
    assert sorted(["cam10", "cam2", "Cam1", "a3b"], key=natural_key) == ["a3b", "Cam1", "cam2", "cam10"]


def test_other_files_among_the_videos_are_reported_and_ignored(make_session):
    folder = make_session()
    (folder / "videos" / ".DS_Store").write_bytes(b"\0\1")
    (folder / "videos" / "notes.txt").write_text("take 2 was better")
    (folder / "videos" / "raw").mkdir()
    shutil.copy(folder / "videos" / "cam1.mp4", folder / "videos" / "cam1.LRV")
    files, said = find_videos(folder)
    assert [f.name for f in files] == ["cam1.mp4", "cam2.mp4", "cam3.mp4"]
    assert len(said) == 1 and "cam1.LRV, notes.txt, raw" in said[0] and "DS_Store" not in said[0]


def test_different_lengths_leave_the_common_part(make_session, make_video):
    folder = make_session(frames=20)
    make_video(folder / "videos" / "cam2.mp4", frames=14)
    session = open_session(folder)
    assert session.frames == 14
    assert any("cam2.mp4 14" in text and "first 14 frames" in text for text in session.notices)


def test_a_take_goes_on_when_one_camera_stops_early(make_session, make_video):
    folder = make_session(frames=50)
    make_video(folder / "videos" / "cam2.mp4", frames=20)
    session = open_session(folder)
    assert session.frames == 50
    assert [session.lasts(c) for c in range(3)] == [50, 20, 50]
    assert session.ended is not None and session.ended[1].tolist() == [False] * 20 + [True] * 30
    assert session.frame_indices[1].tolist() == [*range(20), *[19] * 30]
    said = [text for text in session.notices if "cam2.mp4 at frame 20 of the take ends early" in text]
    assert len(said) == 1 and "other cameras are used from there" in said[0]
    part = with_frames(session, np.arange(10, 30, 5))
    assert part.lasts(1) == 2 and part.frames == 4


def test_two_cameras_end_together(make_session, make_video):
    folder = make_session(["cam1", "cam2"], frames=50)
    make_video(folder / "videos" / "cam2.mp4", frames=20)
    session = open_session(folder)
    assert session.frames == 20 and session.ended is None


def test_slow_motion_of_a_phone_is_named(make_session, make_video):
    folder = make_session(frames=12)
    path = make_video(folder / "videos" / "cam2.mp4", frames=12)
    source = path.rename(folder / "source.mp4")
    with av.open(str(source)) as given, av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as out:
        out.metadata["com.android.capture.fps"] = "240.000000"
        stream = out.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    with pytest.raises(
        SessionError, match=r"cam2.mp4 \(recorded at 240 fps, slowed to 30\); .*-itsscale 0.125 -i cam2"
    ):
        open_session(folder)


def test_a_video_eight_times_as_long_is_suspected(make_session, make_video):
    folder = make_session(frames=12)
    make_video(folder / "videos" / "cam2.mp4", frames=96)
    said = [text for text in open_session(folder).notices if "slow motion" in text]
    assert len(said) == 1 and "cam2.mp4 lasts 8 times as long as the others" in said[0]
    make_video(folder / "videos" / "cam2.mp4", frames=72)
    assert not [text for text in open_session(folder).notices if "slow motion" in text]


def test_different_frame_rates_are_paired_by_time(make_session, make_video):
    folder = make_session(frames=20, fps=30)
    make_video(folder / "videos" / "cam3.mp4", frames=60, fps=60)
    session = open_session(folder)
    assert session.fps == 30
    assert session.frames == 20
    assert session.frame_indices[2].tolist() == list(range(0, 40, 2))
    assert any("frame rates differ" in text and "cam3.mp4 60" in text for text in session.notices)


def test_nearly_equal_rates_are_paired_by_number(make_session, make_video):
    folder = make_session(frames=20, fps=30)
    make_video(folder / "videos" / "cam3.mp4", frames=20, fps=29.97)
    session = open_session(folder)
    assert (session.fps, session.frames) == (30, 20)
    assert session.frame_indices[2].tolist() == list(range(20)) and session.late is None
    assert any("differ slightly" in text for text in session.notices)


def test_nearly_equal_rates_are_paired_by_time_where_videos_end_together(make_session, make_video):
    folder = make_session(frames=1000, fps=30)
    make_video(folder / "videos" / "cam3.mp4", frames=996, fps=29.88)
    session = open_session(folder)
    assert session.fps == 30 and session.frames >= 999
    assert session.frame_indices[2, 990] == round(990 * 29.88 / 30) and abs(session.late).max() < 0.02
    assert any("the videos end together" in text for text in session.notices)
    make_video(folder / "videos" / "cam3.mp4", frames=1000, fps=29.88)
    session = open_session(folder)
    assert session.late is None and any("0.13 s apart" in text for text in session.notices)


def test_dropped_frames_are_replaced_by_time(make_session, make_video):
    folder = make_session(frames=20, fps=25)
    kept = [0, 1, 2, 3, 4, 5, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]
    make_video(folder / "videos" / "cam2.mp4", frames=16, pts=[40 * k for k in kept])
    session = open_session(folder)
    assert any("cam2.mp4 varies" in text for text in session.notices)
    assert (session.fps, session.frames) == (25, 20)
    # In the gap the nearest frame stands in; after it the frames are those of the same moment.
    assert session.frame_indices[1].tolist() == [0, 1, 2, 3, 4, 5, 5, 5, 6, 6, *range(6, 16)]
    assert session.late == pytest.approx(0.04 * np.array([[0] * 20, [*[0] * 6, -1, -2, 2, 1, *[0] * 10], [0] * 20]))


def test_different_sizes_are_reported(make_session, make_video):
    folder = make_session()
    make_video(folder / "videos" / "cam2.mp4", width=128, height=96)
    session = open_session(folder)
    camera = session.cameras["cam2"]
    assert (camera.width, camera.height) == (128, 96)
    assert any("cam2" in text and "64x48" in text and "--video-size" in text for text in session.notices)
    assert any("frame sizes differ" in text for text in session.notices)


def test_non_square_pixels_are_those_of_the_calibrated_image(make_session):
    folder = make_session(width=64, height=48)
    _resize(folder, 48, 48, Fraction(4, 3))
    was = load_calibration(folder / "calibration.toml")
    session = open_session(folder)
    assert sum("(scale)" in text for text in session.notices) == 3 and not any("square" in t for t in session.notices)
    x, y = np.moveaxis(was.project(np.array([[0.1, 0.2, 1.0]])), -1, 0)
    found = session.cameras.project(np.array([[0.1, 0.2, 1.0]]))
    np.testing.assert_allclose(found, np.stack([(x + 0.5) * 0.75 - 0.5, y], -1), atol=1e-6)


def test_a_guessed_size_is_replaced_by_the_videos(make_session):
    folder = make_session(width=64, height=48)
    was = load_calibration(folder / "calibration.toml")
    moved = [replace(c, params=(*c.params[:2], c.params[2] + 3, c.params[3] - 2, *c.params[4:])) for c in was]
    export_calibration(CameraGroup(tuple(moved)), folder / "calibration", "easymocap")
    (folder / "calibration.toml").unlink()
    for file in (folder / "calibration").iterdir():
        file.write_text("".join(r for r in file.read_text().splitlines(True) if not r.startswith(("H_", "W_"))))
    for scale in (1.0, 0.5):
        if scale < 1:
            _resize(folder, 32, 24)
        for camera, expected in zip(open_session(folder).cameras, moved, strict=True):
            assert camera.params[0] == pytest.approx(scale * expected.params[0])
            assert camera.params[2] == pytest.approx(scale * (expected.params[2] + 0.5) - 0.5)
            assert (camera.width, camera.height) == (64 * scale, 48 * scale)


def _resize(session: Path, width: int, height: int, aspect: Fraction = Fraction(1)) -> None:
    """Writes a session's videos anew in another size, with pixels of this aspect."""
    for path in sorted((session / "videos").iterdir()):
        with av.open(str(path)) as source, av.open(str(path.with_suffix(".mkv")), "w") as out:
            stream = out.add_stream("libx264", rate=30)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.codec_context.sample_aspect_ratio = aspect
            for frame in source.decode(video=0):
                out.mux(stream.encode(frame.reformat(width, height)))
            out.mux(stream.encode(None))
        path.unlink()


def test_a_video_of_a_camera_without_pose_is_an_error(make_session):
    folder = make_session()
    export_calibration(load_calibration(folder / "calibration.toml"), folder / "calibration.yml", "opencv")
    (folder / "calibration.toml").unlink()
    text = (folder / "calibration.yml").read_text()
    (folder / "calibration.yml").write_text(text.replace("translation_vector:", "nothing:", 1))
    with pytest.raises(SessionError, match="does not say where cam1 is"):
        open_session(folder)
    assert len(open_session(folder, SessionOptions(cameras=("cam2", "cam3"))).cameras) == 2


def _flag_rotation(path: Path) -> None:
    data = bytearray(path.read_bytes())
    upright = struct.pack(">9I", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    at = data.index(upright, data.index(b"tkhd"))
    data[at : at + 36] = struct.pack(">9i", 0, 0x10000, 0, -0x10000, 0, 0, 0, 0, 0x40000000)
    path.write_bytes(data)


def test_a_rotation_flag_is_applied_unless_the_calibration_was_made_without(make_session, make_video):
    folder = make_session()
    make_video(folder / "videos" / "cam2.mp4", width=48, height=64)
    _flag_rotation(folder / "videos" / "cam2.mp4")
    session = open_session(folder)
    assert (session.videos[1].width, session.videos[1].height) == (64, 48)
    assert any("cam2.mp4 has a rotation flag: its frames were turned" in text for text in session.notices)

    make_video(folder / "videos" / "cam2.mp4", width=64, height=48)
    _flag_rotation(folder / "videos" / "cam2.mp4")
    session = open_session(folder)
    assert (session.videos[1].width, session.videos[1].height, session.videos[1].rotation_deg) == (64, 48, 0)
    assert any("ignored as the calibration" in text for text in session.notices)


def test_videos_started_at_other_times_are_cut_to_the_common_part(make_session):
    folder = make_session(frames=30, fps=25)
    clocks = "[cameras.cam2]\noffset = -0.4\n[cameras.cam3]\noffset = 0.13\n"
    (folder / "sync.toml").write_text("muybridge_sync = 1\n" + clocks)
    session = open_session(folder)
    assert session.frame_indices[:, [0, -1]].tolist() == [[10, 26], [0, 16], [13, 29]]
    assert [clock.offset for clock in session.clocks] == pytest.approx([0.0, 0.0, 0.01])
    assert session.notices == (
        "by sync.toml the take begins with frames cam1.mp4 10, cam2.mp4 0, cam3.mp4 13: 17 frames of all videos "
        "(cam1.mp4 30, cam2.mp4 30, cam3.mp4 30)",
    )
    apart = open_session(folder, in_step=False)
    assert apart.frames == 30 and apart.clocks is None


def test_cameras_are_named_once_and_at_least_two(make_session):
    folder = make_session()
    assert open_session(folder, SessionOptions(cameras=("cam3", "cam1", "cam3"))).cameras.names == ("cam3", "cam1")
    with pytest.raises(SessionError, match="--cameras names cam1 alone"):
        open_session(folder, SessionOptions(cameras=("cam1", "cam1")))


def _as_pictures(session, folder):
    shutil.rmtree(session / "videos")
    for camera in ("cam1", "cam2"):
        (folder / camera).mkdir(parents=True)
        for name in ("000000.jpg", "000001.jpg", "notes.txt"):
            (folder / camera / name).write_bytes(b"a picture")


@pytest.mark.parametrize(
    ("spoil", "kind", "said"),
    [
        (lambda f: shutil.rmtree(f), SessionError, "does not exist"),
        (lambda f: shutil.rmtree(f / "videos"), SessionError, "no folder `videos`"),
        (lambda f: [v.unlink() for v in (f / "videos").iterdir()], SessionError, "holds no videos"),
        (lambda f: _as_pictures(f, f / "videos"), SessionError, r"'.*/videos/cam1/\*\.jpg' .* videos/cam1\.mkv"),
        (lambda f: _as_pictures(f, f / "images"), SessionError, r"no folder `videos`.*images/cam1/\*\.jpg"),
        (
            lambda f: [(f / "videos" / n).unlink() for n in ("cam1.mp4", "cam3.mp4")],
            SessionError,
            r"one video \(cam2.mp4\).*two cameras",
        ),
        (lambda f: (f / "videos/cam2.mp4").write_bytes(b""), VideoError, r"cam2\.mp4 is empty"),
        (lambda f: (f / "videos/cam2.mp4").write_bytes(b"x" * 999), VideoError, r"cam2\.mp4 cannot be"),
        (
            lambda f: shutil.copy(f / "videos/cam2.mp4", f / "videos/cam2.mov"),
            SessionError,
            r"more than one video named cam2 \(cam2\.mov, cam2\.mp4\)",
        ),
        (lambda f: (f / "calibration.toml").unlink(), CalibrationError, "no calibration"),
        (lambda f: (f / "calibration.toml").write_text("[cameras"), CalibrationError, "calibration.toml"),
    ],
)
def test_a_broken_session_is_refused_in_one_line(make_session, spoil, kind, said):
    folder = make_session()
    spoil(folder)
    with pytest.raises(kind, match=said) as caught:
        open_session(folder)
    assert "\n" not in str(caught.value)


def test_a_session_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "take.mp4").write_bytes(b"")
    with pytest.raises(SessionError, match="is a file; a session is a folder"):
        open_session(tmp_path / "take.mp4")


def test_one_calibrated_camera_is_too_few(make_session):
    folder = make_session(("cam1",), videos=("cam1.mp4", "cam2.mp4"))
    with pytest.raises(MuybridgeError, match=r"one camera \(cam1\)"):
        open_session(folder)


def test_a_calibration_from_elsewhere(make_session, tmp_path):
    folder = make_session()
    moved = folder.parent / "other.toml"
    (folder / "calibration.toml").rename(moved)
    session = open_session(folder, SessionOptions(calibration=moved))
    assert session.calibration == moved
    assert session.cameras.names == load_calibration(moved).names


def test_the_real_take_opens_and_its_letterboxes_are_reported(real_data):
    session = open_session(real_data / "balancing")
    assert session.cameras.names == ("cam01", "cam02", "cam03", "cam04")
    assert (session.frames, session.fps) == (100, 60.0)
    assert [(c.width, c.height) for c in session.cameras] == [(1080, 1920)] * 2 + [(1088, 1920)] * 2
    assert np.array_equal(session.frame_indices, np.tile(np.arange(100), (4, 1)))
    assert sum("video is 1080x1920" in text for text in session.notices) == 2


def write_times(session: Path, times: dict[str, list[float]], where: str = "timestamps.csv") -> None:
    rows = sorted((t, camera) for camera, all_times in times.items() for t in all_times)
    lines = ["sync_index,cam_id,frame_time", *(f"{round(30 * t)},{camera},{t}" for t, camera in rows)]
    (session / where).write_text("\n".join(lines))


@pytest.mark.parametrize("where", ["timestamps.csv", "videos/frame_time_history.csv"])
def test_frames_are_paired_by_a_table_of_times(make_session, where):
    path = make_session(frames=12)
    even = [100 + k / 30 for k in range(12)]
    # The second camera starts three frames late, the third drops two.
    late, dropped = [t + 0.1 for t in even], [100 + k / 30 for k in (0, 1, 2, 3, 5, 6, 7, 9, 10, 11, 12, 13)]
    write_times(path, {"1": even, "2": late, "3": dropped}, where)
    session = open_session(path)
    assert session.frames == 9 and session.fps == pytest.approx(30)
    assert session.frame_indices[0].tolist() == list(range(3, 12))
    assert session.frame_indices[1].tolist() == list(range(9))
    assert session.frame_indices[2].tolist() == [3, 3, 4, 5, 6, 6, 7, 8, 9]
    assert 30 * session.late == pytest.approx(np.array([[0] * 9, [0] * 9, [0, -1, 0, 0, 0, -1, 0, 0, 0]]), abs=1e-6)
    (said,) = session.notices
    assert f"paired by {Path(where).name}" in said and "33 ms" in said


def test_tables_of_times_that_do_not_match_are_refused(make_session):
    path = make_session(frames=5)
    times = [k / 30 for k in range(5)]
    for table, what in (
        ({"1": times, "2": times}, "no rows for cam3"),
        ({"1": times, "2": times, "3": times[:4]}, "4 rows for cam3, whose video has 5 frames"),
        ({"1": times, "2": times, "3": [9 + t for t in times]}, "not taken at the same time"),
    ):
        write_times(path, table)
        with pytest.raises(SessionError, match=what):
            open_session(path)
    (path / "timestamps.csv").write_text("a,b\n1,2\n")
    with pytest.raises(SessionError, match="needs the columns sync_index, cam_id, frame_time"):
        open_session(path)


@pytest.mark.parametrize("where", ["synchronized_videos", "videos-raw", "."])
def test_folders_of_other_programs_are_sessions(make_session, where):
    """Videos under another name or in the session itself, the calibration under a name of its own beside them."""
    path = make_session(frames=4)
    (path / "calibration.toml").rename(path / "recording_3_camera_calibration.toml")
    for video in (path / "videos").iterdir():
        (path / where).mkdir(exist_ok=True)
        video.rename(path / where / video.name)
    (path / "videos").rmdir()
    (path / "notes.txt").write_text("slept badly")
    session = open_session(path)
    assert session.frames == 4 and session.calibration.name == "recording_3_camera_calibration.toml"
    assert any("videos in the folder itself" in notice for notice in session.notices) == (where == ".")
    # Two of them: nobody can say which counts.
    shutil.copy(session.calibration, path / "better.toml")
    with pytest.raises(CalibrationError, match=r"several calibrations \(better.toml, recording_3"):
        open_session(path)
