"""Layouts of session folders: a folder per camera, chapters, and files of our own among the videos."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError, SessionError
from muybridge.geometry.calibration import save_calibration
from muybridge.infer.results.folder import open_output
from muybridge.infer.session.discover import find_videos
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.session import open_session
from muybridge.infer.session.video import read_chunks
from tests.rigs import ring_of_cameras

CAMERAS = ("cam1", "cam2", "cam3")


@pytest.fixture
def make_folders(tmp_path, make_video):
    """`make_folders("videos", "film.mp4", ...)` writes a session with a folder per camera and these files in each."""

    def make(where: str, *files: str, frames: int = 6) -> Path:
        session = tmp_path / "take"
        session.mkdir()
        save_calibration(ring_of_cameras(CAMERAS, size=(64, 48)), session / "calibration.toml")
        for camera in CAMERAS:
            for file in files:
                make_video(session / where / camera / file.format(camera), frames=frames)
        return session

    return make


@pytest.mark.parametrize("where", ["videos", "recordings"])
@pytest.mark.parametrize("file", ["{}_video.mp4", "clip.mov", "DCIM/100GOPRO/GX010012.MP4"])
def test_a_folder_per_camera_is_read(make_folders, where, file):
    session = open_session(make_folders(where, file))
    assert session.frames == 6
    assert [v.path.name for v in session.videos] == list(CAMERAS)
    said = [n for n in session.notices if "a folder per camera" in n]
    assert len(said) == 1 and f", cam2/{Path(file.format('cam2')).name}," in f"{said[0]}," and "\n" not in said[0]


@pytest.mark.parametrize(
    "files", [("GX010012.MP4", "GX020012.MP4", "GX030012.MP4"), ("GOPR0012.MP4", "GP010012.MP4", "GP020012.MP4")]
)
def test_chapters_are_one_video(make_folders, frame_number, files):
    session = open_session(make_folders("videos", *reversed(files)))
    assert session.frames == 18 and any(f"cam2/{' + '.join(files)}" in notice for notice in session.notices)
    video = session.videos[0]
    assert [f.name for f in video.files] == list(files)
    assert np.allclose(np.diff(video.times), 1 / 30, atol=1e-3)
    assert [frame_number(i) for c in read_chunks(video) for i in c] == 3 * list(range(6))
    assert [frame_number(i) for c in read_chunks(video, np.array([4, 5, 6, 13])) for i in c] == [4, 5, 0, 1]
    assert len(video.stands_alone) == len(video.coded_at) == 18 and sorted(video.coded_at) == list(range(18))
    other = probe_video(session.videos[1].path)
    assert other.content == video.content and other.size_bytes == sum(f.stat().st_size for f in other.files)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (("GX010012.MP4", "GX030012.MP4"), "chapter 2 of this recording is missing"),
        (("GX010012.MP4", "GX010013.MP4"), r"GX010012.MP4, GX010013.MP4\), which are not chapters .*leave the one"),
        (("walk.mp4", "run.mp4"), r"has 2 videos \(run.mp4, walk.mp4\), which are not chapters"),
    ],
)
def test_other_videos_in_a_cameras_folder_are_named(make_folders, files, said):
    with pytest.raises(SessionError, match=said):
        open_session(make_folders("videos", *files, frames=2))


def test_chapters_of_two_sizes_are_refused(make_folders, make_video):
    session = make_folders("videos", "GX010012.MP4")
    make_video(session / "videos" / "cam2" / "GX020012.MP4", width=80)
    with pytest.raises(MuybridgeError, match=r"GX010012.MP4 has 64x48 px .* GX020012.MP4 80x48 .*not one recording"):
        open_session(session)


def test_numbered_files_that_follow_each_other_are_chapters(make_folders):
    session = make_folders("videos", "DJI_0007.MP4", "DJI_0008.MP4")
    with pytest.raises(SessionError, match="not chapters"):  # they do not say when they were recorded
        open_session(session)
    for camera in CAMERAS:
        for second, name in enumerate(("DJI_0007.MP4", "DJI_0008.MP4")):
            _stamp(session / "videos" / camera / name, f"2026-01-01T10:00:0{second}.000000Z")
    assert open_session(session).frames == 12


def _stamp(path: Path, time: str) -> None:
    """Write the video again with a time of recording."""
    import av

    source = path.with_suffix(".source.mp4")
    path.rename(source)
    with av.open(str(source)) as given, av.open(str(path), "w", format="mp4") as out:
        out.metadata["creation_time"] = time
        stream = out.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    source.unlink()


def test_files_beside_folders_come_first(make_session, make_video):
    session = make_session(["cam1", "cam2"])
    make_video(session / "videos" / "old" / "walk.mp4")
    opened = open_session(session)
    assert [v.path.name for v in opened.videos] == ["cam1.mp4", "cam2.mp4"]
    assert any("old" in n for n in opened.notices)


def test_a_results_folder_is_no_session(make_session):
    session = make_session(["cam1", "cam2"])
    results = open_output(session / "muybridge", (), ())
    shutil.copy(session / "calibration.toml", results.path)
    shutil.copy(session / "videos" / "cam1.mp4", results.path / "overlay_cam1.mp4")
    with pytest.raises(SessionError) as refused:
        open_session(results.path)
    assert str(refused.value).endswith(f"is a results folder; name the session's folder, {session.resolve()}")


def test_results_elsewhere_name_their_session(make_session, tmp_path, monkeypatch):
    session = make_session(["cam1", "cam2"])
    results = open_output(tmp_path / "elsewhere" / "results", (), (), session=session)
    results.write_text("a.txt", "")
    monkeypatch.chdir(results.path.parent)
    with pytest.raises(SessionError) as refused:
        open_session(Path("results"))
    assert str(refused.value).endswith(f"name the session's folder, {session.resolve()}")
    results = open_output(tmp_path / "points", (), ())
    with pytest.raises(SessionError, match="which has the folder `videos`"):
        open_session(results.path)


def test_files_of_our_own_are_no_videos(make_session):
    session = make_session(["cam1", "cam2"])
    before = open_session(session)
    for place in (session, session / "videos"):
        (place / "sync.toml").write_text("muybridge_sync = 1\n[cameras.cam1]\noffset = 0.0\n")
        (place / "report.html").write_text("<html></html>")
        (place / "run.json").write_text("{}")
        for camera in ("cam1", "cam2"):
            shutil.copy(session / "videos" / "cam1.mp4", place / f"overlay_{camera}.mp4")
    results = open_output(session / "videos" / "muybridge", (), ())
    shutil.copy(session / "videos" / "cam1.mp4", results.work / "video-cam1.mp4")
    again = open_session(session)
    assert [v.path for v in again.videos] == [v.path for v in before.videos]
    assert again.calibration == before.calibration


def test_overlays_beside_videos_without_a_folder_are_left_out(tmp_path, make_video):
    for name in ("cam1.mp4", "cam2.mp4", "overlay_cam1.mp4", "overlay_cam2.mp4"):
        make_video(tmp_path / name, frames=2)
    found, _ = find_videos(tmp_path)
    assert [f.name for f in found] == ["cam1.mp4", "cam2.mp4"]
