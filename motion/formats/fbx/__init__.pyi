from .read import read_fbx as read_fbx
from .write import write_fbx as write_fbx

__all__ = [
    "read_fbx",
    "write_fbx",
]
