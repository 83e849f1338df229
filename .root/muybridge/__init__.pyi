"""The public names, for type checkers and for `__init__.py`, which loads each when it is first used."""

from .api.callbacks import CaptureCancelled as CaptureCancelled
from .api.callbacks import ProgressCallback as ProgressCallback
from .api.files import load_calibration as load_calibration
from .api.files import read_motion as read_motion
from .api.files import read_points as read_points
from .api.files import save_calibration as save_calibration
from .api.files import write_motion as write_motion
from .api.files import write_points as write_points
from .api.live import LiveCapture as LiveCapture
from .api.live import LivePerson as LivePerson
from .api.networks import ImageLandmarks as ImageLandmarks
from .api.networks import KeypointNetwork as KeypointNetwork
from .api.networks import PersonBoxes as PersonBoxes
from .api.networks import PersonDetector as PersonDetector
from .api.session import CapturedPerson as CapturedPerson
from .api.session import Result as Result
from .api.session import capture as capture
from .api.solvers import fit_body as fit_body
from .api.solvers import make_points as make_points
from .api.solvers import smooth as smooth
from .api.solvers import solve_ik as solve_ik
from .api.solvers import triangulate as triangulate
from .errors import CalibrationError as CalibrationError
from .errors import FormatError as FormatError
from .errors import MissingExtraError as MissingExtraError
from .errors import ModelError as ModelError
from .errors import MuybridgeError as MuybridgeError
from .errors import OutputError as OutputError
from .errors import SessionError as SessionError
from .errors import VideoError as VideoError
from .geometry.association.options import TrackingOptions as TrackingOptions
from .geometry.cameras.camera import Camera as Camera
from .geometry.cameras.group import CameraGroup as CameraGroup
from .geometry.fitting.body_fit import BodyFit as BodyFit
from .geometry.fitting.body_fit import FitOptions as FitOptions
from .geometry.ik.pose_prior import PosePrior as PosePrior
from .geometry.ik.solver import IkOptions as IkOptions
from .geometry.ik.solver import IkResult as IkResult
from .geometry.ik.tree import Goal as Goal
from .geometry.ik.tree import KinematicTree as KinematicTree
from .geometry.ik.tree import chain_of_balls as chain_of_balls
from .geometry.ik.tree import tree_of_skeleton as tree_of_skeleton
from .geometry.landmarks.arrays import Points3D as Points3D
from .geometry.landmarks.sets import BODY23 as BODY23
from .geometry.landmarks.sets import LandmarkSet as LandmarkSet
from .geometry.skeleton.body import Body as Body
from .geometry.skeleton.motion import Motion as Motion
from .geometry.skeleton.skeleton import Skeleton as Skeleton
from .geometry.smoothing.kalman import SmoothOptions as SmoothOptions
from .geometry.triangulation.left_right import FlipOptions as FlipOptions
from .geometry.triangulation.multiview import TriangulateOptions as TriangulateOptions
from .geometry.triangulation.shape_prior import PosePriorOptions as PosePriorOptions
from .geometry.triangulation.view_bias import ViewBiasOptions as ViewBiasOptions
from .infer.detection.detect import DetectOptions as DetectOptions
from .infer.detection.person_detector import PeopleOptions as PeopleOptions
from .infer.detection.pose_estimator import KeypointOptions as KeypointOptions
from .infer.detection.refine import RefinementOptions as RefinementOptions
from .infer.detection.tracker import TrackOptions as TrackOptions
from .infer.networks.keypoints import OnnxOptions as OnnxOptions
from .infer.pipelines.videos import RunOptions as RunOptions
from .infer.reconstruction.landmarks import SolveOptions as SolveOptions
from .infer.reconstruction.quality import Quality as Quality
from .infer.results.overlay import OverlayOptions as OverlayOptions
from .infer.session.session import SessionOptions as SessionOptions

__version__: str

__all__ = [
    "BODY23",
    "Body",
    "BodyFit",
    "CalibrationError",
    "Camera",
    "CameraGroup",
    "CaptureCancelled",
    "CapturedPerson",
    "DetectOptions",
    "FitOptions",
    "FlipOptions",
    "FormatError",
    "Goal",
    "IkOptions",
    "IkResult",
    "ImageLandmarks",
    "KeypointNetwork",
    "KeypointOptions",
    "KinematicTree",
    "LandmarkSet",
    "LiveCapture",
    "LivePerson",
    "MissingExtraError",
    "ModelError",
    "Motion",
    "MuybridgeError",
    "OnnxOptions",
    "OutputError",
    "OverlayOptions",
    "PeopleOptions",
    "PersonBoxes",
    "PersonDetector",
    "Points3D",
    "PosePrior",
    "PosePriorOptions",
    "ProgressCallback",
    "Quality",
    "RefinementOptions",
    "Result",
    "RunOptions",
    "SessionError",
    "SessionOptions",
    "Skeleton",
    "SmoothOptions",
    "SolveOptions",
    "TrackOptions",
    "TrackingOptions",
    "TriangulateOptions",
    "VideoError",
    "ViewBiasOptions",
    "__version__",
    "capture",
    "chain_of_balls",
    "fit_body",
    "load_calibration",
    "make_points",
    "read_motion",
    "read_points",
    "save_calibration",
    "smooth",
    "solve_ik",
    "tree_of_skeleton",
    "triangulate",
    "write_motion",
    "write_points",
]
