from .body_model import BodyBatch as BodyBatch
from .body_model import BodyModel as BodyModel
from .pose_sampler import PoseSampler as PoseSampler
from .surface_markers import marker_table as marker_table
from .surface_markers import virtual_markers as virtual_markers

__all__ = [
    "BodyBatch",
    "BodyModel",
    "PoseSampler",
    "marker_table",
    "virtual_markers",
]
