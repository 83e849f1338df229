"""Scenes of people who use things, by name."""

from collections.abc import Callable

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using import riding, sitting

USES: dict[str, Callable[[BodyModel, np.random.Generator], Scene]] = {
    "chair": sitting.seated("chair", "office chair"),
    "stool": sitting.seated("stool", "stool", "ball"),
    "bench": sitting.seated("bench", "sofa"),
    "floor cushion": sitting.floor_seat,
    "wheelchair": sitting.wheelchair_user,
    "table": sitting.table_user(False),
    "desk": sitting.table_user(True),
    "two at a table": sitting.two_at_table,
    "bicycle": riding.cyclist,
    "bicycle on rollers": riding.cyclist_on_rollers,
    "motorbike": riding.motorcyclist,
    "horse": riding.horse_rider,
}
