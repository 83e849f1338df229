from .rig import SkinnedBody as SkinnedBody
from .rig import forward as forward
from .rig import joint_angles as joint_angles
from .sampler import MOTIONS as MOTIONS
from .sampler import MotionClip as MotionClip
from .sampler import MotionSampler as MotionSampler
from .sampler import PoseSamples as PoseSamples

__all__ = [
    "MOTIONS",
    "MotionClip",
    "MotionSampler",
    "PoseSamples",
    "SkinnedBody",
    "forward",
    "joint_angles",
]
