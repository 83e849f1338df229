from .demo import run_demo as run_demo
from .labelling import run_label as run_label
from .landmarks import session_keypoints as session_keypoints
from .marker_videos import run_marker_session as run_marker_session
from .solve_points import SolvePointsOptions as SolvePointsOptions
from .sync import find_clocks as find_clocks
from .sync import write_sync as write_sync
from .videos import RunOptions as RunOptions
from .videos import RunResult as RunResult
from .videos import run_session as run_session

__all__ = [
    "RunOptions",
    "RunResult",
    "SolvePointsOptions",
    "find_clocks",
    "run_demo",
    "run_label",
    "run_marker_session",
    "run_session",
    "session_keypoints",
    "write_sync",
]
