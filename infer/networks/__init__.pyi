from .characters import RiggerNetwork as RiggerNetwork
from .characters import SkinningNetwork as SkinningNetwork
from .correction import SolverNetwork as SolverNetwork
from .external import ExternalModel as ExternalModel
from .external import open_keypoints as open_keypoints
from .keypoints import KeypointNetwork as KeypointNetwork
from .keypoints import OnnxOptions as OnnxOptions
from .keypoints import PeopleNetwork as PeopleNetwork
from .labelling import LabelNetwork as LabelNetwork
from .models import Models as Models
from .models import open_models as open_models

__all__ = [
    "ExternalModel",
    "KeypointNetwork",
    "LabelNetwork",
    "Models",
    "OnnxOptions",
    "PeopleNetwork",
    "RiggerNetwork",
    "SkinningNetwork",
    "SolverNetwork",
    "open_keypoints",
    "open_models",
]
