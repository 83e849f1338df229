from .retarget import read_target as read_target
from .retarget import retarget_results as retarget_results
from .rigging import bind_mesh as bind_mesh
from .rigging import rig_static as rig_static
from .rigging import write_bound as write_bound
from .takes import find_takes as find_takes

__all__ = [
    "bind_mesh",
    "find_takes",
    "read_target",
    "retarget_results",
    "rig_static",
    "write_bound",
]
