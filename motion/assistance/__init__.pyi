from .completion import Assisted as Assisted
from .completion import AssistOptions as AssistOptions
from .completion import assist as assist
from .completion import check_keys as check_keys
from .completion import driving_joints as driving_joints
from .completion import still_joints as still_joints
from .takes import CapturedTake as CapturedTake
from .takes import bring_take as bring_take
from .takes import mirrored as mirrored

__all__ = [
    "AssistOptions",
    "Assisted",
    "CapturedTake",
    "assist",
    "bring_take",
    "check_keys",
    "driving_joints",
    "mirrored",
    "still_joints",
]
