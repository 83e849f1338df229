from .fingers import place_fingers as place_fingers
from .people import place_people as place_people
from .quadruped import place_quadruped as place_quadruped
from .stylised import is_person as is_person
from .stylised import place_stylised as place_stylised

__all__ = [
    "is_person",
    "place_fingers",
    "place_people",
    "place_quadruped",
    "place_stylised",
]
