from .export import publish_people as publish_people
from .options import PeopleTraining as PeopleTraining

__all__ = [
    "PeopleTraining",
    "publish_people",
]
