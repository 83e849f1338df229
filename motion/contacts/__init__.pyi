from .detect import ContactOptions as ContactOptions
from .detect import detect_contacts as detect_contacts
from .detect import foot_joints as foot_joints
from .detect import point_contacts as point_contacts
from .footskate import Footskate as Footskate
from .footskate import contact_spans as contact_spans
from .footskate import measure_footskate as measure_footskate
from .footskate import sliding_frames as sliding_frames

__all__ = [
    "ContactOptions",
    "Footskate",
    "contact_spans",
    "detect_contacts",
    "foot_joints",
    "measure_footskate",
    "point_contacts",
    "sliding_frames",
]
