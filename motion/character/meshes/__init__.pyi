from .bound_mesh import BoundMesh as BoundMesh
from .bound_mesh import NamedMotion as NamedMotion
from .read import MESH_SUFFIXES as MESH_SUFFIXES
from .read import read_mesh as read_mesh
from .static_mesh import Look as Look
from .static_mesh import Picture as Picture
from .static_mesh import StaticMesh as StaticMesh
from .static_mesh import Surface as Surface
from .write_fbx import write_skinned_fbx as write_skinned_fbx
from .write_gltf import write_skinned_glb as write_skinned_glb
from .write_usd import write_skinned_usd as write_skinned_usd

__all__ = [
    "MESH_SUFFIXES",
    "BoundMesh",
    "Look",
    "NamedMotion",
    "Picture",
    "StaticMesh",
    "Surface",
    "read_mesh",
    "write_skinned_fbx",
    "write_skinned_glb",
    "write_skinned_usd",
]
