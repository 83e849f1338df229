from .rig import MeshRig as MeshRig
from .rig import RigOptions as RigOptions
from .rig import rig_mesh as rig_mesh
from .templates import RIGS as RIGS
from .templates import TEMPLATES as TEMPLATES

__all__ = [
    "RIGS",
    "TEMPLATES",
    "MeshRig",
    "RigOptions",
    "rig_mesh",
]
