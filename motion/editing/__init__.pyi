from .arguments import Parameter as Parameter
from .arguments import Step as Step
from .channels import check_editable as check_editable
from .cutting import join as join
from .cutting import trim as trim
from .filtering import smooth as smooth
from .looping import LoopCut as LoopCut
from .looping import close_loop as close_loop
from .looping import find_loop as find_loop
from .looping import loop as loop
from .mirroring import mirror as mirror
from .naming import rename_joints as rename_joints
from .pairing import Sides as Sides
from .pairing import find_sides as find_sides
from .pairing import pair_names as pair_names
from .placing import lowest_height as lowest_height
from .placing import move as move
from .placing import put_on_floor as put_on_floor
from .placing import scale as scale
from .placing import turn as turn
from .reducing import Reduced as Reduced
from .reducing import reduce_keys as reduce_keys
from .resampling import motion_at as motion_at
from .resampling import resample as resample
from .root_path import GroundPath as GroundPath
from .root_path import extract_root_motion as extract_root_motion
from .root_path import ground_path as ground_path
from .root_path import in_place as in_place
from .root_path import with_path as with_path
from .root_path import without_path as without_path
from .steps import STEPS as STEPS
from .steps import Call as Call
from .steps import edit_take as edit_take
from .steps import parse_steps as parse_steps

__all__ = [
    "Call",
    "GroundPath",
    "LoopCut",
    "Parameter",
    "Reduced",
    "STEPS",
    "Sides",
    "Step",
    "motion_at",
    "check_editable",
    "close_loop",
    "edit_take",
    "extract_root_motion",
    "find_loop",
    "find_sides",
    "ground_path",
    "in_place",
    "join",
    "loop",
    "lowest_height",
    "mirror",
    "move",
    "pair_names",
    "parse_steps",
    "put_on_floor",
    "reduce_keys",
    "rename_joints",
    "resample",
    "scale",
    "smooth",
    "trim",
    "turn",
    "with_path",
    "without_path",
]
