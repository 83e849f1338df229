"""The time line of a take: videos of other lengths, rates and speeds."""

import av
import numpy as np
import pytest

from muybridge.errors import SessionError
from muybridge.infer.session.session import open_session, with_frames


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


def test_different_lengths_leave_the_common_part(make_session, make_video):
    folder = make_session(frames=20)
    make_video(folder / "videos" / "cam2.mp4", frames=14)
    session = open_session(folder)
    assert session.frames == 14
    assert any("cam2.mp4 14" in text and "first 14 frames" in text for text in session.notices)


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
