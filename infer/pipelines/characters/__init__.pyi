from .retarget import read_target as read_target
from .retarget import retarget_results as retarget_results
from .rigging import move_character as move_character
from .rigging import rig_file as rig_file
from .rigging import write_rigged as write_rigged
from .takes import find_takes as find_takes

__all__ = [
    "find_takes",
    "move_character",
    "read_target",
    "retarget_results",
    "rig_file",
    "write_rigged",
]
