from .character import Character as Character
from .character import Material as Material
from .character import Mesh as Mesh
from .character import Morph as Morph
from .posing import pose_mesh as pose_mesh
from .posing import pose_meshes as pose_meshes
from .read import read_character as read_character
from .skinning import METHODS as METHODS
from .skinning import Baked as Baked
from .skinning import BakeOptions as BakeOptions
from .skinning import Skin as Skin
from .skinning import Skinner as Skinner
from .skinning import bake as bake
from .weights import WEIGHT_METHODS as WEIGHT_METHODS
from .weights import WeightOptions as WeightOptions
from .weights import skin_weights as skin_weights
from .write import write_character_clip as write_character_clip

__all__ = [
    "METHODS",
    "WEIGHT_METHODS",
    "BakeOptions",
    "Baked",
    "Character",
    "Material",
    "Mesh",
    "Morph",
    "Skin",
    "Skinner",
    "WeightOptions",
    "bake",
    "pose_mesh",
    "pose_meshes",
    "read_character",
    "skin_weights",
    "write_character_clip",
]
