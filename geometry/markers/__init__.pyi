from .cleaning import Cleaned as Cleaned
from .cleaning import CleanOptions as CleanOptions
from .cleaning import Sample as Sample
from .cleaning import clean_markers as clean_markers
from .matching import MatchOptions as MatchOptions
from .matching import follow_points as follow_points
from .recovery import RecoverOptions as RecoverOptions
from .recovery import recover_points as recover_points
from .rigidity import RigidityOptions as RigidityOptions
from .rigidity import measured_rigidity as measured_rigidity
from .rigidity import prior_rigidity as prior_rigidity
from .subjects import split_people as split_people
from .tracking import TrackOptions as TrackOptions
from .tracking import Tracks as Tracks
from .tracking import find_tracks as find_tracks
from .tracking import track_points as track_points
from .voting import VoteOptions as VoteOptions
from .voting import vote as vote

__all__ = [
    "CleanOptions",
    "Cleaned",
    "MatchOptions",
    "RecoverOptions",
    "RigidityOptions",
    "Sample",
    "TrackOptions",
    "Tracks",
    "VoteOptions",
    "clean_markers",
    "find_tracks",
    "follow_points",
    "measured_rigidity",
    "prior_rigidity",
    "recover_points",
    "split_people",
    "track_points",
    "vote",
]
