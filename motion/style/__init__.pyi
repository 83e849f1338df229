from .examples import Examples as Examples
from .examples import examples_of as examples_of
from .files import load_style as load_style
from .files import save_style as save_style
from .learning import StyleOptions as StyleOptions
from .learning import learn_style as learn_style
from .model import Style as Style
from .posing import StyledPose as StyledPose
from .posing import solve_pose as solve_pose

__all__ = [
    "Examples",
    "Style",
    "StyleOptions",
    "StyledPose",
    "examples_of",
    "learn_style",
    "load_style",
    "save_style",
    "solve_pose",
]
