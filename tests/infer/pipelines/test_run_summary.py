"""What a run prints at its end."""

from types import SimpleNamespace

import numpy as np

from muybridge.infer.pipelines.videos import summary


def test_a_camera_that_saw_nobody_has_no_reprojection() -> None:
    seen = {"seen": 1.0, "reprojection_px": 7.25, "leave_one_out_px": 11.5}
    cameras = {"cam1": {"seen": 0.0, "reprojection_px": np.nan, "leave_one_out_px": np.nan}, "cam2": seen}
    quality = SimpleNamespace(coverage=1.0, reprojection_px=7.0, leave_one_out_px=11.0, cameras=cameras)
    session = SimpleNamespace(name="walk", frames=24, cameras=["cam1", "cam2"])
    result = SimpleNamespace(quality=quality, session=session, seconds=3.0, others=(), problems=(), out="out")
    lines = summary(result).splitlines()
    assert "    cam1  sees   0.0%" in lines
    assert "    cam2  sees 100.0%   reprojection    7.2 px   left out   11.5 px" in lines
