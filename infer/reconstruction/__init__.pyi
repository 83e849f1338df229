from .body import BodySolution as BodySolution
from .body import fit_labelled_markers as fit_labelled_markers
from .body import fit_landmarks as fit_landmarks
from .gravity import estimate_gravity as estimate_gravity
from .landmarks import Solution as Solution
from .landmarks import SolveOptions as SolveOptions
from .landmarks import solve as solve
from .marker_videos import MarkerVideoOptions as MarkerVideoOptions
from .marker_videos import find_markers as find_markers
from .marker_videos import triangulate_again as triangulate_again
from .quality import Quality as Quality
from .quality import assess as assess
from .recognise import RecognisedPoints as RecognisedPoints
from .virtual_markers import marker_set as marker_set

__all__ = [
    "BodySolution",
    "MarkerVideoOptions",
    "Quality",
    "RecognisedPoints",
    "Solution",
    "SolveOptions",
    "assess",
    "estimate_gravity",
    "find_markers",
    "fit_labelled_markers",
    "fit_landmarks",
    "marker_set",
    "solve",
    "triangulate_again",
]
