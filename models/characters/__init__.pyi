from .rig_network import RigNet as RigNet
from .weight_network import WeightNet as WeightNet

__all__ = [
    "RigNet",
    "WeightNet",
]
