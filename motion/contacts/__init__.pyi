from .events import contact_events as contact_events
from .events import contact_facts as contact_facts
from .feet import FEET as FEET
from .feet import PARTS as PARTS
from .feet import FootPoints as FootPoints
from .feet import feet_of_motion as feet_of_motion
from .feet import feet_of_points as feet_of_points
from .find import ContactOptions as ContactOptions
from .find import Contacts as Contacts
from .find import find_contacts as find_contacts
from .floor import Floor as Floor
from .footskate import Footskate as Footskate
from .footskate import contact_spans as contact_spans
from .footskate import measure_footskate as measure_footskate
from .footskate import sliding_frames as sliding_frames
from .keeping import keep_feet as keep_feet
from .planting import Planted as Planted
from .planting import PlantOptions as PlantOptions
from .planting import plant_feet as plant_feet
from .plates import PlateLoad as PlateLoad
from .plates import plate_loads as plate_loads

__all__ = [
    "FEET",
    "PARTS",
    "ContactOptions",
    "Contacts",
    "Floor",
    "FootPoints",
    "Footskate",
    "PlantOptions",
    "Planted",
    "PlateLoad",
    "contact_events",
    "contact_facts",
    "contact_spans",
    "feet_of_motion",
    "feet_of_points",
    "find_contacts",
    "measure_footskate",
    "keep_feet",
    "plant_feet",
    "plate_loads",
    "sliding_frames",
]
