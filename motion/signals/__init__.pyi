from .bands import MotionBands as MotionBands
from .bands import scale_bands as scale_bands
from .bands import split_bands as split_bands
from .reaching import reach as reach
from .time_warping import TimeMap as TimeMap
from .time_warping import time_map as time_map
from .time_warping import warp_time as warp_time
from .warping import KeyPoses as KeyPoses
from .warping import keys_of_motion as keys_of_motion
from .warping import warp_to_keys as warp_to_keys

__all__ = [
    "KeyPoses",
    "MotionBands",
    "TimeMap",
    "keys_of_motion",
    "reach",
    "scale_bands",
    "split_bands",
    "time_map",
    "warp_time",
    "warp_to_keys",
]
