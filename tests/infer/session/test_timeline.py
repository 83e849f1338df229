"""Videos of a session that end early or run at another speed."""

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
