from .options import RiggerTraining as RiggerTraining
from .options import SkinningTraining as SkinningTraining

__all__ = [
    "RiggerTraining",
    "SkinningTraining",
]
