from .decode import DetectedPeople as DetectedPeople
from .decode import box_overlap as box_overlap
from .decode import decode_people as decode_people
from .decode import suppress_overlaps as suppress_overlaps
from .metadata import PeopleModelCard as PeopleModelCard
from .metadata import people_card as people_card
from .network import PeopleNet as PeopleNet

__all__ = [
    "DetectedPeople",
    "PeopleModelCard",
    "PeopleNet",
    "box_overlap",
    "decode_people",
    "people_card",
    "suppress_overlaps",
]
