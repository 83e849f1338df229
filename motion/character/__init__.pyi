from .character import Character as Character
from .character import Material as Material
from .character import Mesh as Mesh
from .character import Morph as Morph
from .posing import pose_mesh as pose_mesh
from .posing import pose_meshes as pose_meshes
from .read import read_character as read_character
from .write import write_character_clip as write_character_clip

__all__ = [
    "Character",
    "Material",
    "Mesh",
    "Morph",
    "pose_mesh",
    "pose_meshes",
    "read_character",
    "write_character_clip",
]
