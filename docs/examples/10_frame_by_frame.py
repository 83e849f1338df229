"""People in 3D frame by frame, as images arrive: the way to live capture.

    python 10_frame_by_frame.py SESSION FRAMES

Recorded videos stand in for cameras here. Less accurate than `muybridge.capture`, which sees the whole take.
"""

import sys
from pathlib import Path

import av

import muybridge

session, frames = Path(sys.argv[1]), int(sys.argv[2])
cameras = muybridge.load_calibration(session / "calibration.toml")
videos = {camera.name: av.open(str(session / "videos" / f"{camera.name}.mp4")) for camera in cameras}
fps = float(next(iter(videos.values())).streams.video[0].average_rate)
streams = {name: video.decode(video=0) for name, video in videos.items()}

with muybridge.LiveCapture(cameras, fps=fps) as live:
    nose = live.landmarks.index("nose")
    for number in range(frames):
        images = {name: next(stream).to_ndarray(format="rgb24") for name, stream in streams.items()}
        for person in live.process(images):
            x, y, z = person.points_world[nose]
            print(
                f"frame {number}: person {person.id}, nose at {x:.2f} {y:.2f} {z:.2f} m, {len(person.cameras)} cameras"
            )

for video in videos.values():
    video.close()
