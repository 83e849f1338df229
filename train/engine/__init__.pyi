from .checkpoint import load_checkpoint as load_checkpoint
from .checkpoint import save_checkpoint as save_checkpoint
from .loop import AveragedWeights as AveragedWeights
from .loop import TrainingHistory as TrainingHistory
from .loop import TrainingRun as TrainingRun
from .muon import Muon as Muon
from .muon import Optimisers as Optimisers
from .options import Training as Training
from .process_pool import map_in_processes as map_in_processes

__all__ = [
    "AveragedWeights",
    "Muon",
    "Optimisers",
    "Training",
    "TrainingHistory",
    "TrainingRun",
    "load_checkpoint",
    "map_in_processes",
    "save_checkpoint",
]
