from .options import TrackingOptions as TrackingOptions
from .select import Person as Person
from .select import PersonSelection as PersonSelection
from .select import find_people as find_people
from .select import select_person as select_person
from .select import take_person as take_person
from .select import take_slots as take_slots
from .tracker import PeopleTracker as PeopleTracker
from .tracker import identify_people as identify_people
from .tracker import track_people as track_people
from .tracks import BodyTrack as BodyTrack

__all__ = [
    "BodyTrack",
    "PeopleTracker",
    "Person",
    "PersonSelection",
    "TrackingOptions",
    "find_people",
    "identify_people",
    "select_person",
    "take_person",
    "take_slots",
    "track_people",
]
