from .board import Board as Board
from .board import BoardDetector as BoardDetector
from .extrinsics import BoardOptions as BoardOptions
from .extrinsics import RigCalibration as RigCalibration
from .extrinsics import calibrate_lenses as calibrate_lenses
from .extrinsics import calibrate_rig as calibrate_rig
from .intrinsics import Lens as Lens
from .intrinsics import LensCalibration as LensCalibration
from .intrinsics import adjust_lens as adjust_lens
from .intrinsics import board_pose as board_pose
from .intrinsics import calibrate_lens as calibrate_lens
from .pdf import board_pdf as board_pdf

__all__ = [
    "Board",
    "BoardDetector",
    "BoardOptions",
    "Lens",
    "LensCalibration",
    "RigCalibration",
    "adjust_lens",
    "board_pdf",
    "board_pose",
    "calibrate_lens",
    "calibrate_lenses",
    "calibrate_rig",
]
