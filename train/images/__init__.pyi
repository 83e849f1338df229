from .compositor import Batch as Batch
from .compositor import Compositor as Compositor
from .dataset import batches as batches
from .dataset import training_data as training_data
from .options import AugmentOptions as AugmentOptions
from .scenes import SceneBatch as SceneBatch
from .scenes import SceneCompositor as SceneCompositor

__all__ = [
    "AugmentOptions",
    "Batch",
    "Compositor",
    "SceneBatch",
    "SceneCompositor",
    "batches",
    "training_data",
]
