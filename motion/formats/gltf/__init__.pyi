from .read import clip_names as clip_names
from .read import read_gltf as read_gltf
from .read import read_gltf_take as read_gltf_take
from .write import write_glb as write_glb

__all__ = [
    "clip_names",
    "read_gltf",
    "read_gltf_take",
    "write_glb",
]
