from .audio import audio_clock as audio_clock
from .clocks import Clock as Clock
from .clocks import own_frames as own_frames
from .clocks import resample as resample
from .clocks import resample_keypoints as resample_keypoints
from .epipolar import epipolar_clocks as epipolar_clocks
from .motion import motion_clocks as motion_clocks

__all__ = [
    "Clock",
    "audio_clock",
    "epipolar_clocks",
    "motion_clocks",
    "own_frames",
    "resample",
    "resample_keypoints",
]
